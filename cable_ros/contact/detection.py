# SPDX-License-Identifier: Apache-2.0
"""Compiled: which places of the cable touch, and how they change as its shape does.

Where the gap has a distinct minimum a contact point sits there, at any arc length: a unilateral constraint
gap >= 0 with its multiplier, the normal force. It slides with the shape. Along a stretch that lies on the
surface the gap has no distinct minimum: see `contact.patches`. Units of the cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import LEAF, njit
from cable_ros.contact.distance import gap
from cable_ros.contact.interfaces import gap_at, lowest
from cable_ros.contact.patches import CLAMPED, SAMPLES, grounded, inside, lay, sample, settle
from cable_ros.contact.points import (
    APART,
    FORCE,
    KIND,
    LENGTH,
    OBSTACLE,
    PLACE,
    POINT,
    ROW,
    SAMPLE,
    add,
    remove,
)
from cable_ros.rod.centreline import curve, find_element, position

OPTIONS = {"cache": True, "error_model": "numpy"}

AWAY = 1.0
"""What is nearer than so many samples' spacing is looked at closely."""
LEVEL = 1e-9
"""Slope of a clamp that lies along a surface, rad: rounding."""
BESIDE = 0.25
"""A minimum this near to a contact point, in parts of the spacing, is that of a cable all but flat there."""
LONG = 4.0
"""What is inside over so many samples is no point contact."""


@njit(**OPTIONS)
def scan(c, h, s0, samples, obstacles, phi):
    """Gaps phi (obstacles, samples) at the arc lengths `samples`; returns the smallest at the inner ones.

    What is farther off than AWAY may have a smaller number, which is safe: the curve has unit speed.
    """
    r, n = np.empty(3), np.empty(3)
    directions, bends = np.empty((2, 3)), np.empty(2)
    smallest, m = np.inf, samples.shape[0]
    away = AWAY * (samples[m - 1] - samples[0]) / (m - 1)
    for o in range(obstacles.shape[0]):
        last, value = 0.0, -np.inf
        for k in range(m):
            least = value - (samples[k] - last)
            if least > away:
                phi[o, k] = least
            else:
                position(c, h, s0, samples[k], r)
                value, last = gap(obstacles[o], r, n, directions, bends), samples[k]
                phi[o, k] = value
            if 0 < k < m - 1:
                smallest = min(smallest, phi[o, k])
    return smallest


@njit(**OPTIONS)
def press(c, h, s0, samples, obstacles, points, phi, stiffness):
    """Make the samples that are inside an obstacle the contact points, on springs of `stiffness` per length.

    Returns their number.
    """
    scan(c, h, s0, samples, obstacles, phi)
    count = 0
    for o in range(obstacles.shape[0]):
        for k in range(1, samples.shape[0] - 1):
            if phi[o, k] < 0.0 and count < points.shape[0]:
                count = add(points, count, o, samples[k], SAMPLE)
                points[count - 1, LENGTH] = 0.5 * (samples[k + 1] - samples[k - 1])
                points[count - 1, FORCE] = -stiffness * points[count - 1, LENGTH] * phi[o, k]
    return count


@njit(**OPTIONS)
def flatten(q, h, s0, nodes, c, spacing, obstacles, give, points, count):
    """Make stretches of the points beside which the cable, more curved than the surface, dips deeper than
    `give`; returns (changed, count).
    """
    r, t, dt, n = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    directions, bends = np.empty((2, 3)), np.empty(2)
    changed = False
    i = 0
    while i < count:
        if points[i, KIND] == POINT and points[i, FORCE] > 0.0:
            o, P = int(points[i, OBSTACLE]), points[i, FORCE]
            # where it is going to slide to: beside an edge the gap is curved as the face is
            s = lowest(q, h, s0, nodes, c, points[i, PLACE], spacing, obstacles[o])
            _, _, curvature = gap_at(q, h, s0, nodes, c, s, obstacles[o], r, t, dt, n, directions, bends)
            half = spacing
            if curvature >= 0.0:
                # or to and fro, between minima on both sides of where it presses
                s, curvature, half = ridge(q, h, s0, nodes, c, points[i, PLACE], spacing, obstacles[o])
            # the curvature rises by P/2 per length on both sides
            if curvature < 0.0 and -2.67 * curvature**3 > give * P**2:
                points[i, PLACE] = s
                half = min(-2.0 * curvature / P, half, 0.45 * s, 0.45 * (1.0 - s))
                count = lay(points, count, o, s - half, s + half)
                changed = True
                i = 0
                continue
        i += 1
    return changed, count


