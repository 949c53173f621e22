# SPDX-License-Identifier: Apache-2.0
"""Compiled: the table of contact points.

One row each, see the columns below. A contact is a point, whose place is where the gap has its minimum, or a
stretch along which the cable lies on the surface: its first and its last point, where the cable lifts off,
and samples between them. Units of the cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import LEAF, njit

OPTIONS = {"cache": True, "error_model": "numpy"}

CAPACITY = 240
"""Contact points at once."""
OBSTACLE, PLACE, KIND, FORCE, FRICTION, HELD, TIE, LENGTH, ROW = 0, 1, 2, 3, 4, 7, 10, 11, 12
SLIPS, GRIP, WENT = 13, 14, 15
"""Columns of the contact points (CAPACITY, COLUMNS): obstacle, arc length, kind, normal force, friction (3),
the friction of the last equilibrium (3), the boundary between elements that goes with the point (-1: none),
the length of cable that a sample stands for, the border that holds the slope of the gap at the end of a
stretch, or the number of a sample, counted along the cable, 1 for what slips, the first of the two borders
that hold what sticks (0: none), and how far a point or an end went in the last iteration."""
COLUMNS = 16
POINT, SAMPLE, FIRST, LAST = 0.0, 1.0, 2.0, 3.0
"""Kinds: a touching point, one of the samples of a stretch, the first and the last point of a stretch.

A stretch without its first or last point begins or ends at the clamp.
"""
YIELD = 1e-6
"""A sample that stands for the length l yields to the change of its force in an iteration by YIELD l^3 / EI:
little beside what the cable does, but enough to tell forces apart that hardly bend it."""
LYING = 6
"""An element that lies on a surface is no longer than so many times the spacing."""
APART = 2.5
"""Around a contact point what is so near, in parts of the spacing, is its own."""


@njit(**OPTIONS)
def held(points, normals, count):
    """(3,) the force of all contact points on the cable."""
    out = np.zeros(3)
    for i in range(count):
        for a in range(3):
            out[a] += points[i, FORCE] * normals[i, a] + points[i, FRICTION + a]
    return out


@njit(**LEAF)
def add(points, count, o, s, kind):
    """One more contact point, unless there is no space; returns the count."""
    if count < points.shape[0]:
        points[count] = 0.0
        points[count, OBSTACLE], points[count, PLACE], points[count, TIE] = o, s, -1.0
        points[count, KIND] = kind
        return count + 1
    return count


@njit(**OPTIONS)
def remove(points, count, i):
    """Drop contact point i, keeping the others' order; returns the count."""
    for k in range(i, count - 1):
        points[k] = points[k + 1]
    return count - 1
