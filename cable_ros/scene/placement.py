# SPDX-License-Identifier: Apache-2.0
"""What carries a clamp or an obstacle, and which way it is turned."""

from __future__ import annotations

import math

import numpy as np

from cable_ros.scene.errors import suggestion
from cable_ros.scene.fields import Field, Size, vector
from cable_ros.scene.section import Section

UNIT_TOLERANCE = 1e-3
"""How far a quaternion's norm may be from 1 before it is refused; nearer ones are normalised."""

_DEGREES = "it looks like degrees"
ANGLE = Size("rad", -2 * math.pi, 2 * math.pi, _DEGREES, _DEGREES)

LINK = Field(
    "link", "text", "a link of the robot, or leave it out",
    "Link of the robot that carries it.", "turret", default=None, absent="fixed in the world",
    extent="a link of the URDF",
)  # fmt: skip

ROTATION = (
    Field(
        "orientation", vector(4), "a unit quaternion [x, y, z, w]",
        "Quaternion x y z w that turns the own axes into those of the link or the world.",
        "[0, 0, 0, 1]", unit="1", extent=f"norm 1 within {UNIT_TOLERANCE:g}", absent="required without `rpy`",
    ),
    Field(
        "rpy", vector(3), "[roll, pitch, yaw] in radians",
        "The same as roll, pitch, yaw about the fixed axes x, y, z, as in a URDF.",
        "[1.570796, 0, 0]", default=None, absent="required without `orientation`", size=ANGLE,
    ),
)  # fmt: skip


def read_link(section: Section, links: tuple[str, ...] | None) -> str | None:
    """The field `link`, which must be one of the robot's."""
    if "link" not in section:
        return None
    link = section.text("link")
    if links is None:
        section.fail(
            f"'{link}' needs a robot; add 'robot: {{urdf: FILE}}' to the scene, "
            "or let the node take it from robot_description, "
            "or leave 'link' out for what is fixed in the world",
            "link",
        )
    if link not in links:
        section.fail(
            f"the robot has no link '{link}'{suggestion(link, links)}; its links are {', '.join(links)}",
            "link",
        )
    return link


def unit_quaternion(section: Section, name: str) -> np.ndarray:
    """(4,) a quaternion x y z w, normalised."""
    quaternion = section.vector(name, 4)
    norm = math.hypot(*quaternion)
    if abs(norm - 1) > UNIT_TOLERANCE:
        section.fail(
            f"the quaternion's norm is {norm:.6g}, not 1; give a unit quaternion [x, y, z, w], "
            "such as [0, 0, 0, 1] for no rotation",
            name,
        )
    unit = quaternion / norm
    unit.setflags(write=False)
    return unit


def rotation(section: Section) -> np.ndarray:
    """(4,) quaternion x y z w of the section's `orientation`, or of its `rpy` as URDF has it.

    URDF's roll, pitch and yaw turn about the fixed axes x, y, z, one after the other.
    """
    if "rpy" not in section:
        return unit_quaternion(section, "orientation")
    if "orientation" in section:
        section.fail("both orientation and rpy are given; give one of the two")
    angles = section.vector("rpy", 3)
    (sr, sp, sy), (cr, cp, cy) = np.sin(0.5 * angles), np.cos(0.5 * angles)
    quaternion = np.array(
        [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ]
    )
    quaternion.setflags(write=False)
    return quaternion
