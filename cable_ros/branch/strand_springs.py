# SPDX-License-Identifier: Apache-2.0
"""Penalty method: a rod whose strands are kept apart by springs while it snaps.

A snap-through descends the energy. On the way strands that meet must not pass through each other: a spring
acts at each pair of closest points that are nearer than a diameter, along their normal, whose sign is kept
from step to step. Units of the cable, start clamp's frame.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cable_ros.contact.active_set_rod import ActiveSetRod
from cable_ros.contact.crossing import candidates
from cable_ros.contact.crossing_kernels import closest_points
from cable_ros.contact.friction_kernels import FRICTIONLESS
from cable_ros.contact.overlaps import OUTLINE, SPACING
from cable_ros.contact.penalty import SpringRows
from cable_ros.contact.points import ARC_LENGTH, FRICTION, INTERFACE, KIND, OBSTACLE, SAMPLE
from cable_ros.contact.report import positions
from cable_ros.contact.response_kernels import displacements
from cable_ros.rod.centreline import direction
from cable_ros.rod.rod_state import ENERGY
from cable_ros.solve.trust_region import Minimum, Options, minimize

STIFFNESS = 1e6
"""Of a spring, EI / L^3: a force of 100 EI / L^2, that of a tight loop, presses it in by 1e-4 L."""
WATCHED = 0.1
"""Distance of strands, L, within which the sign of their normal is kept."""
ROWS, FAINT = 5, 1e-6
"""Rows of a spring in the bordered system, and the least size of what one adds to the Hessian, EI / L^3."""
SAME = 0.1
"""Maximum motion along the cable, L, of a pair of closest points in a step."""
BESIDE = 1e-3
"""Moment, EI / L, left at the end of a descent beside an equilibrium: where strands slide along each other
the energy is that of the centreline, its derivatives those of the frames."""
OPTIONS = Options(radius=0.02, largest_radius=0.1, step_tolerance=1e-5, iterations=150)
"""Steps are short: a strand moves by less than a diameter."""


class Strands(NamedTuple):
    """Two strands where they are closest."""

    arcs: np.ndarray
    """(2,) arc lengths, L."""
    normal: np.ndarray
    """(3,) unit vector from the second to the first, or the other way if they have passed each other."""
    distance: float
    """L; negative if they have."""


class StrandSprings(SpringRows):
    """A `solve.trust_region.Problem`: a rod among no obstacles, whose contact points it overwrites.

    Args:
        rod: the rod; its first obstacle must be out of reach.
        diameter: L.
        known: the strands that were near each other before.
    """

    def __init__(self, rod: ActiveSetRod, diameter: float, known: list[Strands]) -> None:
        super().__init__(rod)
        self.diameter, self.known = diameter, known
        self.at_end, self.slips = False, False

    def strands(self, x: np.ndarray) -> list[Strands]:
        """Where strands are near each other at x (n, 4)."""
        rod = self.rod
        rod.trace(x)
        line = positions(rod.c, rod.h, rod.s0, np.linspace(0.0, 1.0, OUTLINE))
        curve = x, rod.c, rod.h, rod.s0, rod.mesh.element.nodes, 1.0
        out: list[Strands] = []
        for fractions in candidates(line, line, self.diameter + WATCHED, SPACING * self.diameter):
            at, points, tangents = np.array(fractions), np.empty((2, 3)), np.empty((2, 3))
            closest_points(curve, curve, at, points, tangents)
            if not at[1] - at[0] > SPACING * self.diameter:
                continue
            normal = points[0] - points[1]
            distance = float(np.linalg.norm(normal))
            if at[0] <= 0.0 or at[1] >= 1.0:
                # but for clamps that are beside each other
                self.at_end |= distance < self.diameter and (at[0] > 0.0 or at[1] < 1.0)
                continue
            normal /= max(distance, 1e-300)
            before = min(self.known, key=lambda one: np.abs(one.arcs - at).max(), default=None)
            if before is not None and np.abs(before.arcs - at).max() < SAME and normal @ before.normal < 0.0:
                normal, distance = -normal, -distance
            out.append(Strands(at, normal, distance))
        return out

    def pressed(self, x: np.ndarray) -> list[Strands]:
        """The strands at x whose springs are loaded."""
        return [one for one in self.strands(x) if one.distance < self.diameter]

    def force(self, one: Strands) -> float:
        """Of a spring, EI / L^2."""
        return STIFFNESS * (self.diameter - one.distance)

    def _energy(self, pressed: list[Strands]) -> float:
        return sum(0.5 * self.force(one) ** 2 / STIFFNESS for one in pressed)

    def value(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        energy, c = self.rod.value(x)
        return energy + self._energy(self.pressed(x)), c

    def linearize(self, x: np.ndarray, y: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        rod = self.rod
        self.at_end = False
        self.known = self.strands(x)
        self.slips |= self.at_end
        pressed = [one for one in self.known if one.distance < self.diameter]
        k = len(pressed)
        rod.count = 2 * k
        points = rod.points[: rod.count]
        points[:] = 0.0
        points[:, KIND], points[:, INTERFACE], points[:, OBSTACLE] = SAMPLE, -1.0, 0.0
        for j, one in enumerate(pressed):
            load = self.force(one) * one.normal
            points[j, ARC_LENGTH], points[k + j, ARC_LENGTH] = one.arcs
            points[j, FRICTION : FRICTION + 3], points[k + j, FRICTION : FRICTION + 3] = load, -load
        rod.rows = rod.assemble(x, y, FRICTIONLESS)
        n = rod.V.shape[1]
        moved, turned = np.empty((2 * k, 3, n)), np.empty((2 * k, 3, n))
        arcs = points[:, ARC_LENGTH].copy()
        displacements(rod.shape(x), rod.saddle[1][2], arcs, 0.0, np.zeros((0, 0, 3)), moved, turned)
        rod.rows = 3 + ROWS * k
        rod.V[3 : rod.rows], rod.delta[3 : rod.rows] = 0.0, 1.0
        for j, one in enumerate(pressed):
            rod.V[3 + j], rod.delta[3 + j] = one.normal @ (moved[j] - moved[k + j]), 1.0 / STIFFNESS
            values, rows = self._turning(x, one, moved[[j, k + j]], turned[[j, k + j]])
            at = 3 + k + (ROWS - 1) * j + np.flatnonzero(values)
            rod.V[at], rod.delta[at] = rows[values != 0.0], 1.0 / values[values != 0.0]
        g = rod.g.ravel().copy()
        g[:3] = g[-3:] = 0.0
        rod._normal = None
        return float(rod.totals[ENERGY]) + self._energy(pressed), rod.totals[:ENERGY] - rod.re, g

    def _turning(
        self, x: np.ndarray, one: Strands, moved: np.ndarray, turned: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Minus its force times the Hessian of the distance, as a sum of values (4,) times squares of rows.

        The closest points slide along both strands. moved, turned: (2, 3, 3n) derivatives of the points and
        of the tangents there; rows (4, 3n).
        """
        rod, n, d = self.rod, one.normal, one.distance
        t, bend = np.empty((2, 3)), np.empty((2, 3))
        for i in range(2):
            direction(x, rod.h, rod.s0, rod.mesh.element.nodes, one.arcs[i], t[i], bend[i])
        e = np.linalg.svd(n[None])[2][1:]  # across the normal
        sliding = np.array([
            [1.0 / d + n @ bend[0], -(t[0] @ t[1]) / d], [-(t[0] @ t[1]) / d, 1.0 / d - n @ bend[1]],
        ])  # fmt: skip
        by_sliding = np.array([[*(e @ t[0] / d), 1.0, 0.0], [*(-(e @ t[1]) / d), 0.0, -1.0]])
        hessian = np.diag([1.0 / d, 1.0 / d, 0.0, 0.0])
        hessian -= by_sliding.T @ np.linalg.solve(sliding, by_sliding)
        rows = np.vstack([e @ (moved[0] - moved[1]), n @ turned[0], n @ turned[1]])
        values, vectors = np.linalg.eigh(-self.force(one) * hessian)
        values[np.abs(values) < FAINT] = 0.0
        return values, vectors.T @ rows

    def descend(self, q: np.ndarray, F: np.ndarray) -> tuple[Minimum, bool]:
        """From the nodal frames q (n, 4) and the end force F (3,); and whether an equilibrium is beside it.

        Not if a strand has come upon an end, where it may slip off what is not a cable there.
        """
        found = minimize(self, q, F, OPTIONS)
        left = float(np.abs(self.linearize(found.x, found.y)[2]).max())
        self.rod.count, self.rod.ready = 0, False
        return found, not self.slips and (found.converged or left < BESIDE)
