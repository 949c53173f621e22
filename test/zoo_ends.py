# SPDX-License-Identifier: Apache-2.0
"""Hard cases of ends that are not clamps, for the zoo."""

from __future__ import annotations

from dataclasses import replace
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


def drawn(kind: str, seed: int, **fields: Any) -> Case:
    """A heavy cable whose end clamp is led once round a drawn path; its start is of this kind."""
    rng = np.random.default_rng(seed)
    away = rng.normal(size=3)
    away *= rng.uniform(0.3, 0.8) / np.linalg.norm(away)
    scene = cable(turned(away.tolist(), rng.normal(size=3).tolist()), gravity_number=10.0)
    (one,) = scene["cables"]
    one["start"] = {"kind": kind, **({} if kind == "free" else one["start"]), **fields}
    begin, turns = rng.uniform(0.0, 6.0, 2), np.linspace(0.0, 2.0 * np.pi, 100)
    moves = [
        {
            "yaw": 1.2 * (np.sin(a + begin[0]) - np.sin(begin[0])),
            "pitch": 0.8 * (np.sin(2.0 * a + begin[1]) - np.sin(begin[1])),
            "z": 0.15 * np.sin(a),
            "spin": 1.5 * np.sin(a),
        }
        for a in turns
    ]
    name = f"{kind} end: led round a drawn path"
    return led(
        name, "verified all along, any snap reported", scene, moves,
        statuses=TRUSTED, check=checks.snaps(at_least=0), polyline_points=201,
    )  # fmt: skip


_CASES = (
    *ends(),
    drawn("pinned", 1),
    drawn("swivel", 2),
    drawn("sliding", 3, axial_force=-5.0),
    drawn("free", 4, force=[2.0, -1.0, 3.0]),
)
# other people's methods know two clamps only
ENDS = tuple(replace(case, baselines=False) for case in _CASES)
