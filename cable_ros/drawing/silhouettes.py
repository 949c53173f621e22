# SPDX-License-Identifier: Apache-2.0
"""What an obstacle looks like from far along a world axis: the outline of its projection."""

from __future__ import annotations

import numpy as np

from cable_ros.scene.obstacles import Plane, Shape

_DIRECTIONS = 120  # of an outline's points; a circle of as many corners looks round
_EDGE_ON = 1e-9  # a plane whose normal leans farther out of the drawing fills all of it


def silhouette(shape: Shape, across: int, up: int, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(k, 2) corners of the projection on the world axes `across` and `up`, m.

    A bounded shape is whole; of a plane that is seen edge on, what is solid between `low` and `high` (3,);
    no corner where it is seen from another side.
    """
    if isinstance(shape, Plane):
        return _half_plane(shape, across, up, low, high)
    angles = np.linspace(0.0, 2 * np.pi, _DIRECTIONS, endpoint=False)
    directions = np.zeros((len(angles), 3))
    directions[:, across], directions[:, up] = np.cos(angles), np.sin(angles)
    return shape.farthest(directions)[:, [across, up]]


def _half_plane(plane: Plane, across: int, up: int, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    normal = plane.normal[[across, up]]
    if np.linalg.norm(normal) < 1 - _EDGE_ON:
        return np.empty((0, 2))
    (left, bottom), (right, top) = low[[across, up]], high[[across, up]]
    corners = np.array([[left, bottom], [right, bottom], [right, top], [left, top]])
    heights = (corners - plane.point[[across, up]]) @ normal
    kept = []
    for i in range(4):  # Sutherland and Hodgman's clipping of a polygon by one edge
        j = (i + 1) % 4
        if heights[i] <= 0:
            kept.append(corners[i])
        if heights[i] * heights[j] < 0:
            kept.append(corners[i] + heights[i] / (heights[i] - heights[j]) * (corners[j] - corners[i]))
    return np.array(kept).reshape(-1, 2)
