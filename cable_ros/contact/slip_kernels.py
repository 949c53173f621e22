# SPDX-License-Identifier: Apache-2.0
"""Compiled: how far contact points slip in a step, and how that differs from the step before.

Friction follows the direction of slip at a step's end as far as slip goes on as it did, see
`friction_kernels.lead`. Where it does not, shorter steps have to tell.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import LEAF, LEAF_ENTRY, njit
from cable_ros.contact.distance import FRICTION_COEFFICIENT
from cable_ros.contact.friction_kernels import AT_REST
from cable_ros.contact.points import (
    ARC_LENGTH,
    BEFORE,
    FORCE,
    FRICTION,
    KIND,
    OBSTACLE,
    POINT,
    SLIP,
    SLIP_BEFORE,
    SLIPS,
    STEP_BEFORE,
    WAS,
)

FOLLOWED = 0.3
"""Part of a turn that counts even if `lead` follows it: 0.05 rad in a step, over which it fades by 1 %."""
SLIPPED = 0.9
"""Least friction before a step, over that after it, of a point that slipped then too, and has only turned."""


@njit(**LEAF_ENTRY)
def note_slip(points, count, step):
    """Keep how far the points slipped in a step that has been taken.

    Args:
        points, count: (CAPACITY, COLUMNS) the contact points and their number.
        step: its length, L.
    """
    for i in range(count):
        for a in range(3):
            points[i, SLIP_BEFORE + a] = points[i, SLIP + a] if points[i, SLIPS] == 1.0 else 0.0
        points[i, STEP_BEFORE] = step


@njit(**LEAF_ENTRY)
def slip_missed(points, count, step):
    """How far a point may have slipped that has come to rest within a step, L; 0: none has.

    It sticks, or slips so little that, slowing down evenly, it has stopped on the way: its speed at the end
    is a backward difference of second order. What sticks does so from the beginning of a step, though it
    may have slipped on, ever slower, to the end.

    Args:
        points, count, step: as in `note_slip`.
    """
    missed = 0.0
    for i in range(count):
        slip, slid = points[i, SLIP : SLIP + 3], points[i, SLIP_BEFORE : SLIP_BEFORE + 3]
        if points[i, KIND] != POINT or norm(slid) <= AT_REST:
            continue
        along = 0.0
        for a in range(3):
            along += slip[a] * slid[a] if points[i, SLIPS] == 1.0 else 0.0
        missed = max(missed, may_have_slipped(along, norm(slid), step / points[i, STEP_BEFORE]))
    return missed


@njit(**LEAF_ENTRY)
def may_have_slipped(along, size, ratio):
    """`slip_missed` of one point, of the unit of `size`.

    Args:
        along: its slip times that in the step before, see `note_slip`; 0 if it sticks.
        size: of its slip in the step before.
        ratio: length of this step over that of the one before.
    """
    return 0.5 * ratio * size if (1.0 + 2.0 * ratio) * along <= (ratio * size) ** 2 else 0.0


@njit(**LEAF_ENTRY)
def farthest_roll(points, count):
    """The longest way along the cable that a point which sticks has rolled in a step, L.

    points, count: as in `note_slip`.
    """
    most = 0.0
    for i in range(count):
        if points[i, KIND] == POINT and points[i, SLIPS] == 0.0 and points[i, WAS] > 0.0:
            most = max(most, abs(points[i, ARC_LENGTH] - points[i, WAS]))
    return most


@njit(**LEAF_ENTRY)
def has_new_point(points, count):
    """Whether a point touches that did not at the last equilibrium; points, count: as in `note_slip`."""
    new = False
    for i in range(count):
        new = new or (points[i, KIND] == POINT and points[i, WAS] == 0.0)
    return new


@njit(**LEAF_ENTRY)
def slip_change(points, count, obstacles):
    """Sum of the changes of friction in a step where it slips, and that of all possible friction, EI / L^2.

    Args:
        points, count: (CAPACITY, COLUMNS) the contact points and their number.
        obstacles: (o, WIDTH).
    """
    change, possible = 0.0, 0.0
    for i in range(count):
        possible += points[i, FORCE] * obstacles[int(points[i, OBSTACLE]), FRICTION_COEFFICIENT]
        if points[i, SLIPS] == 1.0:
            for a in range(3):
                change += abs(points[i, FRICTION + a] - points[i, BEFORE + a])
    return change, possible


@njit(**LEAF_ENTRY)
def slip_bend(points, count):
    """Sum of what slip turns otherwise in a step than it did in the one before, times friction, EI / L^2.

    That much of the turn `lead` does not follow; all of a turn where nothing slipped in the step before.
    Returned, too, is that sum with FOLLOWED of each turn at least.

    Args:
        points, count: (CAPACITY, COLUMNS) the contact points, POINT each, and their number.
    """
    unforeseen, total = 0.0, 0.0
    for i in range(count):
        if points[i, SLIPS] == 0.0:
            continue
        now, before = points[i, FRICTION:BEFORE], points[i, BEFORE : BEFORE + 3]
        slip, slid = points[i, SLIP : SLIP + 3], points[i, SLIP_BEFORE : SLIP_BEFORE + 3]
        size, was, long = norm(now), norm(before), norm(slid)
        # friction that has only grown or shrunk has not turned
        same = size / was if was > SLIPPED * size and was > 0.0 else 1.0
        turn, bend = 0.0, 0.0
        for a in range(3):
            one = now[a] - same * before[a]
            turn += one * one
            if long > AT_REST and was > 0.0:
                # the turn over the second half of the step before goes on
                one -= 2.0 * norm(slip) / long * size * (before[a] / was + slid[a] / long)
            bend += one * one
        unforeseen += np.sqrt(bend)
        total += max(np.sqrt(bend), FOLLOWED * np.sqrt(turn))
    return unforeseen, total


@njit(**LEAF)
def norm(v):
    """Of the vector v (3,)."""
    return np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
