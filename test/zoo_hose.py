# SPDX-License-Identifier: Apache-2.0
"""The zoo's hoses: on rough ground, on a robot's arm, and cables that may go to either side.

`PASSING` are counted by the zoo; `OPEN` are run beside it, see `zoo_open.py`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import zoo_checks as checks
from references import contact
from zoo_make import led

from cable_ros.bench.cases import Case, Step, lost, relative_difference
from cable_ros.bench.metamorphic import SAME, at_rate, follow

REFERENCE = 0.05
"""Allowed of a force. A discrete Coulomb rod of some hundred segments is good to 3 %."""
UPRIGHT = [0.0, 0.0, 0.0, 1.0]
LYING = [0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5)]
"""The clamp's tangent along x."""


def joint(name: str, kind: str, parent: str, child: str, axis: str, origin: str = "0 0 0") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{origin}" rpy="0 0 0"/><axis xyz="{axis}"/>'
        '<limit lower="-9" upper="9" effort="1" velocity="9"/></joint>'
    )


def robot(name: str, joints: Sequence[tuple[str, str, str, str]]) -> str:
    """URDF of a chain from `world` through links `after_NAME`: name, kind, axis and origin of each joint."""
    links = ["world", *(f"after_{one[0]}" for one in joints)]
    text = "".join(f'<link name="{link}"/>' for link in links)
    for (which, kind, axis, origin), parent, child in zip(joints, links, links[1:], strict=False):
        text += joint(which, kind, parent, child, axis, origin)
    return f'<robot name="{name}">{text}</robot>'


def never_lost(steps: list[Step]) -> str | None:
    """No pose was solved cold, said or half said."""
    at = next((i for i, step in enumerate(steps) if lost(step.equilibrium)), None)
    return None if at is None else f"pose {at}: {steps[at].equilibrium.message}"


def force_near(exact: Sequence[float], part: float) -> checks.Check:
    """The last end force is within a `part` of this one."""

    def check(steps: list[Step]) -> str | None:
        off = np.linalg.norm(steps[-1].equilibrium.end_wrench[:3] - exact) / np.linalg.norm(exact)
        return (
            None
            if off <= part
            else f"end force {100 * off:.3g} % off the reference, allowed {100 * part:g} %"
        )

    return check


