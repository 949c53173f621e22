# SPDX-License-Identifier: Apache-2.0
"""Compiled: where the cable touches, and how that changes with its shape: the active set.

Where the gap has a distinct minimum a contact point sits there, at any arc length: a unilateral constraint
gap >= 0 with its multiplier, the normal force. It moves with the shape. Along a patch that lies on the
surface the gap has no distinct minimum: see `contact.patches`. Units of the cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, LEAF, njit
from cable_ros.contact.contact_state import shape_of, surface
from cable_ros.contact.distance import AXES, CENTRE, DIMENSIONS, OFFSET, gap
from cable_ros.contact.interfaces import gap_at, lowest
from cable_ros.contact.patch_ends import settle
from cable_ros.contact.patches import CLAMPED, SAMPLES, grounded, inside, make_patch, sample
from cable_ros.contact.points import (
    APART,
    ARC_LENGTH,
    FORCE,
    KIND,
    LENGTH,
    NUMBER,
    OBSTACLE,
    POINT,
    SAMPLE,
    add,
    remove,
)
from cable_ros.rod.centreline import curve, find_element, position
from cable_ros.rod.rod_state import grid_of

OPTIONS = {"cache": True, "error_model": "numpy"}

AWAY = 1.0
"""Gap below which it is evaluated exactly, in spacings of the samples."""
LEVEL = 1e-9
"""Maximum slope of a clamp that lies along a surface, rad: rounding."""
BESIDE = 0.25
"""Distance from a contact point, in spacings, within which a minimum is that of a cable nearly flat there."""
LONG = 4.0
"""Length inside an obstacle, in spacings, above which contact is a patch, not a point."""


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
def press(shape, samples, obstacles, points, phi, stiffness, minima):
    """Put a contact point on a spring at the minimum gap of each sample's cell; returns their number.

    With springs at the samples themselves, an edge between two of them would hold the cable. The energy of
    the minimum is continuous, and its gradient is that at a fixed arc length (envelope theorem).

    Args:
        shape: `Shape`, as a plain tuple.
        samples, obstacles, phi: as in `scan`.
        points: (CAPACITY, COLUMNS) the contact points, overwritten.
        stiffness: of the springs per length, EI / L^4.
        minima: whether at the minimum; else at the sample.
    """
    shape, at = shape_of(shape), surface()
    scan(shape.c, shape.grid.h, shape.grid.s0, samples, obstacles, phi)
    count = 0
    for o in range(obstacles.shape[0]):
        for k in range(1, samples.shape[0] - 1):
            low, high = 0.5 * (samples[k - 1] + samples[k]), 0.5 * (samples[k] + samples[k + 1])
            if phi[o, k] >= (0.5 * (high - low) if minima else 0.0):
                continue
            s, depth = samples[k], -phi[o, k]
            if minima:
                s = minimum_between(shape, low, high, obstacles[o], at)
                depth = -gap_at(shape, s, obstacles[o], at)[0]
                phi[o, k] = min(phi[o, k], -depth)
            if depth > 0.0 and count < points.shape[0]:
                # the minimum moves with the shape, which the row of a point's slope takes into account
                count = add(points, count, o, s, POINT if minima and low < s < high else SAMPLE)
                points[count - 1, LENGTH], points[count - 1, NUMBER] = high - low, k
                points[count - 1, FORCE] = stiffness * (high - low) * depth
    return count


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


@njit(**INNER)
def flatten(shape, spacing, obstacles, give, points, count):
    """Make patches of the points beside which the cable, more curved than the surface, dips too deep.

    Args:
        shape: `Shape`.
        spacing: of the samples, L.
        obstacles: (o, WIDTH).
        give: depth that is too deep, L.
        points, count: (CAPACITY, COLUMNS) the contact points and their number.

    Returns:
        Whether there are any, and the number of points.
    """
    at = surface()
    changed = False
    i = 0
    while i < count:
        if points[i, KIND] == POINT and points[i, FORCE] > 0.0:
            o, P = int(points[i, OBSTACLE]), points[i, FORCE]
            # at the minimum that it moves to: beside an edge the gap is curved as the face is
            s = lowest(shape, points[i, ARC_LENGTH], spacing, obstacles[o])
            _, _, curvature = gap_at(shape, s, obstacles[o], at)
            half = spacing
            if curvature >= 0.0:
                # or, if it alternates between two minima, at the maximum between them
                s, curvature, half = ridge(shape, points[i, ARC_LENGTH], spacing, obstacles[o])
            if curvature < 0.0 and -2.67 * curvature**3 > give * P**2:
                points[i, ARC_LENGTH] = s
                half = half_patch(s, curvature, P, half)
                count = make_patch(points, count, o, s - half, s + half)
                changed = True
                i = 0
                continue
        i += 1
    return changed, count


@njit(**LEAF)
def half_patch(s, curvature, force, most):
    """Half the length of the patch that a contact point becomes, L, at most `most`.

    The gap's curvature, negative there, rises by half the force per length on both sides.

    Args:
        s: arc length of the point, L.
        curvature: of the gap there, 1 / L.
        force: EI / L^2.
        most: L.
    """
    return min(-2.0 * curvature / force, most, 0.45 * s, 0.45 * (1.0 - s))


@njit(**INNER)
def ridge(shape, s, spacing, obstacle):
    """Arc length of a maximum of the gap near s between two minima, its curvature, and the room beside it.

    The curvature is 0 if there is none, or if the minima are those of two edges.

    Args:
        shape: `Shape`.
        s, spacing: arc length, and that of the samples, L.
        obstacle: (WIDTH,).
    """
    at = surface()
    bends = at.bends
    _, slope, curvature = gap_at(shape, s, obstacle, at)
    sharpest = max(bends[0], bends[1])
    if not curvature < 0.0 or abs(slope) > -0.5 * spacing * curvature:
        return s, 0.0, spacing
    top = s - slope / curvature
    if not spacing < top < 1.0 - spacing:
        return s, 0.0, spacing
    before = lowest(shape, top - 0.5 * spacing, 0.5 * spacing, obstacle)
    after = lowest(shape, top + 0.5 * spacing, 0.5 * spacing, obstacle)
    for end in (before, after):
        gap_at(shape, end, obstacle, at)
        if max(bends[0], bends[1]) > 1.5 * sharpest:
            return s, 0.0, spacing
    least, most = 1e-6 * spacing, (1.0 - 1e-6) * spacing
    if least < top - before < most and least < after - top < most:
        return top, curvature, 0.25 * (after - before)
    return s, 0.0, spacing


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
    """Arc length of a minimum of the gap that is nearer to sample k than to others; -1: none.

    Two edges side by side have a minimum each, which the gaps at the samples may not show: its slopes do.
    Returned, too, is the slope half way to the next sample. Only for a sample that is not `far`.

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
    _, up, _ = gap_at(shape, high, obstacle, at)
    # a clamp that rests on the surface has no slope there but rounding
    falls, rises = down < 0.0, up >= 0.0
    if k == 1 and abs(down) < LEVEL:
        _, slope, _ = gap_at(shape, 0.75 * low + 0.25 * high, obstacle, at)
        falls = slope < 0.0
    if k == samples.shape[0] - 2 and abs(up) < LEVEL:
        _, slope, _ = gap_at(shape, 0.25 * low + 0.75 * high, obstacle, at)
        rises = slope >= 0.0
    if not (falls and rises):
        return -1.0, up
    return lowest(shape, 0.5 * (low + high), 0.5 * (high - low), obstacle), up


