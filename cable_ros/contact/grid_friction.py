# SPDX-License-Identifier: Apache-2.0
"""Friction of a grid of contacts, interpolated to contact points and patches."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cable_ros.contact.active_set_rod import ActiveSetRod
from cable_ros.contact.nodal_rod import NodalRod
from cable_ros.contact.points import ARC_LENGTH, FORCE, FRICTION, OBSTACLE, SLIPS

REACH = 1.5
"""Half width, cells, of the hat function that averages the grid's friction at a contact point."""


class Friction(NamedTuple):
    """Friction on c points of a grid."""

    cell: float
    """Length of a cell, L."""
    arc_lengths: np.ndarray
    """(c,) arc lengths, L."""
    obstacles: np.ndarray
    """(c,) which obstacle each is of."""
    normal: np.ndarray
    """(c,) normal force, EI / L^2."""
    forces: np.ndarray
    """(c, 3) friction, EI / L^2."""
    sliding: np.ndarray
    """(c,) whether it slides."""

    @staticmethod
    def of(rod: NodalRod) -> Friction:
        arc_lengths, _, normals, forces, obstacles, sliding, _ = rod.contacts()
        normal = np.einsum("ca,ca->c", forces, normals)
        friction = forces - normal[:, None] * normals
        return Friction(1.0 / rod.cells, arc_lengths, obstacles, normal, friction, sliding)

    def give(self, rod: ActiveSetRod) -> None:
        """Give the contact points of `rod` friction in the grid's ratio to their normal forces.

        The grid spreads the force at the end of a patch over cells. So forces alone would not do: friction
        would exceed its limit on one side of the end, and fall short of it on the other.
        """
        for point in rod.points[: rod.count]:
            away = np.abs(self.arc_lengths - point[ARC_LENGTH]) / self.cell
            away[self.obstacles != int(point[OBSTACLE])] = np.inf
            near = np.maximum(1.0 - away / max(REACH, float(away.min(initial=np.inf)) + 1.0), 0.0)
            pressed = float(near @ self.normal)
            if pressed > 0.0:
                point[FRICTION : FRICTION + 3] = max(point[FORCE], 0.0) * (near @ self.forces) / pressed
                point[SLIPS] = float(self.sliding[away.argmin()])
