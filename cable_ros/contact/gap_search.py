# SPDX-License-Identifier: Apache-2.0
"""Compiled: the gap along the cable: at samples, its minima between them, and what a step passes through.

Units of the cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, LEAF, njit
from cable_ros.contact.contact_state import shape_of, surface
from cable_ros.contact.distance import AXES, CENTRE, DIMENSIONS, OFFSET, gap
from cable_ros.contact.interfaces import LEVEL, gap_at, lowest
from cable_ros.contact.points import (
    FORCE,
    LENGTH,
    NUMBER,
    SAMPLE,
    add,
)
from cable_ros.rod.centreline import curve, position
from cable_ros.rod.rod_state import grid_of

OPTIONS = {"cache": True, "error_model": "numpy"}

AWAY = 1.0
"""Gap below which it is evaluated exactly, in spacings of the samples."""
NODES = 0.5 - 0.5 * np.sqrt(0.6), 0.5, 0.5 + 0.5 * np.sqrt(0.6)
WEIGHTS = 5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0
"""Gauss rule on an interval of length 1: exact for the square of a parabola's depth."""
SURFACING, SURFACED = 40, 1e-10
"""Maximum number of steps to where the curve leaves an obstacle, and the last one, L."""
REACH, REMOTE = 1.1, 0.1
"""Distance from its start that no part of a cable exceeds, L: it is stretched to no more than this; and how
far beyond an obstacle is that need not be looked at."""
ROUNDING = 1e-9
"""Part of an obstacle's width within which a bound of motions is not told from it."""


@njit(**OPTIONS)
def scan(c, h, s0, samples, obstacles, phi):
    """Gaps at the samples; returns the smallest at the inner ones.

    What is farther off than AWAY may have a smaller number, which is safe: the curve has unit speed.

    Args:
        c: (m, g + 1, 3) of `Shape`.
        h, s0: of `Grid`.
        samples: (k,) arc lengths, L.
        obstacles: (o, WIDTH).
        phi: (o, k) receives the gaps, L.
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
def press(shape, samples, obstacles, points, phi, stiffness, foundation):
    """Put springs where the cable is inside an obstacle; returns their number.

    A spring at a sample stands for all of its cell, so a contact that slides from one sample to the next
    passes over a bump, and may rest there. The energy of a foundation, the integral over what is inside, has
    none. Its gradient is that at fixed arc lengths,
    for where the cable leaves the obstacle it has no depth.

    Args:
        shape: `Shape`, as a plain tuple.
        samples, obstacles, phi: as in `scan`.
        points: (CAPACITY, COLUMNS) the contact points, overwritten.
        stiffness: of the springs per length, EI / L^4.
        foundation: whether they are a foundation; else each is at a sample.
    """
    shape, at = shape_of(shape), surface()
    scan(shape.c, shape.grid.h, shape.grid.s0, samples, obstacles, phi)
    count = 0
    for o in range(obstacles.shape[0]):
        for k in range(1, samples.shape[0] - 1):
            low, high = 0.5 * (samples[k - 1] + samples[k]), 0.5 * (samples[k] + samples[k + 1])
            if not foundation:
                if phi[o, k] < 0.0:
                    count = spring(points, count, o, k, samples[k], high - low, stiffness, -phi[o, k])
                continue
            if phi[o, k] >= 0.5 * (high - low):
                continue
            s = minimum_between(shape, low, high, obstacles[o], at)
            phi[o, k] = min(phi[o, k], gap_at(shape, s, obstacles[o], at)[0])
            if phi[o, k] >= 0.0:
                continue
            first = surfacing(shape, s, low, obstacles[o], at)
            last = surfacing(shape, s, high, obstacles[o], at)
            if first > low or last < high:
                count = lay(shape, points, count, o, k, (first, s), stiffness, obstacles[o], at)
                first = s
            count = lay(shape, points, count, o, k, (first, last), stiffness, obstacles[o], at)
    return count


@njit(**INNER)
def lay(shape, points, count, o, k, span, stiffness, obstacle, at):
    """Put springs at the Gauss points of a span of sample k's cell; returns the number of points."""
    low, high = span
    for g in range(3):
        s = low + NODES[g] * (high - low)
        depth = -gap_at(shape, s, obstacle, at)[0]
        count = spring(points, count, o, k, s, WEIGHTS[g] * (high - low), stiffness, depth)
    return count


