# SPDX-License-Identifier: Apache-2.0
"""Names of the frames that messages have as their frame_id."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass

from cable_ros.scene.model import Robot


@dataclass(frozen=True)
class Frames:
    """Two robots of one kind have the same frames; a prefix tells them apart, as robot_state_publisher's."""

    prefix: str
    world_name: str
    """Of what has no link, without the prefix."""

    @property
    def world(self) -> str:
        """The frame of what has no link."""
        return self.of(self.world_name)

    def of(self, name: str) -> str:
        """The frame of a link or of a clamp."""
        return f"{self.prefix}{name}"


def root_frame(robot: Robot | None) -> str:
    """The frame that the scene's positions without a link are in: the robot's root link, or "world"."""
    if robot is None:
        return "world"
    root = ET.fromstring(robot.urdf.strip())
    children = {child.get("link") for child in root.iterfind("joint/child")}
    return next(
        (n for n in (link.get("name", "") for link in root.iterfind("link")) if n not in children), "world"
    )
