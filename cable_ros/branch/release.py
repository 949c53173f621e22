# SPDX-License-Identifier: Apache-2.0
"""Descent of the energy by what supports share: from clips to what slides or turns, and at a snap-through."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cable_ros.branch.coupled_state import Shared
from cable_ros.branch.coupled_tangent import CoupledTangent
from cable_ros.branch.coupling import NEUTRAL, assemble

RADIUS, LARGEST, SMALLEST = 0.2, 0.3, 1e-7
"""Trust region: first, largest and smallest radius, rad."""
FALL = 1e-3
"""Radius, rad, below which a piece that cannot follow has come to a fold of its own."""
STEPS = 300
"""Maximum number of steps."""
ENOUGH = 1e-4
"""Minimum decrease of the energy over that of the quadratic model."""
EXACT = 1e-6
"""Step of Newton's method at which the descent ends, rad."""
ROUNDING = 1e-12
"""Change of the energy, relative, that may be rounding."""
NUDGE = 1e-4
"""Fraction of the radius by which it leaves a saddle point."""


@dataclass(frozen=True, eq=False)
class Release:
    """The energy as a function of what the supports share."""

    move: Callable[[Shared, bool], Shared | None]
    """Moves the pieces to a state, a free end at most as far as an obstacle, and gives that; if they cannot
    follow, they stay. True: each may fall to another."""
    back: Callable[[Shared], None]
    """Moves them back to the state before."""
    energy: Callable[[], float]
    """Of the present state, J."""
    tangent: Callable[[Shared], CoupledTangent]
    """About the present state."""
    scale: np.ndarray
    """(N,) stiffness that belongs to each unknown."""
    free: Callable[[], np.ndarray]
    """(N,) which unknowns there are at present."""
    landed: Callable[[Shared], Shared]
    """The present state with free ends off what they do not press on."""
    turns_freely: bool = False
    """Whether there may be a motion that takes no energy."""


def descend(problem: Release, state: Shared) -> Shared | None:
    """The minimum that a trust-region descent from `state` ends at; None: it got stuck."""
    radius, energy, model = RADIUS, problem.energy(), None
    for _ in range(STEPS):
        if model is None:
            state = problem.landed(state)
            free, tangent = problem.free(), problem.tangent(state)
            weight = np.sqrt(problem.scale[free] / problem.scale[0])
            system = assemble(tangent.sides(), np.zeros(len(state.arcs)), tangent.loose)
            found = principal(system.hessian[np.ix_(free, free)], system.residual[free], weight)
            if found is None:
                return None  # a piece is as long as the distance of its ends
            values, vectors, g = found
            if problem.turns_freely:
                neutral = np.abs(values) < NEUTRAL * problem.scale[0]
                values, g = np.where(neutral, NEUTRAL * problem.scale[0], values), np.where(neutral, 0.0, g)
            model = values, vectors, g
        values, vectors, g = model
        y = lowest(values, g, radius)
        if values[0] > 0.0 and np.abs(y).max() < EXACT:
            return state
        expected = -float(g @ y + 0.5 * values @ y**2)
        step = np.zeros(len(free))
        step[free] = vectors @ y / weight
        to = state.moved(step)
        moved = problem.move(to, radius < FALL)
        if moved is not None:
            to, new = moved, problem.energy()
            slack = ROUNDING * (abs(energy) + abs(new))
            if energy - new >= ENOUGH * expected - slack:
                if energy - new > 0.75 * expected and np.linalg.norm(y) > 0.8 * radius:
                    radius = min(2.0 * radius, LARGEST)
                state, energy, model = to, new, None
                continue
            problem.back(state)
        radius = 0.25 * min(radius, float(np.linalg.norm(y)))
        if radius < SMALLEST:
            return None
    return None


def principal(
    K: np.ndarray, residual: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Eigenvalues, which rise, and vectors of K (n, n), symmetric part, and the residual (n,) along these.

    In unknowns times `weight` (n,); None: K is not finite.
    """
    scaled = K / weight / weight[:, None]
    if not np.isfinite(scaled).all():
        return None
    values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
    return values, vectors, vectors.T @ (residual / weight)


def lowest(values: np.ndarray, g: np.ndarray, radius: float) -> np.ndarray:
    """Minimum of g.y + 1/2 y.diag(values).y within the radius; `values` rise."""
    if values[0] > 0.0:
        y = -g / values
        if np.linalg.norm(y) <= radius:
            return y
    elif abs(g[0]) < NUDGE * radius * abs(values[0]):
        g = g.copy()
        g[0] = np.copysign(NUDGE * radius * abs(values[0]) + 1e-300, -g[0])
    low = max(0.0, -float(values[0]))
    high = low + float(np.linalg.norm(g)) / radius
    for _ in range(100):
        middle = 0.5 * (low + high)
        size = np.linalg.norm(g / (values + middle)) if middle > -values[0] else np.inf
        low, high = (middle, high) if size > radius else (low, middle)
    return -g / (values + high)
