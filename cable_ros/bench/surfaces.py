# SPDX-License-Identifier: Apache-2.0
"""Distances to obstacles, written from their definitions, to check contact with."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from cable_ros.scene.obstacles import Box, Capsule, Cylinder, Obstacle, Plane, Sphere

Distance = Callable[[np.ndarray], np.ndarray]
"""World points (..., 3) to signed distances (...), m, negative inside."""
Derivatives = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""World points (n, 3) to gradients (n, 3) and Hessians (n, 3, 3), 1/m, of a distance."""


def distance(obstacle: Obstacle, link: np.ndarray, radius: float) -> Distance:
    """How far a cable of `radius` is from an obstacle whose link is at the pose `link` (7,)."""
    frame = Rotation.from_quat(link[3:]).as_matrix()
    offset = _offset(obstacle, radius)

    def signed(points: np.ndarray) -> np.ndarray:
        local = (np.reshape(points, (-1, 3)) - link[:3]) @ frame
        return (_signed(obstacle, local) - offset).reshape(np.shape(points)[:-1])

    return signed


def _offset(obstacle: Obstacle, radius: float) -> float:
    return obstacle.margin + (radius if obstacle.cable_radius_counts else 0.0)


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


def derivatives(obstacle: Obstacle, link: np.ndarray, radius: float) -> Derivatives | None:
    """Those of `distance`, exact beside a face's end as well, where differences would reach across it.

    None for a shape with sharp edges, across which a cable's line without thickness is pushed in no direction
    of its own.
    """
    if isinstance(obstacle.shape, (Box, Cylinder)) and _offset(obstacle, radius) <= 0.0:
        return None
    frame = Rotation.from_quat(link[3:]).as_matrix()

    def both(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        normals, bends = _derivatives(obstacle, (points - link[:3]) @ frame)
        return normals @ frame.T, frame @ bends @ frame.T

    return both


def _derivatives(obstacle: Obstacle, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gradients (n, 3) and Hessians (n, 3, 3) of `_signed` at points (n, 3)."""
    shape = obstacle.shape
    if isinstance(shape, Plane):
        return np.broadcast_to(shape.normal, x.shape), np.zeros((len(x), 3, 3))
    if isinstance(shape, Sphere):
        return _from_core(x - shape.center, np.broadcast_to(np.eye(3), (len(x), 3, 3)))
    if isinstance(shape, Box):
        turn = Rotation.from_quat(shape.orientation).as_matrix()
        y = (x - shape.center) @ turn
        # (n, 3, 3) how far beyond each pair of faces changes, as rows
        rows = np.where(y < 0.0, -1.0, 1.0)[:, :, None] * turn.T
        normals, bends = _corner(np.abs(y) - 0.5 * shape.size)
        return _turned(normals, rows), rows.swapaxes(1, 2) @ bends @ rows
    way = shape.end - shape.start
    size = float(np.linalg.norm(way))
    axis = way / size
    along = (x - shape.start) @ axis
    across = x - shape.start - np.outer(along, axis)
    if isinstance(shape, Capsule):
        inside = (along > 0.0) & (along < size)
        beyond = along - np.clip(along, 0.0, size)
        stays = np.eye(3) - inside[:, None, None] * np.outer(axis, axis)
        return _from_core(across + np.outer(beyond, axis), stays)
    assert isinstance(shape, Cylinder)
    rho = np.linalg.norm(across, axis=1)
    ahead = along - 0.5 * size
    rows = np.stack([across / rho[:, None], np.outer(np.where(ahead < 0.0, -1.0, 1.0), axis)], axis=1)
    normals, bends = _corner(np.column_stack([rho - shape.radius, np.abs(ahead) - 0.5 * size]))
    round_ = np.cross(axis, rows[:, 0])
    hoop = (normals[:, 0] / rho)[:, None, None] * round_[:, :, None] * round_[:, None, :]
    return _turned(normals, rows), rows.swapaxes(1, 2) @ bends @ rows + hoop


def _from_core(away: np.ndarray, changes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of the distance from a core, by the vectors (n, 3) from its nearest points and how these change."""
    size = np.linalg.norm(away, axis=1)
    normals = away / size[:, None]
    return normals, (changes - normals[:, :, None] * normals[:, None, :]) / size[:, None, None]


def _corner(over: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of `_outside_or_in`, by how far a point is beyond each pair of faces (n, k)."""
    axes = np.eye(over.shape[1])
    deepest = axes[over.argmax(axis=1)]
    outside = np.max(over, axis=1, keepdims=True) > 0.0
    away = np.where(outside, np.maximum(over, 0.0), deepest)
    changes = np.where(outside, over > 0.0, deepest)[:, :, None] * axes
    return _from_core(away, changes)


def _turned(normals: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Gradients (n, k) of what changes as the `rows` (n, k, 3), as gradients (n, 3) in space."""
    return (normals[:, None, :] @ rows)[:, 0]
