# SPDX-License-Identifier: Apache-2.0
"""Curvature and twist that the cable has without load, off a drum or from long storage."""

from __future__ import annotations

import dataclasses

import numpy as np

from cable_ros.effects.effect import Environment, Properties
from cable_ros.scene import Cable, Scene

NAME = "natural_strain"
ABSENT = "no natural_strain: straight and untwisted without load"
SIZE = "natural curvature and twist x L, rad"


def cause(scene: Scene, cable: Cable) -> str:
    if cable.natural_strain is None or not cable.natural_strain.any():
        return ""
    return f"natural_strain [{', '.join(f'{value:g}' for value in cable.natural_strain)}] 1/m"


def add(properties: Properties, scene: Scene, cable: Cable, environment: Environment) -> Properties:
    return dataclasses.replace(properties, natural=cable.natural_strain)


def size(scene: Scene, cable: Cable, environment: Environment, force: float) -> float:
    return 0.0 if cable.natural_strain is None else float(np.linalg.norm(cable.natural_strain)) * cable.length