@njit(**INNER)
def update_active_set(shape, samples, obstacles, depth, give, points, count, phi):
    """Update the active set at a solution: drop what pulls, add what is inside an obstacle.

    Args:
        shape: `Shape`.
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
    q, c, (h, s0, tables) = shape
    spacing = 1.0 / (samples.shape[0] - 1)
    changed = False
    i = 0
    while i < count:
        if points[i, KIND] == POINT and points[i, FORCE] < 0.0:
            count = remove(points, count, i)
            changed = True
        else:
            i += 1
    curve(q, h, tables.values, tables.primitives, c)
    settled, count = settle(c, h, s0, points, count, spacing, obstacles, depth)
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
            if s < 0.0:
                continue
            value, _, _ = gap_at(shape, s, obstacles[o], at)
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
            beside = ends or (near >= 0 and abs(points[near, ARC_LENGTH] - s) < BESIDE * spacing)
            if beside and value >= -give:
                continue
            if ends:
                points[near, ARC_LENGTH] = s
            elif near >= 0:
                # two minima closer than the spacing: the cable begins to lie on the surface
                low, high = min(s, points[near, ARC_LENGTH]), max(s, points[near, ARC_LENGTH])
                middle, force = points[near, ARC_LENGTH], points[near, FORCE]
                _, _, curvature = gap_at(shape, middle, obstacles[o], at)
                if curvature < 0.0 and force > 0.0:
                    # the minima are those beside a point that holds a cable more curved than the surface
                    half = half_patch(middle, curvature, force, spacing)
                    low, high = middle - half, middle + half
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
def sampled(points, count, o, g):
    """Whether sample g presses on obstacle o; `points`, `count`: as in `update_active_set`."""
    for i in range(count):
        if points[i, OBSTACLE] == o and points[i, KIND] == SAMPLE and points[i, NUMBER] == g:
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
    smallest = scan(c, h, s0, samples, obstacles, phi)
    crossed = False
    r, r_old = np.empty(3), np.empty(3)
    for o in range(obstacles.shape[0]):
        new, old = obstacles[o], old_obstacles[o]
        width = np.inf
        for k in range(DIMENSIONS, OFFSET):
            if new[k] > 0.0:
                width = min(width, new[k])
        if width == np.inf:
            continue
        for k in range(1, samples.shape[0] - 1):
            position(c, h, s0, samples[k], r)
            position(old_c, h, s0, samples[k], r_old)
            motion = 0.0
            for i in range(3):
                v = 0.0
                for j in range(3):
                    v += new[AXES + 3 * j + i] * (r[j] - new[CENTRE + j])
                    v -= old[AXES + 3 * j + i] * (r_old[j] - old[CENTRE + j])
                motion += v * v
            motion = np.sqrt(motion)
            crossed = crossed or (motion > width + new[OFFSET] and phi[o, k] < motion)
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
