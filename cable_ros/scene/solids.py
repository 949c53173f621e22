# SPDX-License-Identifier: Apache-2.0
"""Distances from bounded obstacle shapes, for what is computed once a scene; contact has compiled ones."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from cable_ros.scene.obstacles import Box, Capsule, Cylinder, Sphere

Solid = Sphere | Capsule | Cylinder | Box
"""The bounded shapes."""


def distances(shape: Solid, points: np.ndarray) -> np.ndarray:
    """Signed distances (n,) of points (n, 3) from the surface, m, negative inside."""
    if isinstance(shape, Sphere):
        return np.linalg.norm(points - shape.center, axis=1) - shape.radius
    if isinstance(shape, Box):
        own = (points - shape.center) @ Rotation.from_quat(shape.orientation.copy()).as_matrix()
        return _outside(np.abs(own) - 0.5 * shape.size)
    length = float(np.linalg.norm(shape.end - shape.start))
    axis = (shape.end - shape.start) / length
    along = (points - shape.start) @ axis
    if isinstance(shape, Capsule):
        feet = shape.start + np.outer(np.clip(along, 0.0, length), axis)
        return np.linalg.norm(points - feet, axis=1) - shape.radius
    across = np.linalg.norm(points - shape.start - np.outer(along, axis), axis=1)
    return _outside(np.column_stack([across - shape.radius, np.abs(along - 0.5 * length) - 0.5 * length]))


def _outside(beyond: np.ndarray) -> np.ndarray:
    """Distances (n,) from a product of balls; `beyond` (n, k): how far outside of each."""
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)


def placed(shape: Solid, position: np.ndarray, turn: np.ndarray) -> Solid:
    """The shape turned about the origin by a rotation matrix (3, 3), then moved by `position` (3,), m."""
    if isinstance(shape, Sphere):
        return Sphere(position + turn @ shape.center, shape.radius)
    if isinstance(shape, Box):
        quaternion = Rotation.from_matrix(turn) * Rotation.from_quat(shape.orientation.copy())
        return Box(position + turn @ shape.center, shape.size, quaternion.as_quat())
    kind = Capsule if isinstance(shape, Capsule) else Cylinder
    return kind(position + turn @ shape.start, position + turn @ shape.end, shape.radius)


def facing(z: np.ndarray) -> np.ndarray:
    """Some rotation matrix (3, 3) with the given third column."""
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])