@njit(**INNER)
def spring(points, count, o, k, s, width, stiffness, depth):
    """Add a spring at arc length s for a width of sample k's cell; returns the number of points."""
    if depth > 0.0 and width > 0.0 and count < points.shape[0]:
        count = add(points, count, o, s, SAMPLE)
        points[count - 1, LENGTH], points[count - 1, NUMBER] = width, k
        points[count - 1, FORCE] = stiffness * width * depth
    return count


@njit(**INNER)
def surfacing(shape, inside, end, obstacle, at):
    """Arc length where the curve leaves an obstacle, between one inside and an end; that end if it does not.

    Newton's method, bisecting where that leaves the bracket.
    """
    if gap_at(shape, end, obstacle, at)[0] <= 0.0:
        return end
    s = 0.5 * (inside + end)
    for _ in range(SURFACING):
        value, slope, _ = gap_at(shape, s, obstacle, at)
        if value <= 0.0:
            inside = s
        else:
            end = s
        last, s = s, 0.5 * (inside + end)
        if slope != 0.0 and (last - value / slope - inside) * (last - value / slope - end) <= 0.0:
            s = last - value / slope
        if abs(s - last) < SURFACED:
            break
    return s


@njit(**INNER)
def minimum_between(shape, low, high, obstacle, at):
    """Arc length of the smallest gap between two arc lengths, if there is one minimum at most.

    Args:
        shape: `Shape`.
        low, high: the arc lengths, L.
        obstacle: (WIDTH,).
        at: `Surface`, overwritten.
    """
    if gap_at(shape, low, obstacle, at)[1] >= 0.0:
        return low
    if gap_at(shape, high, obstacle, at)[1] <= 0.0:
        return high
    return lowest(shape, 0.5 * (low + high), 0.5 * (high - low), obstacle)


@njit(**LEAF)
def far(samples, k, phi):
    """Whether nothing nearer to sample k than to others can touch: the curve has unit speed.

    Args:
        samples: (m,) arc lengths, L.
        k: a sample.
        phi: (m,) gaps at the samples, L.
    """
    before = samples[k] - samples[k - 1]
    after = samples[k + 1] - samples[k]
    return phi[k] > max(
        before if k == 1 else 0.5 * before, after if k == samples.shape[0] - 2 else 0.5 * after
    )


