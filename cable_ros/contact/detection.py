# SPDX-License-Identifier: Apache-2.0
"""Compiled: where the cable touches, and how that changes with its shape: the active set.

Where the gap has a distinct minimum a contact point sits there, at any arc length: a unilateral constraint
gap >= 0 with its multiplier, the normal force. It moves with the shape. Along a patch that lies on the
surface the gap has no distinct minimum: see `contact.patches`. Units of the cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, njit
from cable_ros.contact.contact_state import surface
from cable_ros.contact.distance import FRICTION_COEFFICIENT
from cable_ros.contact.flattening import half_patch
from cable_ros.contact.gap_search import dips, far, minimum_beside, scan
from cable_ros.contact.interfaces import at_edge, gap_at
from cable_ros.contact.lift_off import settle
from cable_ros.contact.patches import CLAMPED, SAMPLES, grounded, inside, make_patch, rests, sample
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
    SAMPLE,
    SPARED,
    add,
    remove,
)
from cable_ros.rod.centreline import find_element

OPTIONS = {"cache": True, "error_model": "numpy"}

BESIDE = 0.25
"""Distance from a contact point, in spacings, within which a minimum is that of a cable nearly flat there."""
MOVES = 3.0
"""Maximum number of times, in a solve, that the end of a patch moves out to where the cable dips beside it:
what brings it back is the mesh, and only a finer one can tell whether it touches there."""
RESTING, EDGED = 5e-4, 0.1
"""Distance from a clamp, L, within which contact is the clamp's own: with so short an arm its force, of which
the cable tells the moment alone, goes to infinity. And curvature of an edge, of which that is not said, times
this distance."""
GRAZES = 1e-10
"""Depth, L, above which a cable lies between a point and a clamp that rests on the surface: how these two
share its force is told by less than what counts as a depth elsewhere."""
OWN = 4.0
"""Distance of a minimum from a point that holds a cable more curved than the surface, in halves of the patch
that this becomes, within which it is the point's: that is at 2."""
ALIKE = 1e-6
"""Relative difference of two points' forces that may be rounding."""
LONG = 4.0
"""Length inside an obstacle, in spacings, above which contact is a patch, not a point."""


