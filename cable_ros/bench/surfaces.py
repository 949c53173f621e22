# SPDX-License-Identifier: Apache-2.0
"""Distances to obstacles, written from their definitions, to check contact with."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from cable_ros.scene.obstacles import Box, Capsule, Cylinder, Obstacle, Plane, Sphere

Distance = Callable[[np.ndarray], np.ndarray]
"""World points (..., 3) to signed distances (...), m, negative inside."""


def distance(obstacle: Obstacle, link: np.ndarray, radius: float) -> Distance:
    """How far a cable of `radius` is from an obstacle whose link is at the pose `link` (7,)."""
    frame = Rotation.from_quat(link[3:]).as_matrix()
    offset = obstacle.margin + (radius if obstacle.cable_radius_counts else 0.0)

    def signed(points: np.ndarray) -> np.ndarray:
        local = (np.reshape(points, (-1, 3)) - link[:3]) @ frame
        return (_signed(obstacle, local) - offset).reshape(np.shape(points)[:-1])

    return signed


def gradient(signed: Distance, points: np.ndarray, step: float) -> np.ndarray:
    """(..., 3) gradients of a distance at points (..., 3), by central differences."""
    ways, points = step * np.eye(3), points[..., None, :]
    return (signed(points + ways) - signed(points - ways)) / (2.0 * step)


def curvature(signed: Distance, points: np.ndarray, step: float) -> np.ndarray:
    """(..., 3, 3) Hessians of a distance at points (..., 3), by central differences."""
    ways, points = step * np.eye(3), points[..., None, :]
    h = (gradient(signed, points + ways, step) - gradient(signed, points - ways, step)) / (2.0 * step)
    return 0.5 * (h + h.swapaxes(-1, -2))


def _signed(obstacle: Obstacle, x: np.ndarray) -> np.ndarray:
    shape = obstacle.shape
    if isinstance(shape, Sphere):
        return np.linalg.norm(x - shape.center, axis=1) - shape.radius
    if isinstance(shape, Plane):
        return (x - shape.point) @ shape.normal
    if isinstance(shape, Box):
        y = np.abs((x - shape.center) @ Rotation.from_quat(shape.orientation).as_matrix())
        return _outside_or_in(y - 0.5 * shape.size)
    way = shape.end - shape.start
    size = float(np.linalg.norm(way))
    along = (x - shape.start) @ way / size
    if isinstance(shape, Capsule):
        nearest = shape.start + np.outer(np.clip(along, 0.0, size), way / size)
        return np.linalg.norm(x - nearest, axis=1) - shape.radius
    assert isinstance(shape, Cylinder)
    across = np.linalg.norm(x - shape.start - np.outer(along, way / size), axis=1)
    return _outside_or_in(np.column_stack([across - shape.radius, np.abs(along - 0.5 * size) - 0.5 * size]))


def _outside_or_in(over: np.ndarray) -> np.ndarray:
    """Distance from how far a point is beyond each pair of faces (n, k)."""
    return np.linalg.norm(np.maximum(over, 0.0), axis=1) + np.minimum(over.max(axis=1), 0.0)
