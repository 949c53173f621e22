# SPDX-License-Identifier: Apache-2.0
"""Penalty method: a rod among obstacles that are springs, for a descent from any shape."""

from __future__ import annotations

import numpy as np

from cable_ros.contact.active_set_rod import ActiveSetRod
from cable_ros.contact.contact_entry_points import lowest
from cable_ros.contact.friction_kernels import FRICTIONLESS
from cable_ros.contact.gap_search import press
from cable_ros.contact.patches import grounded
from cable_ros.contact.points import (
    ARC_LENGTH,
    COLUMNS,
    FIRST,
    FORCE,
    INTERFACE,
    KIND,
    LAST,
    LENGTH,
    NUMBER,
    OBSTACLE,
    SAMPLE,
)
from cable_ros.rod.rod_state import ENERGY

LONGEST_POINT = 3
"""Maximum number of neighbouring samples inside an obstacle that become a point; more become a patch."""


class SpringRows:
    """What every `solve.trust_region.Problem` has whose springs act in the contact rows of its rod."""

    def __init__(self, rod: ActiveSetRod) -> None:
        self.rod = rod
        self.retract, self.derivative, self.norm = rod.retract, rod.derivative, rod.norm
        self.normal_step = rod.normal_step

    def factor(self, mu: float) -> bool:
        return self.rod.kkt_factor(mu, 3)

    def step(self, gradient: np.ndarray, constraints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        s, y = self.rod.kkt_step(gradient, np.concatenate([constraints, np.zeros(self.rod.rows - 3)]))
        return s, y[:3]

    def apply_hessian(self, s: np.ndarray) -> np.ndarray:
        rod = self.rod
        V = rod.V[3 : rod.rows]
        return rod.apply_hessian(s) + (V @ s / rod.delta[3 : rod.rows]) @ V


class PenaltyProblem(SpringRows):
    """A `solve.trust_region.Problem`: what is inside an obstacle is pushed out by springs, one a cell.

    Args:
        rod: the rod, whose contact points it overwrites.
        stiffness: of the springs per length, EI / L^4.
        foundation: see `press`.
    """

    def __init__(self, rod: ActiveSetRod, stiffness: float, foundation: bool) -> None:
        super().__init__(rod)
        self.stiffness, self.foundation = stiffness, foundation
        self.phi = np.empty((0 if rod.obstacles is None else len(rod.obstacles), len(rod.samples)))

    def _press(self, x: np.ndarray) -> float:
        """Set the rod's contact points to what is inside at x; returns the springs' energy."""
        rod = self.rod
        rod.trace(x)
        rod.count = press(
            rod.shape(x), rod.samples, rod.obstacles, rod.points, self.phi, self.stiffness, self.foundation
        )
        springs = rod.points[: rod.count]
        return 0.5 * float((springs[:, FORCE] ** 2 / springs[:, LENGTH]).sum()) / self.stiffness

    def value(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        energy, c = self.rod.value(x)
        return energy + self._press(x), c

    def linearize(self, x: np.ndarray, y: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        rod = self.rod
        penalty = self._press(x)
        rod.rows = rod.assemble(x, y, FRICTIONLESS)
        rod.delta[3 : 3 + rod.count] = 1.0 / (self.stiffness * rod.points[: rod.count, LENGTH])
        g = rod.g.ravel().copy()
        g[:3] = g[-3:] = 0.0
        rod._normal = None
        return float(rod.totals[ENERGY]) + penalty, rod.totals[:ENERGY] - rod.re, g

    def to_contacts(self, x: np.ndarray) -> float:
        """Replace the springs at x by contacts with the same forces; returns the energy that they had."""
        rod = self.rod
        energy = self._press(x)
        points = rod.points[: rod.count]
        give_contacts(
            rod,
            x,
            points[:, OBSTACLE].copy(),
            rod.samples[points[:, NUMBER].astype(int)],
            points[:, FORCE].copy(),
        )
        return energy


def give_contacts(
    rod: ActiveSetRod, q: np.ndarray, obstacles: np.ndarray, arc_lengths: np.ndarray, forces: np.ndarray,
    spacing: float | None = None,
) -> None:  # fmt: skip
    """Give the rod of shape q (n, 4) contact points and patches for forces at neighbouring samples.

    Args:
        obstacles, arc_lengths, forces: (k,) which obstacle each is of, its arc length, its size.
        spacing: of the arc_lengths; None: the rod's samples. `rod.c` is the curve of q.
    """
    spacing = rod.spacing if spacing is None else spacing
    new: list[np.ndarray] = []
    for o in np.unique(obstacles):
        which = np.flatnonzero(obstacles == o)
        which = which[np.argsort(arc_lengths[which])]
        for run in np.split(which, np.flatnonzero(np.diff(arc_lengths[which]) > 1.5 * spacing) + 1):
            new += _contacts(rod, q, int(o), arc_lengths[run], forces[run], spacing)
    rod.count = min(len(new), len(rod.points))
    if new:
        rod.points[: rod.count] = new[: rod.count]


def _contacts(
    rod: ActiveSetRod,
    q: np.ndarray,
    obstacle: int,
    arc_lengths: np.ndarray,
    forces: np.ndarray,
    spacing: float,
) -> list[np.ndarray]:
    """Rows (COLUMNS,) of contact points for forces at `arc_lengths` (k,), rising, `spacing` apart."""
    low, high, total = arc_lengths[0], arc_lengths[-1], forces.sum()
    assert rod.obstacles is not None
    ob = rod.obstacles[obstacle]
    template = np.zeros(COLUMNS)
    template[OBSTACLE], template[INTERFACE] = obstacle, -1.0
    if high - low < (LONGEST_POINT - 0.5) * spacing:
        deepest = arc_lengths[np.argmax(forces)]
        template[ARC_LENGTH] = lowest(rod.shape(q), deepest, 0.5 * spacing, ob)
        template[FORCE] = total
        return [template]
    out = []
    if low > 1.5 * spacing or not grounded(rod.c, rod.h, rod.s0, ob, 0.0):
        out.append((low, FIRST, forces[0]))
    else:
        low = 0.0
    if high < 1.0 - 1.5 * spacing or not grounded(rod.c, rod.h, rod.s0, ob, 1.0):
        out.append((high, LAST, forces[-1]))
    else:
        high = 1.0
    # samples of the elements replace them once there is a mesh
    inner = rod.samples[(rod.samples > low) & (rod.samples < high)]
    out += [(s, SAMPLE, total / len(inner)) for s in inner]
    rows = np.tile(template, (len(out), 1))
    rows[:, [ARC_LENGTH, KIND, FORCE]] = out
    rows[rows[:, KIND] == SAMPLE, LENGTH] = rod.spacing
    return list(rows)
