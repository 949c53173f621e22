# SPDX-License-Identifier: Apache-2.0
"""The published method with a ball: its equations, and what the contact does."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.cases import arm
from cable_ros.baselines import bvp, published
from cable_ros.baselines.published_contact import SphereDifferences, lifted, middle, solve_contact, touching
from cable_ros.scene.obstacles import Sphere

BALL = Sphere(np.array([0.092, 0.010, -0.095]), 0.045)


@pytest.fixture(scope="module")
def starts():
    """Free equilibria of the arm's cable, led there from 0."""
    result = bvp.solve_cold(arm(0.0), tolerance=1e-4)
    found = {}
    for degrees in range(5, 80, 5):
        result = found[degrees] = bvp.solve(arm(np.radians(degrees)), result, tolerance=1e-4)
    return found


def problem(friction, nodes=(3, 4, 5), parts=8):
    free = published.FiniteDifferences(arm(1.0), parts)
    return SphereDifferences(free, BALL, np.array(nodes), friction)


@pytest.mark.parametrize("friction", [0.0, 0.35, -0.35])
def test_jacobian_against_central_differences(friction):
    case = problem(friction)
    x = np.random.default_rng(0).normal(size=7 * 9 + 3)
    v = np.empty(case.rows)
    case.residual(x, v)
    case.linearise(x, v)
    jacobian, gradient = case.jacobian.copy(), case.gradient.copy()
    assert gradient == pytest.approx(jacobian.T @ v)
    plus, minus = np.empty_like(v), np.empty_like(v)
    for k in range(len(x)):
        shift = np.zeros_like(x)
        shift[k] = 1e-6  # truncation step^2, rounding 1e-16 / step, relative to the largest entry
        case.residual(x + shift, plus)
        case.residual(x - shift, minus)
        assert jacobian[:, k] == pytest.approx((plus - minus) / 2e-6, abs=1e-8 * np.abs(jacobian).max())


def test_without_contact_forces_the_rod_is_the_free_one():
    case = problem(0.35)
    x = np.random.default_rng(1).normal(size=7 * 9 + 3)
    x[-3:] = 0.0
    v, free = np.empty(case.rows), np.empty(case.free.rows)
    case.residual(x, v)
    case.free.residual(x[:-3].reshape(-1, 7), free)
    assert np.array_equal(v[: len(free)], free)
    # (56) is satisfied by a force of 0, (55) is not: it fixes the middle node whatever the force
    assert v[len(free) :][[0, 2]] == pytest.approx(0.0, abs=0.0)
    assert v[len(free) + 1] > 0


def test_contact_force_acts_along_the_radius_and_friction_across_cable_and_radius():
    x = np.random.default_rng(2).normal(size=7 * 9 + 3)
    x[: 7 * 9].reshape(-1, 7)[:, :4] /= np.linalg.norm(x[: 7 * 9].reshape(-1, 7)[:, :4], axis=1)[:, None]
    x[-3:] = 0.7, 0.0, 0.0
    loads = {}
    for friction in (0.0, 0.35):
        case = problem(friction)
        with_force, without = np.empty(case.rows), np.empty(case.rows)
        case.residual(x, with_force)
        case.residual(np.concatenate([x[:-3], np.zeros(3)]), without)
        row = 11 + 7 * (3 - 1) + 1  # the force balance of the part that ends at node 3
        loads[friction] = (with_force - without)[row : row + 3] / case.free.step
        assert np.count_nonzero((with_force - without)[: case.free.rows]) == 3
    p1, p2, _, _ = case._geometry()
    assert np.linalg.norm(loads[0.0]) == pytest.approx(0.7 * np.linalg.norm(p2[0]))
    friction = loads[0.35] - loads[0.0]
    assert friction @ loads[0.0] == pytest.approx(0.0, abs=1e-12)
    assert np.linalg.norm(friction) == pytest.approx(0.35 * 0.7 * np.linalg.norm(np.cross(p1[0], p2[0])))


@pytest.mark.parametrize(("nodes", "chosen"), [([4], 4), ([4, 5], 5), ([4, 5, 6], 5), ([4, 5, 6, 7], 6)])
def test_middle_node_is_the_farther_of_two(nodes, chosen):
    assert middle(nodes) == chosen


def test_nodes_inside_the_sphere():
    points = BALL.center + np.array([[0.0, 0, 0], [0.044, 0, 0], [0, 0.046, 0], [0, 0, 0.0449]])
    assert touching(points, BALL).tolist() == [1, 3]  # the first node is the clamp


def test_fitted_points_are_lifted_to_the_surface_and_no_others_moved():
    points = BALL.center + np.array([[0.01, 0.02, 0.03], [0.01, 0.0, -0.02], [0.0, 0.0, 0.05]])
    moved = lifted(points, BALL)
    assert np.linalg.norm(moved[:2] - BALL.center, axis=1) == pytest.approx(BALL.radius)
    assert np.array_equal(moved[:, :2], points[:, :2])
    assert moved[1, 2] < BALL.center[2]
    assert np.array_equal(moved[2], points[2])


def test_clear_cable_is_the_free_solution(starts):
    cable = arm(np.radians(30))
    options = published.GaussNewton(step_tolerance=1e-3)
    with_ball = solve_contact(cable, BALL, 40, starts[30], options=options)
    assert with_ball.middle == -1
    assert with_ball.total_force == 0.0
    free = published.solve(cable, 40, starts[30], options)
    assert np.array_equal(with_ball.rod.end_wrench, free.end_wrench)


@pytest.mark.parametrize("degrees", [60, 75])
def test_touching_cable_lies_on_the_ball_and_pulls_less_at_its_end(starts, degrees):
    cable = arm(np.radians(degrees))
    touched = solve_contact(cable, BALL, 20, starts[degrees])
    assert touched.rod.converged
    assert touched.middle in touched.nodes
    free = published.solve(cable, 20, starts[degrees])
    depth = BALL.radius - np.linalg.norm(free.points - BALL.center, axis=1).min()
    gap = np.linalg.norm(touched.rod.points[touched.middle] - BALL.center) - BALL.radius
    # the least squares leave some of the gap, as the paper's do: a tenth of how deep the free cable runs
    assert abs(gap) < 0.1 * depth
    assert touched.total_force > 0
    # the paper: with the ball the force at the end is smaller
    assert np.linalg.norm(touched.rod.end_wrench[:3]) < np.linalg.norm(free.end_wrench[:3])
