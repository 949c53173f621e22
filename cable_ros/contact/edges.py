# SPDX-License-Identifier: Apache-2.0
"""Edges of obstacles beside a contact point: across one the direction of contact begins to turn."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cable_ros.contact.distance import AXES, BOX, CENTRE, CYLINDER, DIMENSIONS, OFFSET, SHAPE

JUST = 1e-3
"""How far beyond the edge, in radii of the cable: there the normal has turned by as many rad."""


def across_edges(obstacle: np.ndarray, r: np.ndarray, near: float) -> Iterator[np.ndarray]:
    """The obstacle (WIDTH,) moved so that the point r (3,) on a face of it is just beyond an edge of it.

    One for each edge that is at most `near` away, L. None for a cable without a diameter: about an edge the
    direction of contact turns within its radius.
    """
    if obstacle[OFFSET] <= 0.0:
        return
    turn = obstacle[AXES:DIMENSIONS].reshape(3, 3)
    y = turn.T @ (r - obstacle[CENTRE:AXES])
    half = obstacle[DIMENSIONS:OFFSET]
    if obstacle[SHAPE] == BOX:
        inward = np.diag(-np.sign(y))
        beyond = np.abs(y) - half
    elif obstacle[SHAPE] == CYLINDER:
        radius = max(float(np.hypot(y[0], y[1])), 1e-12)
        inward = np.array([[-y[0] / radius, -y[1] / radius, 0.0], [0.0, 0.0, -np.sign(y[2])]])
        beyond = np.array([radius - half[0], abs(y[2]) - half[1]])
    else:
        return
    if np.count_nonzero(beyond > 0.0) != 1:  # already at an edge, or inside
        return
    for direction, distance in zip(inward, -beyond, strict=True):
        if 0.0 <= distance <= near:
            moved = obstacle.copy()
            moved[CENTRE:AXES] += turn @ direction * (distance + JUST * obstacle[OFFSET])
            yield moved