def hose(name: str, n: int) -> Case:
    """A hose whose lifted end is led sideways in `n` poses, and back and beyond in as many."""
    slides = [("x", "prismatic", "1 0 0", "0 0 0"), ("y", "prismatic", "0 1 0", "0 0 0")]
    scene = {
        "gravity": [0.0, 0.0, -9.80665],
        "obstacles": [
            {"name": "ground", "plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}, "friction": 0.5}
        ],
        "cables": [
            {
                "name": "hose", "length": 2.0, "stiffness": [0.5, 0.5, 0.375], "outer_diameter": 0.02,
                "linear_density": 0.5, "start": {"position": [0, 0, 0.01], "orientation": LYING},
                "end": {"link": "after_y", "position": [0, 0, 0.5], "orientation": UPRIGHT},
            }
        ],
    }  # fmt: skip
    there = [0.15 * k / n for k in range(n + 1)]
    path = [{"x": 1.6, "y": y} for y in [*there, *(0.15 - 0.3 * k / n for k in range(1, n + 1))]]
    return Case(
        name, "discrete Coulomb rod", scene, path[: int(1.8 * n) + 1], urdf=robot("gantry", slides),
        baselines=False, polyline_points=401,
        check=checks.every(never_lost, force_near([1.016, 1.002, -0.983], REFERENCE)),
    )  # fmt: skip


def sideways(weight: float, friction: float, step: float) -> Case:
    """Ground drawn sideways under a rod that lies on it until all slides, and then the other way."""
    reference = contact.dragged_sideways(weight, friction)
    (ground,) = reference.obstacles
    scene = replace(reference, obstacles=({**ground, "link": "after_y"},)).scene()
    there = np.arange(1, round(0.03 / step) + 1) * -step
    path = [0.0, *there, *there[-2::-1], 0.0, *-there]
    drawn = len(there)

    def slides_both_ways(steps: list[Step]) -> str | None:
        off = relative_difference(steps[drawn].equilibrium.end_wrench, reference.end_wrench, steps[drawn].rod)
        # within the tolerance asked for, in force and in moment, and what a stick gives way
        if not off <= 3e-4:
            return f"pose {drawn}: end wrench off by {off:.1e} where all slides"
        for at, sign in ((drawn, -1.0), (len(steps) - 1, 1.0)):
            found = steps[at].equilibrium
            rub = sum((touch.friction for touch in found.contacts), np.zeros(3))
            miss = float(np.linalg.norm(rub - [0.0, sign * friction * weight, 0.0])) / (friction * weight)
            if not miss <= 1e-3:
                return f"pose {at}: friction is {100 * miss:.3g} % off that of a rod of which all slides"
        return None

    return Case(
        f"ground drawn sideways, weight {weight:g}, friction {friction:g}, steps of {step:g}",
        "manufactured",
        scene,
        [{"y": float(y)} for y in path],
        urdf=robot("ground", [("y", "prismatic", "0 1 0", "0 0 0")]),
        polyline_points=401,
        baselines=False,
        check=checks.every(never_lost, slides_both_ways),
    )


UR10E = (
    ("pan", "continuous", "0 0 1", "0 0 0.1807"),
    ("lift", "continuous", "0 1 0", "0 0.176 0"),
    ("elbow", "continuous", "0 1 0", "0 -0.137 0.6127"),
    ("wrist_1", "continuous", "0 1 0", "0 0 0.57155"),
    ("wrist_2", "continuous", "0 0 1", "0 0.135 0"),
    ("wrist_3", "continuous", "0 1 0", "0 0 0.12"),
)
"""An arm of a UR10e's lengths: upright at zero, its links along z."""
CORNERS = (
    (0.0, 0.6, 1.2, 0.2, 0.0, 0.0),
    (0.8, 0.9, 1.0, 0.6, 0.5, 0.7),
    (0.3, 0.4, 1.8, -0.4, -0.6, 1.5),
)


SECONDS = 0.4
"""Of each leg of the trajectory."""
TRUTH = 500.0
"""Hz; the trajectory is compared with itself at this rate."""


def arm_hose(rate: float) -> Case:
    """A hose from the upper arm to the tool, with capsules about the links, led along one trajectory."""
    bars = (("after_lift", 0.6, 0.09), ("after_elbow", 0.57, 0.08), ("after_wrist_1", 0.1, 0.06))
    scene: dict[str, Any] = {
        "gravity": [0.0, 0.0, -9.80665],
        "obstacles": [
            {"name": link, "link": link, "capsule": {"start": [0, 0, 0], "end": [0, 0, size], "radius": r}}
            for link, size, r in bars
        ],
        "cables": [
            {
                "name": "hose", "length": 1.3, "stiffness": [0.6, 0.6, 0.45], "outer_diameter": 0.02,
                "linear_density": 0.4,
                "start": {"link": "after_lift", "position": [0.1, 0, 0.1], "orientation": UPRIGHT},
                "end": {"link": "after_wrist_3", "position": [0.1, 0.1, 0.05], "orientation": UPRIGHT},
            }
        ],
    }  # fmt: skip
    names = [one[0] for one in UR10E]
    path = at_rate([dict(zip(names, corner, strict=True)) for corner in CORNERS], rate, SECONDS)
    return Case(
        f"hose of a six-axis arm at {rate:g} Hz", f"as at {TRUTH:g} Hz; never lost", scene, path,
        urdf=robot("arm", UR10E), wrench=arm_wrench, wrench_tolerance=SAME, baselines=False,
        polyline_points=401, check=checks.every(never_lost, checks.touched("after_lift")),
    )  # fmt: skip


@cache
def arm_wrench() -> np.ndarray:
    return follow(arm_hose(TRUTH)).found[-1].end_wrench


def either_side() -> list[Case]:
    """Planar problems with mirror-image answers, passed through the pose where both are the same."""
    flat = {
        "name": "cable", "length": 1.0, "stiffness": [1.0, 1.0, 0.75], "linear_density": 20.0 / 9.81,
        "outer_diameter": 0.02,
    }  # fmt: skip
    ground = {"name": "ground", "plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}}
    level = {
        "gravity": [0.0, 0.0, -9.81],
        "obstacles": [ground],
        "cables": [{**flat, "start": {"position": [0, 0, 0.01], "orientation": LYING},
                    "end": {"position": [0.9, 0, 0.01], "orientation": LYING}}],
    }  # fmt: skip
    rises = [*np.linspace(0.0, 0.3, 16), *np.linspace(0.28, 0.0, 15)]
    slot = {
        "gravity": [0.0, 0.0, 0.0],
        "obstacles": [
            {"name": name, "plane": {"point": [0, 0, 0.05 * side], "normal": [0, 0, -side]}}
            for name, side in (("floor", -1), ("ceiling", 1))
        ],
        "cables": [{**flat, "start": {"position": [0, 0, 0], "orientation": LYING},
                    "end": {"position": [0.92, 0, 0], "orientation": LYING}}],
    }  # fmt: skip
    ins = [*np.linspace(0.0, -0.1, 11), *np.linspace(-0.09, 0.0, 10)]
    options = {"baselines": False, "polyline_points": 401}
    return [
        led("lying arch lifted at one end and laid down again", "as on the way there, or said", level,
            [{"z": float(z)} for z in rises], check=same_side, **options),
        led("column pressed between two plates and let out again", "as on the way there, or said", slot,
            [{"x": float(x)} for x in ins], check=same_side, **options),
    ]  # fmt: skip


def same_side(steps: list[Step]) -> str | None:
    """Back at a pose the cable is on the side where it was, unless a status or message says otherwise."""
    plain = steps[0].equilibrium.status.sentence
    for k, step in enumerate(steps[: len(steps) // 2]):
        other = len(steps) - 1 - k
        if any(one.equilibrium.message != plain for one in steps[k + 1 : other + 1]):
            continue
        a, b = step.equilibrium, steps[other].equilibrium
        apart = float(np.linalg.norm(a.points - b.points, axis=1).max()) / step.rod.length
        if apart > 1e-3:
            return f"poses {k} and {other} are one pose, and the shapes {apart:.1e} L apart: nothing was said"
    return None


SIDEWAYS = ((20.0, 0.35), (40.0, 0.2), (40.0, 0.35), (40.0, 0.6), (80.0, 0.35))
"""Weights and coefficients of friction."""
PASSING: tuple[Case, ...] = (
    arm_hose(50.0),
    *either_side(),
    hose("hose on rough ground led sideways, 10 poses a leg", 10),
    *(sideways(weight, friction, 0.03) for weight, friction in SIDEWAYS),
)
OPEN: tuple[Case, ...] = (
    hose("hose on rough ground led sideways, 30 poses a leg", 30),
    *(sideways(weight, friction, step) for weight, friction in SIDEWAYS for step in (0.005, 0.01)),
    *(sideways(80.0, 0.8, step) for step in (0.005, 0.01, 0.03)),
)
"""The same in smaller steps, which take minutes, and the strongest friction, which is not had yet."""
