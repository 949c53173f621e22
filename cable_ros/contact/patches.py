# SPDX-License-Identifier: Apache-2.0
"""Compiled: stretches along which the cable lies on an obstacle, see `contact.points`; how they grow and
part.

Where a cable lifts off a smooth surface, gap and slope are zero and a concentrated force acts; its place is
where no couple is needed to hold the slope, that is where the curvature does not jump. In between, a pressure
holds the cable on the surface at the points of a Gauss rule on each element. Units of the cable, start
clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import njit
from cable_ros.contact.distance import gap
from cable_ros.contact.points import (
    ARC_LENGTH,
    BEFORE,
    FIRST,
    FORCE,
    KIND,
    LAST,
    LENGTH,
    LYING,
    NUMBER,
    OBSTACLE,
    POINT,
    SAMPLE,
    SHIFT,
    SLOPE_ROW,
    add,
    remove,
)
from cable_ros.rod.centreline import position

OPTIONS = {"cache": True, "error_model": "numpy"}

SAMPLES = 4
"""An element that lies on a surface has so many samples: fewer than it has ways to bend, and the Gauss rule
makes a smooth pressure of their forces."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(SAMPLES)
NODES, WEIGHTS = 0.5 * (1.0 + _NODES), 0.5 * _WEIGHTS
STRIDE = 2.0
"""An end of a stretch goes so many samples' spacing at most in an iteration."""
ROOM = 0.45
"""And this part of the way to what is next to it."""
CREEP = 0.3
"""An end that goes this part of its last way again is sent where a geometric series of such ways ends."""
FAINT = 1e-3
"""Force, EI / L^2, below which the place where it acts is found with care."""
CLAMPED = 1e-8
"""A clamp less than this above a surface is on it."""


@njit(**OPTIONS)
def inside(points, count, o, s):
    """Whether arc length s is in a stretch on obstacle o."""
    left, right = -1.0, 2.0
    before, after, lies = POINT, POINT, False
    for i in range(count):
        if points[i, OBSTACLE] != o or points[i, KIND] == POINT:
            continue
        if points[i, KIND] == SAMPLE:
            lies = True
            continue
        place = points[i, ARC_LENGTH]
        if left < place <= s:
            left, before = place, points[i, KIND]
        if s < place < right:
            right, after = place, points[i, KIND]
    if left >= 0.0:
        return before == FIRST
    return after == LAST if right <= 1.0 else lies


