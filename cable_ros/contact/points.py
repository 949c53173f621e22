# SPDX-License-Identifier: Apache-2.0
"""Compiled: the table of contact points.

One row each, see the columns below. A contact is a point, at the minimum of the gap, or a patch along which
the cable lies on the surface: its touchdown and its lift-off point, and samples between them. Units of the
cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, LEAF, LEAF_ENTRY, njit

OPTIONS = {"cache": True, "error_model": "numpy"}

CAPACITY = 240
"""Contact points at once."""
OBSTACLE, ARC_LENGTH, KIND, FORCE, FRICTION, BEFORE, INTERFACE, LENGTH, NUMBER = 0, 1, 2, 3, 4, 7, 10, 11, 12
SLOPE_ROW, SLIPS, STICK_ROW, SLIP_ROW, SHIFT, MOTION, SWINGS = 13, 14, 15, 16, 17, 18, 21
ARM, HOLD, GIVEN, TARGET, SPRING, WAS, AT_EDGE = 22, 25, 26, 29, 32, 33, 34
SLIP, SLIP_BEFORE, STEP_BEFORE, WENT, COLUMNS = 35, 38, 41, 42, 43
"""Columns of the contact points (CAPACITY, COLUMNS): obstacle, arc length, kind, normal force, friction (3),
the friction of the last equilibrium (3), the boundary between elements that goes with the point (-1: none),
the length of cable that a sample stands for, the number of a sample along the cable (of an end: how often a
solve has moved it out; of a point: `SPARED` or 0), the constraint row of the gap's slope at a point or an end
of a patch, 1 for what slips, the first of the two constraint rows of what sticks, that of what slips (each 0:
none), how far a point or an end went in the last iteration, how far the obstacle goes there in the step (3),
how often in a row a point went back by what it had come; then what holds a point at an arm, see
`point_couples`: the arm along the section's axes (3; 0: nothing), the arc length, the given force (3), the
place (3) and the stiffness of a spring; the arc length of a point at the last equilibrium (0: it is new);
of an end of a patch, see `patch_edges`, -1 if an edge holds it (SHIFT is how far it would go), the pressure
if the cable stands off between it and an edge, else 0; how far a point that slips has slipped in the step,
L (3), and in the one before (3; 0: it stuck, or is new), that step's length, L; and how far an end of a
patch was moved in the last iteration, L; then the number of columns."""
POINT, SAMPLE, FIRST, LAST = 0.0, 1.0, 2.0, 3.0
"""Kinds: a touching point, one of the samples of a contact patch, the touchdown and the lift-off point of a
patch.

A patch without its touchdown or lift-off point begins or ends at the clamp. A sample that stands for no
length is a concentrated reaction, see `pinches`; it has no number.
"""
SPARED = -1.0
"""NUMBER of a point that stays since a solve has dropped another one that pulled as much, see `leaving`."""
YIELD = 1e-6
"""A sample that stands for the length l yields to the change of its force in an iteration by YIELD l^3 / EI:
little beside what the cable does, but it tells apart forces that hardly bend it."""
LYING = 6
"""Maximum length of an element that lies on a surface, in spacings of the samples."""
NEAR_LIMIT = 0.9
"""Least friction, over the largest possible, of what may go on slipping on another mesh: pressures change."""
APART = 2.5
"""Distance from a contact point, in spacings, within which contact belongs to it."""


@njit(**LEAF_ENTRY)
def total_force(points, normals, count, out):
    """The force of all contact points on the cable.

    Args:
        points, normals: of `ContactSet`.
        count: of the contact points.
        out: (3,) receives the force.
    """
    out[0], out[1], out[2] = 0.0, 0.0, 0.0
    for i in range(count):
        for a in range(3):
            out[a] += points[i, FORCE] * normals[i, a] + points[i, FRICTION + a]


@njit(**LEAF)
def add(points, count, o, s, kind):
    """One more contact point, unless there is no space; returns the count.

    Args:
        points, count: (CAPACITY, COLUMNS) the contact points and their number.
        o, s, kind: its obstacle, arc length and kind.
    """
    if count < points.shape[0]:
        points[count] = 0.0
        points[count, OBSTACLE], points[count, ARC_LENGTH], points[count, INTERFACE] = o, s, -1.0
        points[count, KIND] = kind
        return count + 1
    return count


@njit(**LEAF)
def concentrated(point):
    """Whether a contact point, (COLUMNS,), is a concentrated reaction within a patch."""
    return point[KIND] == SAMPLE and point[LENGTH] == 0.0


@njit(**INNER)
def reaction_at(points, count, o, s):
    """The concentrated reaction of obstacle o at arc length s; -1: there is none.

    `points` (CAPACITY, COLUMNS) holds `count` contact points.
    """
    for i in range(count):
        if concentrated(points[i]) and points[i, OBSTACLE] == o and points[i, ARC_LENGTH] == s:
            return i
    return -1


@njit(**LEAF)
def space_at(points, count, i, s):
    """Distance from arc length s to the patches on the obstacle of point i, L; 0 if one is between both."""
    space, place = np.inf, points[i, ARC_LENGTH]
    for k in range(count):
        other = points[k, ARC_LENGTH]
        if points[k, KIND] == POINT or points[k, OBSTACLE] != points[i, OBSTACLE]:
            continue
        if min(s, place) <= other <= max(s, place):
            return 0.0
        space = min(space, abs(other - s))
    return space


@njit(**INNER)
def nearest(points, count, point, samples):
    """The contact point on the obstacle of `point` that is nearest along the cable; -1: there is none.

    Args:
        points, count: (CAPACITY, COLUMNS) the contact points to choose from, and their number.
        point: (COLUMNS,) a row that is not among them.
        samples: whether only samples of a patch count.
    """
    best, distance = -1, np.inf
    for k in range(count):
        d = abs(points[k, ARC_LENGTH] - point[ARC_LENGTH])
        counts = points[k, LENGTH] > 0.0 or not samples
        if points[k, OBSTACLE] == point[OBSTACLE] and counts and d < distance:
            best, distance = k, d
    return best


@njit(**INNER)
def slide_along(point, others, count):
    """Let a new end or sample of a patch slip if the nearest contact on its obstacle does.

    How a cable slides over a surface is continuous along it. One that began to stick would pull all of a
    cable that slides back by its motion in the step.

    Args:
        point: (COLUMNS,) its row.
        others, count: (CAPACITY, COLUMNS) the contact points and their number, without it.
    """
    best = nearest(others, count, point, False)
    if best >= 0:
        point[SLIPS] = others[best, SLIPS]


@njit(**INNER)
def remove(points, count, i):
    """Drop contact point i of `points` (CAPACITY, COLUMNS), keeping the others' order; returns the count."""
    for k in range(i, count - 1):
        points[k] = points[k + 1]
    return count - 1
