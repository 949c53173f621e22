# SPDX-License-Identifier: Apache-2.0
"""Compiled: where contact points sit on the cable, and the boundaries between elements that go with them.

The curvature has a kink under a point force, and the shear force jumps at the ends of a stretch: both want a
boundary between two elements. Units of the cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import LEAF, njit
from cable_ros.contact.distance import gap
from cable_ros.contact.points import FORCE, KIND, OBSTACLE, PLACE, POINT, SAMPLE, TIE
from cable_ros.rod.centreline import curve, direction, position, shape

OPTIONS = {"cache": True, "error_model": "numpy"}

NARROWEST = 0.12
"""A boundary slides no nearer to its neighbours than this part of the way between them, and no nearer to a
clamp than half the way to it, if that is less."""
SHORTEST = 1e-3
"""And no nearer than this to one that another contact point has; parts of the length."""


@njit(**LEAF)
def gap_at(q, h, s0, nodes, c, s, obstacle, r, t, dt, n, directions, bends):
    """Gap at arc length s, its first and second derivative by s."""
    position(c, h, s0, s, r)
    direction(q, h, s0, nodes, s, t, dt)
    value = gap(obstacle, r, n, directions, bends)
    slope, curvature = 0.0, 0.0
    for a in range(3):
        slope += n[a] * t[a]
        curvature += n[a] * dt[a]
    for i in range(2):
        along = directions[i, 0] * t[0] + directions[i, 1] * t[1] + directions[i, 2] * t[2]
        curvature += bends[i] * along * along
    return value, slope, curvature


@njit(**OPTIONS)
def lowest(q, h, s0, nodes, c, s, reach, obstacle):
    """The arc length of the gap's minimum near s, at most `reach` away, by safeguarded Newton steps."""
    r, t, dt, n = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    directions, bends = np.empty((2, 3)), np.empty(2)
    low, high = max(s - reach, 0.0), min(s + reach, 1.0)
    for _ in range(30):
        _, slope, curvature = gap_at(q, h, s0, nodes, c, s, obstacle, r, t, dt, n, directions, bends)
        if slope > 0.0:
            high = s
        else:
            low = s
        new = s - slope / curvature if curvature > 0.0 else 0.5 * (low + high)
        if not low <= new <= high:
            new = 0.5 * (low + high)
        if abs(new - s) < 1e-13:
            return new
        s = new
    return s


@njit(**LEAF)
def room(points, count, boundary, h, s0):
    """How near a boundary may come to the one before it and to the one after it."""
    narrow = NARROWEST * (h[boundary - 1] + h[boundary])
    before, after = narrow, narrow
    # a point may come close to a clamp
    if boundary == 1:
        before = min(narrow, max(0.5 * h[0], SHORTEST))
    if boundary == h.shape[0] - 1:
        after = min(narrow, max(0.5 * h[boundary], SHORTEST))
    for i in range(count):
        if points[i, TIE] == boundary - 1 and boundary > 1:
            before = min(narrow, SHORTEST)
        if points[i, TIE] == boundary + 1:
            after = min(narrow, SHORTEST)
    return before, after


@njit(**OPTIONS)
def slide(q, h, s0, nodes, boundary, s, before, after):
    """Move the boundary between two elements to the arc length s; the shape q (n, 4) stays, its nodes move.

    Returns whether it may: no nearer than `before` and `after` to the neighbouring boundaries.
    """
    e = boundary - 1
    low, old = s0[e], s0[boundary]
    high = old + h[boundary]
    if s - low < before or high - s < after:
        return False
    if s == old:
        return True
    order = nodes.shape[0] - 1
    first = e * order
    N, dN = np.empty(order + 1), np.empty(order + 1)
    moved = np.empty((2 * order + 1, 4))
    for m in range(2 * order + 1):
        at = low + (s - low) * nodes[m] if m <= order else s + (high - s) * nodes[m - order]
        left = at < old
        shape(nodes, (at - low) / (old - low) if left else (at - old) / (high - old), N, dN)
        base = first if left else first + order
        size = 0.0
        for a in range(4):
            v = 0.0
            for i in range(order + 1):
                v += N[i] * q[base + i, a]
            moved[m, a] = v
            size += v * v
        size = 1.0 / np.sqrt(size)
        for a in range(4):
            moved[m, a] *= size
    for m in range(1, 2 * order):
        for a in range(4):
            q[first + m, a] = moved[m, a]
    h[e], h[boundary] = s - low, high - s
    s0[boundary] = s
    return True


@njit(**OPTIONS)
def tie(points, count, i, h, s0):
    """Give contact point i the nearest free boundary that can come to it, or none; whether it has one."""
    s = points[i, PLACE]
    best, distance = -1, np.inf
    points[i, TIE] = -1.0
    for b in range(1, h.shape[0]):
        low, high = s0[b - 1], s0[b] + h[b]
        away = abs(s - s0[b])
        before, after = room(points, count, b, h, s0)
        there = away < 1e-9 or (low + 1.5 * before < s < high - 1.5 * after)
        if not there or away >= distance:
            continue
        taken = False
        for k in range(count):
            taken = taken or points[k, TIE] == b
        if not taken:
            best, distance = b, away
    points[i, TIE] = best
    return best >= 0


@njit(**OPTIONS)
def place_points(q, h, s0, N, nodes, primitives, c, obstacles, spacing, points, count):
    """Let the points go to their gap's minimum, and boundaries to them and to where stretches end.

    Returns whether each has its boundary.
    """
    r, t, dt, n = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    directions, bends = np.empty((2, 3)), np.empty(2)
    curve(q, h, N, primitives, c)
    tied = True
    for i in range(count):
        if points[i, KIND] == SAMPLE:
            continue
        if points[i, KIND] == POINT:
            ob, s = obstacles[int(points[i, OBSTACLE])], points[i, PLACE]
            _, _, curvature = gap_at(q, h, s0, nodes, c, s, ob, r, t, dt, n, directions, bends)
            minimum = lowest(q, h, s0, nodes, c, s, spacing, ob)
            # the kink that its force makes goes with the point: the shape does not show it where it went
            if 0.25 * points[i, FORCE] * abs(minimum - s) <= curvature:
                points[i, PLACE] = minimum
        for _ in range(2):
            if points[i, TIE] < 0.0 and not tie(points, count, i, h, s0):
                break
            b = int(points[i, TIE])
            before, after = room(points, count, b, h, s0)
            if slide(q, h, s0, nodes, b, points[i, PLACE], before, after):
                break
            points[i, TIE] = -1.0
        if points[i, TIE] >= 0.0:
            curve(q, h, N, primitives, c)
        else:
            tied = False
    return tied
