# SPDX-License-Identifier: Apache-2.0
"""Obstacles that the cable cannot enter; `contact.touching_rod` holds the equations.

Contact has no unknowns while nothing touches or is about to, whatever a scene calls for.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from cable_ros.contact.distance import (
    AXES,
    BOX,
    CAPSULE,
    CENTRE,
    CYLINDER,
    DIMENSIONS,
    OFFSET,
    PLANE,
    SHAPE,
    SPHERE,
    WIDTH,
)
from cable_ros.effects.effect import Environment, Properties
from cable_ros.rod.quaternion import matrix_from_ros
from cable_ros.scene import Cable, Scene
from cable_ros.scene.obstacles import Box, Capsule, Cylinder, Obstacle, Plane, Sphere

NAME = "contact"
ABSENT = "no obstacles"
SIZE = "cable radius / L"
FAR = 1e6
"""Distance, m, of an obstacle that a cable leaves out."""


def cause(scene: Scene, cable: Cable) -> str:
    names = [one.name for one in scene.obstacles if cable.name not in one.left_out_by]
    return f"obstacle{'s' if len(names) > 1 else ''} {', '.join(names)}" if names else ""


def add(properties: Properties, scene: Scene, cable: Cable, environment: Environment) -> Properties:
    return dataclasses.replace(properties, obstacles=encode(scene.obstacles, cable.radius, cable.name))


def size(scene: Scene, cable: Cable, environment: Environment, force: float) -> float:
    return cable.radius / cable.length


def encode(obstacles: Sequence[Obstacle], radius: float, cable: str = "") -> np.ndarray:
    """The obstacles (n, WIDTH) as `distance.gap` takes them, SI, each in its link's frame.

    One that the cable of this name leaves out keeps its row, as a point that is far away.
    """
    out = np.zeros((len(obstacles), WIDTH))
    for row, obstacle in zip(out, obstacles, strict=True):
        shape = obstacle.shape
        turn = np.eye(3)
        if cable in obstacle.left_out_by:
            row[SHAPE], row[AXES:DIMENSIONS], row[OFFSET] = SPHERE, turn.ravel(), -FAR
            continue
        if isinstance(shape, Sphere):
            row[SHAPE], row[CENTRE:AXES], row[DIMENSIONS] = SPHERE, shape.center, shape.radius
        elif isinstance(shape, Plane):
            row[SHAPE], row[CENTRE:AXES] = PLANE, shape.point
            turn = _facing(shape.normal)
        elif isinstance(shape, Capsule | Cylinder):
            axis = shape.end - shape.start
            row[SHAPE] = CAPSULE if isinstance(shape, Capsule) else CYLINDER
            row[CENTRE:AXES] = 0.5 * (shape.start + shape.end)
            row[DIMENSIONS : DIMENSIONS + 2] = shape.radius, 0.5 * np.linalg.norm(axis)
            turn = _facing(axis / np.linalg.norm(axis))
        elif isinstance(shape, Box):
            row[SHAPE], row[CENTRE:AXES], row[DIMENSIONS:OFFSET] = BOX, shape.center, 0.5 * shape.size
            turn = matrix_from_ros(shape.orientation)
        row[AXES:DIMENSIONS] = turn.ravel()
        row[OFFSET] = obstacle.margin + (radius if obstacle.cable_radius_counts else 0.0)
    return out


def _facing(z: np.ndarray) -> np.ndarray:
    """Some rotation matrix (3, 3) with the given third column."""
    x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])