@njit(**OPTIONS)
def place(g, h, s0):
    """Arc length of sample g."""
    return s0[g // SAMPLES] + h[g // SAMPLES] * NODES[g % SAMPLES]


@njit(**OPTIONS)
def cover(points, count, h, s0, covered):
    """Mark in `covered` (obstacles, samples) the samples that are in a stretch."""
    covered[:] = False
    for o in range(covered.shape[0]):
        lies = False
        for i in range(count):
            lies = lies or (points[i, OBSTACLE] == o and points[i, KIND] != POINT)
        if lies:
            for g in range(covered.shape[1]):
                covered[o, g] = inside(points, count, o, place(g, h, s0))


@njit(**OPTIONS)
def fill(points, count, h, s0, covered):
    """Give what has come to be in a stretch its samples, and take those of what no longer is.

    `covered` as `cover` left it for the stretches before. Returns (changes, count).
    """
    now = np.empty_like(covered)
    cover(points, count, h, s0, now)
    changes, i = 0, 0
    while i < count:
        if points[i, KIND] == SAMPLE:
            g = int(points[i, NUMBER])
            if not now[int(points[i, OBSTACLE]), g]:
                count = remove(points, count, i)
                changes += 1
                continue
            points[i, ARC_LENGTH], points[i, LENGTH] = place(g, h, s0), h[g // SAMPLES] * WEIGHTS[g % SAMPLES]
        i += 1
    for o in range(now.shape[0]):
        for g in range(now.shape[1]):
            if now[o, g] and not covered[o, g]:
                count = sample(points, count, o, g, h, s0)
                changes += 1
    for o in range(now.shape[0]):
        for g in range(now.shape[1]):
            covered[o, g] = now[o, g]
    return changes, count


@njit(**OPTIONS)
def resample(points, count, h, s0):
    """Take for the samples of all stretches those of the elements with lengths h and starts s0; the count."""
    obstacles = 0
    for i in range(count):
        obstacles = max(obstacles, int(points[i, OBSTACLE]) + 1)
    covered = np.empty((obstacles, SAMPLES * h.shape[0]), np.bool_)
    cover(points, count, h, s0, covered)
    old = points[:count].copy()
    before, count = count, 0
    for i in range(before):
        if old[i, KIND] != SAMPLE:
            points[count] = old[i]
            count += 1
    for o in range(obstacles):
        for g in range(covered.shape[1]):
            if covered[o, g]:
                count = sample(points, count, o, g, h, s0)
                inherit(points, count - 1, old, before)
    return count


@njit(**OPTIONS)
def sample(points, count, o, g, h, s0):
    """One more sample, g, which presses and rubs as its nearest neighbour; the count."""
    before = count
    count = add(points, count, o, place(g, h, s0), SAMPLE)
    if count > before:
        points[before, LENGTH], points[before, NUMBER] = h[g // SAMPLES] * WEIGHTS[g % SAMPLES], g
        inherit(points, before, points, before)
    return count


@njit(**OPTIONS)
def inherit(points, i, others, count):
    """Let sample i press and rub, for its length, as the nearest of the `others` on its obstacle does."""
    best, distance = -1, np.inf
    for k in range(count):
        d = abs(others[k, ARC_LENGTH] - points[i, ARC_LENGTH])
        if others[k, OBSTACLE] == points[i, OBSTACLE] and others[k, KIND] == SAMPLE and d < distance:
            best, distance = k, d
    if best >= 0:
        for a in range(FORCE, BEFORE + 3):
            points[i, a] = others[best, a] * points[i, LENGTH] / others[best, LENGTH]


@njit(**OPTIONS)
def lay(points, count, o, low, high):
    """Make low..high on obstacle o a stretch, with the points in it, which give it their force.

    From 0, or to 1, it begins or ends at the clamp.
    """
    total = np.zeros(BEFORE + 3 - FORCE)
    i = 0
    while i < count:
        s = points[i, ARC_LENGTH]
        if points[i, OBSTACLE] == o and points[i, KIND] == POINT and low <= s <= high:
            total += points[i, FORCE : BEFORE + 3]
            count = remove(points, count, i)
        else:
            i += 1
    for s, kind in ((low, FIRST), (high, LAST)):
        if 0.0 < s < 1.0 and count < points.shape[0]:
            count = add(points, count, o, s, kind)
            points[count - 1, FORCE : BEFORE + 3] = 0.5 * total
    return count


@njit(**OPTIONS)
def grounded(c, h, s0, obstacle, s):
    """Whether the clamp at s, 0 or 1, is on the obstacle's surface."""
    r, n = np.empty(3), np.empty(3)
    position(c, h, s0, s, r)
    return gap(obstacle, r, n, np.empty((2, 3)), np.empty(2)) < CLAMPED


@njit(**OPTIONS)
def move_ends(points, count, y, spacing):
    """Move points and stretches' ends to where no couple holds them; y (rows,) the borders' multipliers.

    The couple that holds the slope, divided by the force that acts there, is its lever; an end that pulls is
    out too far. Returns the largest motion.
    """
    largest = 0.0
    shifts = np.zeros(count)
    for i in range(count):
        if points[i, KIND] == SAMPLE or points[i, SLOPE_ROW] == 0.0:
            continue
        back, forth = points[i, ARC_LENGTH], 1.0 - points[i, ARC_LENGTH]
        for k in range(count):
            d = points[k, ARC_LENGTH] - points[i, ARC_LENGTH]
            if k == i or points[k, OBSTACLE] != points[i, OBSTACLE] or points[k, KIND] == SAMPLE:
                continue
            if d < 0.0:
                back = min(back, -d)
            else:
                forth = min(forth, d)
        shift = y[int(points[i, SLOPE_ROW])] / max(abs(points[i, FORCE]), FAINT)
        if points[i, FORCE] < 0.0 and points[i, KIND] != POINT:
            shift = (0.5 if points[i, KIND] == FIRST else -0.5) * spacing
        last, points[i, SHIFT] = points[i, SHIFT], shift
        if CREEP * last * last < shift * last < last * last:
            shift, points[i, SHIFT] = shift / (1.0 - shift / last), 0.0
        shift = min(max(shift, -STRIDE * spacing), STRIDE * spacing)
        shifts[i] = min(max(shift, -ROOM * back), ROOM * forth)
        largest = max(largest, abs(shifts[i]))
    for i in range(count):
        points[i, ARC_LENGTH] += shifts[i]
    return largest


@njit(**OPTIONS)
def neighbour(points, count, i, kind):
    """The next end of a stretch after point i on its obstacle, if it is of this kind; else -1."""
    best = -1
    for k in range(count):
        if points[k, OBSTACLE] != points[i, OBSTACLE] or points[k, KIND] < FIRST:
            continue
        later = points[k, ARC_LENGTH] > points[i, ARC_LENGTH] or (
            points[k, ARC_LENGTH] == points[i, ARC_LENGTH] and k > i
        )
        if k != i and later and (best < 0 or points[k, ARC_LENGTH] < points[best, ARC_LENGTH]):
            best = k
    return best if best >= 0 and points[best, KIND] == kind else -1


@njit(**OPTIONS)
def shrink(points, count, spacing, depth):
    """Make points of the stretches that are so short that they dip less than `depth`; (changed, count)."""
    changed, i = False, 0
    while i < count:
        j = neighbour(points, count, i, LAST) if points[i, KIND] == FIRST else -1
        length = points[j, ARC_LENGTH] - points[i, ARC_LENGTH] if j >= 0 else 1.0
        if length < spacing and length**3 * (points[i, FORCE] + points[j, FORCE]) < depth:
            points[i, FORCE : BEFORE + 3] += points[j, FORCE : BEFORE + 3]
            o, low = points[i, OBSTACLE], points[i, ARC_LENGTH]
            points[i, ARC_LENGTH], points[i, KIND] = low + 0.5 * length, POINT
            count = remove(points, count, j)
            count = clear(points, count, o, low, low + length)
            changed, i = True, 0
        else:
            i += 1
    return changed, count


@njit(**OPTIONS)
def settle(c, h, s0, points, count, spacing, obstacles, depth):
    """Change the stretches at a solution with the last ones; returns (changed, count).

    What is so short that it dips less than `depth` becomes a point, stretches that meet become one, one that
    reaches the clamp begins there, and where samples pull the cable lifts off.
    """
    changed, count = shrink(points, count, spacing, 5.0 * depth)
    i = 0
    while i < count:
        kind, s = points[i, KIND], points[i, ARC_LENGTH]
        if kind < FIRST:
            i += 1
            continue
        ob = obstacles[int(points[i, OBSTACLE])]
        edge = 0.0 if kind == FIRST else 1.0
        if abs(s - edge) < 0.5 * spacing and grounded(c, h, s0, ob, edge):
            count = remove(points, count, i)
            changed = True
            continue
        if kind == LAST:
            j = neighbour(points, count, i, FIRST)
            if j >= 0 and points[j, ARC_LENGTH] - s < 0.1 * spacing:
                count = remove(points, count, max(i, j))
                count = remove(points, count, min(i, j))
                changed = True
                i = 0
                continue
        if points[i, FORCE] < 0.0:
            points[i, ARC_LENGTH] += (-0.5 if kind == FIRST else 0.5) * min(spacing, abs(s - edge))
            changed = True
        i += 1
    lifted, count = part(points, count, h, s0, obstacles.shape[0])
    return changed or lifted, count


@njit(**OPTIONS)
def clear(points, count, o, low, high):
    """Drop the samples on obstacle o between low and high; the count."""
    i = 0
    while i < count:
        if points[i, KIND] == SAMPLE and points[i, OBSTACLE] == o and low <= points[i, ARC_LENGTH] <= high:
            count = remove(points, count, i)
        else:
            i += 1
    return count


@njit(**OPTIONS)
def part(points, count, h, s0, obstacles):
    """Take away the samples that pull; a stretch ends where several do. Returns (changed, count)."""
    changed = False
    size = SAMPLES * h.shape[0]
    covered = np.empty((obstacles, size), np.bool_)
    cover(points, count, h, s0, covered)
    presses = np.empty(size, np.bool_)
    pulls = np.empty(size, np.bool_)
    for o in range(obstacles):
        presses[:], pulls[:] = False, False
        i = 0
        while i < count:
            if points[i, OBSTACLE] == o and points[i, KIND] == SAMPLE:
                if points[i, FORCE] < 0.0:
                    pulls[int(points[i, NUMBER])] = True
                    changed = True
                    count = remove(points, count, i)
                    continue
                presses[int(points[i, NUMBER])] = True
            i += 1
        g = 0
        while g < size:
            if not covered[o, g] or presses[g]:
                g += 1
                continue
            first, any_pulls = g, False
            while g < size and covered[o, g] and not presses[g]:
                any_pulls = any_pulls or pulls[g]
                g += 1
            at_clamp = first == 0 or g == size
            if not any_pulls or (g == first + 1 and not at_clamp):
                continue
            low = place(first - 1, h, s0) if first > 0 and presses[first - 1] else -1.0
            high = place(g, h, s0) if g < size and presses[g] else -1.0
            count = lift(points, count, o, 0.5 * (place(first, h, s0) + place(g - 1, h, s0)), low, high)
    return changed, count


@njit(**OPTIONS)
def lift(points, count, o, s, low, high):
    """Let the cable lift off about s, between the samples at `low` and `high` that still press (-1: none).

    The stretch's end is a point where none does.
    """
    for presses, end, kind in ((low, FIRST, LAST), (high, LAST, FIRST)):
        if presses >= 0.0:
            count = add(points, count, o, presses, kind)
        else:
            e = end_beside(points, count, o, s, end)
            if e >= 0:
                points[e, KIND] = POINT
    return count


@njit(**OPTIONS)
def end_beside(points, count, o, s, kind):
    """The end of a stretch on obstacle o that is next to s, before it (FIRST) or after it (LAST); or -1."""
    best = -1
    for i in range(count):
        d = s - points[i, ARC_LENGTH] if kind == FIRST else points[i, ARC_LENGTH] - s
        if points[i, OBSTACLE] != o or points[i, KIND] != kind or d < 0.0:
            continue
        if best < 0 or d < abs(points[best, ARC_LENGTH] - s):
            best = i
    return best


@njit(**OPTIONS)
def coarse(points, count, h, s0, spacing):
    """Whether an element that lies on a surface is longer than LYING samples."""
    for e in range(h.shape[0]):
        if h[e] > 1.1 * LYING * spacing:
            middle = s0[e] + 0.5 * h[e]
            for i in range(count):
                if points[i, KIND] != POINT and inside(points, count, points[i, OBSTACLE], middle):
                    return True
    return False
