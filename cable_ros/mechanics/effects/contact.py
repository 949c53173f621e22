"""Obstacles that the cable cannot enter; `statics.contact_kernels` holds the equations.

Contact has no unknowns while nothing touches or is about to, whatever a scene calls for.
"""

from __future__ import annotations

import dataclasses

from cable_ros.mechanics.effects.effect import Environment, Properties
from cable_ros.scene import Cable, Scene

NAME = "contact"
ABSENT = "no obstacles"
SIZE = "cable radius / L"


def cause(scene: Scene, cable: Cable) -> str:
    names = [obstacle.name for obstacle in scene.obstacles]
    return f"obstacle{'s' if len(names) > 1 else ''} {', '.join(names)}" if names else ""


def add(properties: Properties, scene: Scene, cable: Cable, environment: Environment) -> Properties:
    return dataclasses.replace(properties, contact=True)


def size(scene: Scene, cable: Cable, environment: Environment, force: float) -> float:
    return cable.radius / cable.length
