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

BEYOND = 1.1
"""Friction given to what slides, over that of the grid: no less than the cone as normal forces change."""


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
            away = self._away(point)
            if not np.isfinite(away).any():
                continue
            near = np.maximum(1.0 - away / max(REACH, float(away.min()) + 1.0), 0.0)
            pressed = float(near @ self.normal)
            if pressed > 0.0:
                point[FRICTION : FRICTION + 3] = max(point[FORCE], 0.0) * (near @ self.forces) / pressed
                point[SLIPS] = float(self.sliding[away.argmin()])
        for obstacle in np.unique(self.obstacles):
            self._conserve(rod.points[: rod.count], obstacle)

    def slides_on(self, rod: ActiveSetRod) -> bool:
        """Whether the contact points of `rod` slip where the grid slides; nothing has moved since."""
        for point in rod.points[: rod.count]:
            away = self._away(point)
            slides = self.sliding[away.argmin()] and np.isfinite(away).any()
            if point[FORCE] > 0.0 and slides and point[SLIPS] == 0.0:
                return False
        return True

    def _away(self, point: np.ndarray) -> np.ndarray:
        """(c,) distances from a contact point (COLUMNS,), cells; infinite on other obstacles."""
        away = np.abs(self.arc_lengths - point[ARC_LENGTH]) / self.cell
        away[self.obstacles != int(point[OBSTACLE])] = np.inf
        return away

    def _conserve(self, points: np.ndarray, obstacle: int) -> None:
        """Change the friction of the `points` (k, COLUMNS) on an obstacle, so that the total is the grid's.

        That of what sticks. What slides keeps sliding: its friction is beyond the cone, to which it returns.
        """
        mine, theirs = points[:, OBSTACLE] == obstacle, self.obstacles == obstacle
        friction, pressed = points[:, FRICTION : FRICTION + 3], np.maximum(points[:, FORCE], 0.0) * mine
        total = float(pressed.sum())
        if total == 0.0:
            return
        slides = points[:, SLIPS] == 1.0
        scale = min(1.0, float(self.normal[theirs].sum()) / total)
        missing = self.forces[theirs].sum(axis=0) - scale * friction[mine].sum(axis=0)
        sticks = mine & ~slides
        held = float(pressed[sticks].sum())
        if held > 0.0:
            friction[sticks] = scale * friction[sticks] + pressed[sticks, None] / held * missing
        friction[mine & slides] *= BEYOND
