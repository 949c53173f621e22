# SPDX-License-Identifier: Apache-2.0
"""A rod among obstacles that give way: what a descent from any shape is made with."""

from __future__ import annotations

import numpy as np

from cable_ros.contact.active_set_rod import ActiveSetRod
from cable_ros.contact.detection import press
from cable_ros.contact.friction_kernels import FRICTIONLESS
from cable_ros.contact.interfaces import lowest
from cable_ros.contact.patches import grounded
from cable_ros.contact.points import COLUMNS, FIRST, FORCE, KIND, LAST, LENGTH, OBSTACLE, PLACE, SAMPLE, TIE
from cable_ros.rod.centreline import curve

LONGEST_POINT = 3
"""So many samples inside an obstacle side by side are taken for a point, more for a stretch."""


class Softened:
    """A `solve.trust_region.Problem`: the samples that are inside an obstacle are pushed out by springs.

    Args:
        rod: the rod, whose contact points it uses up.
        stiffness: of the springs per length, EI / L^4.
    """

    def __init__(self, rod: ActiveSetRod, stiffness: float) -> None:
        self.rod, self.stiffness = rod, stiffness
        self.phi = np.empty((0 if rod.obstacles is None else len(rod.obstacles), len(rod.samples)))
        self.retract, self.derivative, self.norm = rod.retract, rod.derivative, rod.norm
        self.normal_step = rod.normal_step

    def _press(self, x: np.ndarray) -> float:
        """Set the rod's contact points to the samples inside at x; returns the springs' energy."""
        rod = self.rod
        curve(x, rod.h, rod.tables[0], rod.primitives, rod.c)
        rod.count = press(rod.c, rod.h, rod.s0, rod.samples, rod.obstacles, rod.points, self.phi,
                          self.stiffness)  # fmt: skip
        springs = rod.points[: rod.count]
        return 0.5 * float((springs[:, FORCE] ** 2 / springs[:, LENGTH]).sum()) / self.stiffness

    def value(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        energy, c = self.rod.value(x)
        return energy + self._press(x), c

    def linearize(self, x: np.ndarray, y: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        rod = self.rod
        penalty = self._press(x)
        rod.rows = rod.system(x, y, FRICTIONLESS)
        rod.delta[3 : 3 + rod.count] = 1.0 / (self.stiffness * rod.points[: rod.count, LENGTH])
        g = rod.g.ravel().copy()
        g[:3] = g[-3:] = 0.0
        rod._normal = None
        return float(rod.totals[3]) + penalty, rod.totals[:3] - rod.re, g

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
        """Make of what is inside at x contact points and stretches, which bear the same forces."""
        rod = self.rod
        self._press(x)
        pressed = rod.points[: rod.count].copy()
        new: list[np.ndarray] = []
        for o in np.unique(pressed[:, OBSTACLE]):
            rows = pressed[pressed[:, OBSTACLE] == o]
            rows = rows[np.argsort(rows[:, PLACE])]
            for run in np.split(rows, np.flatnonzero(np.diff(rows[:, PLACE]) > 1.5 * rod.spacing) + 1):
                new += self._hardened(x, run)
        rod.count = min(len(new), len(rod.points))
        if new:
            rod.points[: rod.count] = new[: rod.count]

    def _hardened(self, x: np.ndarray, run: np.ndarray) -> list[np.ndarray]:
        """Contact points for a `run` (k, COLUMNS) of samples side by side that are inside an obstacle."""
        rod, total = self.rod, run[:, FORCE].sum()
        low, high = run[0, PLACE], run[-1, PLACE]
        assert rod.obstacles is not None
        ob = rod.obstacles[int(run[0, OBSTACLE])]
        template = np.zeros(COLUMNS)
        template[OBSTACLE], template[TIE] = run[0, OBSTACLE], -1.0
        if high - low < (LONGEST_POINT - 0.5) * rod.spacing:
            deepest = run[np.argmax(run[:, FORCE]), PLACE]
            template[PLACE] = lowest(
                x, rod.h, rod.s0, rod.mesh.element.nodes, rod.c, deepest, 0.5 * rod.spacing, ob
            )
            template[FORCE] = total
            return [template]
        out = []
        if low > 1.5 * rod.spacing or not grounded(rod.c, rod.h, rod.s0, ob, 0.0):
            out.append((low, FIRST, run[0, FORCE]))
        else:
            low = 0.0
        if high < 1.0 - 1.5 * rod.spacing or not grounded(rod.c, rod.h, rod.s0, ob, 1.0):
            out.append((high, LAST, run[-1, FORCE]))
        else:
            high = 1.0
        # samples of the elements take their place once there is a mesh
        inner = rod.samples[(rod.samples > low) & (rod.samples < high)]
        out += [(s, SAMPLE, total / len(inner)) for s in inner]
        rows = np.tile(template, (len(out), 1))
        rows[:, [PLACE, KIND, FORCE]] = out
        rows[rows[:, KIND] == SAMPLE, LENGTH] = rod.spacing
        return list(rows)
