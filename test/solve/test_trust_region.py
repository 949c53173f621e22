# SPDX-License-Identifier: Apache-2.0
"""The trust region on small problems with minima known by hand, and what it does where there is none."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from cable_ros.equilibrium import Status
from cable_ros.solve.trust_region import Minimum, Options, minimize


class Dense:
    """A problem with dense algebra and derivatives by hand; remembers what was tried and accepted."""

    def __init__(self, objective, gradient, hessian, constraint=None, jacobian=None, curvature=None) -> None:
        self.f, self.df, self.ddf = objective, gradient, hessian
        self.c = constraint or (lambda x: np.zeros(0))
        self.dc = jacobian or (lambda x: np.zeros((0, len(x))))
        self.ddc = curvature or (lambda x: np.zeros((0, len(x), len(x))))
        self.tried: list[np.ndarray] = []
        self.accepted: list[np.ndarray] = []

    def value(self, x):
        self.tried.append(x)
        return float(self.f(x)), np.asarray(self.c(x), float)

    def linearize(self, x, y):
        self.accepted.append(x)
        self.C = np.asarray(self.dc(x), float)
        self.H = np.asarray(self.ddf(x), float) - np.tensordot(y, self.ddc(x), 1)
        return float(self.f(x)), np.asarray(self.c(x), float), np.asarray(self.df(x)) - y @ self.C

    def factor(self, mu):
        H = self.H + mu * np.eye(len(self.H))
        rows = len(self.C)
        self.saddle = np.block([[H, -self.C.T], [self.C, np.zeros((rows, rows))]])
        _, sizes, basis = np.linalg.svd(self.C)
        tangent = basis[rows:]
        return bool(
            sizes.min(initial=1.0) > 1e-12
            and np.linalg.eigvalsh(tangent @ H @ tangent.T).min(initial=np.inf) > 1e-12
        )

    def step(self, gradient, constraints):
        right = -np.concatenate([gradient, constraints])
        try:
            both = np.linalg.solve(self.saddle, right)
        except np.linalg.LinAlgError:
            both = np.full_like(right, np.nan)
        return both[: len(gradient)], both[len(gradient) :]

    def normal_step(self, constraints):
        return -np.linalg.lstsq(self.C, constraints, rcond=None)[0]

    def apply_hessian(self, s):
        return self.H @ s

    def derivative(self, s):
        return self.C @ s

    def norm(self, s):
        return float(np.linalg.norm(s))

    def retract(self, x, s):
        return x + s


def rosenbrock() -> Dense:
    return Dense(
        lambda x: 100 * (x[1] - x[0] ** 2) ** 2 + (1 - x[0]) ** 2,
        lambda x: [-400 * x[0] * (x[1] - x[0] ** 2) - 2 * (1 - x[0]), 200 * (x[1] - x[0] ** 2)],
        lambda x: [[1200 * x[0] ** 2 - 400 * x[1] + 2, -400 * x[0]], [-400 * x[0], 200]],
    )


def two_wells() -> Dense:
    """(x^2 - 1)^2 + y^2: minima at (1, 0) and (-1, 0), a saddle between."""
    return Dense(
        lambda x: (x[0] ** 2 - 1) ** 2 + x[1] ** 2,
        lambda x: [4 * x[0] * (x[0] ** 2 - 1), 2 * x[1]],
        lambda x: [[12 * x[0] ** 2 - 4, 0], [0, 2]],
    )


def on_circle(radius: float = np.sqrt(2.0)) -> Dense:
    """x + y on a circle: least at (-1, -1) radius / sqrt 2 with the multiplier -1 / (radius sqrt 2)."""
    return Dense(
        lambda x: x[0] + x[1],
        lambda x: [1.0, 1.0],
        lambda x: np.zeros((2, 2)),
        lambda x: [x @ x - radius**2],
        lambda x: [2 * x],
        lambda x: [2 * np.eye(2)],
    )


def parabola() -> Dense:
    """(1 - x)^2 on 10 (y - x^2) = 0 (problem 6 of Hock and Schittkowski): (1, 1)."""
    return Dense(
        lambda x: (1 - x[0]) ** 2,
        lambda x: [-2 * (1 - x[0]), 0],
        lambda x: [[2, 0], [0, 0]],
        lambda x: [10 * (x[1] - x[0] ** 2)],
        lambda x: [[-20 * x[0], 10]],
        lambda x: [[[-20, 0], [0, 0]]],
    )


def logarithm() -> Dense:
    """ln(1 + x^2) - y on (1 + x^2)^2 + y^2 = 4 (problem 7 of Hock and Schittkowski): (0, sqrt 3)."""
    return Dense(
        lambda x: np.log(1 + x[0] ** 2) - x[1],
        lambda x: [2 * x[0] / (1 + x[0] ** 2), -1],
        lambda x: [[2 * (1 - x[0] ** 2) / (1 + x[0] ** 2) ** 2, 0], [0, 0]],
        lambda x: [(1 + x[0] ** 2) ** 2 + x[1] ** 2 - 4],
        lambda x: [[4 * x[0] * (1 + x[0] ** 2), 2 * x[1]]],
        lambda x: [[[4 + 12 * x[0] ** 2, 0], [0, 2]]],
    )


def run(problem: Dense, start, multipliers=(), **options) -> Minimum:
    return minimize(problem, np.array(start, float), np.array(multipliers, float), Options(**options))


# A full step of 1e-10 ends the iteration, and it is of second order: what is left is rounding.
CLOSE = 1e-9


@pytest.mark.parametrize(
    ("problem", "start", "multipliers", "minimum"),
    [
        (rosenbrock(), (-1.2, 1.0), (), (1.0, 1.0)),
        (two_wells(), (3.0, 4.0), (), (1.0, 0.0)),
        (parabola(), (-1.2, 1.0), (0.0,), (1.0, 1.0)),
        (logarithm(), (2.0, 2.0), (0.0,), (0.0, np.sqrt(3.0))),
        (on_circle(), (3.0, 0.1), (0.0,), (-1.0, -1.0)),
    ],
    ids=["rosenbrock", "two wells", "parabola", "logarithm", "circle"],
)
def test_known_minima(problem: Dense, start, multipliers, minimum) -> None:
    found = run(problem, start, multipliers)
    assert found.converged
    assert found.x == pytest.approx(np.array(minimum), abs=CLOSE)
    assert found.violation < CLOSE
    assert found.iterations < 40
    assert found.objective == pytest.approx(problem.f(np.array(minimum)), abs=CLOSE)


def test_multipliers_are_the_objective_per_constraint() -> None:
    # d f* / d c* with c = |x|^2 - 2: f* = -sqrt(2 |x|^2), so -1/2 at |x|^2 = 2.
    assert run(on_circle(), (3.0, 0.1), (0.0,)).y == pytest.approx([-0.5], abs=CLOSE)


def test_the_last_steps_are_of_second_order() -> None:
    problem = rosenbrock()
    run(problem, (-1.2, 1.0))
    errors = [np.linalg.norm(x - 1.0) for x in problem.accepted]
    late = [(a, b) for a, b in pairwise(errors) if 1e-7 < a < 1e-2 and b > 1e-15]
    # The Hessian's change per unit length over its smallest eigenvalue (0.4): 1200 / 0.4 at most.
    assert late
    assert all(b < 3000 * a**2 for a, b in late)


@pytest.mark.parametrize("side", [1e-9, -1e-9, 1e-3])
def test_from_beside_a_saddle_down_the_side_it_is_on(side: float) -> None:
    found = run(two_wells(), (side, 0.0))
    assert found.converged
    assert found.x == pytest.approx([np.sign(side), 0.0], abs=CLOSE)


def test_from_beside_a_maximum_on_the_constraint() -> None:
    found = run(on_circle(), (1.0, 1.0 + 1e-6), (0.5,))
    assert found.converged
    assert found.x == pytest.approx([-1.0, -1.0], abs=CLOSE)


def test_a_saddle_is_never_taken_for_a_minimum() -> None:
    # The gradient is zero; only the inertia tells.
    assert not run(two_wells(), (0.0, 0.0)).converged


def test_a_maximum_on_the_constraint_is_never_taken_for_a_minimum() -> None:
    found = run(on_circle(), (1.0, 1.0), (0.5,))
    # Rounding may push it off and down.
    assert not found.converged or found.x == pytest.approx([-1.0, -1.0], abs=CLOSE)


def log_cosh() -> Dense:
    """ln cosh x: Newton's full steps diverge from |x| > 1.09."""
    return Dense(
        lambda x: float(np.log(np.cosh(x[0]))),
        lambda x: np.tanh(x),
        lambda x: [[1 / np.cosh(x[0]) ** 2]],
    )


