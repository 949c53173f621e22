# SPDX-License-Identifier: Apache-2.0
"""Coulomb friction against what it must come to: a capstan, a cable drawn over the ground either way.

The obstacle moves under a cable between fixed clamps, so where it slides all along the equilibrium is one of
a boundary-value problem, and what it was before is the other way round.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from one_joint import moved
from references import contact
from references.free_boundary import GROUND, Lying, Surface, clamp, meet, stuck
from references.reference import Reference, planar_frame

from cable_ros import Equilibrium, Status, Tracker, load_scene
from cable_ros.bench.cases import Case, case_scene
from cable_ros.bench.drawn import drawn_case, refined
from cable_ros.contact.points import SLIPS
from cable_ros.contact.touching_rod import TouchingRod
from cable_ros.share import share_file

MU, RADIUS, WRAP = 0.35, 0.15, 1.4
CENTRE = contact.cylinder_centre(RADIUS, WRAP)
REACHED = 1e-4
"""Relative error of a wrench: the tolerance asked for."""
STUCK = 5e-5
"""What a stick of 1e8 EI / L^3 gives way adds to it, at most, where nearly all slips; measured: 2e-5."""
ROOM = 1e-6
"""Of the cone, for rounding."""


def tracker(reference: Reference, obstacle: dict, urdf: str, tolerance: float = 1e-4) -> Tracker:
    scene = replace(reference, obstacles=({**obstacle, "link": "body"},)).scene()
    return Tracker(load_scene(scene, urdf=urdf), tolerance=tolerance)


def follow(tracker: Tracker, joint: str, values: Sequence[float]) -> list[Equilibrium]:
    found = [tracker.arrive({joint: float(value)})["cable"] for value in values]
    for one in found:
        assert one.status is Status.CONVERGED, one.message
    return found


def on_drum(reference: Reference, friction: float, tolerance: float = 1e-4) -> Tracker:
    drum = {
        "name": "drum",
        "cylinder": {"start": [0.0, 0.0, -1.0], "end": [0.0, 0.0, 1.0], "radius": RADIUS},
        "friction": friction,
    }
    return tracker(reference, drum, moved("turn", "continuous", (0, 0, 1), (*CENTRE, 0.0)), tolerance)


DRUM = Surface((float(CENTRE[0]), float(CENTRE[1])), RADIUS)
ENDS = clamp(contact.draped().reference.start), clamp(contact.draped().reference.end)


@cache
def draped(friction: float) -> tuple[Lying, Reference]:
    """The rod between the clamps of `contact.draped` with friction mobilised, by boundary values."""
    found = Lying(0.45 * (1 - 0.21), 0.55 * (1 - 0.21), 0.7, 12.0, 28.0, 32.0)
    for part in (0.0, 0.5, 1.0):
        found, reference = meet(ENDS, found, DRUM, 20.0, part * friction)
    return found, reference


def off_stuck(found: Equilibrium, lying: Lying, turn: float) -> float:
    """Relative error of the end force of a rod that has stuck to the drum since `lying`."""
    _, force, _ = stuck(lying, ENDS, DRUM, 20.0, turn)
    return error(-(planar_frame(ENDS[1][2]) @ found.end_wrench[:3])[:2], force)


def error(found: np.ndarray, exact: np.ndarray) -> float:
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))


def keeps_the_cone(found: Equilibrium, friction: float) -> None:
    largest = max(touch.normal_force for touch in found.contacts)
    for touch in found.contacts:
        assert touch.normal_force >= -ROOM * largest
        assert np.linalg.norm(touch.friction) <= friction * touch.normal_force + ROOM * largest


def test_a_drum_turned_under_the_rod_there_and_back() -> None:
    there = np.array([0.0, 0.02, 0.04])
    back = np.linspace(0.02, -0.04, 4)
    again = np.linspace(-0.02, 0.04, 4)
    found = follow(on_drum(draped(0.0)[1], MU), "turn", [*there, *back, *again])
    assert error(found[0].end_wrench, draped(0.0)[1].end_wrench) < REACHED
    for one, friction in ((found[2], MU), (found[6], -MU), (found[10], MU)):
        exact = draped(friction)[1]
        assert error(one.end_wrench, exact.end_wrench) < REACHED
        assert error(one.start_wrench, exact.start_wrench) < REACHED
        assert all(touch.sliding for touch in one.contacts)
    for one in found:
        keeps_the_cone(one, MU)
    # the way there is forgotten: the second time round is the first
    assert found[10].end_wrench == pytest.approx(found[2].end_wrench, abs=1e-5 * 42.0)


def test_what_sticks_is_carried_along_until_all_of_it_slips() -> None:
    turns = np.arange(0.0, 0.0126, 5e-4)
    found = follow(on_drum(draped(0.0)[1], MU), "turn", turns)
    for turn, one in zip(turns, found, strict=True):
        keeps_the_cone(one, MU)
        # at 0.0097 rad the force is that of the drum that slips all along, see below
        if turn < 0.0096:
            assert off_stuck(one, draped(0.0)[0], turn) < REACHED + STUCK
    assert error(found[-1].end_wrench, draped(MU)[1].end_wrench) < REACHED
    # which is when it slips: the force it then has is that of the stuck rod at this angle
    slips = next(turn for turn, one in zip(turns, found, strict=True) if turn > 0 and _slips(one))
    assert slips == pytest.approx(0.01, abs=1e-9)


def _slips(found: Equilibrium) -> bool:
    return error(found.end_wrench, draped(MU)[1].end_wrench) < REACHED


def test_where_it_turns_back_it_sticks_again() -> None:
    steps = on_drum(draped(0.0)[1], MU)
    follow(steps, "turn", [0.0, 0.02, 0.04])
    for turn in -5e-4 * np.arange(1, 9):
        (one,) = follow(steps, "turn", [0.04 + turn])
        assert off_stuck(one, draped(MU)[0], turn) < REACHED + STUCK
        keeps_the_cone(one, MU)


def test_the_size_of_the_steps_does_not_matter() -> None:
    small, large = (
        follow(on_drum(draped(0.0)[1], MU), "turn", turns)[-1]
        for turns in (np.linspace(0.0, 0.006, 13), [0.0, 0.006])
    )
    assert error(small.end_wrench, large.end_wrench) < REACHED + STUCK


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6])
def test_a_taut_rod_over_a_drum_is_a_capstan(tolerance: float) -> None:
    reference = contact.capstan(200.0, MU).reference
    found = follow(on_drum(reference, MU, tolerance), "turn", [0.0, 0.02, 0.04, 0.06])[-1]
    pulls = [float(np.linalg.norm(wrench[:3])) for wrench in (found.start_wrench, found.end_wrench)]
    exact = [np.linalg.norm(w[:3]) for w in (reference.start_wrench, reference.end_wrench)]
    assert pulls == pytest.approx(exact, rel=max(tolerance, STUCK))
    assert error(found.end_wrench, reference.end_wrench) < max(tolerance, STUCK)
    # the rule of the flexible cable is off by what bending adds, see `contact.capstan`: here by 0.15
    assert np.log(pulls[1] / pulls[0]) == pytest.approx(
        np.log(exact[1] / exact[0]), abs=max(tolerance, STUCK)
    )


def test_what_slips_goes_on_slipping_on_the_same_way() -> None:
    """New factors of an equilibrium tell no stick from what slips at the very limit: nothing has moved."""
    turned = on_drum(contact.capstan(200.0, MU).reference, MU)
    follow(turned, "turn", [0.0, 0.02])
    tracked = turned._tracked_cables[0]
    rod = tracked._rod
    assert isinstance(rod, TouchingRod)
    slips = rod.points[: rod.count, SLIPS].copy()
    assert slips.any()
    rod.refactor(tracked._q, tracked._F)
    assert (rod.points[: rod.count, SLIPS] == slips).all()


def test_slip_over_a_ball_has_its_direction_to_the_tolerance() -> None:
    """A point that slips a little in each step: an error of its small displacement turns the friction."""
    loose, tight = (Tracker(str(share_file("config", "space_arm_sphere.yaml")), tol) for tol in (1e-7, 1e-9))
    for degrees in np.arange(41.0, 52.0, 0.5):
        joints = {"orientation": float(np.radians(degrees))}
        (found,), (exact,) = loose.arrive(joints).values(), tight.arrive(joints).values()
    assert any(touched.sliding for touched in found.contacts)
    assert error(found.end_wrench, exact.end_wrench) < 1e-7


def test_ground_drawn_lengthwise_under_a_cable_that_is_lifted() -> None:
    friction, weight = 0.2, 60.0
    made = contact.lifted().reference
    ends = clamp(made.start), clamp(made.end)
    table = {**contact.GROUND, "friction": friction}
    steps = tracker(made, table, moved("x", "prismatic", (1, 0, 0)))
    there, back = follow(steps, "x", [0.0, 0.01, 0.02, 0.01, 0.0])[2::2]
    for one, sign in ((there, -1.0), (back, 1.0)):
        lying, exact = meet(ends, Lying(0.0, 0.55, 0.0, 10.0, 0.0, 19.0), GROUND, weight, sign * friction)
        # the shape is that without friction: what lies is straight, and cannot be drawn out
        assert error(one.end_wrench, made.end_wrench) < REACHED
        borne = weight * (1.0 - lying.after) + lying.last
        rub = sum(touch.friction[0] for touch in one.contacts)
        assert rub == pytest.approx(-sign * friction * borne, rel=REACHED)
        # all of it pulls at the start clamp, beside what the lifted span pulls
        assert one.start_wrench[2] == pytest.approx(exact.start_wrench[2], abs=REACHED * friction * borne)
        keeps_the_cone(one, friction)


def test_ground_drawn_sideways_under_a_lying_rod() -> None:
    reference = contact.dragged_sideways()
    (table,) = reference.obstacles
    there, back = follow(
        tracker(reference, table, moved("y", "prismatic", (0, 1, 0))),
        "y",
        [0.0, -0.01, -0.02, -0.03, -0.02, 0.03],
    )[3::2]
    assert error(there.end_wrench, reference.end_wrench) < REACHED
    assert error(there.start_wrench, reference.start_wrench) < REACHED
    for one, sign in ((there, -1.0), (back, 1.0)):
        rub = sum(touch.friction for touch in one.contacts)
        assert rub == pytest.approx([0.0, sign * 0.35 * 40.0, 0.0], abs=REACHED * 40.0)
        assert all(touch.sliding for touch in one.contacts)
        keeps_the_cone(one, 0.35)


def test_a_lying_cable_led_sideways_and_back_in_more_poses_has_the_same_wrench() -> None:
    """Where the path turns round friction does, too: within one step if only the poses made the steps."""
    case = drawn_case(12, 21, 1e-4)  # a cable on the ground, 31 poses
    there = case.path[:19]
    few, many = (
        [tracker.arrive(pose)["cable"] for pose in path]
        for tracker, path in (
            (Tracker(case_scene(case)), there),
            (Tracker(case_scene(case)), refined(there, 4)),
        )
    )
    assert {one.status for one in (*few, *many)} == {Status.CONVERGED}
    off = [error(a.end_wrench, b.end_wrench) for a, b in zip(few, many[::4], strict=True)]
    assert max(off) < 0.01


def last_pose(case: Case, parts: int) -> Equilibrium:
    """The answer at a drawn case's last pose, its steps told in so many."""
    tracker = Tracker(case_scene(case))
    return [tracker.arrive(pose)["cable"] for pose in refined(case.path, parts)][-1]