@njit(**INNER)
def update_active_set(shape, samples, obstacles, depth, give, points, count, phi):
    """Update the active set at a solution: drop what pulls, add what is inside an obstacle.

    Args:
        shape: `Shape`, its centreline traced.
        samples: (m,) equally spaced arc lengths, L.
        obstacles: (o, WIDTH).
        depth: depth up to which a point may be inside, L.
        give: the same in a patch and beside its ends and points, where only a finer mesh can tell what
            touches, L.
        points, count: (CAPACITY, COLUMNS) the contact points and their number.
        phi: (o, m) receives the gaps at the samples, L.

    Returns:
        Whether the set has changed, and the number of points.
    """
    _, c, (h, s0, _) = shape
    spacing = 1.0 / (samples.shape[0] - 1)
    changed = False
    leaves = leaving(points, count)
    for i in range(count - 1, -1, -1):
        if leaves[i]:
            count = remove(points, count, i)
            changed = True
    released, count = release(shape, obstacles, points, count, True)
    changed = changed or released > 0
    settled, left, count = settle(c, h, s0, points, count, spacing, obstacles, depth)
    if left:  # how the cable dips beside the clamp that pulls it off says nothing of where it lies
        return True, count
    changed = changed or settled
    m = samples.shape[0]
    scan(c, h, s0, samples, obstacles, phi)
    at = surface()
    for o in range(obstacles.shape[0]):
        slope = np.nan
        for k in range(1, m - 1):
            if far(samples, k, phi[o]):
                slope = np.nan
                continue
            s, slope = minimum_beside(shape, samples, k, obstacles[o], slope)
            # on a rough surface Newton's method does not find how a patch so short slips: it stays a point
            smooth, grazes = obstacles[o, FRICTION_COEFFICIENT] == 0.0, False
            if s < 0.0 and not smooth:
                continue
            value = 0.0
            if s >= 0.0:
                value, _, _ = gap_at(shape, s, obstacles[o], at)
            if value >= -depth and (k == 1 or k == m - 2):
                # a point in the clamp's cell is one minimum, a dip between it and the clamp another, of which
                # slopes may show nothing
                clamp = 0.0 if k == 1 else 1.0
                s, value = between_clamp(shape, clamp, points, count, o, spacing, obstacles[o])
                grazes = smooth and value < -GRAZES
                value = min(value, -2.0 * depth) if value < -GRAZES else 0.0
            if value >= -depth or (value > -(RESTING**2) and min(s, 1.0 - s) < RESTING):
                continue
            if inside(points, count, o, s):
                e, x = find_element(s, s0, h)
                g = SAMPLES * e + min(int(SAMPLES * x), SAMPLES - 1)
                if value < -give - CLAMPED and not sampled(points, count, o, g):
                    count = sample(points, count, o, g, h, s0)
                    changed = True
                continue
            near = nearest(points, count, o, s, APART * spacing)
            ends = near >= 0 and points[near, KIND] != POINT
            beside = ends or (near >= 0 and abs(points[near, ARC_LENGTH] - s) < BESIDE * spacing)
            if beside and not grazes:
                rise = rise_between(shape, points[near, ARC_LENGTH], s, obstacles[o])
                if max(value, rise) >= -give:
                    continue
            if ends and points[near, NUMBER] >= MOVES:
                continue
            if ends:
                points[near, ARC_LENGTH], points[near, NUMBER] = s, points[near, NUMBER] + 1.0
            elif near >= 0 and not at_edge(shape, points[near, ARC_LENGTH], s, obstacles[o]):
                # two minima closer than the spacing: the cable begins to lie on the surface
                low, high = min(s, points[near, ARC_LENGTH]), max(s, points[near, ARC_LENGTH])
                middle, force = points[near, ARC_LENGTH], points[near, FORCE]
                _, _, curvature = gap_at(shape, middle, obstacles[o], at)
                if curvature < 0.0 and force > 0.0:
                    # a cable more curved than the surface has minima beside the point that holds it
                    half = half_patch(middle, curvature, force, spacing)
                    if abs(s - middle) < OWN * half:
                        low = high = middle
                    low, high = min(low, middle - half), max(high, middle + half)
                low = 0.0 if k == 1 and grounded(c, h, s0, obstacles[o], 0.0) else low
                high = 1.0 if k == m - 2 and grounded(c, h, s0, obstacles[o], 1.0) else high
                count = make_patch(points, count, o, low, high)
            else:
                first, last = k, k
                while first > 1 and phi[o, first - 1] < -depth:
                    first -= 1
                while last < m - 2 and phi[o, last + 1] < -depth:
                    last += 1
                if samples[last] - samples[first] > LONG * spacing:
                    low = 0.0 if first == 1 and grounded(c, h, s0, obstacles[o], 0.0) else samples[first]
                    high = 1.0 if last == m - 2 and grounded(c, h, s0, obstacles[o], 1.0) else samples[last]
                    count = make_patch(points, count, o, low, high)
                else:
                    count = add(points, count, o, s, POINT)
            changed = True
    return changed, count


@njit(**INNER)
def may_stay(shape, samples, obstacles, deep, points, count, pull, phi):
    """Whether the active set may stay as it is: none of its forces pulls by more than `pull`, and between the
    samples nothing is deeper than `deep`, L.

    Other arguments as in `update_active_set`.
    """
    for i in range(count):
        if points[i, FORCE] < -pull:
            return False
    _, c, (h, s0, _) = shape
    scan(c, h, s0, samples, obstacles, phi)
    return not dips(shape, samples, obstacles, phi, deep)


@njit(**INNER)
def leaving(points, count):
    """(count,) which points are dropped, as they pull: of those that pull alike the one nearest to the start.

    Where another one of them can hold the cable, which is then one of two mirror images, rounding does not
    choose. The others are marked, see SPARED.

    `points`, `count`: as in `release`.
    """
    out = np.zeros(count, np.bool_)
    for i in range(count):
        pull = -points[i, FORCE]
        out[i] = points[i, KIND] == POINT and pull > 0.0
        if not out[i]:
            continue
        for k in range(count):
            nearer = points[k, KIND] == POINT and points[k, ARC_LENGTH] < points[i, ARC_LENGTH]
            if nearer and abs(points[k, FORCE] + pull) <= ALIKE * pull:
                out[i], points[i, NUMBER] = False, SPARED
    return out


