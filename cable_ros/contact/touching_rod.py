# SPDX-License-Identifier: Apache-2.0
"""One cable that may touch obstacles: a rod with contact points, which come and go."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from cable_ros.contact.active_set_rod import ActiveSetRod
from cable_ros.contact.distance import gap
from cable_ros.contact.friction_kernels import COULOMB
from cable_ros.contact.gap_search import largest_motion, passage
from cable_ros.contact.meshing import CLOSEST
from cable_ros.contact.patch_ends import join
from cable_ros.contact.penalty_continuation import FAR, NEAR, descend, descend_instead, drops
from cable_ros.contact.points import ARC_LENGTH, BEFORE, FORCE, INTERFACE, OBSTACLE
from cable_ros.contact.travel import travel
from cable_ros.contact.viscous_flow import Flow
from cable_ros.rod import warm_step
from cable_ros.rod.centreline import position
from cable_ros.rod.elements import Mesh
from cable_ros.rod.kirchhoff import ALGEBRAIC, Rod
from cable_ros.solve.trust_region import Options

BETWEEN = 2.0
"""Largest motion between nodes over that of the nodes: the Lebesgue constant of order 6 is 1.9."""
NOT_MOVED = 1e-10
"""Length of a step, L, in which what slips along a patch only pauses."""
CLOSELY = 2
"""Number of springs of a fall, over that of another, where another has led nowhere."""
MOST_NEAR = 50
"""Maximum number of iterations with stiff springs: a cable that snaps far needs fewer with soft ones."""


class Room(NamedTuple):
    """The least distance from the nearest obstacle; of these arrays, which nobody changes, and no others."""

    shape: np.ndarray
    """(n, 4) nodal frames."""
    obstacles: np.ndarray
    """(o, WIDTH)."""
    samples: np.ndarray
    """(m,) arc lengths at which it was looked for contact, L."""
    left: float
    """Least gap at the samples, less what is near, L."""


class TouchingRod(ActiveSetRod):
    """A rod among obstacles.

    The contact points belong to its last equilibrium: `advance` and `minimum` change them, together with the
    lengths of the elements, and put them back where they fail.
    """

    room: Room | None = None
    """Of its last equilibrium; None: not known."""

    def variant(
        self, mesh: Mesh | None = None, stiffness: np.ndarray | None = None,
        natural: np.ndarray | None = None, scale: float = 1.0, tolerance: float | None = None,
    ) -> TouchingRod:  # fmt: skip
        new = self._like(
            self.mesh if mesh is None else mesh,
            self.K if stiffness is None else stiffness,
            self.natural if natural is None else natural,
            self.tolerance if tolerance is None else tolerance,
            scale,
        )
        new.set_conditions(self.qe, self.re, self.f / scale, self.obstacles)
        new.model, new.direction, new.forgot = self.model, self.direction, self.forgot
        new.yield_at_end(self.end_compliance * scale)
        new.points, new.count, new.normals = self.points.copy(), self.count, self.normals.copy()
        new.points[:, FORCE : BEFORE + 3] /= scale
        new.followed = self.followed.in_units(scale)
        new.least, new.clamps = max(new.least, self.least / scale), self.clamps
        if mesh is not None:
            new.points[:, INTERFACE] = -1.0
            new.take_samples()
        return new

    def _like(
        self, mesh: Mesh, stiffness: np.ndarray, natural: np.ndarray, tolerance: float, scale: float
    ) -> TouchingRod:
        """A rod of this kind without contacts; `scale` as in `variant`."""
        return TouchingRod(mesh, stiffness, natural, tolerance, self.density)

    def for_tolerance(self, tolerance: float) -> TouchingRod:
        return self if tolerance == self.tolerance else self.variant(tolerance=tolerance)

    def minimum(
        self, q: np.ndarray, F: np.ndarray, options: Options
    ) -> tuple[np.ndarray, np.ndarray, int] | None:
        """Descend with soft obstacles, which any shape can start from, then with hard ones."""
        self.ready = False
        if not self.bare:
            # mostly the same equilibrium on another mesh: its contacts are known
            known = self._from_contacts(q, F, options.step_tolerance)
            if known is None and self._join_short():
                known = self._from_contacts(q, F, options.step_tolerance)
            if known is not None:
                return known
            if self.model == COULOMB and self.frictional and not self.forgot:
                return None  # a descent forgets friction
            near = replace(options, iterations=min(options.iterations, MOST_NEAR))
            kept, mesh = self.state(), self.mesh
            found = descend(self, q, F, near, NEAR)
            if found is not None and drops(self, kept[0], found[1]):
                self.restore(kept, mesh)
                return None
            if found is not None or self.work <= 0.0:
                return found
            return descend(self, q, F, options, FAR, foundation=True)
        return descend(self, q, F, options)

    def fall(
        self, q: np.ndarray, F: np.ndarray, options: Options
    ) -> tuple[np.ndarray, np.ndarray, int] | None:
        # it starts outside of the obstacles, so their edges may be sharp and their foundation stiff
        self.ready = False
        return descend(self, q, F, options, NEAR, foundation=True, round_edges=False)

    def fall_closely(
        self, q: np.ndarray, F: np.ndarray, options: Options
    ) -> tuple[np.ndarray, np.ndarray, int] | None:
        # a cable that slides along an edge bears on one place, which two springs far apart would share
        density = self.density
        self.densify(CLOSELY * density)
        found = self.fall(q, F, options)
        self.densify(density)
        return found

    def fall_with_friction(
        self, q: np.ndarray, F: np.ndarray, qe: np.ndarray, re: np.ndarray, f: np.ndarray,
        obstacles: np.ndarray | None,
    ) -> tuple[np.ndarray, np.ndarray, int] | None:  # fmt: skip
        if self.model != COULOMB or not self.count or self.soft:
            return None
        assert obstacles is not None
        if self.falling is None:
            self.falling = Flow(self, q, F, (qe, re, f, obstacles))
        fall = self.falling
        rests = fall.go(self, self.passed_in_contact)
        if rests is not None or fall.over:
            self.falling = None
        if rests is None:
            return None
        self.follow_fall(fall.pulled, rests[1])
        return *rests, fall.iterations

    def _from_contacts(
        self, q: np.ndarray, F: np.ndarray, tolerance: float
    ) -> tuple[np.ndarray, np.ndarray, int] | None:
        """The equilibrium beside (q, F) by Newton's method from the present contacts, or None."""
        if self.model == COULOMB:
            # where forces of 1e4 EI / L^2 rub, rounding is above 1e-10 of them
            tolerance = max(tolerance, ALGEBRAIC * self.tolerance)
        q_let, F_let = self._let_go(q, F, tolerance)
        code, iterations, q_new, F_new = self.correct(q_let, F_let, tolerance)
        return (q_new, F_new, iterations) if code == warm_step.ADVANCED else None

    def _join_short(self) -> bool:
        """Make points of short patches, which Newton's method finds again; whether there were any."""
        before, self.count = self.count, join(self.points, self.count, CLOSEST)
        return self.count != before

    def advance(
        self, q: np.ndarray, F: np.ndarray, qe: np.ndarray, re: np.ndarray, f: np.ndarray,
        tolerance: float, limit: float = 0.6, obstacles: np.ndarray | None = None,
    ) -> tuple[int, int, np.ndarray, np.ndarray]:  # fmt: skip
        assert obstacles is not None
        assert self.obstacles is not None
        if self.bare:
            before = self.qe, self.re, self.f
            self.ready, self.stride = False, 2.0  # that of a step in contact was another's
            code, iterations, q_new, F_new = super().advance(q, F, qe, re, f, tolerance, limit)
            if code != warm_step.ADVANCED:
                return code, iterations, q_new, F_new
            if self._stays_far(q, q_new, obstacles):
                self.obstacles = obstacles
                return code, iterations, q_new, F_new
            clearance, crossed = self._passage(q, F, q_new, F_new, self.obstacles, obstacles)
            near = clearance <= 0.5 * self.spacing
            self.room = Room(q_new, obstacles, self.samples, clearance - 0.5 * self.spacing)
            if not near or (clearance > -self.depth and not self._dips(q_new, obstacles)):
                if crossed:
                    self.set_conditions(*before)
                    return warm_step.TOO_FAR, iterations, q_new, F_new
                self.obstacles = obstacles
                return code, iterations, q_new, F_new
            self.set_conditions(*before)
        known, mesh, direction = self.state(), self.mesh, self.direction
        there = self.qe, self.re, self.f, self.obstacles
        held = self.touched()
        result = self.step_in_contact(q, F, qe, re, f, tolerance, limit, obstacles)
        if result[0] != warm_step.ADVANCED:
            result = self._instead(q, F, qe, re, f, limit, obstacles, result)
        if result[0] != warm_step.ADVANCED:
            return result
        if not self.passed_in_contact(q, F, *result[2:], mesh, there[3], held):
            if self.lies and travel(there[0], there[1], there[3], qe, re, obstacles) < NOT_MOVED:
                self._slip_on(known[0])  # it has only paused
            return result
        self.restore(known, mesh)
        self.set_conditions(*there)
        self.direction, self.ready = direction, False
        return warm_step.TOO_FAR, *result[1:]

    def _stays_far(self, q: np.ndarray, q_new: np.ndarray, obstacles: np.ndarray) -> bool:
        """Whether a bare step from q to q_new, (n, 4), to other `obstacles` cannot lead near any or past one.

        What was left to the nearest one when that was computed last is used up by motions.
        """
        known, self.room = self.room, None
        if known is None or known.left <= 0.0 or self.soft:
            return False
        # a rod that was put back, or that other cables touch, may be another one, or among others
        if not (known.shape is q and known.obstacles is self.obstacles and known.samples is self.samples):
            return False
        motion, width, beyond = largest_motion(q, q_new, known.obstacles, obstacles)
        left = min(known.left - BETWEEN * motion, beyond - 0.5 * self.spacing)
        self.room = Room(q_new, obstacles, self.samples, left)
        return BETWEEN * motion <= width and left > 0.0

    def _instead(
        self, q: np.ndarray, F: np.ndarray, qe: np.ndarray, re: np.ndarray, f: np.ndarray, limit: float,
        obstacles: np.ndarray, failed: tuple[int, int, np.ndarray, np.ndarray],
    ) -> tuple[int, int, np.ndarray, np.ndarray]:  # fmt: skip
        """What takes the place of a step that failed."""
        return descend_instead(self, q, F, qe, re, f, limit, obstacles, failed)

    def passed_in_contact(
        self, q: np.ndarray, F: np.ndarray, q_new: np.ndarray, F_new: np.ndarray, mesh: Mesh,
        before: np.ndarray, held: tuple[np.ndarray, np.ndarray],
    ) -> bool:  # fmt: skip
        """Whether a step in contact may have led through an obstacle.

        One that it does not touch now and might have passed, or touches from another side than where it was.

        Args:
            q, F, q_new, F_new: nodal frames (n, 4) and end force (3,) before and after.
            mesh, before: the mesh before, and the obstacles (o, WIDTH).
            held: `touched` before.
        """
        assert self.obstacles is not None
        if len(q) == len(q_new):
            motion, width, _ = largest_motion(q, q_new, before, self.obstacles)
            if motion <= width:
                return False
        shape, points = mesh.interpolate(q, self.mesh.nodes), self.points[: self.count]
        which = points[:, OBSTACLE].astype(int)
        self.trace(shape, F)
        r, n, directions, bends = np.empty(3), np.empty(3), np.empty((2, 3)), np.empty(2)
        sides = np.full(len(before), -1.0)
        for o, s, normal in zip(which, points[:, ARC_LENGTH], self.normals, strict=False):
            position(self.c, self.h, self.s0, s, r)
            gap(before[o], r, n, directions, bends)
            # where it touched already, or where the material was that touches now
            sides[o] = max(sides[o], float(n @ normal), *(held[1][held[0] == o] @ normal))
        if (sides[which] < 0.0).any():
            return True
        free = np.setdiff1d(np.arange(len(before)), which)
        return self._passage(shape, F, q_new, F_new, before[free], self.obstacles[free])[1]

    def _passage(
        self, q: np.ndarray, F: np.ndarray, q_new: np.ndarray, F_new: np.ndarray, before: np.ndarray,
        obstacles: np.ndarray,
    ) -> tuple[float, bool]:  # fmt: skip
        """`gap_search.passage` of a step from (q, F) to (q_new, F_new).

        `before`, `obstacles`: (o, WIDTH), which the step leads past.
        """
        phi = self.phi[: len(obstacles)]
        return passage(q, self.shape(q_new), self.samples, before, obstacles, phi)

    def take_contacts(self, other: TouchingRod, scale: float = 1.0) -> None:
        """Take over mesh, contact points and friction of another rod; `scale` as in `variant`."""
        self._allocate(Mesh(other.mesh.element, other.h.copy()))
        self.points[:], self.normals[:], self.count = other.points, other.normals, other.count
        self.points[:, FORCE : BEFORE + 3] /= scale
        self.followed = other.followed.in_units(scale)
        self.points[:, INTERFACE] = -1.0
        self.model, self.direction, self.forgot = other.model, other.direction, other.forgot
        self.take_samples()

    def snapshot(self) -> Callable[[], Rod]:
        return partial(_restored, self, self.mesh, self.points[: self.count].copy(), self.obstacles)


def _restored(rod: TouchingRod, mesh: Mesh, points: np.ndarray, obstacles: np.ndarray | None) -> TouchingRod:
    """A rod like `rod`, among these obstacles and with these contact points (k, COLUMNS)."""
    new = rod.variant(mesh)
    new.count = len(points)
    new.points[: new.count] = points
    new.set_conditions(rod.qe, rod.re, rod.f, obstacles)
    return new