def second_pose(case: Case, parts: int) -> Equilibrium:
    """The answer at a drawn case's second pose, told in so many poses."""
    return last_pose(replace(case, path=case.path[:2]), parts)


def test_a_first_touch_in_one_pose_or_in_four() -> None:
    """Most of the way a rough ball does not touch yet: slip was taken to be that of all of it, 3 % off."""
    case = drawn_case(134, 41, 1e-4)
    once, told = second_pose(case, 1), second_pose(case, 4)
    assert once.contacts
    assert error(told.end_wrench, once.end_wrench) < 0.005


def test_a_point_lands_beside_a_patch_in_one_pose_or_in_more() -> None:
    """On a tray that is pushed along under it a cable lies and lands: as it was told, it was 1 to 3 % off."""
    case = drawn_case(158, 354, 1e-4)
    found = [second_pose(case, parts) for parts in (1, 2, 8)]
    assert {one.status for one in found} == {Status.CONVERGED}
    assert max(error(one.end_wrench, found[-1].end_wrench) for one in found) < 0.005


def test_a_point_that_comes_to_rest_in_one_pose_or_in_many() -> None:
    """It was taken to stick in all of a step in which it slipped on, with the friction of slip: 2 % off."""
    case = drawn_case(184, 407, 1e-4)
    found = [last_pose(case, parts) for parts in (1, 2, 4, 16)]
    assert not any(one.contacts[0].sliding for one in found)
    assert max(error(one.end_wrench, found[-1].end_wrench) for one in found) < 0.005


