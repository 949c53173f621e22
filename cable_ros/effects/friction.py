# SPDX-License-Identifier: Apache-2.0
"""Friction of the obstacles that the cable touches, by the scene's friction_model."""

from __future__ import annotations

import dataclasses

import numpy as np

from cable_ros.effects.effect import Environment, Properties
from cable_ros.scene import Cable, Scene

NAME = "friction"
ABSENT = "no obstacle with friction"
SIZE = "largest coefficient"


def cause(scene: Scene, cable: Cable) -> str:
    rough = [f"{obstacle.name} {obstacle.friction:g}" for obstacle in scene.obstacles if obstacle.friction]
    return f"friction of {', '.join(rough)}, friction_model {scene.friction_model}" if rough else ""


def add(properties: Properties, scene: Scene, cable: Cable, environment: Environment) -> Properties:
    coefficients = np.array([obstacle.friction for obstacle in scene.obstacles])
    return dataclasses.replace(properties, friction=coefficients, friction_model=scene.friction_model)


def size(scene: Scene, cable: Cable, environment: Environment, force: float) -> float:
    return max((obstacle.friction for obstacle in scene.obstacles), default=0.0)
