# SPDX-License-Identifier: Apache-2.0
"""Slip that turns: friction at a step's end is that of the end, not that of the middle."""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros import Tracker
from cable_ros.bench.cases import case_scene
from cable_ros.bench.drawn import drawn_case, refined
from cable_ros.contact.contact_state import History, surface
from cable_ros.contact.distance import WIDTH
from cable_ros.contact.friction_kernels import (
    ACROSS,
    COULOMB,
    DIRECTION,
    STIFFNESS,
    TANGENT,
    TURNS,
    lead,
    stick_stiffness,
    update_friction,
)
from cable_ros.contact.points import (
    BEFORE,
    COLUMNS,
    FORCE,
    FRICTION,
    KIND,
    LENGTH,
    POINT,
    SAMPLE,
    SLIP,
    SLIP_BEFORE,
    SLIPS,
    STEP_BEFORE,
)
from cable_ros.contact.slip_kernels import FOLLOWED, note_slip, slip_bend, slip_missed

NORMAL = np.array([0.0, 0.0, 1.0])


def at(angle: float) -> np.ndarray:
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def led(
    mean: np.ndarray,
    before: np.ndarray,
    slid: np.ndarray | None = None,
    long: float = 1.0,
    ratio: float = 1.0,
) -> tuple[np.ndarray, float]:
    """The direction of friction at the end of a step, and its turn over that of the mean one.

    `before`: friction at its beginning; `slid`: slip in the step before, None: it stuck. This one is `long`,
    in a step that is `ratio` times as long.
    """
    direction, slips = mean.copy(), (np.zeros(3) if slid is None else slid.copy(), -long * mean)
    by_turn, _ = lead(direction, before, slips, NORMAL, 1.0, ratio)
    return direction, by_turn


def lag(turn: float, ratio: float) -> float:
    """By how much friction lags behind slip along a circle by `turn` a step, every second `ratio` as long."""
    angle, friction, slid, before = 0.0, at(0.0), None, turn
    for step in range(40):
        size = turn * (ratio if step % 2 else 1.0)
        mean = at(angle + 0.5 * size)
        friction, _ = led(mean, friction, slid, size, size / before)
        angle, slid, before = angle + size, -size * mean, size
    return angle - float(np.unwrap([angle, float(np.arctan2(friction[1], friction[0]))])[1])


@pytest.mark.parametrize("ratio", [0.2, 1.0])
def test_slip_that_turns_steadily_is_followed_to_third_order(ratio: float) -> None:
    """The mean direction lags by half a turn. What is left is of the cosine by which the lead fades."""
    coarse, fine = lag(0.2, ratio), lag(0.1, ratio)
    assert coarse < 0.02
    assert np.log2(coarse / fine) == pytest.approx(3.0, abs=0.2)


@pytest.mark.parametrize("long", [0.02, 50.0])
def test_a_slip_that_begins_or_ends_leads_nowhere(long: float) -> None:
    """A slip a fiftieth as fast as the other, before or after it, says nothing of how that turns."""
    direction, _ = led(at(0.5), at(0.0), -at(0.0), long)
    assert np.arctan2(direction[1], direction[0]) == pytest.approx(0.5, abs=0.01)
    # as fast a slip in a step that is as much shorter or longer is led on
    direction, _ = led(at(0.2), at(0.0), -at(0.0), long, ratio=long)
    assert np.arctan2(direction[1], direction[0]) > (0.203 if long < 1.0 else 0.35)


def test_the_first_slip_lags_by_a_quarter() -> None:
    """Friction of what stuck tells where slip began: half of the turn from there is followed."""
    friction, _ = led(at(0.05), at(0.0))
    assert np.arctan2(friction[1], friction[0]) == pytest.approx(0.075, rel=0.02)


@pytest.mark.parametrize("slid", [None, -at(0.0)])
@pytest.mark.parametrize("corner", [1.2, 0.5 * np.pi, np.pi])
def test_at_a_corner_slip_goes_where_it_went(corner: float, slid: np.ndarray | None) -> None:
    direction, by_turn = led(at(corner), at(0.0), slid)
    assert np.abs(direction - at(corner)).max() < 1e-3
    assert by_turn == pytest.approx(1.0, abs=3e-3)  # the lead fades there


