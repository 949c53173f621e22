# SPDX-License-Identifier: Apache-2.0
"""Baseline: the published method, Liu et al. 2018, doi:10.1007/s11071-018-4383-y, equations unchanged.

First-order finite differences of Euler parameters and internal forces, 7 n + 11 equations for 7 n + 7
unknowns (39), minimised by damped Gauss-Newton steps (43) with Armijo's rule (46) and the ratio rule for the
damping (44), (45). Made as fast as we can without touching the equations: compiled residual and analytic
Jacobian, banded Cholesky of J^T J + mu I with the four rows that see the whole cable as a low-rank update,
warm starts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from cable_ros.baselines import published_kernels as kernels
from cable_ros.baselines.result import BaselineResult, ClampedCable, wrench_on_body

_MM = 1e-3  # the paper computes in mm and N; the least-squares weights depend on it


@dataclass(frozen=True)
class GaussNewton:
    """The parameters that the paper leaves open, and when to stop (there is no root to reach).

    The valley of |v|^2 is so flat that where it stops matters: with the default damping it comes to rest
    soonest, in tens of iterations or fewer, while mu = 1e-3 creeps along it for hundreds.
    """

    damping: float | None = None
    """mu at the start; None: 1e-6, and from 80 parts on 1e-6 (80 / n)^3, found by trial."""
    damping_factor: float = 2.0
    """q of (45), 2 to 10."""
    armijo_slope: float = 1e-4
    """sigma of (46)."""
    armijo_shrink: float = 0.5
    """beta of (46)."""
    step_tolerance: float = 1e-5
    """Stop when no unknown changes by more than this times the largest."""
    max_iterations: int = 300


def solve(
    cable: ClampedCable,
    parts: int,
    guess: BaselineResult | None = None,
    options: GaussNewton = GaussNewton(),
) -> BaselineResult:
    """Least-squares solution with `parts` (at least 2) equal parts.

    Without a guess it starts from the paper's vector of ones. The moment at the end, which the paper does
    not give, is M = K omega with (20) at the last node.
    """
    if parts < 2:
        raise ValueError(f"parts is {parts}; the published differences need at least 2")
    problem = FiniteDifferences(cable, parts, guess)
    x = problem.ones() if guess is None else problem.sample(guess)
    x, iterations, converged, message = minimise(problem, x, options)
    return problem.result(x, iterations, converged, message)


class FiniteDifferences:
    """Residual and Jacobian in mm and N, and the way from and to SI."""

    def __init__(self, cable: ClampedCable, parts: int, guess: BaselineResult | None = None) -> None:
        self.parts = parts
        self.rows = kernels.NODE * parts + 11
        self.length = cable.length / _MM
        self.step = self.length / parts
        self.stiffness = cable.stiffness / _MM**2
        self.load = cable.load * _MM
        self.origin = cable.start[:3]
        self.start_q, self.end_q = _scalar_first(cable.start[3:]), _scalar_first(cable.end[3:])
        if guess is not None:
            # both ends' signs follow the guess: the sign at the end decides the branch
            first, last = _scalar_first(guess.orientations[0]), _scalar_first(guess.orientations[-1])
            self.start_q = self.start_q * (1.0 if first @ self.start_q > 0 else -1.0)
            self.end_q = self.end_q * (1.0 if last @ self.end_q > 0 else -1.0)
        self.end_r = (cable.end[:3] - cable.start[:3]) / _MM
        self.end_orientation = cable.end[3:]
        size = kernels.NODE * (parts + 1)
        self.local = np.empty((parts, kernels.NODE, 3 * kernels.NODE))
        self.whole = np.empty((kernels.WHOLE_CABLE_ROWS, size))
        self.spread = np.empty_like(self.whole)
        self.band = np.empty((size, kernels.SUBDIAGONALS + 1))
        self.factor = np.empty_like(self.band)
        self.gradient = np.empty(size)
        self.product = np.empty(size)

    def ones(self) -> np.ndarray:
        """The paper's start."""
        return np.ones((self.parts + 1, kernels.NODE))

    def sample(self, guess: BaselineResult) -> np.ndarray:
        """Unknowns (n + 1, 7) from any result, interpolated to this grid."""
        grid = np.linspace(0.0, guess.arc_length[-1], self.parts + 1)
        if guess.nodes != self.parts + 1 or not np.array_equal(grid, guess.arc_length):
            guess = guess.at(grid)
        x = np.empty((self.parts + 1, kernels.NODE))
        x[:, :4] = _scalar_first(guess.orientations)
        x[:, 4:] = Rotation.from_quat(guess.orientations).inv().apply(guess.force)
        return x

    def residual(self, x: np.ndarray, v: np.ndarray) -> float:
        """v of (39) into `v` (7 n + 11,); returns |v|^2 / 2 of (41)."""
        return kernels.residual(
            x, self.step, self.stiffness, self.load, self.start_q, self.end_q, self.end_r, self.length, v
        )

    def linearise(self, x: np.ndarray, v: np.ndarray) -> None:
        """Jacobian blocks, gradient (42) and the band of J^T J at x."""
        kernels.jacobian(x, self.step, self.stiffness, self.load, self.local, self.whole)
        kernels.normal_equations(v, self.local, self.whole, self.band, self.gradient)

    def damped_step(self, mu: float) -> np.ndarray:
        """d of (43); NaN where J^T J + mu I lost positive definiteness to rounding."""
        d = np.empty_like(self.gradient)
        done = kernels.damped_step(
            self.local, self.whole, self.band, self.gradient, mu, self.factor, self.spread, d, self.product
        )
        return d if done else np.full_like(d, np.nan)

    def predicted(self, d: np.ndarray) -> float:
        """Denominator of (44): g d + |J d|^2 / 2."""
        return self.gradient @ d + kernels.normal_product(self.local, self.whole, d, self.product) / 2

    def result(self, x: np.ndarray, iterations: int, converged: bool, message: str) -> BaselineResult:
        """Back to SI; points by (34), (35), moments M = K omega with (20), (24)."""
        q = x[:, :4]
        slope = np.diff(q, axis=0, prepend=0.0) / self.step
        slope[0] = (-3 * q[0] + 4 * q[1] - q[2]) / (2 * self.step)
        a, b, c, d = q.T
        rows = np.array([[-b, a, d, -c], [-c, -d, a, b], [-d, c, -b, a]])
        strain = 2 * np.einsum("ikn,nk->ni", rows, slope)
        quaternions = q[:, [1, 2, 3, 0]] / np.linalg.norm(q, axis=1, keepdims=True)
        sections = Rotation.from_quat(quaternions)
        force = sections.apply(x[:, 4:])
        moment = sections.apply(strain * self.stiffness) * _MM
        points = np.empty((self.parts + 1, 3))
        kernels.positions(x, self.step, points)
        return BaselineResult(
            end_wrench=wrench_on_body(force[-1], moment[-1], self.end_orientation),
            arc_length=np.linspace(0.0, self.length * _MM, self.parts + 1),
            points=self.origin + _MM * points,
            orientations=quaternions,
            force=force,
            moment=moment,
            iterations=iterations,
            converged=converged,
            message=message,
        )


