"""A rod among obstacles that give way: what a descent from any shape is made with."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cable_ros.mechanics.effects.contact_kernels import curve
from cable_ros.statics.touch_kernels import CAPACITY, FLAT, FORCE, OBSTACLE, PLACE, TIE, scan
from cable_ros.statics.touch_system import FRICTIONLESS

if TYPE_CHECKING:
    from cable_ros.statics.touching import TouchingRod

LONGEST_POINT = 3
"""So many samples inside an obstacle side by side become one sliding point, more a stretch."""


class Softened:
    """Implements `solve.trust_region.Problem`: the samples that are inside an obstacle are pushed out by springs.

    Args:
        rod: the rod, whose contact points it uses up.
        stiffness: of the springs, EI / L^3.
    """

    def __init__(self, rod: TouchingRod, stiffness: float) -> None:
        self.rod, self.stiffness = rod, stiffness
        self.retract, self.derivative, self.norm = rod.retract, rod.derivative, rod.norm
        self.normal_step = rod.normal_step

    def _penalty(self, x: np.ndarray) -> float:
        rod = self.rod
        assert rod.obstacles is not None
        curve(x, rod.h, rod.tables[0], rod.primitives, rod.c)
        scan(rod.c, rod.h, rod.s0, rod.samples, rod.obstacles, rod.phi)
        return 0.5 * self.stiffness * float((np.minimum(rod.phi[:, 1:-1], 0.0) ** 2).sum())

    def value(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        energy, c = self.rod.value(x)
        return energy + self._penalty(x), c

    def linearize(self, x: np.ndarray, y: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        rod = self.rod
        penalty = self._penalty(x)
        self._press()
        rod.rows = rod.system(x, y, FRICTIONLESS)
        rod.delta[3 : 3 + rod.count] = 1.0 / self.stiffness
        g = rod.g.ravel().copy()
        g[:3] = g[-3:] = 0.0
        rod._normal = None
        return float(rod.totals[3]) + penalty, rod.totals[:3] - rod.re, g

    def _press(self) -> None:
        """One contact point for every sample inside, the deepest where there are too many."""
        rod = self.rod
        inner = rod.phi[:, 1:-1]
        inside = np.argwhere(inner < 0.0)
        if len(inside) > CAPACITY:
            depth = inner[inside[:, 0], inside[:, 1]]
            inside = inside[np.sort(np.argsort(depth)[:CAPACITY])]
        rod.count = len(inside)
        points = rod.points[: rod.count]
        points[:] = 0.0
        points[:, OBSTACLE], points[:, PLACE] = inside[:, 0], rod.samples[1 + inside[:, 1]]
        points[:, FLAT], points[:, TIE] = 1.0, -1.0
        points[:, FORCE] = -self.stiffness * inner[inside[:, 0], inside[:, 1]]

    def factor(self, mu: float) -> bool:
        return self.rod.border_factor(mu, 3)

    def step(self, gradient: np.ndarray, constraints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        s, y = self.rod.border_step(gradient, np.concatenate([constraints, np.zeros(self.rod.rows - 3)]))
        return s, y[:3]

    def apply_hessian(self, s: np.ndarray) -> np.ndarray:
        rod = self.rod
        V = rod.V[3 : rod.rows]
        return rod.apply_hessian(s) + (V @ s / rod.delta[3 : rod.rows]) @ V

    def harden(self, x: np.ndarray) -> None:
        """Leave the rod with the contact points that the springs at x stand for."""
        rod = self.rod
        self._penalty(x)
        self._press()
        pressed = rod.points[: rod.count].copy()
        new: list[np.ndarray] = []
        for o in np.unique(pressed[:, OBSTACLE]):
            rows = pressed[pressed[:, OBSTACLE] == o]
            cuts = np.flatnonzero(np.diff(rows[:, PLACE]) > 1.5 * rod.spacing) + 1
            for stretch in np.split(rows, cuts):
                if len(stretch) <= LONGEST_POINT:
                    deepest = stretch[np.argmax(stretch[:, FORCE])].copy()
                    deepest[FLAT], deepest[FORCE] = 0.0, stretch[:, FORCE].sum()
                    new.append(deepest)
                else:
                    new.extend(stretch)
        rod.count = len(new)
        if new:
            rod.points[: rod.count] = new
