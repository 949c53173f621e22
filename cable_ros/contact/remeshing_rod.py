# SPDX-License-Identifier: Apache-2.0
"""A rod with contact points whose mesh changes: with them, for a layer, or back where a step has failed."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from cable_ros.contact.friction_kernels import COULOMB, FRICTIONLESS
from cable_ros.contact.frictional_rod import FrictionalRod
from cable_ros.contact.meshing import CLOSEST, fitted, layered
from cable_ros.contact.patches import resample
from cable_ros.contact.path_error import PathError
from cable_ros.contact.points import (
    ARC_LENGTH,
    BEFORE,
    FIRST,
    FORCE,
    FRICTION,
    INTERFACE,
    KIND,
    OBSTACLE,
    POINT,
    SAMPLE,
)
from cable_ros.rod import warm_step
from cable_ros.rod.elements import Mesh

State = tuple[np.ndarray, int, np.ndarray, np.ndarray]
"""Contact points (k, COLUMNS), their number, lengths and starts (m,) of the elements."""


KEPT, SETTLES, PRESSES = 1e-3, 0.05, 0.005
"""Maximum relative change of friction and contact forces on a new mesh with friction as it was, rotation of
a section, rad, and relative change of contact forces that go on as they did: what friction holds may be far
from where it would be without, and an edge that it rolls over may be near."""
STAYS = 3e-5
"""Maximum motion of a point along the cable then, L: mostly it is less than 1e-5. The sum of friction says
nothing of a cable that slides along two edges, 2e-3 L, nor where a point becomes a patch."""


class RemeshingRod(FrictionalRod):
    """The part of `ActiveSetRod` that changes its mesh, and puts back what a step has changed."""

    found_on: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
    """Frames (k, 4) of the last equilibrium, lengths (j,) and starts (j,) of the elements on which it was
    found, if it lies with friction and its mesh has changed since: what sticks stays where it was there."""

    @property
    def adapts_mesh(self) -> bool:  # type: ignore[override]
        return self.count > 0

    def correct(
        self, q: np.ndarray, F: np.ndarray, tolerance: float, limit: float = 1.0, remesh: bool = True
    ) -> tuple[int, int, np.ndarray, np.ndarray]:
        """See `ActiveSetRod`."""
        raise NotImplementedError

    def _let_go(self, q: np.ndarray, F: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
        """The equilibrium (q, F) on a fresh mesh with the friction that it had: what sticks moves with it.

        A finer mesh shows the shape better everywhere; friction does not act against that change. Only for
        contact points: along a patch friction that is held, not what sticks, would let the cable drift.
        """
        points = self.points[: self.count]
        if self.model != COULOMB or not points[:, FRICTION:BEFORE].any() or (points[:, KIND] != POINT).any():
            return q, F
        assert self.obstacles is not None
        kept, mesh, followed = self.state(), self.mesh, self.followed
        total = points[:, FRICTION:BEFORE].sum(axis=0)
        then = self._state_of(q)
        self.model = FRICTIONLESS
        code, _, q_new, F_new = self.correct(q, F, tolerance, SETTLES, remesh=False)
        self.model, self.ready, self.followed = COULOMB, False, followed
        left = self.points[: self.count]
        near = code == warm_step.ADVANCED and self._settled(then, q_new, KEPT) and _stay(kept[0], left)
        if near and np.abs(left[:, FRICTION:BEFORE].sum(axis=0) - total).max() <= KEPT * np.abs(total).max():
            return q_new, F_new
        self.restore(kept, mesh)
        return q, F

    def fit(self, q: np.ndarray) -> np.ndarray:
        """Change to a mesh fitted to the contact points; returns the shape q (n, 4) on it."""
        points = self.points[: self.count]
        return self._onto(fitted(self.mesh.element, list(self.s0[1:]), points, self.finest()), q)

    def fit_patches(self, q: np.ndarray) -> np.ndarray:
        """`fit` if the cable lies along anything; with contact points alone it keeps its mesh."""
        return self.fit(q) if (self.points[: self.count, KIND] != POINT).any() else q

    def resolve(self, q: np.ndarray, F: np.ndarray) -> np.ndarray:
        """Change to a mesh fine enough for the layers in which the end force F bends the cable; q on it."""
        mesh = layered(self.mesh, self.points[: self.count], float(np.linalg.norm(F)))
        return q if len(mesh.lengths) == len(self.h) else self._onto(mesh, q)

    def refined(self, q: np.ndarray) -> np.ndarray:
        """Change to a mesh with all elements halved; returns the shape q (n, 4) on it."""
        return self._onto(self.mesh.split(np.ones(len(self.h), bool)), q)

    def _onto(self, mesh: Mesh, q: np.ndarray) -> np.ndarray:
        fresh = self.mesh.interpolate(q, mesh.nodes)
        fresh[0], fresh[-1] = q[0], q[-1]
        before = (q, self.h, self.s0) if self.found_on is None else self.found_on
        self._allocate(mesh)
        self.stay(before)
        self.points[: self.count, INTERFACE] = -1.0
        self.take_samples()
        return fresh

    def stay(self, found_on: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
        """Let what sticks along a patch stay where it was on another mesh, see `found_on`.

        On a new mesh the frames between two nodes are others than they were, and the cable is elsewhere, if
        only by 1e-6 of its length. A taut one that sticks there has another end force, by up to 1 %.
        """
        if self.model == COULOMB and self.has_patch:
            self.found_on = found_on

    def state(self) -> State:
        """Contact points, their number, lengths and starts of the elements, for `restore`."""
        return self.points[: self.count].copy(), self.count, self.h.copy(), self.s0.copy()

    def restore(self, state: State, mesh: Mesh | None = None) -> None:
        """Put back a `state`, and the `mesh` if it may have changed."""
        if mesh is not None and self.mesh is not mesh:
            self._allocate(mesh)
            self.found_on = None
        points, self.count, self.h[:], self.s0[:] = state
        self.points[: self.count] = points

    def kept(self) -> Callable[[], None]:
        conditions = self.qe, self.re, self.f, self.obstacles
        return partial(self._put_back, self.state(), self.mesh, conditions, self.followed)

    def _put_back(self, state: State, mesh: Mesh, conditions: tuple[Any, ...], followed: PathError) -> None:
        self.restore(state, mesh)
        self.set_conditions(*conditions)
        self.ready, self.followed = False, followed

    def _state_of(self, q: np.ndarray) -> tuple[Mesh, np.ndarray, np.ndarray, float]:
        """Mesh, frames q (n, 4), contact force (3,) and sum of the sizes of the contact forces."""
        size = float(self.points[: self.count, FORCE].sum())
        return Mesh(self.mesh.element, self.h.copy()), q, self.contact_force(), size

    def _settled(
        self, then: tuple[Mesh, np.ndarray, np.ndarray, float], q: np.ndarray, most: float = PRESSES
    ) -> bool:
        """Whether the cable has settled at q (n, 4) and not gone elsewhere since `then`, see `_state_of`.

        `most`: relative change of the contact forces.
        """
        mesh, before, force, size = then
        same = float(np.abs(self.contact_force() - force).max()) <= most * size
        return same and self._rotated(before, q, mesh) <= SETTLES

    def take_samples(self) -> None:
        """Give the patches the samples of the present mesh; what slips goes on slipping."""
        before = self.points[: self.count].copy()
        self.count = resample(self.points, self.count, self.h, self.s0, self.creeps)
        self._slip_on(before)

    def _crowded(self, before: np.ndarray) -> np.ndarray:
        """(m,) which elements have less than a boundary for each end of a patch of a step that failed.

        Those beside these ends and the contacts before it, if any end goes without: there the shear force can
        have no jump, and contact forces of either sign take its place.

        Args:
            before: (k, COLUMNS) the contact points before it.
        """
        points = self.points[: self.count]
        without = points[(points[:, KIND] >= FIRST) & (points[:, INTERFACE] < 0.0), ARC_LENGTH]
        if not len(without):
            return np.zeros(len(self.h), bool)
        s = np.concatenate([without, before[before[:, KIND] != SAMPLE, ARC_LENGTH]])[:, None]
        ends = np.cumsum(self.mesh.lengths)
        near = (s >= ends - self.mesh.lengths - CLOSEST) & (s <= ends + CLOSEST)
        return np.asarray(near.any(axis=0))


def _stay(before: np.ndarray, after: np.ndarray) -> bool:
    """Whether the contact points `before`, (k, COLUMNS), are those `after`, at their places on the cable."""
    if len(before) != len(after) or (before[:, [OBSTACLE, KIND]] != after[:, [OBSTACLE, KIND]]).any():
        return False
    return bool((np.abs(after[:, ARC_LENGTH] - before[:, ARC_LENGTH]) <= STAYS).all())
