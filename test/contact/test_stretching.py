# SPDX-License-Identifier: Apache-2.0
"""A cable that stretches among obstacles: boundary values, limits, derivatives, invariances."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from arm_over_ball import BALL, CLAMP, START, check_response, error, moved, numbers, over_ball
from pages import blocks
from references import stretched_contact
from references.reference import Reference
from scipy.spatial.transform import Rotation

from cable_ros import Equilibrium, Status, Tracker, load_scene
from cable_ros.bench.carriage import on_carriage
from cable_ros.contact.stretching_rod import StretchingTouchingRod
from cable_ros.rod import quaternion
from cable_ros.rod.rod_state import ENERGY
from cable_ros.scene.text import parse_yaml
from cable_ros.solve.trust_region import Options


def arm(soft: float | None, **changes: Any) -> dict[str, Any]:
    """The arm's cable over the ball with EA = 1 / soft, N."""
    return over_ball({} if soft is None else {"axial_stiffness": 1.0 / soft}, **changes)


def solve(mapping: dict[str, Any], tolerance: float = 1e-9) -> Equilibrium:
    found = Tracker(load_scene(mapping), tolerance).solve({})["cable"]
    assert found.status is Status.CONVERGED, found.message
    assert found.contacts
    return found


# A cold start beside home finds the cable on this side of the drum; from farther the branch may be lost.
AROUND = tuple((0.0, 0.3 * a, 0.0) for a in np.linspace(0.04, 0.0, 5))
HOME = ((0.0, 0.0, 0.0),)


def at_home(reference: Reference, soft: float, tolerance: float, path: Any) -> Equilibrium:
    scene, urdf, home = on_carriage(reference.scene(axial_stiffness=1.0 / soft))
    tracker = Tracker(load_scene(scene, urdf=urdf), tolerance)
    for x, y, yaw in path:
        found = tracker.arrive({**home, "x": home["x"] + x, "y": home["y"] + y, "yaw": home["yaw"] + yaw})
    assert found["cable"].status is Status.CONVERGED, found["cable"].message
    return found["cable"]


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5, 1e-7])
@pytest.mark.parametrize(
    ("make", "soft", "path"),
    [
        (stretched_contact.lifted, 5e-3, HOME),
        (stretched_contact.sagging, 1e-3, HOME),
        (stretched_contact.sagging, 5e-3, HOME),
        (stretched_contact.draped, 1e-3, AROUND),
    ],
)
def test_against_boundary_values(make: Any, soft: float, path: Any, tolerance: float) -> None:
    reference = make(soft)
    found = at_home(reference, soft, tolerance, path)
    facts = reference.facts
    assert error(found.end_wrench, reference.end_wrench) < tolerance
    assert error(found.start_wrench, reference.start_wrench) < tolerance
    # the estimate is that of the end wrench; 1e-8 is left by equations solved to a hundredth of the tolerance
    assert error(found.end_wrench, reference.end_wrench) < 3 * found.error_estimate + 1e-8
    # where it lifts off follows from the slope of the curvature: it is had less well than the wrench
    assert found.contacts[-1].arc_length == pytest.approx(facts["touchdown_end"], abs=max(tolerance, 1e-4))
    # without the stretch the answer is another one
    stiff = error(make(1e-9).end_wrench, reference.end_wrench)
    assert stiff > 1e-3


def test_the_inextensible_limit_is_met_in_proportion() -> None:
    limit = solve(arm(None))
    gaps = [error(solve(arm(soft)).end_wrench, limit.end_wrench) for soft in (1e-2, 1e-3, 1e-4)]
    np.testing.assert_allclose(np.array(gaps[:-1]) / gaps[1:], 10.0, rtol=0.05)  # and a term of second order


@pytest.mark.parametrize("body", ["start", "end", "ball"])
def test_stiffness_and_virtual_work(body: str) -> None:
    # the strain is 2 % here, and the ball bears a third of the cable
    found, step = solve(arm(0.1)), 2e-5
    response = found.wrench_response(["ball"])
    for k in range(3 if body == "ball" else 6):
        motion = np.zeros(6)
        motion[k] = step * (1.0 if k < 3 else 10.0)

        def at(by: float, motion: np.ndarray = motion) -> np.ndarray:
            return numbers(solve(arm(0.1, **moved(body, by * motion)), 1e-10))

        # central difference of fourth order
        numeric = (8 * (at(1) - at(-1)) - (at(2) - at(-2))) / (12 * motion[k])
        # 1e-10 of the wrench over the step
        check_response(found, response, body, k, numeric, stiffness=2e-5, work=1e-5, push=1e-4)


def test_all_moved_together_only_turns_the_wrenches() -> None:
    whole, shift = Rotation.from_rotvec([0.7, -0.4, 1.1]), np.array([0.3, -2.0, 1.0])
    place = [(whole.apply(p) + shift, whole * r) for p, r in (START, CLAMP)]
    here = solve(arm(0.1))
    there = solve(
        arm(0.1, start=place[0], end=place[1], ball=whole.apply(BALL) + shift,
            gravity=whole.apply([0.0, 0.0, -9.80665]))
    )  # fmt: skip
    assert error(there.end_wrench, here.end_wrench) < 1e-8
    assert error(there.start_wrench, here.start_wrench) < 1e-8
    assert there.stability_margin == pytest.approx(here.stability_margin, rel=1e-3)


