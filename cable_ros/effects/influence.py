# SPDX-License-Identifier: Apache-2.0
"""What temperature and dose share: stiffness factors from a table."""

from __future__ import annotations

import dataclasses

import numpy as np

from cable_ros.effects.effect import Environment, Properties
from cable_ros.scene import Influence


def factors(influence: Influence, environment: Environment) -> np.ndarray:
    """(3,) factors of EIx, EIy, GJ now."""
    return influence.factors(environment.get(influence.name, influence.value))


def describe(influence: Influence | None) -> str:
    """What in the scene calls for it; empty for nothing."""
    if influence is None:
        return ""
    source = f", from topic {influence.topic}" if influence.topic else ""
    return f"{influence.name} of {influence.value:g} {influence.unit}{source}, with a table"


def scaled(properties: Properties, influence: Influence | None, environment: Environment) -> Properties:
    """The properties with their stiffness times the factors."""
    if influence is None:
        return properties
    return dataclasses.replace(properties, stiffness=properties.stiffness * factors(influence, environment))


def departure(influence: Influence | None, environment: Environment) -> float:
    """Largest distance of a factor from 1."""
    return 0.0 if influence is None else float(np.abs(factors(influence, environment) - 1.0).max())
