# SPDX-License-Identifier: Apache-2.0
"""What the URDF says that a joint can do: where it ends, and how fast it is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from cable_ros.scene import Scene, SceneError
from cable_ros.scene.urdf import joint_elements, number_of

WARN, REFUSE, IGNORE = "warn", "refuse", "ignore"
MODES = (WARN, REFUSE, IGNORE)
"""A joint value outside is solved and reported, or reported and not solved, or solved as any other."""

SLACK = 1e-3
"""rad or m; how far beyond its end a sensor may see a joint that rests there."""
JITTER = 0.01
"""s; how much earlier or later than its stamp a position may have been measured."""


@dataclass(frozen=True)
class JointLimit:
    """Of one joint; what the URDF does not give is infinite."""

    name: str
    unit: str
    """rad or m."""
    lower: float = -math.inf
    upper: float = math.inf
    velocity: float = math.inf
    """rad/s or m/s."""

    def beyond(self, value: float) -> str:
        """A sentence if the value is outside, else an empty text."""
        if self.lower - SLACK <= value <= self.upper + SLACK:
            return ""
        slip = "; it looks like degrees" if self.unit == "rad" and abs(value) > 2 * math.pi else ""
        return (
            f"Joint '{self.name}' is {value:.6g} {self.unit}, outside its limits of {self.lower:.6g} to "
            f"{self.upper:.6g} {self.unit} in the URDF{slip}."
        )

    def too_fast(self, distance: float, seconds: float) -> str:
        """A sentence if the joint cannot have come so far in this time, else an empty text."""
        if abs(distance) <= self.velocity * (seconds + JITTER) + SLACK:
            return ""
        return (
            f"Joint '{self.name}' went {abs(distance):.4g} {self.unit} in {seconds:.4g} s; "
            f"its velocity limit in the URDF is {self.velocity:.4g} {self.unit}/s."
        )


class JointLimits:
    """The limits of some joints of a scene's robot, in their order. Continuous joints have no ends.

    Raises:
        SceneError: a limit is not a number, or the lower one is above the upper one.
    """

    def __init__(self, scene: Scene, names: Sequence[str]) -> None:
        self.joints = _read(scene, names)
        self._ranges = [(one.lower - SLACK, one.upper + SLACK) for one in self.joints]

    def beyond(self, values: Sequence[float]) -> str:
        """Sentences about those of the values, one for each joint, that are outside; mostly none."""
        for (lower, upper), value in zip(self._ranges, values, strict=True):
            if not lower <= value <= upper:
                pairs = zip(self.joints, values, strict=True)
                return " ".join(filter(None, (one.beyond(each) for one, each in pairs)))
        return ""


def _read(scene: Scene, names: Sequence[str]) -> list[JointLimit]:
    if scene.robot is None or not names:
        return []
    source = scene.robot.source
    elements = joint_elements(scene.robot.urdf, source)
    out = []
    for name in names:
        kind, place = elements[name].get("type", ""), f"joint '{name}'"
        unit = "m" if kind == "prismatic" else "rad"
        limit = elements[name].find("limit")
        given = {} if limit is None else dict(limit.attrib)
        velocity = number_of(given, "velocity", math.inf, source, place)
        lower, upper = -math.inf, math.inf
        # An element with neither is there for effort and velocity, which some exporters write alone.
        if kind != "continuous" and {"lower", "upper"} & set(given):
            lower = number_of(given, "lower", 0.0, source, place)
            upper = number_of(given, "upper", 0.0, source, place)
        if lower > upper:
            raise SceneError(source, place, f"its lower limit {lower:g} is above its upper one, {upper:g}")
        out.append(JointLimit(name, unit, lower, upper, velocity if velocity > 0 else math.inf))
    return out
