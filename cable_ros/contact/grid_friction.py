# SPDX-License-Identifier: Apache-2.0
"""Friction that goes over from a grid of contacts to contact points and patches."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cable_ros.contact.active_set_rod import ActiveSetRod
from cable_ros.contact.nodal_rod import NodalRod
from cable_ros.contact.points import ARC_LENGTH, FORCE, FRICTION, OBSTACLE, SLIPS

REACH = 1.5
"""Distance, cells, over which places of the grid tell the friction of a contact point: it has two at least."""


class Friction(NamedTuple):
    """Friction on c places of a grid."""

    cell: float
    """Length of a cell, L."""
    places: np.ndarray
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
        places, _, normals, forces, obstacles, sliding, _ = rod.contacts()
        normal = np.einsum("ca,ca->c", forces, normals)
        return Friction(
            1.0 / rod.cells, places, obstacles, normal, forces - normal[:, None] * normals, sliding
        )

    def give(self, rod: ActiveSetRod) -> None:
        """Give it to the contact points of `rod`: the same part of their normal forces as on the grid there.

        Beside the end of a patch the grid spreads a force that acts at a point. So forces themselves would
        not do: friction would be more than its limit on one side, and less on the other.
        """
        for point in rod.points[: rod.count]:
            away = np.abs(self.places - point[ARC_LENGTH]) / self.cell
            away[self.obstacles != int(point[OBSTACLE])] = np.inf
            near = np.maximum(1.0 - away / max(REACH, float(away.min(initial=np.inf)) + 1.0), 0.0)
            pressed = float(near @ self.normal)
            if pressed > 0.0:
                point[FRICTION : FRICTION + 3] = max(point[FORCE], 0.0) * (near @ self.forces) / pressed
                point[SLIPS] = float(self.sliding[away.argmin()])
