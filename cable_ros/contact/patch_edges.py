# SPDX-License-Identifier: Apache-2.0
"""Compiled: contact patches that come to an edge of their obstacle, or to a contact point beside them.

A cable that would lift off beyond an edge bends over it: it touches the edge at a point, stands off the face
beside it, and lies farther in. As it comes back, what stands off shrinks to nothing. Units of the cable,
start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, LEAF, njit
from cable_ros.contact.contact_state import surface
from cable_ros.contact.interfaces import SHARPER, SHORTEST, gap_at, sharpest_at
from cable_ros.contact.points import (
    ARC_LENGTH,
    AT_EDGE,
    BEFORE,
    FIRST,
    FORCE,
    FRICTION,
    INTERFACE,
    KIND,
    LAST,
    OBSTACLE,
    POINT,
    SAMPLE,
    SHIFT,
    SLIPS,
    add,
    remove,
)

BISECTIONS = 50
"""Number of halvings of an interval that holds an edge."""
BACK = 0.5
"""Distance from the edge, in spacings of the samples, at which a patch without a pressure ends as the cable
begins to bend over it."""
ASIDE = 1e-7
"""Distance from a contact point, L, at which an edge is looked for beyond it: it may be just before that."""
AGAIN = 0.25
"""What stands off beside an edge as the end of the patch and the edge become one, over that as they part."""


@njit(**INNER)
def meet_edges(shape, f, obstacles, spacing, depths, points, count):
    """Hold the ends of patches at edges; make a point and a shorter patch, or one of both again.

    A cable that lies up to an edge, and would lift off a distance e beyond it, stands off the face along
    d = 2 sqrt(P e / p), where P is the force at the edge and p the pressure. No small d is found by steps
    from a lift-off that is not there, so the edge holds the end of the patch, and the slope there as well, by
    the couple P e. Where the slope that the cable truly has, p d^3 / 24, counts, both part.

    Args:
        shape: `Shape`.
        f: (3,) load per length.
        obstacles: (o, WIDTH).
        spacing: of the samples, L.
        depths: penetration that does not count, and that beside the ends of patches, of which only a finer
            mesh can tell what touches, L.
        points, count: (CAPACITY, COLUMNS) the contact points and their number.

    Returns:
        Whether there were any, and the number of points.
    """
    at = surface()
    changed, i = False, 0
    while i < count:
        o, kind = int(points[i, OBSTACLE]), points[i, KIND]
        if kind < FIRST:
            i += 1
            continue
        gap_at(shape, points[i, ARC_LENGTH], obstacles[o], at)
        pressure = -(f[0] * at.n[0] + f[1] * at.n[1] + f[2] * at.n[2])
        point = point_outside(points, count, i)
        if point >= 0 and is_one(shape, obstacles[o], spacing, depths, pressure, points[i], points[point]):
            points[i, ARC_LENGTH], points[i, INTERFACE] = points[point, ARC_LENGTH], points[point, INTERFACE]
            points[i, FORCE : BEFORE + 3] += points[point, FORCE : BEFORE + 3]
            count = remove(points, count, point)
            changed, i = True, 0
            continue
        s, out, back = points[i, ARC_LENGTH], 1.0 if kind == LAST else -1.0, 0.5 * extent(points, count, i)
        held = points[i, AT_EDGE] < 0.0
        outer = min(max(s + out * min(spacing, back), 0.0), 1.0) if held else s
        edge = edge_between(shape, s - out * min(spacing, back), outer, obstacles[o])
        points[i, AT_EDGE] = 0.0
        if edge >= 0.0:
            points[i, ARC_LENGTH], points[i, AT_EDGE] = edge, -1.0
            beyond = out * points[i, SHIFT] if held else 0.0
            off = stands_off(beyond, points[i, FORCE], pressure, min(BACK * spacing, back), back)
            counts = off > SHORTEST and pressure * off**3 > 24.0 * depths[1]
            if pressure <= 0.0:
                counts = beyond > depths[1]
            if counts and count < points.shape[0]:
                load = max(pressure, 0.0) * off
                points[i, KIND], points[i, AT_EDGE], points[i, SHIFT] = POINT, 0.0, 0.0
                points[i, FORCE] += 0.75 * load
                count = add(points, count, o, edge - out * off, kind)
                points[count - 1, FORCE], points[count - 1, AT_EDGE] = 0.25 * load, max(pressure, 0.0)
                share = points[count - 1, FORCE] / max(points[i, FORCE], 1e-300)
                for a in range(3):
                    points[count - 1, FRICTION + a] = share * points[i, FRICTION + a]
                points[count - 1, SLIPS] = points[i, SLIPS]
                changed = True
        elif point >= 0 and pressure > 0.0 and abs(points[point, ARC_LENGTH] - s) < spacing:
            bends = bends_over(shape, obstacles[o], s, points[point, ARC_LENGTH])
            points[i, AT_EDGE] = pressure if bends else 0.0
        i += 1
    return changed, count


@njit(**LEAF)
def stands_off(beyond, force, pressure, without, most):
    """Length along which the cable stands off a face beside the edge over which it bends, L.

    Args:
        beyond: how far beyond the edge it would lift off, L.
        force: at the edge, EI / L^2.
        pressure: of its weight on the face, EI / L^3.
        without: the length if there is none, L.
        most: L.
    """
    if beyond <= 0.0 or force <= 0.0:
        return 0.0
    return min(2.0 * np.sqrt(force * beyond / pressure), most) if pressure > 0.0 else without


@njit(**INNER)
def is_one(shape, obstacle, spacing, depths, pressure, end, point):
    """Whether what stands off between the end of a patch and a contact point is next to nothing.

    Args:
        shape, spacing, depths: as in `meet_edges`.
        obstacle: (WIDTH,).
        pressure: as in `stands_off`.
        end, point: their rows of the contact points.
    """
    away = abs(point[ARC_LENGTH] - end[ARC_LENGTH])
    if away > spacing or end[FORCE] <= 0.0 or point[FORCE] <= 0.0:  # a new end may have no force yet
        return False
    if not bends_over(shape, obstacle, end[ARC_LENGTH], point[ARC_LENGTH]):
        return end[FORCE] * away**3 < depths[0]
    if pressure > 0.0:
        return pressure * away**3 < AGAIN * 24.0 * depths[1]
    return end[FORCE] * away < AGAIN * depths[1] * (end[FORCE] + point[FORCE])


@njit(**INNER)
def bends_over(shape, obstacle, s, point):
    """Whether there is an edge at the contact point next to the end of a patch.

    Args:
        shape, obstacle: as in `is_one`.
        s, point: arc lengths of the end and of the point, L.
    """
    beyond = point + (ASIDE if point > s else -ASIDE)
    return sharpest_at(shape, beyond, obstacle) > SHARPER * sharpest_at(shape, s, obstacle)


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