def test_a_small_step_does_not_leave_the_branch() -> None:
    """Newton's method went to a distant equilibrium in the smaller steps there, not in the larger ones."""
    case = drawn_case(108, 76, 1e-4)  # between two rough rollers
    once, told = second_pose(case, 1), second_pose(case, 4)
    assert once.status is told.status is Status.CONVERGED
    assert error(told.end_wrench, once.end_wrench) < 0.01


def test_a_ball_turned_under_a_cable_that_sticks_rolls_to_and_fro_without_loss() -> None:
    """Contact moves along the cable while the ball turns beside it: slip is that of the material half way."""
    case = drawn_case(110, 23, 1e-4)  # turned by 30 degrees in four poses, and back
    few, many = (
        [tracker.arrive(pose)["cable"] for pose in path]
        for tracker, path in (
            (Tracker(case_scene(case)), case.path),
            (Tracker(case_scene(case)), refined(case.path, 4)),
        )
    )
    assert {one.status for one in (*few, *many)} == {Status.CONVERGED}
    assert not any(touch.sliding for one in many for touch in one.contacts)
    # it was 1 % of first order in the step, and is of second
    assert max(error(a.end_wrench, b.end_wrench) for a, b in zip(few, many[::4], strict=True)) < REACHED
    assert error(few[4].end_wrench, few[0].end_wrench) > 0.05
    assert error(few[-1].end_wrench, few[0].end_wrench) < REACHED


