# SPDX-License-Identifier: Apache-2.0
"""One cable that lengthens under its tension and may touch obstacles."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from cable_ros.contact.active_set_rod import ActiveSetRod
from cable_ros.contact.constrained_rod import ROWS
from cable_ros.contact.friction_kernels import COULOMB, FRICTIONLESS
from cable_ros.contact.gap_search import passed
from cable_ros.contact.penalty_continuation import descend, descend_instead
from cable_ros.contact.report import positions
from cable_ros.contact.stretched import displaced, traced
from cable_ros.contact.touching_rod import TouchingRod
from cable_ros.rod import entry_points, quaternion, warm_step
from cable_ros.rod.centreline import curve
from cable_ros.rod.elements import Mesh
from cable_ros.rod.extensible import StretchingRod
from cable_ros.rod.rod_state import ENERGY
from cable_ros.solve.trust_region import Options

REACHES = "row_reach", "skew_reach"
"""Large arrays, of which few rows are used."""
SHORTER = (0.95, 0.9, 0.8)
"""Maximum distances of the clamps, L, at which a cold start seeks the inextensible equilibrium, in turn."""
SHORTEST = 1e-3
"""Minimum step of a continuation, fraction of the path."""


class StrainingTouchingRod(TouchingRod, StretchingRod):  # type: ignore[misc]
    """A `TouchingRod` whose centreline depends on its end force, too; arguments as in `TouchingRod`."""

    def __init__(
        self, mesh: Mesh, stiffness: np.ndarray, natural: np.ndarray | None, compliance: np.ndarray,
        tolerance: float = 1e-4, density: int = 1,
    ) -> None:  # fmt: skip
        self.pull = np.zeros(3)  # the end force of the last traced shape
        super().__init__(mesh, stiffness, natural, tolerance, density, compliance=compliance)
        self.bedding = 1e30  # slip creeps along a cable that stretches, over less than stick would yield

    def _passage(
        self, q: np.ndarray, F: np.ndarray, q_new: np.ndarray, F_new: np.ndarray, before: np.ndarray,
        obstacles: np.ndarray,
    ) -> tuple[float, bool]:  # fmt: skip
        self.trace(q, F)
        was = self.c.copy()
        self.trace(q_new, F_new)
        curves, phi = (self.c, self.h, self.s0), self.phi[: len(obstacles)]
        return passed(was, curves, self.samples, before, obstacles, phi)


class StretchingTouchingRod(StrainingTouchingRod):
    """A `TouchingRod` with compliance against tension.

    None against shear: a section that shears has a kink under a point force, so it touches a smooth obstacle
    at no single point. Friction lets the tension jump. Where a contact that sticks rolls along the cable, the
    cable creeps over the obstacle as a belt does over a pulley: the material that comes into contact sticks,
    and has another strain once the contact has passed. There is no penalty method: a descent goes through the
    inextensible rod.

    Args:
        mesh, stiffness, natural, tolerance, density: as in `TouchingRod`.
        compliance: (3,) in units of the cable, 0, 0, 1 / EA.
    """

    def __init__(
        self, mesh: Mesh, stiffness: np.ndarray, natural: np.ndarray | None, compliance: np.ndarray,
        tolerance: float = 1e-4, density: int = 1,
    ) -> None:  # fmt: skip
        assert not compliance[:2].any()
        super().__init__(mesh, stiffness, natural, compliance, tolerance, density)

    def stay(self, found_on: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
        """Its material's places depend on the forces too, which are known on its own mesh."""

    def _allocate(self, mesh: Mesh) -> None:
        super()._allocate(mesh)
        self.c = np.zeros((*self.c.shape[:2], 4))
        self.internal = np.zeros((len(self.h), len(self.tables.points), 3))
        self.row_reach, self.skew_reach = np.zeros((ROWS, ROWS)), np.zeros((ROWS, ROWS))

    def __getstate__(self) -> dict[str, Any]:
        used = slice(self.rows), slice(self.rows)
        return super().__getstate__() | {name: getattr(self, name)[used].copy() for name in REACHES}

    def __setstate__(self, state: dict[str, Any]) -> None:
        super().__setstate__(state)
        for name in REACHES:
            used, whole = state[name], np.zeros((ROWS, ROWS))
            whole[: len(used), : len(used)] = used
            setattr(self, name, whole)

    @property
    def strain(self) -> tuple[np.ndarray, ...]:
        return self.compliance, self.internal, self.row_reach, self.skew_reach, self.end_compliance

    @property
    def replaceable(self) -> bool:  # type: ignore[override]
        """Without friction's history a descent does better than a grid."""
        return self.model == COULOMB

    def _like(
        self, mesh: Mesh, stiffness: np.ndarray, natural: np.ndarray, tolerance: float, scale: float
    ) -> StretchingTouchingRod:
        new = StretchingTouchingRod(
            mesh, stiffness, natural, self.compliance * scale, tolerance, self.density
        )
        new.pull = self.pull / scale
        return new

    def trace(self, q: np.ndarray, F: np.ndarray | None = None) -> None:
        if F is not None:
            self.pull = F
        forces = self.pull, self.f
        traced(self.shape(q), forces, self.contacts, self.count, self.obstacles, self.strain)

    def sunk(self, q: np.ndarray, F: np.ndarray, obstacles: np.ndarray) -> bool:
        # what reads centreline and normals later needs this force, and the obstacles where they are then
        before, self.obstacles = self.obstacles, obstacles
        self.trace(q, F)
        out = super().sunk(q, F, obstacles)
        self.obstacles = before
        return out

    def _centreline(self, q: np.ndarray) -> Callable[[], np.ndarray]:
        self.trace(q)
        return partial(np.asarray, self.c.copy())

    def centreline(self, q: np.ndarray, F: np.ndarray) -> np.ndarray:
        self.trace(q, F)
        out: np.ndarray = self.c[..., :3].copy()
        return out

    def _bare(self, q: np.ndarray) -> np.ndarray:
        c = np.empty((*self.c.shape[:2], 3))
        curve(q, self.h, self.tables.values, self.tables.primitives, c)
        return c

    def linearize(self, x: np.ndarray, y: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        if not self.count:
            return super().linearize(x, y)
        self.trace(x, y)
        self.rows = self.assemble(x, y, FRICTIONLESS)
        self.judged = self.ready = False
        g = self.g.ravel().copy()
        g[:3] = g[-3:] = 0.0
        return float(self.totals[ENERGY]), self.totals[:ENERGY] - self.re, g

    def _without_strain(self, q: np.ndarray, F: np.ndarray, boundaries: np.ndarray) -> np.ndarray:
        grid = self.h, self.s0, tuple(self.fine)
        internal, moved = np.empty((len(self.h), len(self.fine.points), 3)), np.empty_like(boundaries)
        displaced(
            (q, self.c, grid), (F, self.f), self.contacts, self.count,
            (self.compliance, internal, *self.strain[2:]), moved,
        )  # fmt: skip
        entry_points.strain_gradient(q, internal, self.f, grid, self.stretching, self.acc)
        boundaries -= moved
        return self.re - moved[-1]

    def _instead(
        self, q: np.ndarray, F: np.ndarray, qe: np.ndarray, re: np.ndarray, f: np.ndarray, limit: float,
        obstacles: np.ndarray, failed: tuple[int, int, np.ndarray, np.ndarray],
    ) -> tuple[int, int, np.ndarray, np.ndarray]:  # fmt: skip
        return descend_instead(self, q, F, qe, re, f, limit, obstacles, failed, _descended)

    def stretch_anywhere(
        self, q: np.ndarray, F: np.ndarray, at: np.ndarray, start: np.ndarray, length: float,
        points: np.ndarray,
    ) -> None:  # fmt: skip
        turn = quaternion.matrix_from_ros(start[3:])
        points[:] = start[:3] + length * positions(self.c, self.h, self.s0, at) @ turn.T

    # minima

    def minimum(
        self, q: np.ndarray, F: np.ndarray, options: Options
    ) -> tuple[np.ndarray, np.ndarray, int] | None:
        """As `Rod.minimum`: near (q, F) by Newton's method, otherwise from the inextensible rod."""
        self.ready = False
        if F.any():
            known = self._near(q, F, options.step_tolerance)
            if known is not None:
                return known
        forgot = self.forgot or (self.model == COULOMB and self.count > 0)
        found = self.from_inextensible(q, F, options)
        self.forgot = forgot
        return found

    def fall(
        self, q: np.ndarray, F: np.ndarray, options: Options
    ) -> tuple[np.ndarray, np.ndarray, int] | None:
        return self.minimum(q, F, options)  # there is no penalty method

    def _near(
        self, q: np.ndarray, F: np.ndarray, tolerance: float
    ) -> tuple[np.ndarray, np.ndarray, int] | None:
        """The equilibrium beside (q, F) by Newton's method, from the present contacts; or None."""
        if self.count:
            found = self._from_contacts(q, F, tolerance)
            if found is None and self._join_short():
                found = self._from_contacts(q, F, tolerance)
            return found
        if not self.refactor(q, F):
            return None
        code, count, q_new, F_new = self.advance(
            q, F, self.qe, self.re, self.f, tolerance, obstacles=self.obstacles
        )
        return (q_new, F_new, count) if code == warm_step.ADVANCED and self.refactor(q_new, F_new) else None

    def from_inextensible(
        self, q: np.ndarray, F: np.ndarray, options: Options, first: int | None = None
    ) -> tuple[np.ndarray, np.ndarray, int] | None:
        """From the equilibrium of the inextensible rod, with the clamps nearer each other if it is taut.

        `first` as in `descend`; None: from any shape. There is no friction then.
        """
        model = self.model
        try:
            return self._from_inextensible(q, F, options, first)
        finally:
            self.use_friction(model)

    def _from_inextensible(
        self, q: np.ndarray, F: np.ndarray, options: Options, first: int | None
    ) -> tuple[np.ndarray, np.ndarray, int] | None:
        chord = float(np.linalg.norm(self.re))
        nearer = [1.0] if chord < SHORTER[0] else []
        for share in nearer + [most / chord for most in SHORTER if most < chord]:
            stiff = TouchingRod(self.mesh, self.K, self.natural, self.tolerance, self.density)
            stiff.set_conditions(self.qe, share * self.re, self.f, self.obstacles)
            stiff.work, stiff.seen = self.work, self.seen
            found = (
                stiff.minimum(q, np.zeros(3), options)
                if first is None
                else descend(stiff, q, F, options, first)
            )
            self.work = stiff.work
            if found is not None:
                return self._soften(stiff, found, options.step_tolerance)
        return None

    def _soften(  # type: ignore[override]
        self, stiff: TouchingRod, found: tuple[np.ndarray, np.ndarray, int], tolerance: float
    ) -> tuple[np.ndarray, np.ndarray, int] | None:
        """From an equilibrium of the inextensible rod to our own: first it softens, then its end moves."""
        q, F, iterations = found
        end, compliance = self.re, self.compliance
        self.take_contacts(stiff)
        for soft in (True, False):
            at, step = 0.0, 1.0
            if not soft and np.array_equal(stiff.re, end):
                break
            while at < 1.0:
                to = min(1.0, at + step)
                self.compliance = to * compliance if soft else compliance
                self.set_conditions(self.qe, stiff.re if soft else (1.0 - at) * stiff.re + at * end, self.f)
                there = stiff.re if soft else (1.0 - to) * stiff.re + to * end
                if self.refactor(q, F):
                    code, count, q_new, F_new = self.advance(
                        q, F, self.qe, there, self.f, tolerance, obstacles=self.obstacles
                    )
                    iterations += count
                    if code == warm_step.ADVANCED:
                        at, q, F, step = to, q_new, F_new, 2.0 * step
                        continue
                step *= 0.5
                if step < SHORTEST or self.work <= 0.0:
                    self.compliance = compliance
                    self.set_conditions(self.qe, end, self.f)
                    return None
        self.compliance = compliance
        self.set_conditions(self.qe, end, self.f)
        return (q, F, iterations) if self.refactor(q, F) else None


def _descended(
    rod: ActiveSetRod, q: np.ndarray, F: np.ndarray, options: Options, first: int
) -> tuple[np.ndarray, np.ndarray, int] | None:
    """`descend` of the inextensible rod, and from there to the rod; contacts are put back if it fails."""
    assert isinstance(rod, StretchingTouchingRod)
    kept, mesh = rod.state(), rod.mesh
    found = rod.from_inextensible(q, F, options, first)
    if found is None:
        rod.restore(kept, mesh)
    return found
