# SPDX-License-Identifier: Apache-2.0
"""Two clamped rods that touch at one point, by shooting over both at once; shares no code with the solver.

    dF/ds = -f,   dM/ds = -r' x F,   R' = R [K^-1 R^T M]x,   r' = (1 + F.t / EA) t,

with jumps of F by -P in the first rod at the arc length a and by P in the second at b, P the force on the
first. Its unknowns are closed by: both ends are where they are held; the line between the points is as long
as the radii together and along P, r_1(a) - r_2(b) = d P / |P|; and P is across both tangents.
"""

from __future__ import annotations

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


def solve(
    cables: list[dict[str, Any]],
    gravity: np.ndarray,
    distance: float,
    guess: Solution,
    accuracy: float = 1e-11,
) -> Solution:
    """The equilibrium near a guess; cables as in a scene, in the world, `distance` the sum of their radii."""

    def shot(cable: dict[str, Any], start: np.ndarray, P: np.ndarray, arc: float) -> tuple[np.ndarray, ...]:
        """State at the touching point and at the end: r, R by rows, F and M on what is before."""
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
        touching = solve_ivp(slope, (0.0, arc), y, **options).y[:, -1]
        beyond = touching.copy()
        beyond[12:15] -= P
        return touching, solve_ivp(slope, (arc, cable["length"]), beyond, **options).y[:, -1]

    def missed(x: np.ndarray) -> np.ndarray:
        starts, P, arcs = x[:12].reshape(2, 6), x[12:15], x[15:]
        out, points, tangents = [], [], []
        for i, cable in enumerate(cables):
            touching, end = shot(cable, starts[i], P if i == 0 else -P, arcs[i])
            last = Rotation.from_euler("xyz", cable["end"]["rpy"])
            turned = last.inv() * Rotation.from_matrix(end[3:12].reshape(3, 3))
            out += [end[:3] - cable["end"]["position"], 0.1 * turned.as_rotvec()]
            points.append(touching[:3])
            tangents.append(touching[3:12].reshape(3, 3)[:, 2])
        n = P / np.linalg.norm(P)
        out += [points[0] - points[1] - distance * n, [0.1 * n @ tangents[0], 0.1 * n @ tangents[1]]]
        return np.concatenate(out)

    x = np.concatenate([guess.starts.ravel(), guess.force, guess.arcs])
    for _ in range(2):  # the second time with a Jacobian of the solution itself
        found = root(missed, x, method="hybr", options={"xtol": 1e-14})
        x = found.x
    if np.abs(found.fun).max() > 1e-10:
        raise ValueError(f"No solution found near the guess: off by {np.abs(found.fun).max():.1e} m.")
    starts, P, arcs = found.x[:12].reshape(2, 6), found.x[12:15], found.x[15:]
    ends = [shot(cables[i], starts[i], P if i == 0 else -P, arcs[i])[1][12:] for i in range(2)]
    return Solution(starts, np.array(ends), P, arcs)