def test_a_contact_that_comes_to_a_clamp_leaves_its_force_to_it() -> None:
    """With a shorter and shorter arm the force beside the clamp would go to infinity."""
    case = drawn_case(108, 23, 1e-4)  # a lift led aside and back, whose clamps rest on the ground
    scene = case_scene(case)
    tracker = Tracker(scene)
    found = [tracker.arrive(pose)["cable"] for pose in refined(case.path[:41], 4)]
    assert {one.status for one in found} == {Status.CONVERGED}
    cable = scene.cables[0]
    unit = cable.stiffness[0] / cable.length**2
    assert max(np.abs(one.end_wrench[:3]).max() for one in found) < 40.0 * unit
    # it touches the ground in between, and a cable that touches nothing has no memory
    out, back = found[80], found[160]
    assert any(len(one.contacts) for one in found[80:160])
    assert not len(out.contacts)
    assert not len(back.contacts)
    assert error(back.end_wrench, out.end_wrench) < REACHED


def over_moving_beams() -> Tracker:
    """A cable across two rough beams whose edges are sharper than its steps are long."""
    joints = ("across", "prismatic", "0 1 0"), ("along", "prismatic", "1 0 0"), ("turn", "revolute", "0 0 1")
    links = "world", "rail", "slide", "body"
    urdf = "".join(f'<link name="{link}"/>' for link in links) + "".join(
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<axis xyz="{axis}"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        for (name, kind, axis), parent, child in zip(joints, links[:-1], links[1:], strict=True)
    )
    beams = [
        {
            "name": f"beam {k}",
            "box": {"center": [x, 0.0, -0.35], "size": [0.04, 1.0, 0.3]},
            "friction": 0.8,
            "link": "body",
        }
        for k, x in enumerate((-0.1, 0.1))
    ]
    low, high = np.sin(np.pi / 8.0), np.cos(np.pi / 8.0)
    cable = {
        "name": "cable", "length": 1.0, "stiffness": [0.01, 0.01, 0.0075], "linear_density": 0.0051,
        "outer_diameter": 0.01,
        "start": {"position": [-0.3, 0.0, 0.05], "orientation": [0.0, high, 0.0, low]},
        "end": {"position": [0.3, 0.0, 0.05], "orientation": [0.0, low, 0.0, high]},
    }  # fmt: skip
    scene = {"gravity": [0.0, 0.0, -9.81], "obstacles": beams, "cables": [cable]}
    return Tracker(load_scene(scene, urdf=f'<robot name="beams">{urdf}</robot>'))


@pytest.mark.parametrize(("joint", "step"), [("across", 0.005), ("along", 0.001), ("turn", 0.005)])
def test_a_step_over_obstacles_that_move_takes_few_iterations(joint, step, monkeypatch):
    """A tangent step that leaves out the motion of what it slips over took a thousand."""
    steps, advance = [], TouchingRod.advance

    def counted(rod, *arguments):
        steps.append(None)
        return advance(rod, *arguments)

    monkeypatch.setattr(TouchingRod, "advance", counted)
    tracker = over_moving_beams()
    joints = {"across": 0.0, "along": 0.0, "turn": 0.0}
    slid = 0  # poses in which it slips over both
    for k in range(16):
        steps.clear()
        (found,) = tracker.solve({**joints, joint: k * step}).values()
        assert found.status is Status.CONVERGED, found.message
        if slid > 1:  # Newton's method: some iterations, each of which squares the error
            assert found.iterations <= 8 * len(steps)
            assert len(steps) <= 5
        slid += all(contact.sliding for contact in found.contacts)
    assert slid > 5
