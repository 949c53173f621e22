# SPDX-License-Identifier: Apache-2.0
"""Compiled: contact patches that come to an edge of their obstacle, or to a contact point beside them.

A cable that would lift off beyond an edge bends over it: it touches the edge at a point, stands off the face
beside it, and lies farther in. As it comes back, what stands off shrinks to nothing. Units of the cable,
start clamp's frame.
"""

from __future__ import annotations

from cable_ros.compilation import INNER, njit
from cable_ros.contact.distance import FRICTION_COEFFICIENT
from cable_ros.contact.interfaces import SHARPER, sharpest_at
from cable_ros.contact.points import (
    ARC_LENGTH,
    BEFORE,
    FIRST,
    FORCE,
    INTERFACE,
    KIND,
    LAST,
    OBSTACLE,
    POINT,
    SAMPLE,
    add,
    remove,
)

BISECTIONS = 50
"""Number of halvings of an interval that holds an edge."""
BACK = 0.5
"""Distance from the edge, in spacings of the samples, at which a patch ends as the cable begins to bend over
it."""
TOGETHER = 0.5
"""Motion of the centre of force, in units of `give`, up to which the end of a patch and the edge beside it
are one: less than the lift-off, which is then found, may be beyond the edge."""


@njit(**INNER)
def meet_edges(shape, obstacles, spacing, depths, points, count):
    """Make a point and a shorter patch where a smooth one reaches beyond an edge, and one of both again.

    Args:
        shape: `Shape`.
        obstacles: (o, WIDTH).
        spacing: of the samples, L.
        depths: penetration that does not count, and that beside the ends of patches, of which only a finer
            mesh can tell what touches, L.
        points, count: (CAPACITY, COLUMNS) the contact points and their number.

    Returns:
        Whether there were any, and the number of points.
    """
    changed, i = False, 0
    while i < count:
        o, kind = int(points[i, OBSTACLE]), points[i, KIND]
        if kind < FIRST or obstacles[o, FRICTION_COEFFICIENT] > 0.0:
            i += 1
            continue
        point = point_outside(points, count, i)
        if point >= 0 and is_one(shape, obstacles[o], spacing, depths, points[i], points[point]):
            points[i, ARC_LENGTH], points[i, INTERFACE] = points[point, ARC_LENGTH], points[point, INTERFACE]
            points[i, FORCE : BEFORE + 3] += points[point, FORCE : BEFORE + 3]
            count = remove(points, count, point)
            changed, i = True, 0
            continue
        s, out, back = points[i, ARC_LENGTH], 1.0 if kind == LAST else -1.0, 0.5 * extent(points, count, i)
        edge = edge_between(shape, s - out * min(spacing, back), s, obstacles[o])
        if edge >= 0.0 and abs(s - edge) > depths[1] and count < points.shape[0]:
            points[i, KIND] = POINT
            count = add(points, count, o, edge - out * min(BACK * spacing, back), kind)
            changed = True
        if edge >= 0.0:
            points[i, ARC_LENGTH] = edge
        i += 1
    return changed, count


@njit(**INNER)
def is_one(shape, obstacle, spacing, depths, end, point):
    """Whether what stands off between the end of a patch and a contact point is next to nothing.

    Args:
        shape, spacing, depths: as in `meet_edges`.
        obstacle: (WIDTH,).
        end, point: their rows of the contact points.
    """
    away = abs(point[ARC_LENGTH] - end[ARC_LENGTH])
    if away > spacing or end[FORCE] <= 0.0 or point[FORCE] <= 0.0:  # a new end has no force yet
        return False
    sharp = SHARPER * sharpest_at(shape, end[ARC_LENGTH], obstacle)
    if sharpest_at(shape, point[ARC_LENGTH], obstacle) > sharp:
        return end[FORCE] * away < TOGETHER * depths[1] * (end[FORCE] + point[FORCE])
    return end[FORCE] * away**3 < depths[0]


@njit(**INNER)
def extent(points, count, i):
    """Length of the patch that ends at point i, L; `points`, `count`: as in `meet_edges`."""
    out = 1.0 if points[i, KIND] == LAST else -1.0
    length = points[i, ARC_LENGTH] if out > 0.0 else 1.0 - points[i, ARC_LENGTH]  # from a clamp
    for k in range(count):
        inward = out * (points[i, ARC_LENGTH] - points[k, ARC_LENGTH])
        if points[k, OBSTACLE] == points[i, OBSTACLE] and points[k, KIND] >= FIRST and inward > 0.0:
            length = min(length, inward)
    return length


@njit(**INNER)
def point_outside(points, count, i):
    """The contact point next to the end of a patch, point i, if nothing else is before it; else -1.

    `points`, `count`: as in `meet_edges`.
    """
    out = 1.0 if points[i, KIND] == LAST else -1.0
    best, nearest = -1, 2.0
    for k in range(count):
        outward = out * (points[k, ARC_LENGTH] - points[i, ARC_LENGTH])
        other = points[k, OBSTACLE] != points[i, OBSTACLE] or points[k, KIND] == SAMPLE
        if k != i and not other and 0.0 <= outward < nearest:
            best, nearest = k, outward
    return best if best >= 0 and points[best, KIND] == POINT else -1


@njit(**INNER)
def edge_between(shape, inner, outer, obstacle):
    """Arc length at which the obstacle's surface becomes an edge, a little before it; -1: nowhere.

    Args:
        shape: `Shape`.
        inner, outer: arc lengths in a patch and at its end, L.
        obstacle: (WIDTH,).
    """
    sharp = SHARPER * sharpest_at(shape, inner, obstacle)
    if sharpest_at(shape, outer, obstacle) <= sharp:
        return -1.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (inner + outer)
        if sharpest_at(shape, middle, obstacle) > sharp:
            outer = middle
        else:
            inner = middle
    return inner
