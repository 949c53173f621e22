# SPDX-License-Identifier: Apache-2.0
"""Sections that tilt against the centreline under transverse force: what matters for a short, thick cable."""

from __future__ import annotations

import dataclasses

import numpy as np

from cable_ros.effects.effect import Environment, Properties
from cable_ros.scene import Cable, Scene

NAME = "shear"
ABSENT = "no shear_stiffness: sections stay across the centreline"
SIZE = "end force / GA"


def cause(scene: Scene, cable: Cable) -> str:
    if cable.shear_stiffness is None:
        return ""
    return f"shear_stiffness [{', '.join(f'{value:g}' for value in cable.shear_stiffness)}] N"


def add(properties: Properties, scene: Scene, cable: Cable, environment: Environment) -> Properties:
    compliance = np.zeros(3) if properties.compliance is None else properties.compliance.copy()
    if cable.shear_stiffness is not None:
        compliance[:2] = 1.0 / cable.shear_stiffness
    return dataclasses.replace(properties, compliance=compliance)


def size(scene: Scene, cable: Cable, environment: Environment, force: float) -> float:
    return 0.0 if cable.shear_stiffness is None else force / float(cable.shear_stiffness.min())
