# SPDX-License-Identifier: Apache-2.0
"""Whether a branch ends where a contact lets go, or where a point comes off its face over an edge."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cable_ros.contact.edges import across_edges
from cable_ros.contact.friction_kernels import FRICTIONLESS
from cable_ros.contact.points import ARC_LENGTH, FORCE, KIND, OBSTACLE, POINT
from cable_ros.contact.remeshing_rod import RemeshingRod
from cable_ros.rod.centreline import position

GOES = 3e-3
"""Maximum force of a contact that is about to end, as a fraction of the largest one, of the end's too."""


def lets_go(rod: RemeshingRod, q: np.ndarray, F: np.ndarray, near: float) -> bool:
    """Whether at the equilibrium (q, F) all that holds the cable is a point that hardly presses any more,
    or the face under a point whose edge, at most `near` away, would not.

    If so, the branch ends at a fold, at which the stability margin jumps. Leaves (q, F) factored.
    """
    forces = rod.points[: rod.count, FORCE]
    if rod.count == 0 or rod.model != FRICTIONLESS:
        return False
    held, kept = True, rod.state()
    for obstacles in _edges_crossed(rod, q, near):
        there, rod.obstacles = rod.obstacles, obstacles
        held = held and rod.refactor(q, F)
        rod.restore(kept)
        rod.obstacles = there
    least = int(np.argmin(forces))
    most = max(float(forces.max()), float(np.linalg.norm(F)))
    if rod.points[least, KIND] == POINT and forces[least] <= GOES * most:
        rod.points[least : rod.count - 1] = rod.points[least + 1 : rod.count].copy()
        rod.count -= 1
        held = held and rod.refactor(q, F)
        rod.restore(kept)
    rod.refactor(q, F)
    return not held


def _edges_crossed(rod: RemeshingRod, q: np.ndarray, near: float) -> Iterator[np.ndarray]:
    """The obstacles (o, WIDTH) with one moved, a point just beyond its edge; see `across_edges`."""
    assert rod.obstacles is not None
    rod.trace(q)
    r = np.empty(3)
    for point in rod.points[: rod.count]:
        if point[KIND] == POINT:
            position(rod.c, rod.h, rod.s0, point[ARC_LENGTH], r)
            which = int(point[OBSTACLE])
            for moved in across_edges(rod.obstacles[which], r, near):
                obstacles = rod.obstacles.copy()
                obstacles[which] = moved
                yield obstacles
