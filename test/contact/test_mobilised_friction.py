# SPDX-License-Identifier: Apache-2.0
"""Friction that is mobilised everywhere, (53) of Liu et al. (2018): its tangent, and that it is all there."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cable_ros import Tracker, load_scene
from cable_ros.bench.cases import run_case
from cable_ros.bench.contact_checks import sliding_fault, surfaces
from cable_ros.bench.contact_fuzz import contact_case
from cable_ros.bench.verification import Rod
from cable_ros.contact.active_set_rod import ActiveSetRod
from cable_ros.contact.friction_kernels import SLIDING
from cable_ros.contact.points import ARC_LENGTH, FORCE, FRICTION, KIND, POINT, SLIP_ROW, SLOPE_ROW
from cable_ros.equilibrium import Equilibrium
from cable_ros.rod import quaternion
from cable_ros.scene import Kinematics, Scene
from cable_ros.share import share_file

ANGLES = 0.6, 0.8, 1.0, 1.1
STEP = 1e-6
"""rad; the differences' error goes with its square, their rounding with its inverse."""


@pytest.fixture(scope="module")
def on_the_ball() -> tuple[Scene, Tracker, list[Equilibrium]]:
    """The arm's cable, led over its ball; the last step is in contact."""
    smooth = load_scene(share_file("config", "space_arm_sphere.yaml"))
    rough = tuple(replace(ball, friction=0.35) for ball in smooth.obstacles)
    scene = replace(smooth, obstacles=rough, friction_model="sliding")
    tracker = Tracker(scene, polyline_points=401)
    return scene, tracker, [next(iter(tracker.solve({"orientation": a}).values())) for a in ANGLES]


def moved_friction(rod: ActiveSetRod, q: np.ndarray, F: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(count, 3) friction by (53) of the same normal forces for the shape q (n, 4), at the arc lengths."""
    rod.points[: rod.count, ARC_LENGTH] = places
    rod.trace(q, F)
    rod.assemble(q, F, SLIDING)
    return rod.points[: rod.count, FRICTION : FRICTION + 3].copy()


@pytest.mark.parametrize("seed", range(3))
def test_the_rows_of_turning_friction_are_its_derivative(
    on_the_ball: tuple[Scene, Tracker, list[Equilibrium]], seed: int
) -> None:
    (cable,) = on_the_ball[1]._tracked_cables
    rod, q, F = cable.rod, cable.q, cable.end_force
    assert isinstance(rod, ActiveSetRod)
    places, state = rod.points[: rod.count, ARC_LENGTH].copy(), rod.state()
    rod.trace(q, F)
    rod.rows = rod.assemble(q, F, SLIDING)
    x = np.random.default_rng(seed).normal(size=3 * len(q))
    x[:3] = x[-3:] = 0.0
    point, normal = rod.points[0], rod.normals[0].copy()
    assert rod.count == 1
    assert point[KIND] == POINT
    slip, slope = int(point[SLIP_ROW]), int(point[SLOPE_ROW])
    assert slip > 0
    # the point goes to where the gap has its minimum again
    goes = -(rod.V[slope] @ x) / (rod.delta[slope] * point[FORCE])
    t = quaternion.tangents(rod.mesh.interpolate(q, places))[0]
    across = np.cross(t, normal)
    axes = np.array([normal, np.cross(across / np.linalg.norm(across), normal)])
    by_rows = -rod.V[[slip, slip + 1]] @ x  # at the same normal force
    found = []
    for size in (STEP, -STEP):
        there = np.empty_like(q)
        quaternion.retract(q, size * x, there)
        found.append(moved_friction(rod, there, F, places + size * goes)[0])
    rod.restore(state)
    change = axes @ (found[0] - found[1]) / (2.0 * STEP)
    # the point is on a boundary of elements, where the curvature jumps by the mesh's error
    assert by_rows == pytest.approx(change, abs=1e-4 * np.abs(change).max())
    assert np.abs(change).max() > 0.1  # it does turn


def test_friction_that_is_not_all_there_is_told(
    on_the_ball: tuple[Scene, Tracker, list[Equilibrium]],
) -> None:
    scene, _, found = on_the_ball
    kinematics, (cable,) = Kinematics(scene), scene.cables
    before, after = (kinematics.poses(np.array([angle]))[0] for angle in ANGLES[-2:])
    rod = Rod(cable.length, cable.stiffness, scene.gravity * cable.linear_density, after[0], after[1])
    met, motion = surfaces(scene, kinematics, np.array(ANGLES[-1:]), cable.radius), (after - before)[1, :3]
    (one,) = found[-1].contacts
    assert sliding_fault(rod, met, found[-1], motion) is None

    def told(friction: np.ndarray) -> str:
        other = replace(found[-1])
        vars(other)["contacts"] = (replace(one, force=one.force - one.friction + friction),)
        return sliding_fault(rod, met, other, motion) or ""

    assert "is not" in told(np.zeros(3))
    assert "is not" in told(0.9 * one.friction)
    assert "pushes the way the end goes" in told(-one.friction)


@pytest.mark.parametrize("index", [106, 172])
def test_a_cable_that_friction_turns_over_is_not_published_without_it(index: int) -> None:
    """It was, as a step that failed was descended without friction."""
    steps = run_case(contact_case(1, index, 1e-4)).steps
    assert steps[0].verified
    assert [step.fault for step in steps] == [None] * len(steps)
    assert not steps[1].equilibrium.status.trusted
    assert "friction_model: sliding" in steps[1].equilibrium.message


def test_the_twelfth_digit_of_the_joint_does_not_show(
    on_the_ball: tuple[Scene, Tracker, list[Equilibrium]],
) -> None:
    scene = on_the_ball[0]
    ends = []
    for shift in (0.0, 1e-12):
        tracker = Tracker(scene, tolerance=1e-6)
        for angle in ANGLES:
            (found,) = tracker.solve({"orientation": angle + shift}).values()
        ends.append(found.end_wrench)
        assert found.status.trusted
    assert np.abs(ends[0] - ends[1]).max() < 1e-6 * math.hypot(*ends[0][:3])
