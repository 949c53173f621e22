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
from cable_ros.contact.friction_kernels import COULOMB, DIRECTION, TANGENT, lead, update_friction
from cable_ros.contact.points import COLUMNS, SLIPS

NORMAL = np.array([0.0, 0.0, 1.0])


def at(angle: float) -> np.ndarray:
    return np.array([np.cos(angle), np.sin(angle), 0.0])


def led(mean: np.ndarray, before: np.ndarray) -> tuple[np.ndarray, float]:
    """The direction at the end of a step, and by how much more it turns than the mean one."""
    direction = mean.copy()
    return direction, lead(direction, before, NORMAL, 1.0)


@pytest.mark.parametrize("turn", [0.01, 0.1, 0.2])
def test_slip_that_turns_steadily_lags_by_a_sixth_of_a_step(turn: float) -> None:
    friction = at(0.0)
    for step in range(40):
        friction, _ = led(at((step + 0.5) * turn), friction)
    lag = 40 * turn - np.unwrap([39.5 * turn, float(np.arctan2(friction[1], friction[0]))])[1]
    # the power of the cosine takes a little of it, by the square of the turn
    assert lag == pytest.approx(turn / 6.0, rel=0.01 + 4.0 * turn**2)


@pytest.mark.parametrize("corner", [1.2, 0.5 * np.pi, np.pi])
def test_at_a_corner_slip_goes_where_it_went(corner: float) -> None:
    direction, factor = led(at(corner), at(0.0))
    assert np.abs(direction - at(corner)).max() < 1e-3
    assert factor == pytest.approx(1.0, abs=1e-3)


def test_what_did_not_rub_does_not_turn_slip() -> None:
    direction, factor = led(at(0.3), np.zeros(3))
    assert (direction == at(0.3)).all()
    assert factor == 1.0


def test_how_much_more_it_turns() -> None:
    """The factor is the derivative across, where the part of the turn that follows does not change itself."""
    small = 1e-6
    (ahead, factor), (behind, _) = (led(at(sign * small), at(0.0)) for sign in (1.0, -1.0))
    assert (ahead - behind)[1] / (2.0 * small) == pytest.approx(factor, rel=1e-6)


@pytest.mark.parametrize(("moved", "slips"), [(1e-4, True), (1e-8, False)])
def test_what_lands_slips_with_its_friction_at_once(moved: float, slips: bool) -> None:
    """Pressed by nothing yet, friction per force is against the motion, unless its direction is rounding."""
    points, tangent, step = np.zeros((1, COLUMNS)), np.empty(TANGENT), moved * at(2.0) - 1e-3 * NORMAL
    there, curves = surface()._replace(n=NORMAL, t=at(0.5)), np.zeros((2, 1, 1, 3))
    last = *curves, np.zeros(1), np.zeros(1), np.zeros((1, WIDTH))
    history = History(COULOMB, np.zeros(3), 0.0, 1.0, *last)
    update_friction(points, 0, there, 0.3, history, 1e8, (step, np.zeros(3), False), tangent)
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
