# SPDX-License-Identifier: Apache-2.0
"""Compiled: the closest points of two cables."""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import njit
from cable_ros.rod.centreline import direction, position

ITERATIONS = 30
"""Maximum number of iterations; Newton's method takes three to five."""
CLOSE = 1e-13
"""Step, L, at which they end."""


@njit(cache=True)
def closest_points(a, b, arcs, points, tangents):  # type: ignore[no-untyped-def]
    """The points of two curves whose distance is smallest nearby, by Newton's method.

    Args:
        a, b: nodal frames q (n, 4), coefficients c (m, g + 1, 3) of the centreline, lengths and starts (m,)
            of the elements, L; nodes of an element; length, m. Frames and centreline in the world, m.
        arcs: (2,) arc lengths to start from, L; receives those of the points.
        points, tangents: (2, 3) receive the points and the tangents there.
    """
    (q, c, h, s0, nodes, length), (q2, c2, h2, s2, nodes2, length2) = a, b
    bend, bend2 = np.empty(3), np.empty(3)
    for _ in range(ITERATIONS):
        position(c, h, s0, arcs[0], points[0])
        direction(q, h, s0, nodes, arcs[0], tangents[0], bend)
        position(c2, h2, s2, arcs[1], points[1])
        direction(q2, h2, s2, nodes2, arcs[1], tangents[1], bend2)
        along, back, cosine, more, less = 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(3):
            d = points[0, k] - points[1, k]
            along += d * tangents[0, k]
            back -= d * tangents[1, k]
            cosine += tangents[0, k] * tangents[1, k]
            more += d * bend[k] / length
            less -= d * bend2[k] / length2
        first, second = 1.0 + more, 1.0 + less
        determinant = first * second - cosine * cosine
        if not (first > 0.0 and determinant > 0.01 * first * second):  # not beside a minimum, or parallel
            first, second = 1.0, 1.0
            determinant = max(1.0 - cosine * cosine, 0.01)
        step = -(second * along + cosine * back) / determinant / length
        step2 = -(first * back + cosine * along) / determinant / length2
        before, before2 = arcs[0], arcs[1]
        arcs[0] = min(max(arcs[0] + step, 0.0), 1.0)
        arcs[1] = min(max(arcs[1] + step2, 0.0), 1.0)
        if abs(arcs[0] - before) < CLOSE and abs(arcs[1] - before2) < CLOSE:
            break