def test_what_did_not_rub_does_not_turn_slip() -> None:
    direction, by_turn = led(at(0.3), np.zeros(3))
    assert (direction == at(0.3)).all()
    assert by_turn == 1.0


def slipped(slip: float, slid: float, turn: float = 0.0, curve: float = 0.0) -> np.ndarray:
    """(1, COLUMNS) a point that slipped `slid` in a step of length 1 along a way that is curved by `curve`,
    and then `slip`; by its end the way has turned by `turn` more than that.
    """
    points = np.zeros((1, COLUMNS))
    points[0, SLIP_BEFORE : SLIP_BEFORE + 3] = slid * at(0.0)
    points[0, STEP_BEFORE], points[0, SLIPS] = 1.0, 1.0
    begun = 0.5 * slid * curve
    points[0, SLIP : SLIP + 3] = slip * at(begun + 0.5 * (slip * curve + turn))
    points[0, BEFORE : BEFORE + 3] = -at(begun)
    points[0, FRICTION : FRICTION + 3] = -at(begun + slip * curve + turn)
    return points


@pytest.mark.parametrize("step", [0.5, 1.0, 3.0])
def test_what_slows_down_evenly_stops_where_its_speed_is_zero(step: float) -> None:
    """Its speed, 1 at first, falls with the path to 0 at `rest`; the step before ends at 1."""
    for rest in (1.0 + 0.99 * step, 1.0 + 1.01 * step):
        slid = 1.0 - 0.5 / rest
        slip = (1.0 + step) * (1.0 - 0.5 * (1.0 + step) / rest) - slid
        assert (slip_missed(slipped(slip, slid), 1, step) > 0.0) == (rest < 1.0 + step)
    stuck = slipped(1.0, 0.7)
    stuck[0, SLIPS] = 0.0
    # slowing down evenly from 0.7 in a step of 1 it might have slipped half of that on
    assert slip_missed(stuck, 1, step) == pytest.approx(0.35 * step)
    assert slip_missed(slipped(1.0, 0.0), 1, step) == 0.0


def test_a_way_that_goes_on_turning_counts_little_and_what_it_turns_otherwise_all() -> None:
    steady, counted = slip_bend(slipped(0.1, 0.2, 0.0, 0.3), 1)
    assert steady < 1.01 * (0.1 * 0.3) ** 2  # of second order in the turn
    assert counted == pytest.approx(FOLLOWED * 0.1 * 0.3, rel=0.01)
    for slid, curve in ((0.2, 0.3), (0.0, 0.0)):
        unforeseen, counted = slip_bend(slipped(0.1, slid, 0.05, curve), 1)
        assert unforeseen == counted == pytest.approx(0.05, rel=0.02)


def test_only_what_slips_remembers_it() -> None:
    points = np.repeat(slipped(0.1, 0.2, 0.05, 0.3), 3, axis=0)
    points[1, SLIPS], points[2, KIND] = 0.0, SAMPLE
    note_slip(points, 3, 0.7)
    kept = points[:, SLIP_BEFORE : SLIP_BEFORE + 3]
    assert (kept[[0, 2]] == points[0, SLIP : SLIP + 3]).all()
    assert not kept[1].any()
    assert (points[:, STEP_BEFORE] == 0.7).all()


def history(step: float = 1e-3) -> History:
    """Of a step of that length, L."""
    last = *np.zeros((2, 1, 1, 3)), np.zeros(1), np.zeros(1), np.zeros((1, WIDTH))
    return History(COULOMB, np.zeros(3), 0.0, 1e8, False, step, *last)


