# SPDX-License-Identifier: Apache-2.0
"""Compiled: where patches lift off, between their ends, beside a clamp, or at an end that pulls.

Units of the cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, njit
from cable_ros.contact.distance import FRICTION_COEFFICIENT, gap
from cable_ros.contact.patch_ends import clear, merge, point_beyond, shrink
from cable_ros.contact.patches import CLAMPED, SAMPLES, WEIGHTS, cover, grounded, rests, sample_place
from cable_ros.contact.points import (
    APART,
    ARC_LENGTH,
    FIRST,
    FORCE,
    KIND,
    LAST,
    LENGTH,
    NUMBER,
    OBSTACLE,
    POINT,
    add,
    concentrated,
    reaction_at,
    remove,
    slide_along,
)
from cable_ros.rod.centreline import position

OPTIONS = {"cache": True, "error_model": "numpy"}

RIPPLE = 0.5
"""Least length, in spacings, along which samples between others that press must pull for the cable to lift
off there: beside a much longer element the pressure of a short one ripples."""
BESIDE_CLAMP = 2.0
"""The same beside a clamp on the surface: there a cable that leaves it along so little rises by less than
what counts as a depth, and force and couple of its lift-off are all but nothing."""


@njit(**INNER)
def settle(c, h, s0, points, count, spacing, obstacles, depth):
    """Change the patches at a solution.

    One that is so short that it hardly dips becomes a point, patches that meet become one, one that reaches
    the clamp begins there, and where samples pull the cable lifts off.

    Args:
        c: (m, g + 1, 3) of `Shape`.
        h, s0: (m,) of `Grid`.
        points, count, spacing: as in `patch_ends.move_ends`.
        obstacles: (o, WIDTH).
        depth: penetration that does not count, L.

    Returns:
        Whether any have changed, whether one has left a clamp, and the number of points.
    """
    changed, count = shrink(points, count, spacing, 5.0 * depth)
    merged, count = merge(points, count, spacing)
    changed = changed or merged
    i = 0
    while i < count:
        kind, s = points[i, KIND], points[i, ARC_LENGTH]
        if kind < FIRST:
            i += 1
            continue
        ob = obstacles[int(points[i, OBSTACLE])]
        edge = 0.0 if kind == FIRST else 1.0
        beside = abs(s - edge) < 0.5 * spacing and grounded(c, h, s0, ob, edge)
        if beside or dips_to_clamp(c, h, s0, ob, s, edge):
            count = remove(points, count, i)
            changed = True
            continue
        k = point_beyond(points, count, i, APART * spacing) if points[i, FORCE] < 0.0 else -1
        if k >= 0:
            # what spans the gap between the two would press: the patch reaches the point
            points[k, KIND] = kind
            count = remove(points, count, i)
            changed = True
            continue
        if points[i, FORCE] < 0.0:
            points[i, ARC_LENGTH] += (-0.5 if kind == FIRST else 0.5) * min(spacing, abs(s - edge))
            changed = True
        i += 1
    lifted, left, count = lift_off(points, count, c, h, s0, spacing, obstacles)
    return changed or lifted, left, count


@njit(**INNER)
def dips_to_clamp(c, h, s0, obstacle, s, clamp):
    """Whether the cable is inside the obstacle half way from arc length s to a clamp that rests on it.

    However little: how much of a cable that lies up to the clamp presses there depends on it.

    Args:
        c, h, s0: as in `settle`.
        obstacle: (WIDTH,).
        s, clamp: L; the latter is 0 or 1.
    """
    if not rests(c, h, s0, obstacle, clamp):
        return False
    r = np.empty(3)
    position(c, h, s0, 0.5 * (s + clamp), r)
    return gap(obstacle, r, np.empty(3), np.empty((2, 3)), np.empty(2)) < -CLAMPED


@njit(**INNER)
def lift_off(points, count, c, h, s0, spacing, obstacles):
    """Remove the samples that pull; a patch ends where several do, and where it leaves a lifted clamp.

    Arguments as in `settle`.

    Returns:
        Whether there were any, whether a patch has left a clamp, and the number of points.
    """
    changed, left = False, False
    size = SAMPLES * h.shape[0]
    covered = np.empty((obstacles.shape[0], size), np.bool_)
    cover(points, count, h, s0, covered)
    presses = np.empty(size, np.bool_)
    pulls = np.empty(size, np.bool_)
    for o in range(obstacles.shape[0]):
        presses[:], pulls[:], pulled = False, False, False
        i = 0
        while i < count:
            if points[i, OBSTACLE] == o and points[i, LENGTH] > 0.0:
                if points[i, FORCE] < 0.0:
                    pulls[int(points[i, NUMBER])] = pulled = changed = True
                    count = remove(points, count, i)
                    continue
                presses[int(points[i, NUMBER])] = True
            i += 1
        if not pulled:
            continue
        # on a rough surface the friction of what is dropped would be missed at once
        smooth = obstacles[o, FRICTION_COEFFICIENT] == 0.0
        for clamp in (0.0, 1.0):
            if smooth and not rests(c, h, s0, obstacles[o], clamp):
                reach, before = 2.0 * spacing, count
                count = leave_clamp(points, count, o, h, s0, clamp, reach, covered[o], presses, pulls)
                left = left or count < before
        g = 0
        while g < size:
            if not covered[o, g] or presses[g]:
                g += 1
                continue
            first, any_pulls, length = g, False, 0.0
            while g < size and covered[o, g] and not presses[g]:
                any_pulls = any_pulls or pulls[g]
                length += h[g // SAMPLES] * WEIGHTS[g % SAMPLES]
                g += 1
            low = sample_place(first - 1, h, s0) if first > 0 and presses[first - 1] else -1.0
            high = sample_place(g, h, s0) if g < size and presses[g] else -1.0
            slight = g == first + 1 or length < RIPPLE * spacing
            if first == 0 or g == size:
                slight = max(low, high) >= 0.0 and length < BESIDE_CLAMP * spacing
            if slight or not any_pulls:
                continue
            begin, end = sample_place(first, h, s0), sample_place(g - 1, h, s0)
            low, high = up_to_reactions(points, count, o, begin, end, low, high)
            count = lift(points, count, o, 0.5 * (begin + end), low, high)
    return changed, left, count


@njit(**INNER)
def leave_clamp(points, count, o, h, s0, clamp, reach, covered, presses, pulls):
    """Drop the samples up to a clamp that pulls them off: what presses among those that pull is a ripple.

    Args:
        points, count, o: as in `lift`.
        h, s0: (m,) of `Grid`.
        clamp: its arc length, 0 or 1.
        reach: distance, L, within which what pulls is the clamp's doing, or that of what pulls beside it.
        covered, presses, pulls: (SAMPLES * m,) whether a sample is in a patch, presses, and pulls; of those
            that are dropped only the last is overwritten.

    Returns:
        The number of points.
    """
    size = covered.shape[0]
    farthest, end, step = clamp, (0 if clamp == 0.0 else size - 1), (1 if clamp == 0.0 else -1)
    g = end
    while 0 <= g < size and covered[g] and abs(sample_place(g, h, s0) - farthest) < reach:
        if pulls[g]:
            farthest = sample_place(g, h, s0)
        g += step
    if farthest == clamp:
        return count
    g = end
    while 0 <= g < size and abs(sample_place(g, h, s0) - clamp) <= abs(farthest - clamp):
        presses[g] = False
        g += step
    return clear(points, count, o, min(farthest, clamp), max(farthest, clamp))


@njit(**INNER)
def up_to_reactions(points, count, o, begin, end, low, high):
    """The places `low` and `high` of `lift`, no farther out than the concentrated reactions that press.

    One between samples that pull becomes a point of its own.

    Args:
        points, count, o: as in `lift`.
        begin, end: arc lengths of the first and the last sample that pulls, L.
        low, high: as in `lift`.

    Returns:
        `low` and `high`.
    """
    middle = 0.5 * (begin + end)
    first, last = end_beside(points, count, o, middle, FIRST), end_beside(points, count, o, middle, LAST)
    least = low if low >= 0.0 else (points[first, ARC_LENGTH] if first >= 0 else 0.0)
    most = high if high >= 0.0 else (points[last, ARC_LENGTH] if last >= 0 else 1.0)
    for i in range(count):
        s = points[i, ARC_LENGTH]
        mine = concentrated(points[i]) and points[i, OBSTACLE] == o and least < s < most
        if not mine or points[i, FORCE] <= 0.0:
            continue
        if s < begin:
            low = max(low, s)
        elif s > end:
            high = s if high < 0.0 else min(high, s)
        else:
            points[i, KIND] = POINT
    return low, high


@njit(**INNER)
def lift(points, count, o, s, low, high):
    """Let the cable lift off about s; a patch's end becomes a point if no sample presses beside it.

    Args:
        points, count: as in `patch_ends.move_ends`.
        o, s: obstacle and arc length, L.
        low, high: arc lengths of the samples on both sides that still press, L; -1: none.

    Returns:
        The number of points.
    """
    for presses, end, kind in ((low, FIRST, LAST), (high, LAST, FIRST)):
        if presses >= 0.0:
            r = reaction_at(points, count, o, presses)
            if r >= 0:
                points[r, KIND] = kind
            else:
                before, count = count, add(points, count, o, presses, kind)
                if count > before:
                    slide_along(points[before], points, before)
        else:
            e = end_beside(points, count, o, s, end)
            if e >= 0:
                points[e, KIND] = POINT
    return count


@njit(**INNER)
def end_beside(points, count, o, s, kind):
    """The end of a patch on obstacle o that is next to s, before it (FIRST) or after it (LAST); or -1.

    `points`, `count`: as in `patch_ends.move_ends`; `kind`: FIRST or LAST.
    """
    best = -1
    for i in range(count):
        d = s - points[i, ARC_LENGTH] if kind == FIRST else points[i, ARC_LENGTH] - s
        if points[i, OBSTACLE] != o or points[i, KIND] != kind or d < 0.0:
            continue
        if best < 0 or d < abs(points[best, ARC_LENGTH] - s):
            best = i
    return best