def test_told_from_the_other_end() -> None:
    half = Rotation.from_rotvec([np.pi, 0.0, 0.0])
    here = solve(arm(0.1))
    back = solve(arm(0.1, start=(CLAMP[0], CLAMP[1] * half), end=(START[0], START[1] * half)))
    turned = np.concatenate([half.apply(back.start_wrench[:3]), half.apply(back.start_wrench[3:])])
    assert error(turned, here.end_wrench) < 1e-8
    assert back.contacts[0].arc_length == pytest.approx(0.38 - here.contacts[0].arc_length, abs=1e-8)


def test_forces_and_polyline() -> None:
    found = solve(arm(0.1), 1e-7)
    (touch,) = found.contacts
    ends = START[1].apply(found.start_wrench[:3]) + CLAMP[1].apply(found.end_wrench[:3])
    weight = 0.1019716 * 9.80665 * 0.38
    np.testing.assert_allclose(ends, touch.force - [0.0, 0.0, weight], atol=1e-6 * weight)
    assert np.linalg.norm(touch.position - BALL) == pytest.approx(0.045, abs=1e-8)
    np.testing.assert_allclose(found.points[-1], CLAMP[0], atol=1e-8)
    steps = np.linalg.norm(np.diff(found.points, axis=0), axis=1)
    assert steps.sum() > 0.38 * 1.003  # it is longer than unloaded
    # the tension at the start clamp is that of the strain there; a step of 1/100 L sees its mean
    assert steps[0] / 0.0038 - 1.0 == pytest.approx(0.1 * found.start_wrench[2], rel=0.05)


def test_largest_tension() -> None:
    reference = stretched_contact.sagging(5e-3)
    mapping = reference.scene(axial_stiffness=200.0, limits={"tension": 1e3})
    found = Tracker(load_scene(mapping), 1e-7).solve({})["cable"]
    (tension,) = [one for one in found.extremes if one.quantity.name == "tension"]
    # it is pulled most along the ground, where the case has it: above it its weight pushes
    assert tension.value == pytest.approx(12.0, rel=1e-6)
    assert 0.3 - 1e-4 < tension.arc_length < 0.65 + 1e-4


def test_stretch_is_left_out_where_it_does_nothing() -> None:
    found = Tracker(load_scene(arm(1e-9) | {"effects": "auto"}), 1e-4).solve({})["cable"]
    assert found.status is Status.CONVERGED
    assert "Left out: stretch" in found.message
    kept = Tracker(load_scene(arm(0.1) | {"effects": "auto"}), 1e-4).solve({})["cable"]
    assert "Left out: stretch" not in kept.message
    assert error(kept.end_wrench, solve(arm(0.1)).end_wrench) < 1e-4


def test_a_copy_of_the_rod_is_the_rod() -> None:
    found = stretched_contact.sagging(5e-3).scene(axial_stiffness=200.0)
    tracker = Tracker(load_scene(found), 1e-5)
    first = tracker.solve({})["cable"]
    # derivatives come from a copy, of which the tracker knows nothing
    tracker.reset()
    np.testing.assert_array_equal(first.clamp_stiffness, tracker.solve({})["cable"].clamp_stiffness)


@pytest.mark.parametrize("push", [0.02, 0.5])
def test_a_fall_ends_where_the_cable_rests(push: float) -> None:
    """From beside it by Newton's method, from farther by way of the cable that keeps its length."""
    tracker = Tracker(load_scene(arm(0.1)), 1e-6)
    tracker.solve({})
    (tracked,) = tracker._tracked_cables
    rod, q, F = tracked.rod, tracked.q, tracked.end_force
    assert isinstance(rod, StretchingTouchingRod)
    energy, count, places = float(rod.totals[ENERGY]), rod.count, np.linspace(0.0, 1.0, 11)
    before = rod.mesh.interpolate(q, places)
    bent = push * np.sin(np.pi * rod.mesh.nodes)[:, None] * [1.0, 0.0, 0.0]
    begin = np.empty_like(q)
    quaternion.retract(q, bent.ravel(), begin)
    # what it falls from has another force, or none is known
    found = rod.fall(begin, F if push < 0.1 else np.zeros(3), Options(step_tolerance=1e-9))
    assert found is not None
    rest, force, _ = found
    assert rod.count == count == 1
    assert not rod.forgot
    np.testing.assert_allclose(force, F, atol=1e-6 * np.linalg.norm(F))
    shape = rod.mesh.interpolate(rest, places)
    np.testing.assert_allclose(np.abs(np.sum(shape * before, axis=1)), 1.0, atol=1e-10)
    assert float(rod.totals[ENERGY]) == pytest.approx(energy, rel=1e-6)
    assert rod.refactor(rest, force)  # and it is stable


def test_natural_frequencies_tend_to_those_without_stretch() -> None:
    """To first order in the compliance; what they are is in `test_contact_modes`."""
    stiff = solve(arm(None), 1e-7).modes(3).frequencies
    near, nearer = (np.abs(solve(arm(soft), 1e-7).modes(3).frequencies / stiff - 1) for soft in (1e-2, 1e-3))
    np.testing.assert_allclose(near / nearer, 10.0, rtol=0.1)


def test_the_example_of_the_page_is_as_it_says() -> None:
    page = Path(__file__).parents[2] / "docs" / "effects.md"
    (example,) = [block.text for block in blocks(page) if block.language == "yaml"]
    found = Tracker(load_scene(parse_yaml(example, str(page)))).solve({})["bungee"]
    assert found.status is Status.CONVERGED, found.message
    (touch,) = found.contacts
    assert touch.obstacle == "bar"
    tension = -found.end_wrench[2]
    assert np.linalg.norm(np.diff(found.points, axis=0), axis=1).sum() == pytest.approx(
        0.8 * (1 + tension / 60.0), abs=1e-3
    )
