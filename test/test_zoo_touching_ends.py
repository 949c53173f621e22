# SPDX-License-Identifier: Apache-2.0
"""Every hard case of ends that meet obstacles: there and back, in any number of steps, none inside of any."""

from __future__ import annotations

import numpy as np
import pytest
from zoo_supports import Answers
from zoo_touching_ends import CASES

from cable_ros.equilibrium import Equilibrium

TOLERANCE = 1e-5
SAME = 2e-5
"""Largest difference of wrenches that agree, over their largest component: that of two solves."""


@pytest.fixture(scope="module", params=CASES, ids=lambda case: case.name)
def answers(request):
    return Answers(request.param, TOLERANCE)


def agree(one: Equilibrium, two: Equilibrium) -> None:
    mine, theirs = (np.stack([found.start_wrench, found.end_wrench]) for found in (one, two))
    np.testing.assert_allclose(mine, theirs, atol=SAME * np.abs(theirs).max())
    np.testing.assert_allclose(one.points, two.points, atol=10 * TOLERANCE)


def test_there_and_back_it_is_as_before(answers):
    found = answers.there_and_back
    for k in range(16):
        agree(found[-1 - k], found[k])
    assert any(one.contacts for one in found)
    for one in found:
        assert all(point.force @ point.normal >= 0.0 for point in one.contacts)


def test_two_eight_or_sixteen_steps_lead_to_one_answer(answers):
    few, some, many = answers.in_steps()
    agree(few, many)
    agree(some, many)


def test_the_twelfth_digit_of_a_joint_hardly_matters(answers):
    agree(*answers.beside())


def test_nothing_of_it_is_inside_of_an_obstacle(answers):
    case = answers.case
    (obstacle,) = case.scene["obstacles"]
    cold = [(part, *case.led(np.array([part]), TOLERANCE)) for part in (0.5, 1.0)]
    for part, found in [*zip(answers.EIGHT, answers.in_eight, strict=True), *cold]:
        points = found.points - case.to * part * ("link" in obstacle)
        assert _outside(obstacle, points).min() > 0.005 - 1e-5


def _outside(obstacle: dict, points: np.ndarray) -> np.ndarray:
    """(n,) distances of points from an obstacle's surface."""
    if "sphere" in obstacle:
        ball = obstacle["sphere"]
        return np.linalg.norm(points - ball["center"], axis=1) - ball["radius"]
    if "plane" in obstacle:
        return (points - obstacle["plane"]["point"]) @ np.array(obstacle["plane"]["normal"])
    box = obstacle["box"]
    beyond = np.abs(points - box["center"]) - 0.5 * np.array(box["size"])
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)
