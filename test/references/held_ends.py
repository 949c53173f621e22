# SPDX-License-Identifier: Apache-2.0
"""A rod with ends of any kind by shooting: initial values at the start, met at the end; shares no code.

State (r, R, F, M) in the world, SI: r' = t, R' = R [kappa]x with R^T M = K (kappa - kappa0), F' = -w,
M' = -t x F (Liu et al. 2018, equations 8 and 9), with F, M what the part beyond exerts on the part before. A
cable that stretches or shears has t + R C R^T F in the place of t, with its compliance C.
Balls that it touches push on it at points: F jumps there, by a force along the normal across the tangent. A
free end may rest on a plane.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from references.supported import compliance


@dataclass(frozen=True)
class Ball:
    """What the cable touches at one point, as guessed, and then as solved."""

    centre: np.ndarray
    radius: float
    """The cable's own counted, m."""
    arc: float
    """Of the point, m."""
    push: float
    """Of the ball on the cable, N."""


@dataclass(frozen=True)
class Solution:
    """Wrenches on the cable in the world, about the cable's own ends, and its points."""

    converged: bool
    start_force: np.ndarray
    start_moment: np.ndarray
    end_force: np.ndarray
    end_moment: np.ndarray
    start: np.ndarray
    end: np.ndarray
    start_frame: Rotation
    end_frame: Rotation
    balls: tuple[Ball, ...]


@dataclass(frozen=True)
class Problem:
    """A cable of a scene mapping, whose mounts are fixed in the world.

    A free end that rests on a plane has `"rests": (normal, height)` there, the height of the cable's axis.
    """

    cable: dict[str, Any]
    gravity: np.ndarray
    balls: tuple[Ball, ...] = ()
    """In the order of their arc lengths."""
    accuracy: float = 1e-11
    K: np.ndarray = field(init=False)
    natural: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "K", np.array(self.cable["stiffness"], float))
        object.__setattr__(self, "natural", np.array(self.cable.get("natural_strain", [0.0, 0.0, 0.0])))

    def _integrate(self, y: np.ndarray, balls: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(18,) the end's state and (2 n,) what the balls' conditions are missed by, from those at the start.

        `balls` (n, 2): arc length and push of each.
        """
        missed, at = np.empty((len(balls), 2)), 0.0
        for i, (arc, push) in enumerate(balls):
            y, at = self._span(y, at, arc), arc
            away = y[:3] - self.balls[i].centre
            n = away / np.linalg.norm(away)
            missed[i] = np.linalg.norm(away) - self.balls[i].radius, n @ y[3:12].reshape(3, 3)[:, 2]
            y[12:15] -= push * n
        return self._span(y, at, self.cable["length"]), missed.ravel()

    def _span(self, initial: np.ndarray, begin: float, end: float) -> np.ndarray:
        weight, soft = self.cable["linear_density"] * self.gravity, compliance(self.cable)

        def slope(_: float, y: np.ndarray) -> np.ndarray:
            R = y[3:12].reshape(3, 3)
            F, M = y[12:15], y[15:]
            kappa = R.T @ M / self.K + self.natural
            spin = np.array([[0, -kappa[2], kappa[1]], [kappa[2], 0, -kappa[0]], [-kappa[1], kappa[0], 0]])
            t = R[:, 2] + R @ (soft * (R.T @ F))
            return np.concatenate([t, (R @ spin).ravel(), -weight, -np.cross(t, F)])

        span = (begin, end)
        return solve_ivp(slope, span, initial, method="DOP853", rtol=self.accuracy, atol=1e-12).y[:, -1]

    def solve(self, guess: np.ndarray) -> Solution:
        """From a guess of position (3,), rotation vector (3,), force and moment (6,) inside the start."""
        size = 1.0 + np.abs(guess[6:]).max()
        scale = np.concatenate([np.ones(6), np.full(6, size), np.tile([1.0, size], len(self.balls))])

        def shot(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            turn = Rotation.from_rotvec(values[3:6]).as_matrix().ravel()
            initial = np.concatenate([values[:3], turn, values[6:12]])
            return self._integrate(initial, values[12:].reshape(-1, 2))

        def conditions(x: np.ndarray) -> np.ndarray:
            values = x * scale
            final, missed = shot(values)
            R = Rotation.from_rotvec(values[3:6])
            at_start = _missed(self.cable["start"], values[:3], R, -values[6:9], -values[9:12])
            end = Rotation.from_matrix(final[3:12].reshape(3, 3))
            at_end = _missed(self.cable["end"], final[:3], end, final[12:15], final[15:])
            return np.concatenate([at_start, at_end, missed])

        touched = [x for ball in self.balls for x in (ball.arc, ball.push)]
        found = root(conditions, np.concatenate([guess, touched]) / scale, method="hybr", tol=1e-12)
        values = found.x * scale
        R, (final, _) = Rotation.from_rotvec(values[3:6]), shot(values)
        touched = values[12:].reshape(-1, 2)
        balls = (replace(ball, arc=s, push=f) for ball, (s, f) in zip(self.balls, touched, strict=True))
        return Solution(
            bool(np.abs(conditions(found.x)).max() < 1e-8),
            -values[6:9], -values[9:12], final[12:15], final[15:],
            values[:3], final[:3], R, Rotation.from_matrix(final[3:12].reshape(3, 3)), tuple(balls),
        )  # fmt: skip


def _missed(
    mount: dict[str, Any], r: np.ndarray, R: Rotation, force: np.ndarray, moment: np.ndarray
) -> np.ndarray:
    """(6,) what an end's conditions are missed by; force and moment on the cable, world."""
    kind = mount.get("kind", "clamped")
    if kind == "free":
        excess = force - mount.get("force", np.zeros(3))
        if "rests" in mount:
            normal, height = mount["rests"]
            excess = np.append(np.linalg.svd(normal[None])[2][1:] @ excess, normal @ r - height)
        return np.concatenate([excess, moment - mount.get("moment", np.zeros(3))])
    frame = Rotation.from_euler("xyz", mount.get("rpy", [0.0, 0.0, 0.0]))
    gap, turn = r - np.array(mount["position"]), (frame.inv() * R).as_rotvec()
    if kind == "pinned":
        return np.concatenate([gap, moment])
    if kind == "swivel":
        tangent = frame.inv().apply(R.as_matrix()[:, 2])
        return np.concatenate([gap, tangent[:2], [float(moment @ R.as_matrix()[:, 2])]])
    if kind == "sliding":
        axis = np.array(mount.get("axis", [0.0, 0.0, 1.0]), float)
        axis = frame.apply(axis / np.linalg.norm(axis))
        across = np.linalg.svd(axis[None])[2][1:]
        held = moment if mount.get("rotation") == "free" else turn
        return np.concatenate([across @ gap, [float(force @ axis) - mount.get("axial_force", 0.0)], held])
    return np.concatenate([gap, turn])