class LeastSquares(Protocol):
    """What the paper's iteration needs to know of a problem."""

    parts: int
    rows: int
    gradient: np.ndarray
    """(42), after `linearise`."""

    def residual(self, x: np.ndarray, v: np.ndarray) -> float: ...
    def linearise(self, x: np.ndarray, v: np.ndarray) -> None: ...
    def damped_step(self, mu: float) -> np.ndarray: ...
    def predicted(self, d: np.ndarray) -> float: ...


def minimise(problem: LeastSquares, x: np.ndarray, options: GaussNewton) -> tuple[np.ndarray, int, bool, str]:
    """The paper's Fig. 6 from x: the minimiser, iterations, whether it came to rest, and what happened."""
    v = np.empty(problem.rows)
    value = problem.residual(x, v)
    mu = options.damping if options.damping is not None else 1e-6 * min(1.0, (80 / problem.parts) ** 3)
    for iteration in range(1, options.max_iterations + 1):
        problem.linearise(x, v)
        d = problem.damped_step(mu)
        slope = problem.gradient @ d
        if not slope < 0:
            mu *= options.damping_factor  # not a descent direction: the factorisation lost its digits
            continue
        size = 1.0
        while True:
            trial = x + size * d.reshape(x.shape)
            trial_value = problem.residual(trial, v)
            if trial_value <= value + options.armijo_slope * size * slope:
                break
            size *= options.armijo_shrink
            if size < 1e-12:
                problem.residual(x, v)
                return x, iteration, True, f"no further decrease; |v|^2 / 2 = {value:.2e}"
        ratio = (trial_value - value) / problem.predicted(size * d)
        if ratio < 0.4:
            mu *= options.damping_factor
        elif ratio > 0.75:
            mu /= options.damping_factor
        change = size * np.max(np.abs(d))
        x, value = trial, trial_value
        if change <= options.step_tolerance * np.max(np.abs(x)):
            return x, iteration, True, f"came to rest; |v|^2 / 2 = {value:.2e}"
    return x, options.max_iterations, False, f"{options.max_iterations} iterations; |v|^2 / 2 = {value:.2e}"


def _scalar_first(quaternion: np.ndarray) -> np.ndarray:
    return quaternion[..., [3, 0, 1, 2]]
