# SPDX-License-Identifier: Apache-2.0
"""A robot of one joint, and a flexible cable that lies among what it moves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

RADIUS = 0.005
ALONG_X = [0.0, 0.5**0.5, 0.0, 0.5**0.5]


def moved(name: str, kind: str, axis: Sequence[float], origin: Sequence[float] = (0.0, 0.0, 0.0)) -> str:
    """URDF of one joint `name` between the world and the link `body`."""
    xyz, place = (" ".join(str(float(x)) for x in v) for v in (axis, origin))
    return (
        f'<robot name="{name}"><link name="world"/><link name="body"/><joint name="{name}" type="{kind}">'
        f'<parent link="world"/><child link="body"/><origin xyz="{place}" rpy="0 0 0"/><axis xyz="{xyz}"/>'
        '<limit lower="-10" upper="10" effort="1" velocity="1"/></joint></robot>'
    )


def lying(start: dict[str, Any], end: dict[str, Any]) -> dict[str, Any]:
    """A cable of 1 m between clamps along X, whose mappings say where they are."""
    return {
        "name": "cable",
        "length": 1.0,
        "stiffness": [0.01, 0.01, 0.0075],
        "outer_diameter": 2.0 * RADIUS,
        "linear_density": 0.05,
        "start": {**start, "orientation": ALONG_X},
        "end": {**end, "orientation": ALONG_X},
    }
