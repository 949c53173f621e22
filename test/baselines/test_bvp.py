# SPDX-License-Identifier: Apache-2.0
"""solve_bvp on two formulations: the equilibria, the branch and the Jacobians."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.spatial.transform import Rotation

from baselines.cases import ARM, CABLES, arm
from cable_ros.baselines import bvp, bvp_plain
from cable_ros.baselines.result import relative_wrench_error


def _problem(case):
    guess = bvp.solve_cold(case.cable, tolerance=1e-3)
    return bvp._Problem(case.cable, guess)


@pytest.mark.parametrize("case", [*ARM.values(), *CABLES])
def test_cold_start_agrees_with_the_independent_equilibria(case):
    result = bvp.solve_cold(case.cable, tolerance=1e-8)
    assert result.converged
    # the references have about nine digits, the solve asks for eight
    assert relative_wrench_error(result.end_wrench, case.end_wrench) < 1e-7


def test_total_twist_names_the_same_branch():
    case = ARM[0]
    result = bvp.solve_cold(case.cable)
    twist = Rotation.from_quat(result.orientations).inv().apply(result.moment)[:, 2] / case.cable.stiffness[2]
    # trapezoidal rule on some 200 nodes
    assert trapezoid(twist, result.arc_length) == pytest.approx(case.total_twist, abs=1e-3)


def test_whole_turns_give_another_equilibrium():
    case = ARM[0]
    result = bvp.solve_cold(case.cable, turns=-1)
    twist = Rotation.from_quat(result.orientations).inv().apply(result.moment)[:, 2] / case.cable.stiffness[2]
    # the second stable equilibrium of this pose has a total twist of 3.25 rad
    assert trapezoid(twist, result.arc_length) == pytest.approx(3.25, abs=0.01)


@pytest.mark.parametrize("case", [ARM[0], CABLES[0]])
def test_rates_jacobian(case):
    problem = _problem(case)
    s = problem.mesh[::17]
    state, force = problem.states[:, ::17].copy(), problem.end_force.copy()
    by_state, by_force = problem.rates_jacobian(s, state, force)
    step = 1e-6  # central differences: error about step^2 and 1e-16 / step, relative to numbers up to 1e2
    for k in range(10):
        shift = np.zeros((10, 1))
        shift[k] = step
        change = (problem.rates(s, state + shift, force) - problem.rates(s, state - shift, force)) / (
            2 * step
        )
        np.testing.assert_allclose(by_state[:, k], change, atol=1e-7)
    for k in range(3):
        shift = np.eye(3)[k] * step
        change = (problem.rates(s, state, force + shift) - problem.rates(s, state, force - shift)) / (
            2 * step
        )
        np.testing.assert_allclose(by_force[:, k], change, atol=1e-7)


def test_warm_start_stays_on_the_branch_and_forgets_the_guess():
    result = bvp.solve_cold(ARM[0].cable, tolerance=1e-6)
    for degrees in range(5, 50, 5):
        result = bvp.solve(arm(np.radians(degrees)), result, tolerance=1e-8)
    # same equilibrium as a reference that never saw the other angles
    assert relative_wrench_error(result.end_wrench, ARM[45].end_wrench) < 1e-7


def test_statics_of_the_whole_cable():
    case = CABLES[0]
    result = bvp.solve_cold(case.cable, tolerance=1e-8)
    # (8): clamp forces and weight balance; the integral is exact for a constant load
    np.testing.assert_allclose(
        result.force[0], result.force[-1] + case.cable.load * case.cable.length, rtol=1e-9
    )
    weight_moment = trapezoid(
        np.cross(result.points - result.points[-1], case.cable.load), result.arc_length, axis=0
    )
    moment = result.moment[-1] + np.cross(result.points[-1] - result.points[0], result.force[-1])
    arm = np.cross(result.points[-1] - result.points[0], case.cable.load * case.cable.length)
    # (9) about the start; trapezoidal rule on a few hundred nodes
    scale = np.linalg.norm(result.moment[0])
    np.testing.assert_allclose(result.moment[0], moment + weight_moment + arm, atol=1e-4 * scale)


def test_written_plainly_it_says_the_same():
    guess = bvp.solve_cold(ARM[0].cable, tolerance=1e-6)
    for degrees in (2, 4):
        cable = arm(np.radians(degrees))
        plain = bvp_plain.solve(cable, guess, tolerance=1e-8)
        guess = bvp.solve(cable, guess, tolerance=1e-8)
        assert plain.converged
        # both ask for eight digits of the residual
        assert relative_wrench_error(plain.end_wrench, guess.end_wrench) < 1e-7
        ends = [plain.force[[0, -1]], plain.moment[[0, -1]]]
        for one, other in zip(ends, [guess.force[[0, -1]], guess.moment[[0, -1]]], strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-7 * np.abs(other).max())


def test_written_plainly_it_says_when_it_fails():
    guess = bvp.solve_cold(ARM[0].cable, tolerance=1e-3)
    result = bvp_plain.solve(arm(0.5), guess, tolerance=1e-8, max_nodes=30)
    assert not result.converged
    assert np.isnan(result.end_wrench).all()