def rubbed(
    kind: float, step: np.ndarray, slid: np.ndarray, history: History
) -> tuple[np.ndarray, np.ndarray]:
    """Friction (3,) and its tangent of a point that slips by `step`, its friction before at the angle 0.1.

    `slid`: slip in the step before, which was 2e-3 L long.
    """
    points, tangent = np.zeros((1, COLUMNS)), np.empty(TANGENT)
    points[0, KIND], points[0, SLIPS], points[0, FORCE], points[0, STEP_BEFORE] = kind, 1.0, 1.0, 2e-3
    points[0, LENGTH] = 0.01 if kind == SAMPLE else 0.0
    points[0, FRICTION : FRICTION + 3] = before = -0.3 * at(0.1)
    increment, there = (step, before, slid.copy(), False), surface()._replace(n=NORMAL, t=at(0.5))
    stiffness = stick_stiffness(points[0], 0.3, history)
    update_friction(points, 0, there, 0.3, history, stiffness, increment, tangent)
    return points[0, FRICTION : FRICTION + 3], tangent


@pytest.mark.parametrize(("slid", "step", "turn"), [(8e-4, 1e-3, 0.26), (0.0, 1e-3, 0.2), (8e-4, 0.0, 0.2)])
def test_along_a_patch_slip_turns_on_where_it_slipped(slid: float, step: float, turn: float) -> None:
    """By a third of the turn since the middle of a step twice as long, less what fades.

    Not where it begins to slip, and not where only the mesh has changed.
    """
    friction, _ = rubbed(SAMPLE, 4e-4 * at(0.2), slid * at(0.0), history(step))
    assert np.arctan2(-friction[1], -friction[0]) == pytest.approx(turn, abs=0.005)


@pytest.mark.parametrize("kind", [POINT, SAMPLE])
@pytest.mark.parametrize("slid", [0.0, 3e-4, 3e-3])
@pytest.mark.parametrize("turn", [-0.8, 0.1, 0.4])
def test_tangent_of_slip_against_differences(kind: float, slid: float, turn: float) -> None:
    """Slip across turns the force, and so does slip along, by how far it is led on."""
    small, step = 1e-9, 1e-3 * at(turn)
    _, tangent = rubbed(kind, step, slid * at(0.0), history())
    exact = -tangent[STIFFNESS] * np.outer(tangent[ACROSS:STIFFNESS], tangent[TURNS:TANGENT])
    for axis in np.eye(3)[:2]:
        ahead, behind = (
            rubbed(kind, step + sign * small * axis, slid * at(0.0), history())[0] for sign in (1.0, -1.0)
        )
        # differences of forces of 0.3 over 2e-9 are good to 1e-7 of the largest slope, 300
        np.testing.assert_allclose((ahead - behind) / (2.0 * small), exact @ axis, atol=1e-4)


@pytest.mark.parametrize(("moved", "slips"), [(1e-4, True), (1e-8, False)])
def test_what_lands_slips_with_its_friction_at_once(moved: float, slips: bool) -> None:
    """Pressed by nothing yet, friction per force is against the motion, unless its direction is rounding."""
    points, tangent, step = np.zeros((1, COLUMNS)), np.empty(TANGENT), moved * at(2.0) - 1e-3 * NORMAL
    there = surface()._replace(n=NORMAL, t=at(0.5))
    update_friction(points, 0, there, 0.3, history(), 1e8, (step, *np.zeros((2, 3)), False), tangent)
    assert bool(points[0, SLIPS]) == slips
    against = tangent[DIRECTION : DIRECTION + 3]
    np.testing.assert_allclose(against, -at(2.0) if slips else np.zeros(3), atol=1e-12)


def test_two_points_of_which_one_sticks_and_one_turns() -> None:
    """A cable in a corner, turned by 22.5 degrees a pose, against itself in 32 times as many: 7 % apart where
    friction had the mean direction of each step.
    """
    case = drawn_case(139, 42, 1e-4)
    path = case.path[:7]

    def end_force(parts: int) -> np.ndarray:
        tracker = Tracker(case_scene(case), tolerance=case.tolerance)
        for pose in refined(path, parts):
            (found,) = tracker.arrive(pose).values()
        assert found.status.trusted, found.message
        return found.end_wrench[:3]

    exact = end_force(32)
    off = np.linalg.norm(end_force(1) - exact) / np.linalg.norm(exact)
    assert off < 0.03
