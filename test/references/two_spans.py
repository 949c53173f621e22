# SPDX-License-Identifier: Apache-2.0
"""A clamped beam on one support in between, in closed form: each span bends as a sum of four functions."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq


def two_spans(at: float, count: int) -> np.ndarray:
    """(count,) angular frequencies; EI = rho = L = 1, the support at the arc length `at`.

    From the clamp on, w = a (cosh bx - cos bx) + c (sinh bx - sin bx) is zero at the support; slope and
    moment are the same from both sides.
    """

    def span(b: float, long: float) -> np.ndarray:
        """Displacement, slope and moment at the support of both functions, without their growth."""
        x = b * long
        grow = np.exp(-x)
        cosh, sinh, cos, sin = 0.5 + 0.5 * grow**2, 0.5 - 0.5 * grow**2, grow * np.cos(x), grow * np.sin(x)
        return np.array([[cosh - cos, sinh - sin], [sinh + sin, cosh - cos], [cosh + cos, sinh + sin]])

    def miss(b: float) -> float:
        left, right = span(b, at), span(b, 1.0 - at)
        whole = np.zeros((4, 4))
        whole[0, :2], whole[1, 2:] = left[0], right[0]
        whole[2], whole[3] = np.append(left[1], right[1]), np.append(left[2], -right[2])
        return float(np.linalg.det(whole))

    grid = np.linspace(0.5, 4.0 * (count + 2), 4000 * count)
    values = [miss(b) for b in grid]
    roots = np.flatnonzero(np.sign(values[1:]) != np.sign(values[:-1]))[:count]
    return np.array([brentq(miss, grid[i], grid[i + 1], xtol=1e-13) for i in roots]) ** 2