@njit(**OPTIONS)
def ridge(q, h, s0, nodes, c, s, spacing, obstacle):
    """Arc length of a maximum of the gap near s between two minima, its curvature, and the room beside it.

    The curvature is 0 where there is none, or where the minima are those of two edges.
    """
    r, t, dt, n = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    directions, bends = np.empty((2, 3)), np.empty(2)
    _, slope, curvature = gap_at(q, h, s0, nodes, c, s, obstacle, r, t, dt, n, directions, bends)
    sharpest = max(bends[0], bends[1])
    if not curvature < 0.0 or abs(slope) > -0.5 * spacing * curvature:
        return s, 0.0, spacing
    top = s - slope / curvature
    if not spacing < top < 1.0 - spacing:
        return s, 0.0, spacing
    before = lowest(q, h, s0, nodes, c, top - 0.5 * spacing, 0.5 * spacing, obstacle)
    after = lowest(q, h, s0, nodes, c, top + 0.5 * spacing, 0.5 * spacing, obstacle)
    for end in (before, after):
        gap_at(q, h, s0, nodes, c, end, obstacle, r, t, dt, n, directions, bends)
        if max(bends[0], bends[1]) > 1.5 * sharpest:
            return s, 0.0, spacing
    least, most = 1e-6 * spacing, (1.0 - 1e-6) * spacing
    if least < top - before < most and least < after - top < most:
        return top, curvature, 0.25 * (after - before)
    return s, 0.0, spacing


@njit(**LEAF)
def far(samples, k, phi):
    """Whether nothing nearer to sample k than to others can touch: the curve has unit speed."""
    before = samples[k] - samples[k - 1]
    after = samples[k + 1] - samples[k]
    return phi[k] > max(
        before if k == 1 else 0.5 * before, after if k == samples.shape[0] - 2 else 0.5 * after
    )


@njit(**OPTIONS)
def minimum_beside(q, h, s0, nodes, c, samples, k, obstacle, down):
    """Arc length of a minimum of the gap that is nearer to sample k than to others; -1: none.

    Two edges side by side have a minimum each, which the gaps at the samples may not show: its slopes do.
    `down`: the slope half way to the sample before, if it is known, else nan; returned, too, is that half way
    to the next. Only for a sample that is not `far`.
    """
    low = 0.5 * (samples[k - 1] + samples[k]) if k > 1 else samples[0]
    high = 0.5 * (samples[k] + samples[k + 1]) if k < samples.shape[0] - 2 else samples[k + 1]
    r, t, dt, n = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    directions, bends = np.empty((2, 3)), np.empty(2)
    if np.isnan(down):
        _, down, _ = gap_at(q, h, s0, nodes, c, low, obstacle, r, t, dt, n, directions, bends)
    _, up, _ = gap_at(q, h, s0, nodes, c, high, obstacle, r, t, dt, n, directions, bends)
    # a clamp that rests on the surface has no slope there but rounding
    falls, rises = down < 0.0, up >= 0.0
    if k == 1 and abs(down) < LEVEL:
        _, slope, _ = gap_at(
            q, h, s0, nodes, c, 0.75 * low + 0.25 * high, obstacle, r, t, dt, n, directions, bends
        )
        falls = slope < 0.0
    if k == samples.shape[0] - 2 and abs(up) < LEVEL:
        _, slope, _ = gap_at(
            q, h, s0, nodes, c, 0.25 * low + 0.75 * high, obstacle, r, t, dt, n, directions, bends
        )
        rises = slope >= 0.0
    if not (falls and rises):
        return -1.0, up
    return lowest(q, h, s0, nodes, c, 0.5 * (low + high), 0.5 * (high - low), obstacle), up


