# SPDX-License-Identifier: Apache-2.0
"""Clamped rods that touch at points, by shooting over all at once; shares no code with the solver.

    dF/ds = -f,   dM/ds = -r' x F,   R' = R [K^-1 R^T M]x,   r' = (1 + F.t / EA) t,

with jumps of F by -P in the first rod at the arc length a and by P in the second at b, P the force on the
first. Its unknowns are closed by: both ends are where they are held; the line between the points is as long
as the radii together and along P, r_1(a) - r_2(b) = d P / |P|; and P is across both tangents. A rod that
touches itself is first and second rod in one: both forces are on it, at a < b.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class Solution:
    """World, N and N m, on the cables."""

    starts: np.ndarray
    """(2, 6) force and moment on their starts."""
    ends: np.ndarray
    """(2, 6) the same on their ends."""
    force: np.ndarray
    """(3,) on the first, from the second."""
    arcs: np.ndarray
    """(2,) where they touch, m."""


@dataclass(frozen=True)
class Itself:
    """A rod that touches itself at k points; world, N and N m, on the rod."""

    start: np.ndarray
    """(6,) force and moment on its start."""
    end: np.ndarray
    """(6,) the same on its end."""
    forces: np.ndarray
    """(k, 3) on the strands that come first."""
    arcs: np.ndarray
    """(k, 2) where the strands touch, m, rising."""


def shot(
    cable: dict[str, Any], gravity: np.ndarray, start: np.ndarray, loads: Sequence[tuple[Any, ...]],
    accuracy: float,
) -> list[np.ndarray]:  # fmt: skip
    """States at the arc lengths of point loads, in their order, and at the end.

    A state is r, R by rows, F and M on what is before; `start` (6,): force and moment on the start. A load is
    its arc length, its force and maybe its couple.
    """
    K, weight = np.array(cable["stiffness"], float), cable["linear_density"] * gravity
    stretch = cable.get("axial_stiffness", np.inf)

    def slope(_: float, y: np.ndarray) -> np.ndarray:
        R, F, M = y[3:12].reshape(3, 3), y[12:15], y[15:]
        k = R.T @ M / K
        spin = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
        along = (1.0 + F @ R[:, 2] / stretch) * R[:, 2]
        return np.concatenate([along, (R @ spin).ravel(), -weight, -np.cross(along, F)])

    first = Rotation.from_euler("xyz", cable["start"]["rpy"]).as_matrix()
    y = np.concatenate([cable["start"]["position"], first.ravel(), -start])
    options = {"rtol": accuracy, "atol": 1e-3 * accuracy, "method": "DOP853"}
    states, before = {}, 0.0
    for which in np.argsort([load[0] for load in loads], kind="stable"):
        arc, P, *couple = loads[which]
        states[which] = y = solve_ivp(slope, (before, arc), y, **options).y[:, -1]
        y, before = y.copy(), arc
        y[12:15] -= P
        if couple:
            y[15:] -= couple[0]
    end = solve_ivp(slope, (before, cable["length"]), y, **options).y[:, -1]
    return [*(states[which] for which in range(len(loads))), end]


def missed_end(cable: dict[str, Any], end: np.ndarray) -> list[np.ndarray]:
    """How far a state is from the end clamp: m, and a tenth of rad."""
    last = Rotation.from_euler("xyz", cable["end"]["rpy"])
    turned = last.inv() * Rotation.from_matrix(end[3:12].reshape(3, 3))
    return [end[:3] - cable["end"]["position"], 0.1 * turned.as_rotvec()]


def missed_contact(first: np.ndarray, second: np.ndarray, P: np.ndarray, distance: float) -> list[np.ndarray]:
    """How far two states are from the conditions of contact; P on the first."""
    n, tangents = P / np.linalg.norm(P), [y[3:12].reshape(3, 3)[:, 2] for y in (first, second)]
    return [first[:3] - second[:3] - distance * n, np.array([0.1 * n @ t for t in tangents])]


def zero(missed: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    """The root near x."""
    for _ in range(2):  # the second time with a Jacobian of the solution itself
        found = root(missed, x, method="hybr", options={"xtol": 1e-14})
        x = found.x
    if np.abs(found.fun).max() > 1e-10:
        raise ValueError(f"No solution found near the guess: off by {np.abs(found.fun).max():.1e} m.")
    return np.array(x)


def solve(
    cables: list[dict[str, Any]],
    gravity: np.ndarray,
    distance: float,
    guess: Solution,
    accuracy: float = 1e-11,
) -> Solution:
    """The equilibrium near a guess; cables as in a scene, in the world, `distance` the sum of their radii."""

    def states(x: np.ndarray) -> list[list[np.ndarray]]:
        starts, P, arcs = x[:12].reshape(2, 6), x[12:15], x[15:]
        each = zip(cables, starts, arcs, (P, -P), strict=True)
        return [shot(cable, gravity, start, [(arc, load)], accuracy) for cable, start, arc, load in each]

    def missed(x: np.ndarray) -> np.ndarray:
        (first, end), (second, other_end) = states(x)
        ends = [*missed_end(cables[0], end), *missed_end(cables[1], other_end)]
        return np.concatenate([*ends, *missed_contact(first, second, x[12:15], distance)])

    x = zero(missed, np.concatenate([guess.starts.ravel(), guess.force, guess.arcs]))
    ends = [each[-1][12:] for each in states(x)]
    return Solution(x[:12].reshape(2, 6), np.array(ends), x[12:15], x[15:])


def solve_itself(
    cable: dict[str, Any], gravity: np.ndarray, guess: Itself, accuracy: float = 1e-11
) -> Itself:
    """The equilibrium near a guess of a cable as in a scene, in the world."""
    count = len(guess.arcs)

    def states(x: np.ndarray) -> list[np.ndarray]:
        forces, arcs = x[6 : 6 + 3 * count].reshape(-1, 3), x[6 + 3 * count :].reshape(-1, 2)
        loads = [(s, P) for s, P in zip(arcs[:, 0], forces, strict=True)]
        loads += [(s, -P) for s, P in zip(arcs[:, 1], forces, strict=True)]
        return shot(cable, gravity, x[:6], loads, accuracy)

    def missed(x: np.ndarray) -> np.ndarray:
        *touching, end = states(x)
        out = missed_end(cable, end)
        for i, P in enumerate(x[6 : 6 + 3 * count].reshape(-1, 3)):
            out += missed_contact(touching[i], touching[count + i], P, cable["outer_diameter"])
        return np.concatenate(out)

    x = zero(missed, np.concatenate([guess.start, guess.forces.ravel(), guess.arcs.ravel()]))
    forces, arcs = x[6 : 6 + 3 * count].reshape(-1, 3), x[6 + 3 * count :].reshape(-1, 2)
    return Itself(x[:6], states(x)[-1][12:], forces, arcs)
