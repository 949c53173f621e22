# SPDX-License-Identifier: Apache-2.0
"""A rod between two clamps, held by pins, rings and tubes, by shooting over all of it; shares no code.

The equations are those of `held_ends`. At a support the force on the cable jumps; the moment does not, but
for that across a tube. The arc length in a ring is an unknown, and the jump along the direction in which the
cable goes through it, the mean of r' on both sides, is a given fraction of that across it. In a tube it is
one, too, and F.t + F.C F / 2 + m.K^-1 m / 2 + m.kappa0 does not jump (Bigoni, Dal Corso, Bosi and Misseroni
2015, of a rod that keeps its length).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root
from scipy.spatial.transform import Rotation


def compliance(cable: dict[str, Any]) -> np.ndarray:
    """(3,) against shear and tension, 1/N, of a cable of a scene mapping."""
    shear = cable.get("shear_stiffness", [np.inf, np.inf])
    return 1.0 / np.array([*shear, cable.get("axial_stiffness", np.inf)])


@dataclass(frozen=True)
class Held:
    """A pin, a ring, or a tube."""

    position: np.ndarray
    """(3,) world, m."""
    slides: bool
    friction: float = 0.0
    """Of a ring: the tension beyond it less that before it, over the force across."""
    tube: Rotation | None = None
    """Axes of a tube, z along the cable."""


@dataclass(frozen=True)
class Solution:
    """World, N and N m, on the cable."""

    start: np.ndarray
    """(6,) force and moment on its start."""
    end: np.ndarray
    """(6,) the same on its end."""
    forces: np.ndarray
    """(n, 3) of the supports."""
    arcs: np.ndarray
    """(n,) arc lengths in them, m."""
    moments: np.ndarray
    """(n, 3) of the supports, a tube's along its own axes."""


def solve(
    cable: dict[str, Any], gravity: np.ndarray, held: list[Held], guess: Solution, accuracy: float = 1e-11
) -> Solution:
    """The equilibrium near a guess of forces and arc lengths."""
    K = np.array(cable["stiffness"], float)
    natural = np.array(cable.get("natural_strain", [0.0, 0.0, 0.0]))
    weight, soft = cable["linear_density"] * gravity, compliance(cable)
    first, last = (Rotation.from_euler("xyz", cable[end]["rpy"]) for end in ("start", "end"))
    count = len(held)
    tubes = [j for j in range(count) if held[j].tube is not None]

    def moments(x: np.ndarray) -> np.ndarray:
        out = np.zeros((count, 3))
        out[tubes, :2] = x[6 + 4 * count :].reshape(-1, 2)
        return out

    def slope(_: float, y: np.ndarray) -> np.ndarray:
        R, F, M = y[3:12].reshape(3, 3), y[12:15], y[15:]
        k, along = R.T @ M / K + natural, stretched(R, F)
        spin = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
        return np.concatenate([along, (R @ spin).ravel(), -weight, -np.cross(along, F)])

    def stretched(R: np.ndarray, F: np.ndarray) -> np.ndarray:
        return R[:, 2] + R @ (soft * (R.T @ F))

    def configurational(R: np.ndarray, F: np.ndarray, M: np.ndarray) -> float:
        m, n = R.T @ M, R.T @ F
        return float(n[2] + 0.5 * n @ (soft * n) + 0.5 * m @ (m / K) + m @ natural)

    def missed(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        jumps, arcs = x[6 : 6 + 3 * count].reshape(-1, 3), x[6 + 3 * count : 6 + 4 * count]
        turning = moments(x)
        y = np.concatenate([cable["start"]["position"], first.as_matrix().ravel(), x[:6]])
        cuts, out = [0.0, *arcs, cable["length"]], []
        for j in range(count + 1):
            y = solve_ivp(slope, cuts[j : j + 2], y, method="DOP853", rtol=accuracy, atol=1e-13).y[:, -1]
            if j == count:
                break
            out.append(y[:3] - held[j].position)
            R = y[3:12].reshape(3, 3)
            tube = held[j].tube
            if tube is not None:
                out.append(tube.inv().apply(R[:, 2])[:2])
                before = configurational(R, y[12:15], y[15:])
                y[12:] -= np.concatenate([jumps[j], tube.apply(turning[j])])
                out.append(np.array([configurational(R, y[12:15], y[15:]) - before]))
                continue
            way = stretched(R, y[12:15]) + stretched(R, y[12:15] - jumps[j])
            tangent = way / np.linalg.norm(way)
            along = float(jumps[j] @ tangent)
            across = float(np.linalg.norm(jumps[j] - along * tangent))
            y[12:15] -= jumps[j]
            drop = -along - held[j].friction * across
            out.append(np.array([drop if held[j].slides else arcs[j] - guess.arcs[j]]))
        turn = last.inv() * Rotation.from_matrix(y[3:12].reshape(3, 3))
        out += [y[:3] - cable["end"]["position"], turn.as_rotvec()]
        return np.concatenate(out), y

    x0 = np.concatenate([-guess.start, guess.forces.ravel(), guess.arcs, guess.moments[tubes, :2].ravel()])
    found = root(lambda x: missed(x)[0], x0, method="hybr", tol=1e-13)
    residual, y = missed(found.x)
    assert np.abs(residual).max() < 1e-8, residual
    x = found.x
    forces, arcs = x[6 : 6 + 3 * count].reshape(-1, 3), x[6 + 3 * count : 6 + 4 * count]
    return Solution(-x[:6], y[12:], forces, arcs, moments(x))
