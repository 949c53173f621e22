# SPDX-License-Identifier: Apache-2.0
"""Compiled: contact patches, along which the cable lies on an obstacle, and their samples.

In a patch a pressure holds the cable on the surface at the points of a Gauss rule on each element; for its
ends see `contact.patch_ends`. Units of the cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, njit
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
    SLIP_BEFORE,
    SLIPS,
    STEP_BEFORE,
    add,
    nearest,
    remove,
    slide_along,
)
from cable_ros.rod.centreline import derivative, position

OPTIONS = {"cache": True, "error_model": "numpy"}

SAMPLES = 4
"""Number of samples of an element in a patch: fewer than its degrees of freedom in bending, and the Gauss
rule makes a smooth pressure of their forces."""
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(SAMPLES)
NODES, WEIGHTS = 0.5 * (1.0 + _NODES), 0.5 * _WEIGHTS
"""(SAMPLES,) the Gauss rule on [0, 1]."""
CLAMPED = 1e-8
"""Maximum gap, L, at which a clamp is on a surface."""
ALONG = 1e-5
"""Maximum slope, rad, at which it is along the surface."""


@njit(**OPTIONS)
def inside(points, count, o, s):
    """Whether arc length s is in a patch on obstacle o.

    Args:
        points, count: (CAPACITY, COLUMNS) the contact points and their number.
        o, s: obstacle and arc length, L.
    """
    left, right = -1.0, 2.0
    before, after, lies = POINT, POINT, False
    for i in range(count):
        if points[i, OBSTACLE] != o or points[i, KIND] == POINT:
            continue
        if points[i, KIND] == SAMPLE:
            lies = True
            continue
        end = points[i, ARC_LENGTH]
        if left < end <= s:
            left, before = end, points[i, KIND]
        if s < end < right:
            right, after = end, points[i, KIND]
    if left >= 0.0:
        return before == FIRST
    return after == LAST if right <= 1.0 else lies


@njit(**INNER)
def sample_place(g, h, s0):
    """Arc length of sample g, on a mesh of elements with lengths h (m,) that start at s0 (m,)."""
    return s0[g // SAMPLES] + h[g // SAMPLES] * NODES[g % SAMPLES]


@njit(**INNER)
def cover(points, count, h, s0, covered):
    """Mark the samples that are in a patch.

    Args:
        points, count: (CAPACITY, COLUMNS) the contact points and their number.
        h, s0: (m,) of `Grid`.
        covered: (o, samples) bool, overwritten.
    """
    covered[:] = False
    for o in range(covered.shape[0]):
        lies = False
        for i in range(count):
            lies = lies or (points[i, OBSTACLE] == o and points[i, KIND] != POINT)
        if lies:
            for g in range(covered.shape[1]):
                covered[o, g] = inside(points, count, o, sample_place(g, h, s0))


@njit(**INNER)
def fill(points, count, h, s0, covered):
    """Add the samples that are in a patch now, and remove those that are in none any more.

    Args:
        points, count, h, s0: as in `cover`.
        covered: (o, samples) as `cover` left it for the patches before; updated.

    Returns:
        The number of changes, and the number of points.
    """
    now = np.empty_like(covered)
    cover(points, count, h, s0, now)
    changes, i = 0, 0
    while i < count:
        if points[i, LENGTH] > 0.0:
            g = int(points[i, NUMBER])
            if not now[int(points[i, OBSTACLE]), g]:
                count = remove(points, count, i)
                changes += 1
                continue
            points[i, ARC_LENGTH], points[i, LENGTH] = (
                sample_place(g, h, s0),
                h[g // SAMPLES] * WEIGHTS[g % SAMPLES],
            )
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
def resample(points, count, h, s0, fronts):
    """Replace the samples of all patches by those of another mesh; returns the number of points.

    Args:
        points, count: (CAPACITY, COLUMNS) the contact points and their number.
        h, s0: (m,) of `Grid` of that mesh.
        fronts: whether friction may jump from sample to sample, as where slip creeps along a cable that
            stretches: each is given that of the nearest one, else it is between those of its neighbours.
    """
    obstacles = 0
    for i in range(count):
        obstacles = max(obstacles, int(points[i, OBSTACLE]) + 1)
    covered = np.empty((obstacles, SAMPLES * h.shape[0]), np.bool_)
    cover(points, count, h, s0, covered)
    old = points[:count].copy()
    before, count = count, 0
    for i in range(before):
        if old[i, LENGTH] == 0.0:
            points[count] = old[i]
            count += 1
    for o in range(obstacles):
        for g in range(covered.shape[1]):
            if covered[o, g]:
                count = sample(points, count, o, g, h, s0)
                if fronts:
                    inherit(points, count - 1, old, before)
                else:
                    interpolate(points, count - 1, old, before)
                points[count - 1, SLIPS] = 0.0  # its friction tells, see `FrictionalRod._slip_on`
    return count


@njit(**INNER)
def sample(points, count, o, g, h, s0):
    """Add sample g on obstacle o, with pressure and friction of its nearest neighbour; the number of points.

    `points`, `count`, `h`, `s0`: as in `cover`.
    """
    before = count
    count = add(points, count, o, sample_place(g, h, s0), SAMPLE)
    if count > before:
        points[before, LENGTH], points[before, NUMBER] = h[g // SAMPLES] * WEIGHTS[g % SAMPLES], g
        inherit(points, before, points, before)
    return count


@njit(**INNER)
def inherit(points, i, others, count):
    """Give sample i of `points` the pressure and friction of the nearest sample on its obstacle.

    It slips if that does, see `slide_along`, or the nearest contact if there is no other sample.

    Args:
        points: (CAPACITY, COLUMNS) the contact points.
        i: the sample.
        others, count: (CAPACITY, COLUMNS) contact points to choose from, and their number.
    """
    best = nearest(others, count, points[i], True)
    if best < 0:
        slide_along(points[i], others, count)
        return
    points[i, SLIPS] = others[best, SLIPS]
    for a in range(FORCE, BEFORE + 3):
        points[i, a] = others[best, a] * points[i, LENGTH] / others[best, LENGTH]
    for a in range(SLIP_BEFORE, STEP_BEFORE + 1):
        points[i, a] = others[best, a]


@njit(**INNER)
def interpolate(points, i, others, count):
    """Give sample i of `points` pressure and friction between those of its neighbours on its obstacle.

    With those of the nearest one a cable that slips lost some percent of its friction: where it presses
    harder than that one did, it was taken to stick.

    Args:
        points, i, others, count: as in `inherit`, which serves beyond the last sample.
    """
    s, left, right = points[i, ARC_LENGTH], -1, -1
    for k in range(count):
        if others[k, OBSTACLE] != points[i, OBSTACLE] or others[k, LENGTH] == 0.0:
            continue
        if others[k, ARC_LENGTH] <= s:
            if left < 0 or others[k, ARC_LENGTH] > others[left, ARC_LENGTH]:
                left = k
        elif right < 0 or others[k, ARC_LENGTH] < others[right, ARC_LENGTH]:
            right = k
    if left < 0 or right < 0:
        inherit(points, i, others, count)
        return
    beyond = (s - others[left, ARC_LENGTH]) / (others[right, ARC_LENGTH] - others[left, ARC_LENGTH])
    for a in range(FORCE, BEFORE + 3):
        per_length = (1.0 - beyond) * others[left, a] / others[left, LENGTH]
        per_length += beyond * others[right, a] / others[right, LENGTH]
        points[i, a] = per_length * points[i, LENGTH]
    for a in range(SLIP_BEFORE, STEP_BEFORE + 1):
        points[i, a] = (1.0 - beyond) * others[left, a] + beyond * others[right, a]


@njit(**INNER)
def make_patch(points, count, o, low, high):
    """Make a patch, with the force of the points in it; returns the number of points.

    From 0, or to 1, it begins or ends at the clamp.

    Args:
        points, count: (CAPACITY, COLUMNS) the contact points and their number.
        o: the obstacle.
        low, high: arc lengths of its ends, L.
    """
    total = np.zeros(BEFORE + 3 - FORCE)
    others, before = points[:count].copy(), count
    i = 0
    while i < count:
        s = points[i, ARC_LENGTH]
        if points[i, OBSTACLE] == o and points[i, KIND] == POINT and low <= s <= high:
            for a in range(total.shape[0]):
                total[a] += points[i, FORCE + a]
            count = remove(points, count, i)
        else:
            i += 1
    for s, kind in ((low, FIRST), (high, LAST)):
        if 0.0 < s < 1.0 and count < points.shape[0]:
            count = add(points, count, o, s, kind)
            for a in range(total.shape[0]):
                points[count - 1, FORCE + a] = 0.5 * total[a]
            slide_along(points[count - 1], others, before)
    return count


@njit(**OPTIONS)
def grounded(c, h, s0, obstacle, s):
    """Whether a clamp is on the obstacle's surface.

    Args:
        c: (m, g + 1, 3) of `Shape`.
        h, s0: (m,) of `Grid`.
        obstacle: (WIDTH,).
        s: arc length of the clamp, 0 or 1.
    """
    r, n = np.empty(3), np.empty(3)
    position(c, h, s0, s, r)
    return gap(obstacle, r, n, np.empty((2, 3)), np.empty(2)) < CLAMPED


@njit(**INNER)
def rests(c, h, s0, obstacle, s):
    """Whether a clamp is on the obstacle's surface and along it; arguments as in `grounded`."""
    r, dr, n = np.empty(3), np.empty(3), np.empty(3)
    position(c, h, s0, s, r)
    derivative(c, h, s0, s, dr)
    value = gap(obstacle, r, n, np.empty((2, 3)), np.empty(2))
    return value < CLAMPED and abs(n[0] * dr[0] + n[1] * dr[1] + n[2] * dr[2]) < ALONG


@njit(**INNER)
def coarse(points, count, h, s0, spacing):
    """Whether an element that lies on a surface is longer than LYING spacings.

    `points`, `count`, `h`, `s0`: as in `cover`; `spacing`: of the samples, L.
    """
    for e in range(h.shape[0]):
        if h[e] > 1.1 * LYING * spacing:
            middle = s0[e] + 0.5 * h[e]
            for i in range(count):
                if points[i, KIND] != POINT and inside(points, count, points[i, OBSTACLE], middle):
                    return True
    return False
