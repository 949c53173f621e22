# SPDX-License-Identifier: Apache-2.0
"""Compiled: touchdown and lift-off points of contact patches: how they move, meet and vanish.

Where a cable lifts off a smooth surface, gap and slope are zero and a concentrated force acts. It acts where
no couple is needed to hold the slope, that is where the curvature does not jump. Units of the cable, start
clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, LEAF, njit
from cable_ros.contact.points import (
    APART,
    ARC_LENGTH,
    AT_EDGE,
    BEFORE,
    FIRST,
    FORCE,
    KIND,
    LAST,
    OBSTACLE,
    POINT,
    SAMPLE,
    SHIFT,
    SLOPE_ROW,
    SWINGS,
    WENT,
    add,
    concentrated,
    remove,
)
from cable_ros.linalg.copies import copy

OPTIONS = {"cache": True, "error_model": "numpy"}

STRIDE = 2.0
"""Maximum motion of an end in an iteration, in spacings of the samples."""
ROOM = 0.45
"""Maximum motion, or half of a new patch, fraction of the distance to what is next to it."""
CREEP, OVERSHOOT = 0.3, 2.0
"""An end that moves at least this fraction of its last motion again is sent to the limit of the geometric
series of such motions; and one that moves back by so much of it, up to the second."""
BACK = 0.9
"""Motion back over the last motion from which a point swings: Newton's method leads it to no place."""
SLIGHT = 1e-4
"""The least of such a motion, in spacings."""
RETURNS = 0.4
"""The same from which it goes to and fro; SWINGS is 0.5 at least from then on."""
MEETS = 0.1
"""Distance, in spacings, at which two patches meet."""
FAINT = 1e-3
"""Force, EI / L^2, below which its lever is taken for that of this force."""


@njit(**INNER)
def move_ends(points, count, y, spacing, smooth, calm):
    """Move points and ends of patches to where no couple holds them.

    The couple that holds the slope, divided by the force that acts there, is its lever; an end that pulls is
    out too far. One that an edge holds goes inward only.

    Args:
        points, count: (CAPACITY, COLUMNS) the contact points and their number.
        y: (rows,) multipliers of the constraint rows.
        spacing: of the samples, L.
        smooth: whether only ends swing: what sticks or slips in turn does, too, and has no limit.
        calm: whether the cable has all but come to rest.

    Returns:
        The largest motion, L, and the largest moment of a force about where it was, EI / L.
    """
    largest, moment = 0.0, 0.0
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
            # where force and couple vanish together, that end goes out until it pulls, and in again
            nothing = -points[i, FORCE] * points[i, WENT] / y[3 + i]  # to where it bears that, by the secant
            if calm and 0.0 < nothing * shift < shift * shift:
                shift = nothing
            if points[i, SWINGS] > 0.0 and point_beyond(points, count, i, APART * spacing) >= 0:
                shift = 0.0  # it has come back: see `settle`
        last, points[i, SHIFT] = points[i, SHIFT], shift
        beside = points[i, AT_EDGE]
        if beside < 0.0:
            if (shift > 0.0) == (points[i, KIND] == LAST):
                continue
            points[i, AT_EDGE] = 0.0  # it lifts off before the edge again
        elif beside > 0.0:
            shift = stand_off(points[i], y[int(points[i, SLOPE_ROW])], back, forth)
            points[i, SHIFT] = np.copysign(0.0, shift)
        back_again = shift * last < 0.0 and abs(shift) > RETURNS * abs(last)
        if back_again and abs(shift) > max(BACK * abs(last), SLIGHT * spacing):
            points[i, SWINGS] += 1.0
        elif back_again or points[i, SWINGS] > 0.0:
            points[i, SWINGS] = 0.5
        overshoots = CREEP * last * last < -shift * last < OVERSHOOT * last * last
        if (smooth and overshoots) or CREEP * last * last < shift * last < last * last:
            shift, points[i, SHIFT] = shift / (1.0 - shift / last), np.copysign(0.0, shift)
        shift = min(max(shift, -STRIDE * spacing), STRIDE * spacing)
        shifts[i] = min(max(shift, -ROOM * back), ROOM * forth)
        largest = max(largest, abs(shifts[i]))
        moment = max(moment, abs(shifts[i] * points[i, FORCE]))
    for i in range(count):
        points[i, ARC_LENGTH] += shifts[i]
        points[i, WENT] = shifts[i]
    return largest, moment


@njit(**LEAF)
def stand_off(end, couple, back, forth):
    """Motion, L, of the end of a patch that stands off beside an edge, see `patch_edges.meet_edges`.

    A beam of length d under a pressure p, clamped to the surface at one end and bent over the edge at the
    other one, by whatever moment, needs the couple p (d0^2 - d^2) / 8 at the clamp: none where it lifts off.

    Args:
        end: (COLUMNS,) its row of the contact points.
        couple: that holds its slope, EI / L.
        back, forth: distances to the contacts before it and after it, L.
    """
    first = end[KIND] == FIRST
    away = back if first else forth
    rest = away * away + 8.0 * (couple if first else -couple) / end[AT_EDGE]
    inward = np.sqrt(max(rest, 0.0)) - away
    return inward if first else -inward