@njit(**OPTIONS)
def revise(q, h, s0, N, nodes, primitives, c, samples, spacing, obstacles, depth, give, points, count, phi):
    """Change the contacts at a solution with the last ones: let go what pulls, take in what is inside.

    By more than `depth`; in a stretch and beside its ends and points, where only a finer mesh can tell what
    touches, by more than `give`. Returns (changed, count).
    """
    changed = False
    i = 0
    while i < count:
        if points[i, KIND] == POINT and points[i, FORCE] < 0.0:
            count = remove(points, count, i)
            changed = True
        else:
            i += 1
    curve(q, h, N, primitives, c)
    settled, count = settle(c, h, s0, points, count, spacing, obstacles, depth)
    changed = changed or settled
    m = samples.shape[0]
    scan(c, h, s0, samples, obstacles, phi)
    r, t, dt, n = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    directions, bends = np.empty((2, 3)), np.empty(2)
    for o in range(obstacles.shape[0]):
        slope = np.nan
        for k in range(1, m - 1):
            if far(samples, k, phi[o]):
                slope = np.nan
                continue
            s, slope = minimum_beside(q, h, s0, nodes, c, samples, k, obstacles[o], slope)
            if s < 0.0:
                continue
            value, _, _ = gap_at(q, h, s0, nodes, c, s, obstacles[o], r, t, dt, n, directions, bends)
            if value >= -depth:
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
            beside = ends or (near >= 0 and abs(points[near, PLACE] - s) < BESIDE * spacing)
            if beside and value >= -give:
                continue
            if ends:
                points[near, PLACE] = s
            elif near >= 0:
                # two minima closer than the samples can tell: the cable begins to lie on the surface
                low, high = min(s, points[near, PLACE]), max(s, points[near, PLACE])
                low = 0.0 if k == 1 and grounded(c, h, s0, obstacles[o], 0.0) else low
                high = 1.0 if k == m - 2 and grounded(c, h, s0, obstacles[o], 1.0) else high
                count = lay(points, count, o, low, high)
            else:
                first, last = k, k
                while first > 1 and phi[o, first - 1] < -depth:
                    first -= 1
                while last < m - 2 and phi[o, last + 1] < -depth:
                    last += 1
                if samples[last] - samples[first] > LONG * spacing:
                    low = 0.0 if first == 1 and grounded(c, h, s0, obstacles[o], 0.0) else samples[first]
                    high = 1.0 if last == m - 2 and grounded(c, h, s0, obstacles[o], 1.0) else samples[last]
                    count = lay(points, count, o, low, high)
                else:
                    count = add(points, count, o, s, POINT)
            changed = True
    return changed, count


@njit(**OPTIONS)
def sampled(points, count, o, g):
    """Whether sample g presses on obstacle o."""
    for i in range(count):
        if points[i, OBSTACLE] == o and points[i, KIND] == SAMPLE and points[i, ROW] == g:
            return True
    return False


@njit(**OPTIONS)
def nearest(points, count, o, s, reach):
    """The point or end of a stretch on obstacle o nearest to s, within `reach`; or -1."""
    best = -1
    for i in range(count):
        if points[i, OBSTACLE] == o and points[i, KIND] != SAMPLE and abs(points[i, PLACE] - s) < reach:
            best, reach = i, abs(points[i, PLACE] - s)
    return best


@njit(**OPTIONS)
def passage(q_old, q, h, s0, N, primitives, c, samples, old_obstacles, obstacles, phi):
    """From one shape to the next on the same mesh: how near it is now, and whether it may have gone through.

    Returns the smallest gap at the inner samples (phi receives all) and whether some sample has moved so far
    beside an obstacle that it could have passed it within the step.
    """
    old_c = np.empty_like(c)
    curve(q_old, h, N, primitives, old_c)
    curve(q, h, N, primitives, c)
    smallest = scan(c, h, s0, samples, obstacles, phi)
    crossed = False
    r, r_old = np.empty(3), np.empty(3)
    for o in range(obstacles.shape[0]):
        new, old = obstacles[o], old_obstacles[o]
        width = np.inf
        for k in range(13, 16):
            if new[k] > 0.0:
                width = min(width, new[k])
        if width == np.inf:
            continue
        for k in range(1, samples.shape[0] - 1):
            position(c, h, s0, samples[k], r)
            position(old_c, h, s0, samples[k], r_old)
            way = 0.0
            for i in range(3):
                v = 0.0
                for j in range(3):
                    v += new[4 + 3 * j + i] * (r[j] - new[1 + j])
                    v -= old[4 + 3 * j + i] * (r_old[j] - old[1 + j])
                way += v * v
            way = np.sqrt(way)
            crossed = crossed or (way > width + new[16] and phi[o, k] < way)
    return smallest, crossed


@njit(**OPTIONS)
def dips(q, h, s0, nodes, c, samples, obstacles, phi, depth):
    """Whether the curve between the samples is deeper than `depth` in some obstacle."""
    r, t, dt, n = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    directions, bends = np.empty((2, 3)), np.empty(2)
    for o in range(obstacles.shape[0]):
        slope = np.nan
        for k in range(1, samples.shape[0] - 1):
            if far(samples, k, phi[o]):
                slope = np.nan
                continue
            s, slope = minimum_beside(q, h, s0, nodes, c, samples, k, obstacles[o], slope)
            if s >= 0.0:
                value, _, _ = gap_at(q, h, s0, nodes, c, s, obstacles[o], r, t, dt, n, directions, bends)
                if value < -depth:
                    return True
    return False
