# SPDX-License-Identifier: Apache-2.0
"""Compiled: touchdown and lift-off points of contact patches: how they move, meet and vanish.

Where a cable lifts off a smooth surface, gap and slope are zero and a concentrated force acts. It acts where
no couple is needed to hold the slope, that is where the curvature does not jump. Units of the cable, start
clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, LEAF, njit
from cable_ros.contact.distance import FRICTION_COEFFICIENT, gap
from cable_ros.contact.patches import CLAMPED, SAMPLES, WEIGHTS, cover, grounded, rests, sample_place
from cable_ros.contact.points import (
    APART,
    ARC_LENGTH,
    AT_EDGE,
    BEFORE,
    FIRST,
    FORCE,
    KIND,
    LAST,
    LENGTH,
    NUMBER,
    OBSTACLE,
    POINT,
    SAMPLE,
    SHIFT,
    SLOPE_ROW,
    SWINGS,
    WENT,
    add,
    concentrated,
    reaction_at,
    remove,
    slide_along,
)
from cable_ros.linalg.copies import copy
from cable_ros.rod.centreline import position

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
RIPPLE = 0.5
"""Least length, in spacings, along which samples between others that press must pull for the cable to lift
off there: beside a much longer element the pressure of a short one ripples."""
BESIDE_CLAMP = 2.0
"""The same beside a clamp on the surface: there a cable that leaves it along so little rises by less than
what counts as a depth, and force and couple of its lift-off are all but nothing."""
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
def settle(c, h, s0, points, count, spacing, obstacles, depth):
    """Change the patches at a solution.

    One that is so short that it hardly dips becomes a point, patches that meet become one, one that reaches
    the clamp begins there, and where samples pull the cable lifts off.

    Args:
        c: (m, g + 1, 3) of `Shape`.
        h, s0: (m,) of `Grid`.
        points, count, spacing: as in `move_ends`.
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
        points, count: as in `move_ends`.
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

    `points`, `count`: as in `move_ends`; `kind`: FIRST or LAST.
    """
    best = -1
    for i in range(count):
        d = s - points[i, ARC_LENGTH] if kind == FIRST else points[i, ARC_LENGTH] - s
        if points[i, OBSTACLE] != o or points[i, KIND] != kind or d < 0.0:
            continue
        if best < 0 or d < abs(points[best, ARC_LENGTH] - s):
            best = i
    return best
