# SPDX-License-Identifier: Apache-2.0
"""Compiled: obstacles that move in a step, and what touches them. Units of the cable, start clamp's frame."""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, njit
from cable_ros.contact.distance import AXES, CENTRE, DIMENSIONS
from cable_ros.contact.points import MOTION


@njit(**INNER)
def carry(old, new, r, v):
    """Move the position r (3,) and turn the vector v (3,) with an obstacle, from `old` to `new` (WIDTH,)."""
    y, w = np.zeros(3), np.zeros(3)
    for i in range(3):
        for j in range(3):
            y[i] += old[AXES + 3 * j + i] * (r[j] - old[CENTRE + j])
            w[i] += old[AXES + 3 * j + i] * v[j]
    for i in range(3):
        r[i] = new[CENTRE + i]
        v[i] = 0.0
        for j in range(3):
            r[i] += new[AXES + 3 * i + j] * y[j]
            v[i] += new[AXES + 3 * i + j] * w[j]


@njit(**INNER)
def obstacle_motion(old, new, r, out):
    """How far an obstacle carries the position r (3,) from `old` to `new` (WIDTH,), L: `out` (3,).

    Exactly 0 where it rests.
    """
    still = True
    for k in range(CENTRE, DIMENSIONS):
        still = still and old[k] == new[k]
    out[:] = 0.0
    if not still:
        for a in range(3):
            out[a] = r[a]
        carry(old, new, out, np.zeros(3))
        for a in range(3):
            out[a] -= r[a]


@njit(**INNER)
def follow_obstacles(contacts, count, rows, total):
    """Let the constraint rows of a tangent step read positions relative to the obstacles, which move.

    Args:
        contacts, count: `ContactSet` and the number of its points.
        rows: `ConstraintRows`.
        total: their number.
    """
    points, gaps, normals = contacts
    for i in range(count):
        for a in range(3):
            gaps[i] -= normals[i, a] * points[i, MOTION + a]
    for b in range(3 + count, total):
        i = rows.owners[b]
        for a in range(3):
            gaps[b - 3] -= rows.lines[b, a] * points[i, MOTION + a]
