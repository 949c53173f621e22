# SPDX-License-Identifier: Apache-2.0
"""The cable's own weight, a load per length along gravity."""

from __future__ import annotations

import dataclasses

import numpy as np

from cable_ros.effects.effect import Environment, Properties
from cable_ros.scene import Cable, Scene

NAME = "weight"
ABSENT = "gravity or linear_density is zero"
SIZE = "w L^3 / EI"


def _load(scene: Scene, cable: Cable) -> np.ndarray:
    return cable.linear_density * np.asarray(scene.gravity, float)


def cause(scene: Scene, cable: Cable) -> str:
    load = float(np.linalg.norm(_load(scene, cable)))
    return f"{load:.4g} N/m by gravity and linear_density" if load else ""


def add(properties: Properties, scene: Scene, cable: Cable, environment: Environment) -> Properties:
    return dataclasses.replace(properties, weight=_load(scene, cable))


def size(scene: Scene, cable: Cable, environment: Environment, force: float) -> float:
    bending = float(np.sqrt(cable.stiffness[0] * cable.stiffness[1]))
    return float(np.linalg.norm(_load(scene, cable))) * cable.length**3 / bending
