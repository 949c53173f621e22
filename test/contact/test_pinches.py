# SPDX-License-Identifier: Apache-2.0
"""A cable that lies on a surface and is pushed onto it by another obstacle: a reaction in one point."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from one_joint import RADIUS, lying, moved

from cable_ros import Equilibrium, Status, Tracker, load_scene
from cable_ros.bench.contact_fuzz import contact_case
from cable_ros.bench.metamorphic import follow, nudged

BALL = 0.02
AWAY, NEAR = 0.3, 0.02
URDF = moved("y", "prismatic", (0, 1, 0))


def scene(height: float) -> dict[str, Any]:
    """A cable on the ground, its clamps at this height, m, and a ball at 45 degrees above its side."""
    above = RADIUS + (RADIUS + BALL) * 0.5**0.5
    return {
        "gravity": [0, 0, -9.81],
        "obstacles": [
            {"name": "ground", "plane": {"point": [0, 0, 0], "normal": [0, 0, 1]}},
            {"name": "ball", "link": "body", "sphere": {"center": [0.1, 0, above], "radius": BALL}},
        ],
        "cables": [lying({"position": [-0.48, 0, height]}, {"position": [0.48, 0, height]})],
    }


def pushed(height: float, steps: int) -> list[Equilibrium]:
    """The ball comes to the cable and pushes it along the ground, in so many steps."""
    tracker = Tracker(load_scene(scene(height), urdf=URDF), tolerance=1e-6)
    return [tracker.solve({"y": float(y)})["cable"] for y in np.linspace(AWAY, NEAR, steps + 1)]


@pytest.mark.parametrize("height", [0.01, 0.02])
def test_the_ground_bears_what_the_ball_presses(height: float) -> None:
    """Right under it, in one point: the cable is flat on both sides, and its shear force does not jump."""
    few, many = pushed(height, 4)[-1], pushed(height, 16)[-1]
    assert few.status is many.status is Status.CONVERGED
    size = float(np.linalg.norm(many.end_wrench))
    assert float(np.abs(few.end_wrench - many.end_wrench).max()) < 2e-6 * size
    (ball,) = [c for c in many.contacts if c.obstacle == "ball"]
    points = [c for c in many.contacts if c.obstacle == "ground" and c.length == 0.0]
    (reaction,) = [c for c in points if c.arc_length == pytest.approx(ball.arc_length, abs=1e-6)]
    assert reaction.normal_force == pytest.approx(-ball.force[2], rel=1e-3)
    ends = [c.arc_length for c in points if c is not reaction]
    assert min(ends) < ball.arc_length < max(ends)


def test_where_it_lifts_off_before_the_ball_the_end_of_the_patch_bears_that() -> None:
    """With clamps this high: then the ground touches nothing under the ball."""
    last = pushed(0.035, 8)[-1]
    assert last.status is Status.CONVERGED
    (ball,) = [c for c in last.contacts if c.obstacle == "ball"]
    ends = [c for c in last.contacts if c.obstacle == "ground" and c.length == 0.0]
    nearest = min(ends, key=lambda c: abs(c.arc_length - ball.arc_length))
    assert nearest.arc_length < ball.arc_length
    assert nearest.normal_force > -ball.force[2]


def test_a_patch_that_ends_beside_a_pinch() -> None:
    """By the last digit it was found or not, or a little beside: without a force of its own under the other
    obstacle's point, the end of the patch went there to give it.
    """
    case = contact_case(77, 4, 1e-4)
    first = follow(case)
    for seed in (102, 103, 105):
        other = follow(nudged(case, seed))
        for i, (a, b) in enumerate(zip(first.found, other.found, strict=True)):
            assert a.status is b.status is Status.CONVERGED
            assert first.difference(a, b, i) < 1e-6
