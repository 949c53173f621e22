# SPDX-License-Identifier: Apache-2.0
"""Compiled: contact forces after an iteration, and whether friction has settled."""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, LEAF, njit
from cable_ros.contact.distance import FRICTION_COEFFICIENT
from cable_ros.contact.friction_kernels import stick
from cable_ros.contact.points import (
    FORCE,
    FRICTION,
    KIND,
    OBSTACLE,
    POINT,
    SAMPLE,
    SLIP_ROW,
    SLIPS,
    SLOPE_ROW,
    STICK_ROW,
)
from cable_ros.linalg.vectors import cross

FIRM = 0.5
"""Presliding, over the motion in which any point's stick yields by itself, that counts as none."""
SHARP = 100.0
"""Curvature of an obstacle, 1 / L, above which the turn of a force counts as a change: on an edge it turns by
much as the cable moves by nothing, and the start wrench with it, of which the end force tells nothing."""


@njit(**LEAF)
def firmer(points, count, obstacles, options, presliding):
    """The next `presliding`, L, of a step that began with `Options.softest`: half of it.

    Where no point's stick would yield less, it is what is asked for.
    """
    asked = options.presliding
    yields = 0.0
    for i in range(count):
        cone = obstacles[int(points[i, OBSTACLE]), FRICTION_COEFFICIENT] * points[i, FORCE]
        if cone > 0.0:
            yields = max(yields, cone / stick(points[i], options.bedding))
    return max(asked, 0.5 * presliding) if 0.5 * presliding > FIRM * yields else asked


@njit(**LEAF)
def largest_change(points, count, friction):
    """Largest change of a component of the points' friction from what it was, (count, 3), EI / L^2."""
    change = 0.0
    for i in range(count):
        for a in range(3):
            change = max(change, abs(points[i, FRICTION + a] - friction[i, a]))
    return change


@njit(**LEAF)
def sticks_now(points, count, slipped):
    """Whether a point, not a sample, sticks that slipped, by `slipped` (count,)."""
    for i in range(count):
        if points[i, KIND] == POINT and points[i, SLIPS] == 0.0 and slipped[i] == 1.0:
            return True
    return False


@njit(**INNER)
def correct_forces(contacts, count, y, rows, total, F, soft):
    """Add the multipliers of a step to the forces.

    Args:
        contacts, count: `ContactSet` and the number of its points.
        y: (rows,) the multipliers.
        rows, total: `ConstraintRows` and their number.
        F: (3,) the end force.
        soft: whether the cable stretches: where its points are depends on friction, that of what slips, too.

    Returns:
        The largest change of a force, EI / L^2, without those of samples, by its normal's turn, too; the
        largest change of a couple that holds a slope at a point, EI / L; and the size of the end force, 1e-3
        at least.
    """
    (points, _, normals), lines = contacts, rows.lines
    scale, change, couple = 1e-3, 0.0, 0.0
    for a in range(3):
        F[a] += y[a]
        scale = max(scale, abs(F[a]))
        change = max(change, abs(y[a]))
    for i in range(count):
        if soft and points[i, SLIPS] == 1.0 and points[i, FORCE] > 0.0:
            k, grown = int(points[i, SLIP_ROW]), max(1.0 + y[3 + i] / points[i, FORCE], 0.0)
            size = 0.0
            for a in range(3):
                size += points[i, FRICTION + a] ** 2
            across = cross(normals[i], points[i, FRICTION : FRICTION + 3])
            turn = y[k] / np.sqrt(size) if k > 0 and size > 0.0 else 0.0
            for a in range(3):
                points[i, FRICTION + a] = grown * points[i, FRICTION + a] + turn * across[a]
        points[i, FORCE] += y[3 + i]
        k = int(points[i, STICK_ROW])
        if k > 0:
            for a in range(3):
                points[i, FRICTION + a] += y[k] * lines[k, a] + y[k + 1] * lines[k + 1, a]
        if points[i, KIND] != SAMPLE:
            change = max(change, abs(y[3 + i]))
        # the couple is the force times the distance that its point has still to go
        if points[i, KIND] == POINT and points[i, SLOPE_ROW] > 0.0:
            couple = max(couple, abs(y[int(points[i, SLOPE_ROW])]))
    for b in range(3 + count, total):
        i = rows.owners[b]
        # a row by which a force turns has delta -1 / (force times the surface's curvature)
        turns = rows.delta[b] < 0.0 and -rows.delta[b] * points[i, FORCE] * SHARP < 1.0
        if turns and points[i, KIND] != SAMPLE:
            change = max(change, abs(y[b]))
    return change, couple, scale
