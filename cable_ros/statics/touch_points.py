"""Compiled: the table of contact points.

One row each, see the columns below. A point slides (its place is where the gap has its minimum) or is flat
(one of the samples of a stretch that lies on the surface, on a stiff spring). Units of the cable, start
clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import njit
from cable_ros.mechanics.effects.contact_kernels import find_element

OPTIONS = {"cache": True, "error_model": "numpy"}

CAPACITY = 240
"""Contact points at once."""
OBSTACLE, PLACE, FLAT, FORCE, FRICTION, HELD, TIE, LENGTH = 0, 1, 2, 3, 4, 7, 10, 11
"""Columns of the contact points (CAPACITY, COLUMNS): obstacle, arc length, 1 for flat, normal force, friction
(3), the friction of the last equilibrium (3), the boundary between elements that goes with the point (-1:
none), and the length of cable that a flat point stands for."""
COLUMNS = 12
FOUNDATION = 1e10
"""Stiffness of the springs under a stretch per length of the cable, EI / L^4.

A pressure of 100 EI / L^3 sinks in by 1e-8 of the length, and the force where the cable lifts off, spread
over about (EI / FOUNDATION)^1/4 = 0.003 of it, by some 1e-7.
"""
LYING = 6
"""So many samples has an element that lies on a surface at most."""
APART = 2.5
"""Around a sliding point so many samples are its own."""


@njit(**OPTIONS)
def add(points, count, o, s, flat, room):
    """One more contact point, unless there is no space or one nearer than `room`; returns the count."""
    for i in range(count):
        if points[i, OBSTACLE] == o and abs(points[i, PLACE] - s) < room:
            return count
    if count < points.shape[0]:
        points[count] = 0.0
        points[count, OBSTACLE], points[count, PLACE], points[count, TIE] = o, s, -1.0
        points[count, FLAT] = 1.0 if flat else 0.0
        return count + 1
    return count


@njit(**OPTIONS)
def remove(points, count, i):
    """Drop contact point i, keeping the others' order; returns the count."""
    for k in range(i, count - 1):
        points[k] = points[k + 1]
    return count - 1


@njit(**OPTIONS)
def owned(points, count, o, s, reach):
    """Whether a sliding point on obstacle o is within `reach` of s."""
    for i in range(count):
        if points[i, OBSTACLE] == o and points[i, FLAT] == 0.0 and abs(points[i, PLACE] - s) < reach:
            return True
    return False


@njit(**OPTIONS)
def ends(points, count, i, spacing):
    """Whether flat point i is the first of its stretch, and whether the last."""
    first, last = True, True
    for k in range(count):
        if k != i and points[k, FLAT] == 1.0 and points[k, OBSTACLE] == points[i, OBSTACLE]:
            d = points[k, PLACE] - points[i, PLACE]
            first = first and not -1.5 * spacing < d < 0.0
            last = last and not 0.0 < d < 1.5 * spacing
    return first, last


@njit(**OPTIONS)
def share(points, count, reach):
    """Let the newest flat point rub, for its force, as its nearest neighbour within `reach` does."""
    new = count - 1
    best, distance = -1, reach
    for i in range(new):
        d = abs(points[i, PLACE] - points[new, PLACE])
        if points[i, OBSTACLE] == points[new, OBSTACLE] and points[i, FLAT] == 1.0 and d < distance:
            best, distance = i, d
    if best >= 0 and points[best, FORCE] > 0.0:
        for a in range(FRICTION, HELD + 3):
            points[new, a] = points[best, a] * points[new, FORCE] / points[best, FORCE]


@njit(**OPTIONS)
def lay(points, count, o, low, high, samples, spacing):
    """Make low..high on obstacle o a stretch, with the sliding points about it, which give it their force."""
    total = np.zeros(HELD + 3 - FORCE)
    i = 0
    while i < count:
        s = points[i, PLACE]
        near = low - APART * spacing < s < high + APART * spacing
        if points[i, OBSTACLE] == o and points[i, FLAT] == 0.0 and near:
            total += points[i, FORCE : HELD + 3]
            low, high = min(low, points[i, PLACE]), max(high, points[i, PLACE])
            count = remove(points, count, i)
        else:
            i += 1
    before = count
    for k in range(1, samples.shape[0] - 1):
        if low - 0.75 * spacing < samples[k] < high + 0.75 * spacing:
            count = add(points, count, o, samples[k], True, 1e-9)
    for i in range(before, count):
        points[i, FORCE : HELD + 3] = total / (count - before)
        points[i, LENGTH] = spacing
    return count


@njit(**OPTIONS)
def coarse(points, count, h, s0, spacing):
    """Whether an element on which a stretch lies is too long to follow the surface between its ends."""
    for i in range(count):
        if points[i, FLAT] == 1.0:
            e, _ = find_element(points[i, PLACE], s0, h)
            if h[e] > 1.1 * LYING * spacing:
                return True
    return False
