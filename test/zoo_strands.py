# SPDX-License-Identifier: Apache-2.0
"""The zoo's cables that touch themselves: a loop whose strands cross and are pressed together."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import zoo_checks as checks
from references import crossing
from scipy.spatial.transform import Rotation

from cable_ros.bench.cases import Case
from cable_ros.scene import load_scene
from cable_ros.tracker import Tracker

POINTS = 801
GRAVITY = np.array([0.0, 0.0, -9.81])
LIFT = (
    '<robot name="lift"><link name="world"/><link name="tool"/><joint name="lift" type="prismatic">'
    '<parent link="world"/><child link="tool"/><axis xyz="0 0 1"/>'
    '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
)
LOOP: dict[str, Any] = {
    "name": "loop",
    "length": 0.5,
    "stiffness": [0.0013, 0.0011, 0.0009],
    "outer_diameter": 0.008,
    "linear_density": 0.02,
    "start": {"position": [0.0, 0.0, 0.0], "rpy": [0.0, math.pi / 2, 0.0]},
    "end": {"link": "tool", "position": [0.1, 0.01, 0.0], "rpy": [0.0, math.pi / 2, 0.2]},
}
"""It hangs in a loop whose strands cross; from 0.06 m up, where they are apart, its end comes down."""


def mapping() -> dict[str, Any]:
    return {
        "robot": {"urdf": "lift.urdf"}, "gravity": GRAVITY, "cable_contact": True,
        "cables": [copy.deepcopy(LOOP)],
    }  # fmt: skip


def loop(name: str, expected: str, lifts: Iterable[float], **options: Any) -> Case:
    path = tuple({"lift": float(lift)} for lift in lifts)
    return Case(
        name, expected, mapping(), path, urdf=LIFT, polyline_points=POINTS, baselines=False, **options
    )


def shot() -> np.ndarray:
    """(6,) end wrench in the end clamp's frame with the end at the bottom, by shooting."""
    tracker = Tracker(load_scene(mapping(), urdf=LIFT))
    for lift in DOWN:
        found = tracker.solve({"lift": float(lift)})["loop"]
    first = found.contacts[0]
    turn = Rotation.from_quat(found.orientations[0])
    start = np.concatenate([turn.apply(found.start_wrench[:3]), turn.apply(found.start_wrench[3:])])
    arcs = np.array([[first.arc_length, first.other_arc_length]])
    end = {"position": np.add(LOOP["end"]["position"], [0.0, 0.0, DOWN[-1]]), "rpy": LOOP["end"]["rpy"]}
    guess = crossing.Itself(-start, np.empty(6), first.force[None], arcs)
    exact = crossing.solve_itself(LOOP | {"end": end}, GRAVITY, guess, 1e-8)
    back = Rotation.from_euler("xyz", end["rpy"]).inv()
    return -np.concatenate([back.apply(exact.end[:3]), back.apply(exact.end[3:])])


DOWN = np.linspace(0.06, -0.01, 15)
STRANDS: tuple[Case, ...] = (
    loop("a loop closes on itself and opens again", "as on the way there", [*DOWN, *DOWN[-2::-1]],
         check=checks.every(checks.touched("loop"), checks.retraced())),
    loop("a loop closes on itself at once", "shooting", [DOWN[0], DOWN[-1]], wrench=shot,
         wrench_tolerance=2e-4, check=checks.touched("loop")),
)  # fmt: skip
