# SPDX-License-Identifier: Apache-2.0
"""Lengthening under tension: what matters for a cable that gets taut."""

from __future__ import annotations

import dataclasses

import numpy as np

from cable_ros.effects.effect import Environment, Properties
from cable_ros.scene import Cable, Scene

NAME = "stretch"
ABSENT = "no axial_stiffness: inextensible"
SIZE = "end force / EA"


def cause(scene: Scene, cable: Cable) -> str:
    return "" if cable.axial_stiffness is None else f"axial_stiffness {cable.axial_stiffness:g} N"


def add(properties: Properties, scene: Scene, cable: Cable, environment: Environment) -> Properties:
    compliance = np.zeros(3) if properties.compliance is None else properties.compliance.copy()
    if cable.axial_stiffness is not None:
        compliance[2] = 1.0 / cable.axial_stiffness
    return dataclasses.replace(properties, compliance=compliance)


def size(scene: Scene, cable: Cable, environment: Environment, force: float) -> float:
    return 0.0 if cable.axial_stiffness is None else force / cable.axial_stiffness
