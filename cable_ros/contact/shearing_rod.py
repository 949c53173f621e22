# SPDX-License-Identifier: Apache-2.0
"""One cable that shears and may touch obstacles."""

from __future__ import annotations

import numpy as np

from cable_ros.contact.stretching_rod import StrainingTouchingRod, StretchingTouchingRod
from cable_ros.contact.touching_rod import TouchingRod
from cable_ros.rod import warm_step
from cable_ros.rod.elements import Mesh
from cable_ros.rod.resultants import centreline
from cable_ros.solve.trust_region import Options


class ShearingTouchingRod(StrainingTouchingRod):
    """A `StretchingRod` that stops where it would touch; a `NodalRod` carries it on from there.

    A point force P gives the centreline of a section that shears a kink P / GA, away from the obstacle: it
    touches a smooth obstacle at no single point, nor lifts off with a force at the end of a patch. It lies on
    patches alone, at whose ends the pressure is largest and falls off inwards over the length (EI / GA)^1/2.

    Args:
        mesh, stiffness, natural, tolerance, density: as in `TouchingRod`.
        compliance: (3,) 1 / GAx, 1 / GAy, 1 / EA in units of the cable.
    """

    replaceable = True
    """Always: it has no contact of its own."""

    def _like(
        self, mesh: Mesh, stiffness: np.ndarray, natural: np.ndarray, tolerance: float, scale: float
    ) -> ShearingTouchingRod:
        new = ShearingTouchingRod(mesh, stiffness, natural, self.compliance * scale, tolerance, self.density)
        new.pull = self.pull / scale
        return new

    def trace(self, q: np.ndarray, F: np.ndarray | None = None) -> None:
        if F is not None:
            self.pull = F
        N, tables = self.tables.values, self.tables
        centreline(
            q, self.pull, self.f, self.compliance, self.h, self.s0, N, tables.points, tables.primitives,
            self.c,
        )  # fmt: skip

    def step_in_contact(
        self, q: np.ndarray, F: np.ndarray, qe: np.ndarray, re: np.ndarray, f: np.ndarray,
        tolerance: float, limit: float, obstacles: np.ndarray, remesh: bool = True,
    ) -> tuple[int, int, np.ndarray, np.ndarray]:  # fmt: skip
        """There is none: the step that would touch fails."""
        return warm_step.NOT_CONTRACTING, 0, q, F

    def _instead(
        self, q: np.ndarray, F: np.ndarray, qe: np.ndarray, re: np.ndarray, f: np.ndarray, limit: float,
        obstacles: np.ndarray, failed: tuple[int, int, np.ndarray, np.ndarray],
    ) -> tuple[int, int, np.ndarray, np.ndarray]:  # fmt: skip
        return failed

    def minimum(
        self, q: np.ndarray, F: np.ndarray, options: Options
    ) -> tuple[np.ndarray, np.ndarray, int] | None:
        """The equilibrium beside (q, F) by Newton's method, if it touches nothing; else None."""
        if not self.refactor(q, F):
            return None
        code, count, q_new, F_new = self.advance(
            q, F, self.qe, self.re, self.f, options.step_tolerance, obstacles=self.obstacles
        )
        return (q_new, F_new, count) if code == warm_step.ADVANCED and self.refactor(q_new, F_new) else None

    def fall(
        self, q: np.ndarray, F: np.ndarray, options: Options
    ) -> tuple[np.ndarray, np.ndarray, int] | None:
        """None: where a branch ends a `NodalRod` takes over, which knows what the cable falls on."""
        return None


def among_obstacles(
    mesh: Mesh, stiffness: np.ndarray, natural: np.ndarray | None, compliance: np.ndarray | None,
    tolerance: float = 1e-4, density: int = 1,
) -> TouchingRod:  # fmt: skip
    """A rod of the kind that this compliance (3,) asks for; None: inextensible and unshearable."""
    if compliance is None or not compliance.any():
        return TouchingRod(mesh, stiffness, natural, tolerance, density)
    kind = ShearingTouchingRod if compliance[:2].any() else StretchingTouchingRod
    return kind(mesh, stiffness, natural, compliance, tolerance, density)


def without_shear(compliance: np.ndarray | None) -> np.ndarray | None:
    """The compliance (3,) against tension alone; None if there is none."""
    if compliance is None or not compliance[2]:
        return None
    return np.array([0.0, 0.0, compliance[2]])
