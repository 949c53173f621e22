# SPDX-License-Identifier: Apache-2.0
"""The radiation dose changes the stiffness, by a table in the scene."""

from __future__ import annotations

from cable_ros.effects.effect import Environment, Properties
from cable_ros.effects.influence import departure, describe, scaled
from cable_ros.scene import Cable, Scene

NAME = "dose"
ABSENT = "no dose"
SIZE = "largest change of a stiffness factor"


def cause(scene: Scene, cable: Cable) -> str:
    return describe(cable.dose)


def add(properties: Properties, scene: Scene, cable: Cable, environment: Environment) -> Properties:
    return scaled(properties, cable.dose, environment)


def size(scene: Scene, cable: Cable, environment: Environment, force: float) -> float:
    return departure(cable.dose, environment)
