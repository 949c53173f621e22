# SPDX-License-Identifier: Apache-2.0
"""Compiled: contact patches into which a point of another obstacle pushes the cable: concentrated reactions.

On both sides of a point force that pushes it onto a surface a cable is as flat, so its shear force does not
jump: the surface answers with a point force right there. The pressures at the samples cannot give it, and the
end of a patch nearby would go there to do so. Units of the cable, start clamp's frame.
"""

from __future__ import annotations

from cable_ros.compilation import INNER, njit
from cable_ros.contact.contact_state import surface
from cable_ros.contact.distance import FRICTION_COEFFICIENT
from cable_ros.contact.interfaces import gap_at
from cable_ros.contact.meshing import TOGETHER
from cable_ros.contact.patches import inside
from cable_ros.contact.points import (
    ARC_LENGTH,
    FIRST,
    FORCE,
    KIND,
    OBSTACLE,
    POINT,
    SAMPLE,
    add,
    concentrated,
    reaction_at,
    remove,
)

OBLIQUE = 0.1
"""Least part of a point's force that pushes onto a patch, over the force, for a reaction of its own: of what
is all but along the surface the samples bear so little that rounding would tell its sign."""


@njit(**INNER)
def meet_pinches(shape, obstacles, points, count):
    """Give patches a concentrated reaction where a point of another obstacle pushes the cable onto them.

    It goes with that point along the cable, and is dropped where no point pushes any more or the patch ends
    before it. Only on smooth obstacles.

    Args:
        shape: `Shape`, its centreline traced.
        obstacles: (o, WIDTH).
        points, count: (CAPACITY, COLUMNS) the contact points and their number.

    Returns:
        The number of changes, and the number of points.
    """
    changes, i = 0, 0
    while i < count:
        if concentrated(points[i]):
            k = pinching(points, count, i)
            if k < 0:
                count = remove(points, count, i)
                changes += 1
                continue
            points[i, ARC_LENGTH] = points[k, ARC_LENGTH]
            k = reaction_at(points, i, points[i, OBSTACLE], points[i, ARC_LENGTH])
            if k >= 0:
                points[k, FORCE] += points[i, FORCE]
                count = remove(points, count, i)
                changes += 1
                continue
        i += 1
    for k in range(count):
        if points[k, KIND] != POINT or points[k, FORCE] <= 0.0:
            continue
        one, s = int(points[k, OBSTACLE]), points[k, ARC_LENGTH]
        for o in range(obstacles.shape[0]):
            if o == one or obstacles[o, FRICTION_COEFFICIENT] > 0.0 or not within(points, count, o, s):
                continue
            if reaction_at(points, count, o, s) < 0 and pushes(shape, s, obstacles[one], obstacles[o]):
                before = count
                count = add(points, count, o, s, SAMPLE)
                changes += count - before
    return changes, count


@njit(**INNER)
def within(points, count, o, s):
    """Whether arc length s is in a patch on obstacle o and not at its end, which has a force of its own.

    `points`, `count`: as in `meet_pinches`.
    """
    for i in range(count):
        at_end = points[i, KIND] >= FIRST and abs(points[i, ARC_LENGTH] - s) < TOGETHER
        if at_end and points[i, OBSTACLE] == o:
            return False
    return inside(points, count, o, s)


@njit(**INNER)
def pinching(points, count, i):
    """The contact point that pushes the cable onto concentrated reaction i: the next one in its patch; or -1.

    `points`, `count`: as in `meet_pinches`.
    """
    best, o = -1, points[i, OBSTACLE]
    for k in range(count):
        if points[k, KIND] != POINT or points[k, OBSTACLE] == o or points[k, FORCE] <= 0.0:
            continue
        away = abs(points[k, ARC_LENGTH] - points[i, ARC_LENGTH])
        nearer = best < 0 or away < abs(points[best, ARC_LENGTH] - points[i, ARC_LENGTH])
        if nearer and within(points, count, o, points[k, ARC_LENGTH]):
            best = k
    return best


@njit(**INNER)
def pushes(shape, s, one, other):
    """Whether what one obstacle exerts on the cable at arc length s pushes it onto another one.

    Args:
        shape: as in `meet_pinches`.
        s: L.
        one, other: (WIDTH,).
    """
    at, there = surface(), surface()
    gap_at(shape, s, one, at)
    gap_at(shape, s, other, there)
    return at.n[0] * there.n[0] + at.n[1] * there.n[1] + at.n[2] * there.n[2] < -OBLIQUE