def test_steps_are_taken_by_actual_against_predicted_reduction() -> None:
    problem = log_cosh()
    found = run(problem, (3.0,), radius=50.0, largest_radius=1e3)
    assert found.converged
    assert found.x == pytest.approx([0.0], abs=CLOSE)
    values = [problem.f(x) for x in problem.accepted]
    # Up to rounding every accepted point lies lower, and some tried ones, which do not, were refused.
    assert all(after <= before + 1e-13 for before, after in pairwise(values))
    refused = [x for x in problem.tried if not any(np.array_equal(x, y) for y in problem.accepted)]
    assert any(problem.f(x) > problem.f(problem.accepted[0]) for x in refused)


def test_no_step_is_longer_than_the_radius() -> None:
    problem = two_wells()
    run(problem, (30.0, 40.0), radius=0.5, largest_radius=0.7)
    steps = [np.linalg.norm(b - a) for a, b in pairwise(problem.accepted)]
    assert max(steps) <= 0.7 * (1 + 1e-12)
    assert steps[0] <= 0.5 * (1 + 1e-12)
    # It grows where the model is good: fewer steps than of the first radius alone.
    assert max(steps) > 0.5


@pytest.mark.parametrize("radius", [1e-3, 1.0, 1e3])
def test_the_first_radius_matters_little(radius: float) -> None:
    found = run(parabola(), (-1.2, 1.0), (0.0,), radius=radius, largest_radius=1e3)
    assert found.converged
    assert found.x == pytest.approx([1.0, 1.0], abs=CLOSE)


