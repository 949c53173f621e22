# SPDX-License-Identifier: Apache-2.0
"""Every hard case of pins, rings and tubes: by shooting, there and back, in any number of steps, mirrored."""

from __future__ import annotations

import numpy as np
import pytest
from references import supported
from zoo_supports import CASES, FLIP, Answers, Case, frame

from cable_ros.equilibrium import Equilibrium

TOLERANCE = 1e-8
SAME = 1e-6
"""Largest difference of wrenches that agree, over their largest component: that of two solves, and 50 times
as much for a taut cable."""


@pytest.fixture(scope="module", params=CASES, ids=lambda case: case.name)
def answers(request):
    return Answers(request.param, TOLERANCE)


def wrenches(found: Equilibrium) -> np.ndarray:
    """(n + 2, 6) of start, end and supports."""
    return np.stack([found.start_wrench, found.end_wrench, *found.support_wrenches.values()])


def agree(one: Equilibrium, two: Equilibrium, tolerance: float = SAME) -> None:
    sizes = np.abs(wrenches(two)).max(axis=0)
    np.testing.assert_allclose(wrenches(one) / sizes.max(), wrenches(two) / sizes.max(), atol=tolerance)


def test_it_is_that_of_shooting(answers):
    case = answers.case
    one = case.tracker(TOLERANCE)
    for part in np.linspace(0.0, case.shot, 9):
        found = one.arrive(case.joints(part))["c"]
    cable = case.fixed(case.shot)
    there = Case(case.name, {"cables": [cable]}, case.to)
    start, end, *inner = there.mounts()
    mine = [
        -frame(mount).apply(wrench.reshape(2, 3)).ravel()
        for mount, wrench in ((start, found.start_wrench), (end, found.end_wrench))
    ]
    kinds = [kind for entry in cable["supports"] for kind in entry if kind != "name"]
    held = [
        supported.Held(
            np.array(mount["position"]), kind != "pin", tube=frame(mount) if kind == "tube" else None
        )
        for mount, kind in zip(inner, kinds, strict=True)
    ]
    given = list(found.support_wrenches.values())
    forces = np.array([-frame(mount).apply(wrench[:3]) for mount, wrench in zip(inner, given, strict=True)])
    moments = -np.array(given)[:, 3:]
    guess = supported.Solution(mine[0], mine[1], forces, one._coupled[0].arcs.copy(), moments)
    exact = supported.solve(cable, np.array([0.0, 0.0, -10.0]), held, guess)
    for name in ("start", "end", "forces", "moments"):
        ours, true = getattr(guess, name), getattr(exact, name)
        size = np.abs(exact.forces).max()
        np.testing.assert_allclose(ours, true, atol=SAME * size, err_msg=name)
    np.testing.assert_allclose(guess.arcs, exact.arcs, atol=1e-8)


def test_there_and_back_it_is_as_before(answers):
    found = answers.there_and_back
    for k in range(16):
        agree(found[-1 - k], found[k])
        assert found[-1 - k].total_twist == pytest.approx(found[k].total_twist, abs=1e-6)


def test_two_eight_or_sixteen_steps_lead_to_one_answer(answers):
    few, some, many = answers.in_steps()
    agree(few, many)
    agree(some, many)


def test_the_twelfth_digit_of_a_joint_hardly_matters(answers):
    agree(*answers.beside())


def test_its_mirror_image_has_mirrored_wrenches(answers):
    mirrored = Answers(answers.case.mirrored(), TOLERANCE)
    for plain, image in zip(answers.in_eight, mirrored.in_eight, strict=True):
        mirror = np.kron(np.diag([1.0, -1.0]), FLIP)  # moments are axial vectors
        size = np.abs(wrenches(plain)).max()
        np.testing.assert_allclose(wrenches(image) @ mirror, wrenches(plain), atol=SAME * size)
        assert image.total_twist == pytest.approx(-plain.total_twist, abs=1e-6)
        np.testing.assert_allclose(image.points @ FLIP, plain.points, atol=1e-7)
