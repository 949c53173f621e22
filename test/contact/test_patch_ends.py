# SPDX-License-Identifier: Apache-2.0
"""How the ends of a patch are moved to where no couple holds them."""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros.contact import patch_ends
from cable_ros.contact.points import ARC_LENGTH, CAPACITY, COLUMNS, FORCE, KIND, LAST, SLOPE_ROW, WENT

move_ends = patch_ends.move_ends
SPACING, PLACE = 0.025, 0.5


def led_to(ratio: float, smooth: bool, iterations: int) -> float:
    """How far from its place an end is that a couple would move by (1 - ratio) times that in each iteration.

    So it would go a part `ratio` of its last motion in each, or back if that is negative.
    """
    points, y = np.zeros((CAPACITY, COLUMNS)), np.zeros(4)
    points[0, KIND], points[0, ARC_LENGTH], points[0, FORCE], points[0, SLOPE_ROW] = LAST, 0.51, 2.0, 3
    for _ in range(iterations):
        y[3] = points[0, FORCE] * (1.0 - ratio) * (PLACE - points[0, ARC_LENGTH])
        move_ends.py_func(points, 1, y, SPACING, smooth, False)
    return abs(points[0, ARC_LENGTH] - PLACE)


@pytest.mark.parametrize("ratio", [0.62, -0.62, -0.9, -1.3])
def test_the_limit_of_a_geometric_series(ratio: float) -> None:
    """An end that comes on by a part, or swings, is sent to where that would lead in the end."""
    assert led_to(ratio, True, 2) < 1e-12


def test_what_rubs_may_swing_for_another_reason() -> None:
    assert led_to(-0.62, False, 2) == pytest.approx(0.01 * 0.62**2)


def test_few_iterations_as_they_are() -> None:
    """Newton's method that converges fast is left alone."""
    assert led_to(-0.1, True, 2) == pytest.approx(0.01 * 0.1**2)


@pytest.mark.parametrize(("calm", "moved"), [(True, 2e-3), (False, 0.5 * SPACING)])
def test_an_end_whose_force_vanishes_stays_where_it_does(calm: bool, moved: float) -> None:
    """It went out by 8e-3 L, and its force from 3 to -1. By half a spacing it would go to and fro."""
    points, y = np.zeros((CAPACITY, COLUMNS)), np.zeros(5)
    points[0, KIND], points[0, ARC_LENGTH], points[0, SLOPE_ROW] = LAST, PLACE, 4
    points[0, FORCE], points[0, WENT], y[3] = -1.0, 8e-3, -4.0
    move_ends.py_func(points, 1, y, SPACING, calm, calm)
    assert points[0, ARC_LENGTH] == pytest.approx(PLACE - moved)
    assert points[0, WENT] == pytest.approx(-moved)