def test_constraints_that_nothing_meets() -> None:
    # |x|^2 + 1 = 0 in three dimensions: at best the violation is 1, at 0.
    impossible = Dense(
        lambda x: x[0],
        lambda x: np.array([1.0, 0.0, 0.0]),
        lambda x: np.zeros((3, 3)),
        lambda x: [x @ x + 1.0],
        lambda x: [2 * x],
        lambda x: [2 * np.eye(3)],
    )
    found = run(impossible, (0.7, 0.2, -0.4), (0.0,))
    assert not found.converged
    assert 1.0 <= found.violation < 1.1
    assert np.all(np.isfinite(found.x))


def test_an_objective_without_a_minimum() -> None:
    slope = Dense(lambda x: x[0], lambda x: [1.0], lambda x: [[0.0]])
    found = run(slope, (0.0,), iterations=7)
    assert not found.converged
    assert found.iterations == 7


def test_nan_beyond_an_edge_is_stepped_back_from() -> None:
    # x - ln x: its domain ends at 0, where Newton's first step from 3 would land (3 - 6 = -3).
    def objective(x: np.ndarray) -> float:
        return float(x[0] - np.log(x[0])) if x[0] > 0 else np.nan

    edge = Dense(objective, lambda x: 1 - 1 / x, lambda x: [[1 / x[0] ** 2]])
    found = run(edge, (3.0,), radius=10.0, largest_radius=10.0)
    assert found.converged
    assert found.x == pytest.approx([1.0], abs=CLOSE)


def test_statuses_say_whether_numbers_may_be_published() -> None:
    assert [status for status in Status if status.trusted] == [Status.CONVERGED, Status.SNAPPED]
    for status in Status:
        assert status.sentence.endswith(".")
        assert status.sentence[0].isupper()


@pytest.mark.parametrize(("force", "converges"), [(1e-12, True), (1e-8, False)])
def test_a_neutral_direction(force: float, converges: bool) -> None:
    """The last digits of a pose make a force of 1e-12 along it, under which nothing need go anywhere.

    Along a direction of curvature 1e-6 a step of 1e-6 that gains 1e-18 was not short enough; where the
    direction turns, no step ever was.
    """
    problem = Dense(
        lambda x: 0.5 * x[0] ** 2 + 0.5e-6 * x[1] ** 2 - force * x[1],
        lambda x: np.array([x[0], 1e-6 * x[1] - force]),
        lambda x: np.diag([1.0, 1e-6]),
    )
    found = minimize(problem, np.zeros(2), np.zeros(0), Options())
    assert found.converged
    assert (found.iterations == 1) is converges