@njit(**INNER)
def minimum_beside(shape, samples, k, obstacle, down):
    """Arc length of the gap's minimum that is nearer to sample k than to others; -1: none.

    Of two beside a maximum it is the lower one. Two edges side by side have a minimum each, which the gaps at
    the samples may not show: its slopes do. Returned, too, is the slope half way to the next sample. Only for
    a sample that is not `far`.

    Args:
        shape: `Shape`.
        samples: (m,) arc lengths, L.
        k: a sample.
        obstacle: (WIDTH,).
        down: the slope of the gap half way to the sample before, or nan if it is not known.
    """
    low = 0.5 * (samples[k - 1] + samples[k]) if k > 1 else samples[0]
    high = 0.5 * (samples[k] + samples[k + 1]) if k < samples.shape[0] - 2 else samples[k + 1]
    at = surface()
    if np.isnan(down):
        _, down, _ = gap_at(shape, low, obstacle, at)
    _, up, curvature = gap_at(shape, high, obstacle, at)
    # a clamp that rests on the surface has no slope there but rounding
    falls, rises = down < 0.0, up >= 0.0
    if k == 1 and abs(down) < LEVEL:
        _, slope, _ = gap_at(shape, 0.75 * low + 0.25 * high, obstacle, at)
        falls = slope < 0.0
    if k == samples.shape[0] - 2 and abs(up) < LEVEL:
        _, slope, _ = gap_at(shape, 0.25 * low + 0.75 * high, obstacle, at)
        rises = slope >= 0.0
    if falls != rises:  # beside a maximum there may be a minimum all the same
        middle = 0.5 * (low + high)
        _, slope, _ = gap_at(shape, middle, obstacle, at)
        if falls and slope >= 0.0:
            high, rises = middle, True
        elif rises and slope < 0.0:
            low, falls = middle, True
        else:  # or the maximum is at the end of this interval, all but there: beyond it the slope turns
            end, slope = high, up
            if rises:
                end = low
                _, slope, curvature = gap_at(shape, low, obstacle, at)
            beyond = end - 2.0 * slope / curvature if curvature < 0.0 else end
            if low < beyond < high:
                _, slope, _ = gap_at(shape, beyond, obstacle, at)
                if falls and slope >= 0.0:
                    high, rises = beyond, True
                elif rises and slope < 0.0:
                    low, falls = beyond, True
    if not (falls and rises):
        return -1.0, up
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    _, _, curvature = gap_at(shape, middle, obstacle, at)
    if curvature >= 0.0:
        return lowest(shape, middle, half, obstacle), up
    before = lowest(shape, middle - 0.5 * half, 0.5 * half, obstacle)
    after = lowest(shape, middle + 0.5 * half, 0.5 * half, obstacle)
    least, _, _ = gap_at(shape, before, obstacle, at)
    other, _, _ = gap_at(shape, after, obstacle, at)
    return (before if least <= other else after), up


@njit(**OPTIONS)
def passage(q_old, shape, samples, old_obstacles, obstacles, phi):
    """From one shape to the next on the same mesh: how near it is now, and whether it may have gone through.

    Args:
        q_old: (n, 4) nodal frames before the step.
        shape: fields of `Shape` after it, as plain tuples.
        samples: (m,) arc lengths, L.
        old_obstacles, obstacles: (o, WIDTH) before and after the step.
        phi: (o, m) receives the gaps at the samples, L.

    Returns:
        The smallest gap at the inner samples, and whether some sample has moved so far beside an obstacle
        that it could have passed it within the step.
    """
    q, c, grid = shape
    h, s0, tables = grid_of(grid)
    old_c = np.empty_like(c)
    curve(q_old, h, tables.values, tables.primitives, old_c)
    curve(q, h, tables.values, tables.primitives, c)
    return passed(old_c, (c, h, s0), samples, old_obstacles, obstacles, phi)


@njit(**OPTIONS)
def largest_motion(q, q_new, old_obstacles, obstacles):
    """The most that a step moves the cable beside an obstacle, and half the width of the thinnest one, L.

    Obstacles that are far out of the cable's reach do not count: they may turn on links far off, or be the
    point for one that the cable leaves out, whose distance, L, changes as the cable slides. Returned, too, is
    how far beyond its reach they are after the step at least, L; infinite if all count.

    Args:
        q, q_new: (n, 4) nodal frames before and after, of the same nodes or nearly so.
        old_obstacles, obstacles: (o, WIDTH) before and after the step.
    """
    turn, width, most, beyond = 0.0, np.inf, 0.0, np.inf
    start, n, directions, bends = np.zeros(3), np.empty(3), np.empty((2, 3)), np.empty(2)
    for i in range(q.shape[0]):
        same, opposite = 0.0, 0.0
        for a in range(4):
            same += (q[i, a] - q_new[i, a]) ** 2
            opposite += (q[i, a] + q_new[i, a]) ** 2
        turn = max(turn, 2.0 * np.sqrt(min(same, opposite)))
    for o in range(obstacles.shape[0]):
        new, old = obstacles[o], old_obstacles[o]
        shift, tilt, size, swell = 0.0, 0.0, 0.0, 0.0
        for i in range(CENTRE, AXES):
            shift += (new[i] - old[i]) ** 2
            size += old[i] ** 2
        for i in range(AXES, DIMENSIONS):
            tilt += (new[i] - old[i]) ** 2
        for i in range(DIMENSIONS, OFFSET + 1):  # in other units, of a cable that slides through its supports
            swell += abs(new[i] - old[i])
        motion = np.sqrt(shift) + np.sqrt(tilt) * (1.0 + np.sqrt(size)) + swell
        left = gap(new, start, n, directions, bends) - REACH
        if left > motion + REMOTE:
            beyond = min(beyond, left)
            continue
        most = max(most, motion)
        for k in range(DIMENSIONS, OFFSET):
            if new[k] > 0.0:
                width = min(width, new[k] + new[OFFSET])
    # no section moves farther than the largest rotation times the length before it
    return turn + most, width, beyond


