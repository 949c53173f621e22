# SPDX-License-Identifier: Apache-2.0
"""The published method: its equations, its convergence and where it ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from baselines.cases import ARM, CABLES
from cable_ros.baselines import bvp, published
from cable_ros.baselines.result import relative_wrench_error


@pytest.fixture(scope="module")
def good_start():
    return bvp.solve_cold(ARM[0].cable, tolerance=1e-6)


TIGHT = published.GaussNewton(step_tolerance=1e-8)


def _force_error(wrench, reference):
    return np.linalg.norm(wrench[:3] - reference[:3]) / np.linalg.norm(reference[:3])


def _dense_jacobian(problem):
    n = problem.parts
    jacobian = np.zeros((7 * n + 11, 7 * n + 7))
    jacobian[:3] = problem.whole[:3]
    jacobian[3:7, :4] = np.eye(4)
    jacobian[7:11, 7 * n : 7 * n + 4] = np.eye(4)
    for part in range(n):
        first = 7 * max(part - 1, 0)
        jacobian[11 + 7 * part : 18 + 7 * part, first : first + 21] += problem.local[part]
    jacobian[11 + 7 * (n - 1)] = problem.whole[3]
    return jacobian


def _random_state(parts, stiffness=CABLES[0].cable.stiffness):
    cable = replace(ARM[0].cable, stiffness=stiffness, load=np.array([0.3, -0.2, -1.0]))
    problem = published.FiniteDifferences(cable, parts)
    x = np.random.default_rng(0).normal(size=(parts + 1, 7))
    v = np.empty(7 * parts + 11)
    problem.residual(x, v)
    problem.linearise(x, v)
    return problem, x, v


@pytest.mark.parametrize("parts", [2, 3, 7])
@pytest.mark.parametrize("stiffness", [ARM[0].cable.stiffness, np.array([1e-3, 2e-3, 0.7e-3])])
def test_jacobian_against_central_differences(parts, stiffness):
    problem, x, v = _random_state(parts, stiffness)
    jacobian = _dense_jacobian(problem)
    step = 1e-6  # truncation step^2, rounding 1e-16 / step, relative to the largest entry
    plus, minus = np.empty_like(v), np.empty_like(v)
    for k in range(x.size):
        shift = np.zeros(x.size)
        shift[k] = step
        problem.residual(x + shift.reshape(x.shape), plus)
        problem.residual(x - shift.reshape(x.shape), minus)
        difference = (plus - minus) / (2 * step)
        np.testing.assert_allclose(jacobian[:, k], difference, atol=1e-8 * np.max(np.abs(jacobian)))


def test_banded_step_is_the_dense_step():
    problem, x, v = _random_state(9)
    jacobian = _dense_jacobian(problem)
    np.testing.assert_allclose(problem.gradient, jacobian.T @ v, rtol=1e-12, atol=1e-12 * np.max(np.abs(v)))
    for mu in (1.0, 1e-3):
        dense = -np.linalg.solve(jacobian.T @ jacobian + mu * np.eye(x.size), jacobian.T @ v)
        # the condition number of J^T J times rounding
        np.testing.assert_allclose(
            problem.damped_step(mu), dense, rtol=1e-6, atol=1e-8 * np.max(np.abs(dense))
        )


def test_residual_vanishes_with_refinement_on_the_true_solution(good_start):
    """The equations are consistent with the rod: inserting its true solution leaves h^1 or less per
    equation.
    """
    true = bvp.solve(ARM[0].cable, good_start, tolerance=1e-9)
    largest = []
    for parts in (40, 80, 160):
        problem = published.FiniteDifferences(ARM[0].cable, parts, true)
        v = np.empty(7 * parts + 11)
        problem.residual(problem.sample(true), v)
        # part 1 aside, where (24) with (25) halves the second difference and leaves an error of order 1
        equations = np.delete(v, np.s_[11:18]).copy()
        equations[11:] /= problem.step
        largest.append(np.max(np.abs(equations[11:-7])))
    orders = np.log2(np.array(largest[:-1]) / largest[1:])
    assert np.all(orders > 0.9)


@pytest.mark.parametrize(("parts", "error"), [(20, 0.21), (40, 0.094), (80, 0.055), (160, 0.033)])
def test_errors_of_a_run_stopped_early(good_start, parts, error):
    """Figures of another write-up of the same formulas, of a run stopped in the flat valley: here 80
    iterations.
    """
    options = published.GaussNewton(damping=1e-3, damping_factor=4.0, max_iterations=80, step_tolerance=0.0)
    result = published.solve(ARM[0].cable, parts, good_start, options)
    # the figures have two digits
    assert _force_error(result.end_wrench, ARM[0].end_wrench) == pytest.approx(error, rel=0.04)


def test_at_rest_the_error_is_of_first_order(good_start):
    errors = []
    for parts in (80, 160, 320, 640):
        result = published.solve(ARM[0].cable, parts, good_start, TIGHT)
        errors.append(relative_wrench_error(result.end_wrench, ARM[0].end_wrench))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 1.0, atol=0.15)


def test_the_start_decides_nothing_at_rest(good_start):
    fine = published.solve(ARM[0].cable, 40, good_start)
    coarse = published.solve(ARM[0].cable, 40, published.solve(ARM[0].cable, 20, good_start))
    # both stop when the step falls below 1e-5 of the unknowns, in a flat valley
    np.testing.assert_allclose(fine.end_wrench, coarse.end_wrench, rtol=1e-2)


def test_a_start_from_ones_wanders(good_start):
    """The paper's start: hundreds of iterations where a good start takes tens."""
    iterations = published.solve(ARM[0].cable, 40, good_start).iterations
    assert published.solve(ARM[0].cable, 40).iterations > 4 * iterations


@pytest.mark.parametrize("case", ARM.values())
def test_other_angles_approach_the_truth(case):
    start = bvp.solve_cold(case.cable, tolerance=1e-6)
    coarse, fine = (published.solve(case.cable, parts, start, TIGHT).end_wrench for parts in (160, 640))
    # four times the parts at first order, with room for what is not yet asymptotic
    assert relative_wrench_error(fine, case.end_wrench) < relative_wrench_error(coarse, case.end_wrench) / 2.5


@pytest.mark.parametrize("case", CABLES)
def test_other_cables_on_a_fine_grid(case):
    result = published.solve(case.cable, 640, bvp.solve_cold(case.cable, tolerance=1e-6))
    # first order, and for the softest one not at rest after 300 iterations: some per cent
    assert relative_wrench_error(result.end_wrench, case.end_wrench) < 0.1


def test_too_few_parts_are_refused(good_start):
    with pytest.raises(ValueError, match="at least 2"):
        published.solve(ARM[0].cable, 1, good_start)
