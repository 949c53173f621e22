# SPDX-License-Identifier: Apache-2.0
"""Hard cases of ends that are not clamps, for the zoo."""

from __future__ import annotations

from typing import Any

import numpy as np
import zoo_checks as checks
from references import planar
from zoo_make import cable, led, turned

from cable_ros.bench.cases import TRUSTED, Case

CRITICAL = 7.837
"""w L^3 / EI at which a clamped column buckles under its own weight (Greenhill 1881)."""


def column(weight: float) -> dict[str, Any]:
    """A cable that stands upright on its end's clamp; its start is free."""
    below = turned([0.0, 0.0, 0.0], [0.0, 0.0, -np.pi / 2])  # the tangent points down, as the weight does
    out = cable(below, gravity_number=weight)
    (one,) = out["cables"]
    one["start"] = {"kind": "free"}
    return out


def with_end(mapping: dict[str, Any], which: str, fields: dict[str, Any]) -> dict[str, Any]:
    """The scene with other fields at an end."""
    (one,) = mapping["cables"]
    one[which] = one[which] | fields
    one.pop("total_twist", None)
    return mapping


def ends() -> list[Case]:
    # never quite upright: the tension of a straight cable between clamps, the judge's, has no value;
    # near its critical height a column answers to any tilt: small steps there
    fine, coarse = np.radians(20.0) * np.linspace(-1.0, 1.0, 40) ** 3, np.radians(np.arange(-19.0, 20.0, 2.0))
    gently, over = (np.concatenate([tilt, tilt[::-1]]) for tilt in (fine, coarse))
    there = np.radians(np.arange(-60.0, 100.0, 4.0))
    swing = np.concatenate([there, there[::-1]])
    arch = with_end(planar.buckled(1.0, 1.0, 0.9).scene(), "start", {"kind": "pinned"})
    return [
        led(
            "free end: a column just below its critical height is tilted through upright",
            "verified all along, no snap",
            column(0.97 * CRITICAL),
            [{"yaw": angle} for angle in gently],
            statuses=TRUSTED,
            check=checks.snaps(at_least=0, at_most=0),
        ),
        led(
            "free end: a column above its critical height falls over to the other side",
            "a snap each way, energy falls",
            column(1.15 * CRITICAL),
            [{"yaw": angle} for angle in over],
            statuses=TRUSTED,
            check=checks.snaps(at_least=2, at_most=2),
        ),
        led(
            "pinned end: an arch snaps through as its other end turns, and back",
            "two snaps, hysteresis",
            arch,
            [{"yaw": angle} for angle in swing],
            statuses=TRUSTED,
            check=checks.snaps(at_least=2),
        ),
    ]


ENDS = tuple(ends())