@njit(**INNER)
def point_beyond(points, count, i, reach):
    """The contact point next to end i of a patch, outside and within `reach`, L, on its obstacle; or -1.

    `points`, `count`: as in `move_ends`.
    """
    best, out = -1, (1.0 if points[i, KIND] == LAST else -1.0)
    for k in range(count):
        d = out * (points[k, ARC_LENGTH] - points[i, ARC_LENGTH])
        mine = points[k, OBSTACLE] == points[i, OBSTACLE] and points[k, KIND] != SAMPLE
        if k != i and mine and 0.0 <= d < reach:
            best, reach = k, d
    presses = best >= 0 and points[best, KIND] == POINT and points[best, FORCE] > 0.0
    return best if presses and points[i, AT_EDGE] == 0.0 else -1


@njit(**INNER)
def neighbour(points, count, i, kind):
    """The next end of a patch after point i on its obstacle, if it is of this kind; else -1.

    `points`, `count`: as in `move_ends`.
    """
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


@njit(**INNER)
def merge(points, count, spacing):
    """Make one patch of two that meet.

    Args:
        points, count, spacing: as in `move_ends`.

    Returns:
        Whether there were any, and the number of points.
    """
    changed, i = False, 0
    while i < count:
        j = neighbour(points, count, i, FIRST) if points[i, KIND] == LAST else -1
        if j >= 0 and points[j, ARC_LENGTH] - points[i, ARC_LENGTH] < MEETS * spacing:
            count = remove(points, count, max(i, j))
            count = remove(points, count, min(i, j))
            changed, i = True, 0
        else:
            i += 1
    return changed, count


@njit(**INNER)
def shrink(points, count, spacing, depth):
    """Turn patches that are so short that they hardly dip into points.

    Args:
        points, count, spacing: as in `move_ends`.
        depth: penetration that does not count, L.

    Returns:
        Whether there were any, and the number of points.
    """
    changed, i = False, 0
    while i < count:
        j = neighbour(points, count, i, LAST) if points[i, KIND] == FIRST else -1
        length = points[j, ARC_LENGTH] - points[i, ARC_LENGTH] if j >= 0 else 1.0
        if length < spacing and length**3 * (points[i, FORCE] + points[j, FORCE]) < depth:
            points[i, FORCE : BEFORE + 3] += points[j, FORCE : BEFORE + 3]
            o, low = points[i, OBSTACLE], points[i, ARC_LENGTH]
            points[i, ARC_LENGTH], points[i, KIND] = low + 0.5 * length, POINT
            for k in range(count):
                # its ends bear little beside a reaction that is concentrated
                s = points[k, ARC_LENGTH]
                if concentrated(points[k]) and points[k, OBSTACLE] == o and low <= s <= low + length:
                    points[i, ARC_LENGTH] = s
                    points[i, FORCE : BEFORE + 3] += points[k, FORCE : BEFORE + 3]
            count = remove(points, count, j)
            # its ends may have moved past its samples: all up to the neighbouring patches are its own
            before, after = 0.0, 1.0
            for k in range(count):
                s = points[k, ARC_LENGTH]
                if points[k, OBSTACLE] == o and points[k, KIND] >= FIRST:
                    before, after = (max(before, s), after) if s < low else (before, min(after, s))
            count = clear(points, count, o, before, after)
            changed, i = True, 0
        else:
            i += 1
    return changed, count


@njit(**OPTIONS)
def join(points, count, length):
    """Replace patches shorter than `length`, L, by points at their centre of force; the number of points.

    Unlike `shrink`, which an iteration may do at any time, this keeps the force of the samples, too.
    `points` (CAPACITY, COLUMNS) holds `count` contact points.
    """
    i = 0
    while i < count:
        j = neighbour(points, count, i, LAST) if points[i, KIND] == FIRST else -1
        if j < 0 or points[j, ARC_LENGTH] - points[i, ARC_LENGTH] >= length:
            i += 1
            continue
        o, low, high = points[i, OBSTACLE], points[i, ARC_LENGTH], points[j, ARC_LENGTH]
        total, moment = np.zeros(BEFORE + 3 - FORCE), 0.0
        k = 0
        while k < count:
            s = points[k, ARC_LENGTH]
            if points[k, OBSTACLE] == o and low <= s <= high:
                for a in range(total.shape[0]):
                    total[a] += points[k, FORCE + a]
                moment += points[k, FORCE] * s
                count = remove(points, count, k)
            else:
                k += 1
        middle = moment / total[0] if total[0] > 0.0 else 0.5 * (low + high)
        count = add(points, count, o, min(max(middle, low), high), POINT)
        copy(total, points[count - 1, FORCE : BEFORE + 3])
        i = 0
    return count


@njit(**INNER)
def clear(points, count, o, low, high):
    """Drop the samples on obstacle o between the arc lengths low and high; returns the number of points.

    `points`, `count`: as in `move_ends`.
    """
    i = 0
    while i < count:
        if points[i, KIND] == SAMPLE and points[i, OBSTACLE] == o and low <= points[i, ARC_LENGTH] <= high:
            count = remove(points, count, i)
        else:
            i += 1
    return count
