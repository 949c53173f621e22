# SPDX-License-Identifier: Apache-2.0
"""Two clamped rods that touch at a point with Coulomb friction, by shooting over both, step by step.

The rods and their loads are those of `crossing`. The force P = N n + f on the first acts at the point of both
surfaces on the line between the centres, so M jumps, too, by the moment of P at an arm of minus the radius
times n on the first, and the other way round on the second. Beside the conditions at the ends there are: the
centres are the radii apart, n is across both tangents, and the law. It is that of the step from the last
state, whose two touching points, fixed in their sections, are now u apart across n: u = 0, or
f = -mu N u / |u| if that needs more than mu N.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import root

from references.crossing import missed_end, shot

STICKS, SLIPS = False, True


@dataclass(frozen=True)
class Touch:
    """A state; world, N, m."""

    x: np.ndarray
    """(17,) wrenches on the starts, P on the first rod, arc lengths where they touch."""
    ends: np.ndarray
    """(2, 6) force and moment on the ends."""
    normal: np.ndarray
    """(3,) from the second to the first."""
    arms: tuple[np.ndarray, np.ndarray]
    """(3,) from the centres to where they touch, along the axes of the sections."""
    slips: bool

    @property
    def arcs(self) -> np.ndarray:
        return self.x[15:]

    @property
    def normal_force(self) -> float:
        return float(self.x[12:15] @ self.normal)

    @property
    def friction(self) -> np.ndarray:
        return self.x[12:15] - self.normal_force * self.normal


class Rods:
    """Two rods as in a scene, in the world, with these radii and this coefficient of friction."""

    def __init__(
        self, gravity: np.ndarray, radii: tuple[float, float], limit: float, accuracy: float = 1e-10
    ) -> None:
        self.gravity, self.radii, self.limit, self.accuracy = gravity, radii, limit, accuracy

    def _states(
        self, cables: list[dict[str, Any]], x: np.ndarray, arcs: np.ndarray
    ) -> list[list[np.ndarray]]:
        """Of each rod: where they touch, at `arcs` (2,), and at the end."""
        P, none, out = x[12:15], np.zeros(3), []
        n = self._normal(cables, x)
        for i, sign in enumerate((1.0, -1.0)):
            couple = np.cross(-sign * self.radii[i] * n, sign * P)
            loads = [(x[15 + i], sign * P, couple), (arcs[i], none)]
            out.append(shot(cables[i], self.gravity, x[6 * i : 6 * i + 6], loads, self.accuracy))
        return out

    def _normal(self, cables: list[dict[str, Any]], x: np.ndarray) -> np.ndarray:
        """The rods before the contact do not depend on it."""
        first, second = (
            shot(cables[i], self.gravity, x[6 * i : 6 * i + 6], [(x[15 + i], np.zeros(3))], self.accuracy)[0]
            for i in range(2)
        )
        n = first[:3] - second[:3]
        return n / np.linalg.norm(n)

    def begin(self, cables: list[dict[str, Any]], starts: np.ndarray, arcs: np.ndarray) -> Touch:
        """Where the rods are near each other without a force; `starts` (2, 6): about the wrenches there."""
        x = np.concatenate([starts.ravel(), np.zeros(3), arcs])

        def missed(y: np.ndarray) -> np.ndarray:
            at = np.concatenate([y[:12], np.zeros(3), y[12:]])
            both = self._states(cables, at, y[12:])
            r = both[0][0][:3] - both[1][0][:3]
            off = [0.1 * r @ one[0][3:12].reshape(3, 3)[:, 2] for one in both]
            return np.concatenate([*(v for i in range(2) for v in missed_end(cables[i], both[i][-1])), off])

        found = root(missed, np.concatenate([x[:12], x[15:]]), method="hybr", options={"xtol": 1e-13})
        assert np.abs(found.fun).max() < 1e-9
        return self._kept(cables, np.concatenate([found.x[:12], np.zeros(3), found.x[12:]]), STICKS)

    def distance(self, cables: list[dict[str, Any]], at: Touch) -> float:
        """Of the centres, m."""
        first, second = (each[0][:3] for each in self._states(cables, at.x, at.arcs))
        return float(np.linalg.norm(first - second))

    def step(self, cables: list[dict[str, Any]], last: Touch) -> Touch:
        """The state for clamps elsewhere."""
        for slips in (last.slips, not last.slips):
            x = self._solved(cables, last, slips)
            if x is None:
                continue
            found = self._kept(cables, x, slips)
            beyond = np.linalg.norm(found.friction) > (1.0 + 1e-7) * self.limit * found.normal_force
            against = self._slip(cables, x, last)[0] @ found.friction <= 0.0
            if (against if slips else not beyond) and found.normal_force > 0.0:
                return found
        raise ValueError("Neither stick nor slip has a solution nearby.")

    def _slip(
        self, cables: list[dict[str, Any]], x: np.ndarray, last: Touch
    ) -> tuple[np.ndarray, list[list[np.ndarray]]]:
        both = self._states(cables, x, last.arcs)
        points = [
            one[1][:3] + one[1][3:12].reshape(3, 3) @ arm for one, arm in zip(both, last.arms, strict=True)
        ]
        return points[0] - points[1], both

    def missed(self, cables: list[dict[str, Any]], x: np.ndarray, last: Touch, slips: bool) -> np.ndarray:
        """(17,) by how much x is off the equations of a step from the last state, that sticks or slips."""
        u, both = self._slip(cables, x, last)
        r, P = both[0][0][:3] - both[1][0][:3], x[12:15]
        distance = np.linalg.norm(r)
        n = r / distance
        slip, f = u - (u @ n) * n, P - (P @ n) * n
        law = f + self.limit * (P @ n) * slip / max(np.linalg.norm(slip), 1e-300) if slips else slip
        tilts = [0.1 * n @ one[0][3:12].reshape(3, 3)[:, 2] for one in both]
        ends = [v for i in range(2) for v in missed_end(cables[i], both[i][-1])]
        # along two directions that stay as they are while x is found
        across = np.linalg.svd(last.normal[None])[2][1:]
        return np.concatenate([*ends, [distance - sum(self.radii)], tilts, across @ law])

    def _solved(self, cables: list[dict[str, Any]], last: Touch, slips: bool) -> np.ndarray | None:
        x = last.x.copy()
        if slips and not last.slips:
            # from stick that is cut to the cone
            stuck = self._solved(cables, last, STICKS)
            if stuck is None:
                return None
            x, n = stuck, last.normal
            f = x[12:15] - x[12:15] @ n * n
            x[12:15] -= f * (1.0 - self.limit * (x[12:15] @ n) / np.linalg.norm(f))
        for _ in range(3):
            found = root(
                lambda y: self.missed(cables, y, last, slips), x, method="hybr", options={"xtol": 1e-12}
            )
            x = found.x
            if np.abs(found.fun).max() < 1e-9:
                return np.array(x)
        return None

    def _kept(self, cables: list[dict[str, Any]], x: np.ndarray, slips: bool) -> Touch:
        both = self._states(cables, x, x[15:])
        first, second = both[0][0], both[1][0]
        n = first[:3] - second[:3]
        n /= np.linalg.norm(n)
        arms = (
            first[3:12].reshape(3, 3).T @ (-self.radii[0] * n),
            second[3:12].reshape(3, 3).T @ (self.radii[1] * n),
        )
        return Touch(x, np.array([both[0][-1][12:], both[1][-1][12:]]), n, arms, slips)