@njit(**INNER)
def between_clamp(shape, clamp, points, count, o, spacing, obstacle):
    """Arc length half way from a clamp on the surface to the contact point beside it, and the gap there, L.

    The gap is 0 if there is no such point.

    Args:
        shape: `Shape`.
        clamp: its arc length, 0 or 1.
        points, count: (CAPACITY, COLUMNS) the contact points and their number.
        o, spacing: obstacle, and distance of the samples, L.
        obstacle: (WIDTH,).
    """
    i = nearest(points, count, o, clamp, 2.0 * spacing)
    if i < 0 or points[i, KIND] != POINT or not rests(shape.c, shape.grid.h, shape.grid.s0, obstacle, clamp):
        return clamp, 0.0
    s = 0.5 * (clamp + points[i, ARC_LENGTH])
    value, _, _ = gap_at(shape, s, obstacle, surface())
    return s, value


@njit(**INNER)
def rise_between(shape, begin, end, obstacle):
    """How much the gap rises from one arc length to another nearby, L, as its slopes tell (Simpson's rule).

    The tangent is exact where a position is interpolated, with an error that may be a greater depth.

    Args:
        shape: `Shape`.
        begin, end: L.
        obstacle: (WIDTH,).
    """
    at = surface()
    _, first, _ = gap_at(shape, begin, obstacle, at)
    _, middle, _ = gap_at(shape, 0.5 * (begin + end), obstacle, at)
    _, last, _ = gap_at(shape, end, obstacle, at)
    return (end - begin) * (first + 4.0 * middle + last) / 6.0


@njit(**INNER)
def release(shape, obstacles, points, count, solved):
    """Drop what has come so near to a clamp that this bears its force: points, and patches up to it.

    See RESTING.

    Args:
        shape: `Shape`.
        obstacles: (o, WIDTH).
        points, count: (CAPACITY, COLUMNS) the contact points and their number.
        solved: whether the shape is a solution with these points.

    Returns:
        How many points are dropped, and the number of those left.
    """
    at = surface()
    before, i = count, 0
    while i < count:
        s, kind, o = points[i, ARC_LENGTH], points[i, KIND], int(points[i, OBSTACLE])
        outer = (kind == FIRST and s > 0.5) or (kind == LAST and s < 0.5)
        # on its way to a solution a smooth one may be as short, and grow again
        final = solved or obstacles[o, FRICTION_COEFFICIENT] > 0.0
        if (kind == POINT or (outer and final)) and min(s, 1.0 - s) < RESTING:
            gap_at(shape, s, obstacles[o], at)
            if max(at.bends[0], at.bends[1]) * RESTING < EDGED:
                if kind == POINT:
                    count = remove(points, count, i)
                else:
                    count, i = strip(points, count, o, s), 0
                continue
        i += 1
    return before - count, count


@njit(**INNER)
def strip(points, count, o, s):
    """Drop all on obstacle o from arc length s to the next clamp; returns the number of points.

    `points`, `count`: as in `release`.
    """
    i = 0
    while i < count:
        beyond = points[i, ARC_LENGTH] >= s if s > 0.5 else points[i, ARC_LENGTH] <= s
        if points[i, OBSTACLE] == o and beyond:
            count = remove(points, count, i)
        else:
            i += 1
    return count


@njit(**INNER)
def dipping(points, count):
    """Whether the cable dips beside the end of a patch, see MOVES; `points`, `count`: as in `release`."""
    found = False
    for i in range(count):
        found = found or (points[i, KIND] >= FIRST and points[i, NUMBER] >= MOVES)
    return found


@njit(**INNER)
def sampled(points, count, o, g):
    """Whether sample g presses on obstacle o; `points`, `count`: as in `update_active_set`."""
    for i in range(count):
        if points[i, OBSTACLE] == o and points[i, LENGTH] > 0.0 and points[i, NUMBER] == g:
            return True
    return False


@njit(**INNER)
def nearest(points, count, o, s, reach):
    """The point or end of a patch on obstacle o nearest to s, within `reach`, L; or -1.

    `points`, `count`: as in `update_active_set`.
    """
    best = -1
    for i in range(count):
        if points[i, OBSTACLE] == o and points[i, KIND] != SAMPLE and abs(points[i, ARC_LENGTH] - s) < reach:
            best, reach = i, abs(points[i, ARC_LENGTH] - s)
    return best
