# SPDX-License-Identifier: Apache-2.0
"""Trust-region minimisation under equality constraints, by sequential quadratic programming.

The problem is any object with the methods of `Problem`: points on a manifold, a few constraints, a metric.
A step is made of a normal part (towards the constraints) and a tangential part (down the Lagrangian), as
Byrd and Omojokun split it, with the tangential part from (H + mu D) by the inertia of its factors
(More and Sorensen); merit function: objective + penalty * |constraints|. Nocedal & Wright, ch. 18.5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

SHORTEST = 1e-9
"""Radius below which a step that gains nothing ends the iteration."""


class Problem(Protocol):
    """What the trust region needs to know of a problem; x is a point, s a step, y the multipliers."""

    def value(self, x: Any) -> tuple[float, np.ndarray]:
        """Objective and constraints at x."""

    def linearize(self, x: Any, y: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Set up Hessian and constraint derivative at (x, y).

        Returns objective, constraints and the Lagrangian's gradient.
        """

    def factor(self, mu: float) -> bool:
        """Factor the saddle system of H + mu D; whether that is positive on the tangent space."""

    def step(self, gradient: np.ndarray, constraints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """s, dy of the factored system: (H + mu D) s - C dy = -gradient, C^T s = -constraints."""

    def normal_step(self, constraints: np.ndarray) -> np.ndarray:
        """The shortest s in the metric D with C^T s = -constraints."""

    def apply_hessian(self, s: np.ndarray) -> np.ndarray:
        """H s."""

    def derivative(self, s: np.ndarray) -> np.ndarray:
        """C^T s."""

    def norm(self, s: np.ndarray) -> float:
        """Length of s in the metric D."""

    def retract(self, x: Any, s: np.ndarray) -> Any:
        """The point that s leads to from x."""


@dataclass(frozen=True)
class Options:
    """Radii in units of the metric; `step_tolerance`: length of a full step at which the iteration ends."""

    radius: float = 1.0
    largest_radius: float = 4.0
    step_tolerance: float = 1e-10
    constraint_tolerance: float = 1e-10
    iterations: int = 100
    noise: float = 1e-13
    """Error of the objective, relative to 1 + its size: what a step may lose."""
    neutral: float = 1e-5
    """Curvature in the metric below which a direction counts as neutral."""


@dataclass(frozen=True)
class Minimum:
    """Where the iteration ended: point, multipliers, whether it converged to a strict local minimum."""

    x: Any
    y: np.ndarray
    converged: bool
    objective: float
    violation: float
    iterations: int
    stalled: bool = False
    """Whether no step from x is short enough to gain: at a kink of the objective."""


def minimize(problem: Problem, x: Any, y: np.ndarray, options: Options = Options()) -> Minimum:
    """A strict local minimum near x, or where the iteration stopped."""
    radius = options.radius
    objective, c, gradient = problem.linearize(x, y)
    for iteration in range(1, options.iterations + 1):
        violation = float(np.linalg.norm(c))
        convex = problem.factor(0.0)
        s, dy = problem.step(gradient, c)
        length = problem.norm(s) if convex else np.inf
        # along a neutral direction rounding alone makes the step long, but such a step gains nothing
        decrement = abs(float(np.vdot(gradient, s)))
        left = min(length, float(np.sqrt(decrement)))
        if 0.0 < decrement <= options.neutral * length**2 < np.inf:
            left = min(left, decrement / length)  # the force along it: the last digits of a pose make one
        if convex and left <= options.step_tolerance and violation <= options.constraint_tolerance:
            # the step is at hand, and what it leaves is of its square
            return Minimum(problem.retract(x, s), y + dy, True, objective, violation, iteration)
        if not length <= radius:
            s, dy = _limited_step(problem, gradient, c, radius)
            length = problem.norm(s)
        rate = float(np.vdot(gradient, s))
        slope = rate + float(y @ problem.derivative(s))
        curvature = 0.5 * float(np.vdot(s, problem.apply_hessian(s)))
        gain = violation - float(np.linalg.norm(c + problem.derivative(s)))
        penalty = 1.5 * float(np.linalg.norm(y + dy)) + 1e-3
        if gain > 0.0:
            penalty = max(penalty, (slope + curvature) / (0.7 * gain))
        predicted = -slope - curvature + penalty * gain
        trial = problem.retract(x, s)
        trial_objective, trial_c = problem.value(trial)
        actual = objective - trial_objective + penalty * (violation - float(np.linalg.norm(trial_c)))
        noise = options.noise * (1.0 + abs(objective) + penalty)
        ratio = (actual + noise) / (predicted + noise) if predicted > -noise else -1.0
        if ratio < 0.25 and np.all(np.isfinite(trial_c)):
            # the constraints' own curvature can spoil a good step: correct for it before giving it up
            corrected = problem.retract(trial, problem.normal_step(trial_c))
            value, vc = problem.value(corrected)
            better = objective - value + penalty * (violation - float(np.linalg.norm(vc)))
            if (better + noise) / (predicted + noise) > max(ratio, 0.25):
                trial, ratio = corrected, (better + noise) / (predicted + noise)
        if ratio > 1e-4:
            x, y = trial, y + dy
            objective, c, gradient = problem.linearize(x, y)
        elif radius < SHORTEST:
            return Minimum(x, y, False, objective, violation, iteration, True)
        if not ratio >= 0.25:
            radius = 0.3 * min(radius, length)
        elif ratio > 0.75 and length > 0.7 * radius:
            radius = min(2.0 * radius, options.largest_radius)
    return Minimum(x, y, False, objective, float(np.linalg.norm(c)), options.iterations)


def _limited_step(
    problem: Problem, gradient: np.ndarray, c: np.ndarray, radius: float
) -> tuple[np.ndarray, np.ndarray]:
    """A step within the radius: at most 0.8 of it towards the constraints, the rest down the Lagrangian."""
    normal = problem.normal_step(c)
    length = problem.norm(normal)
    if length > 0.8 * radius:
        normal *= 0.8 * radius / length
        length = 0.8 * radius
    room = np.sqrt(radius**2 - length**2)
    slope = gradient + problem.apply_hessian(normal)
    nothing = np.zeros_like(c)
    low, high, mu = 0.0, np.inf, 0.0
    best: tuple[np.ndarray, np.ndarray] | None = None
    for _ in range(30):
        if problem.factor(mu):
            s, dy = problem.step(slope, nothing)
            size = problem.norm(s)
            if size <= room:
                high, best = mu, (s, dy)
                if mu == 0.0 or size > 0.7 * room:
                    break
            else:
                low = mu
                # near the boundary 1/|s| is almost linear in mu
                guess = mu + (mu + 0.1) * (size / (0.85 * room) - 1.0)
                mu = guess if guess < high else np.sqrt(max(low, 1e-3 * high) * high)
                continue
        else:
            low = mu
        if np.isinf(high):
            mu = max(4.0 * mu, 0.05)
        elif high - low < 0.02 * high:
            break
        else:
            mu = np.sqrt(max(low, 1e-3 * high) * high)
    if best is None:
        return normal, nothing
    return normal + best[0], best[1]