@njit(**OPTIONS)
def passed(old_c, curves, samples, old_obstacles, obstacles, phi):
    """`passage` from the centreline old_c to another one, given with lengths and starts of the elements."""
    c, h, s0 = curves
    smallest = scan(c, h, s0, samples, obstacles, phi)
    crossed = False
    count = samples.shape[0]
    now, before = np.empty((count, 3)), np.empty((count, 3))
    farthest, reach = 0.0, 0.0
    beside = 0.5 * (samples[1] - samples[0])  # what is nearest may be between two samples
    for k in range(1, count - 1):
        position(c, h, s0, samples[k], now[k])
        position(old_c, h, s0, samples[k], before[k])
        shift, size = 0.0, 0.0
        for i in range(3):
            shift += (now[k, i] - before[k, i]) ** 2
            size += before[k, i] ** 2
        farthest, reach = max(farthest, shift), max(reach, size)
    for o in range(obstacles.shape[0]):
        new, old = obstacles[o], old_obstacles[o]
        width = np.inf
        for k in range(DIMENSIONS, OFFSET):
            if new[k] > 0.0:
                width = min(width, new[k])
        if width == np.inf:
            continue
        # the most that any sample can have moved beside it, by the triangle inequality, and rounding
        shift, turn, size = 0.0, 0.0, 0.0
        for i in range(CENTRE, AXES):
            shift += (new[i] - old[i]) ** 2
            size += old[i] ** 2
        for i in range(AXES, DIMENSIONS):
            turn += (new[i] - old[i]) ** 2
        most = np.sqrt(farthest) + np.sqrt(shift) + np.sqrt(turn) * (np.sqrt(reach) + np.sqrt(size))
        if most <= (1.0 - ROUNDING) * (width + new[OFFSET]):
            continue
        for k in range(1, count - 1):
            motion = 0.0
            for i in range(3):
                v = 0.0
                for j in range(3):
                    v += new[AXES + 3 * j + i] * (now[k, j] - new[CENTRE + j])
                    v -= old[AXES + 3 * j + i] * (before[k, j] - old[CENTRE + j])
                motion += v * v
            motion = np.sqrt(motion)
            crossed = crossed or (motion > width + new[OFFSET] and phi[o, k] < motion + beside)
    return smallest, crossed


@njit(**OPTIONS)
def dips(shape, samples, obstacles, phi, depth):
    """Whether the curve between the samples is deeper than `depth` in some obstacle.

    Args:
        shape: fields of `Shape`, as plain tuples.
        samples: (m,) arc lengths, L.
        obstacles: (o, WIDTH).
        phi: (o, m) gaps at the samples, L.
        depth: L.
    """
    shape = shape_of(shape)
    at = surface()
    for o in range(obstacles.shape[0]):
        slope = np.nan
        for k in range(1, samples.shape[0] - 1):
            if far(samples, k, phi[o]):
                slope = np.nan
                continue
            s, slope = minimum_beside(shape, samples, k, obstacles[o], slope)
            if s >= 0.0:
                value, _, _ = gap_at(shape, s, obstacles[o], at)
                if value < -depth:
                    return True
    return False
