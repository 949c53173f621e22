"""Obstacles that the cable cannot enter; `statics.touching` holds the equations.

Contact has no unknowns while nothing touches or is about to, whatever a scene calls for.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from cable_ros.compilation import njit
from cable_ros.mechanics import quaternion
from cable_ros.mechanics.effects.contact_kernels import BOX, CAPSULE, CYLINDER, PLANE, SPHERE, WIDTH, gap
from cable_ros.mechanics.effects.effect import Environment, Properties
from cable_ros.scene import Cable, Scene
from cable_ros.scene.obstacles import Box, Capsule, Cylinder, Obstacle, Plane, Sphere

NAME = "contact"
ABSENT = "no obstacles"
SIZE = "cable radius / L"


def cause(scene: Scene, cable: Cable) -> str:
    names = [obstacle.name for obstacle in scene.obstacles]
    return f"obstacle{'s' if len(names) > 1 else ''} {', '.join(names)}" if names else ""


def add(properties: Properties, scene: Scene, cable: Cable, environment: Environment) -> Properties:
    return dataclasses.replace(properties, obstacles=encode(scene.obstacles, cable.radius))


def size(scene: Scene, cable: Cable, environment: Environment, force: float) -> float:
    return cable.radius / cable.length


def encode(obstacles: Sequence[Obstacle], radius: float) -> np.ndarray:
    """The obstacles (n, WIDTH) as `contact_kernels.gap` takes them, SI, each in its link's frame."""
    out = np.zeros((len(obstacles), WIDTH))
    for row, obstacle in zip(out, obstacles, strict=True):
        shape = obstacle.shape
        turn = np.eye(3)
        if isinstance(shape, Sphere):
            row[0], row[1:4], row[13] = SPHERE, shape.center, shape.radius
        elif isinstance(shape, Plane):
            row[0], row[1:4] = PLANE, shape.point
            turn = _facing(shape.normal)
        elif isinstance(shape, Capsule | Cylinder):
            axis = shape.end - shape.start
            row[0] = CAPSULE if isinstance(shape, Capsule) else CYLINDER
            row[1:4] = 0.5 * (shape.start + shape.end)
            row[13:15] = shape.radius, 0.5 * np.linalg.norm(axis)
            turn = _facing(axis / np.linalg.norm(axis))
        elif isinstance(shape, Box):
            row[0], row[1:4], row[13:16] = BOX, shape.center, 0.5 * shape.size
            turn = Rotation.from_quat(shape.orientation).as_matrix()
        row[4:13] = turn.ravel()
        row[16] = radius if obstacle.cable_radius_counts else 0.0
    return out


def _facing(z: np.ndarray) -> np.ndarray:
    """Some rotation matrix (3, 3) with the given third column."""
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


@njit(cache=True)
def placed(local: np.ndarray, links: np.ndarray, start: np.ndarray, length: float) -> np.ndarray:
    """Obstacles `local` (n, WIDTH) on links at `links` (n, 7), seen from the start clamp at `start` (7,).

    Poses in the world, x y z, quaternion x y z w; the result is in units of the cable's length.
    """
    out = local.copy()
    a = np.array([start[6], -start[3], -start[4], -start[5]])
    b = np.empty(4)
    v = np.empty(3)
    for i in range(local.shape[0]):
        b[0], b[1], b[2], b[3] = links[i, 6], links[i, 3], links[i, 4], links[i, 5]
        centre = quaternion.rotate(b, local[i, 1:4])
        for k in range(3):
            v[k] = centre[k] + links[i, k] - start[k]
        out[i, 1:4] = quaternion.rotate(a, v) / length
        both = quaternion.multiply(a, b)
        for j in range(3):
            for k in range(3):
                v[k] = local[i, 4 + 3 * k + j]
            v[:] = quaternion.rotate(both, v)
            for k in range(3):
                out[i, 4 + 3 * k + j] = v[k]
        for k in range(13, 17):
            out[i, k] = local[i, k] / length
    return out


@njit(cache=True)
def gaps(obstacles: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Distances (n,) from the point r (3,) to the obstacles (n, WIDTH), negative inside."""
    out = np.empty(obstacles.shape[0])
    n, directions, bends = np.empty(3), np.empty((2, 3)), np.empty(2)
    for i in range(obstacles.shape[0]):
        out[i] = gap(obstacles[i], r, n, directions, bends)
    return out


@njit(cache=True)
def nearest(obstacles: np.ndarray, r: np.ndarray) -> tuple[float, int]:
    """The smallest of `gaps` and which obstacle's it is."""
    distances = gaps(obstacles, r)
    which = int(np.argmin(distances))
    return float(distances[which]), which
