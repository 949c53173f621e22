# SPDX-License-Identifier: Apache-2.0
"""Compiled: what contact points say of friction as it is. Each step asks, of so few of them that calls of
NumPy take longer than its arithmetic.
"""

from __future__ import annotations

from cable_ros.compilation import LEAF_ENTRY, njit
from cable_ros.contact.distance import FRICTION_COEFFICIENT
from cable_ros.contact.points import ARC_LENGTH, FORCE, OBSTACLE, SLIP_ROW, SLIPS


@njit(**LEAF_ENTRY)
def touches_rough(points, count, obstacles):
    """Whether any point is on an obstacle with friction.

    Args:
        points, count: (CAPACITY, COLUMNS) the contact points and their number.
        obstacles: (o, WIDTH).
    """
    rough = False
    for i in range(count):
        rough = rough or obstacles[int(points[i, OBSTACLE]), FRICTION_COEFFICIENT] > 0.0
    return rough


@njit(**LEAF_ENTRY)
def bearable_friction(points, count, obstacles, aside, held):
    """Sum of the friction that the points can bear, EI / L^2.

    Args:
        points, count, obstacles: as in `touches_rough`.
        aside: those nearer to a clamp, L, are left out.
        held: whether those that slip are, too.
    """
    total = 0.0
    for i in range(count):
        s, force = points[i, ARC_LENGTH], max(points[i, FORCE], 0.0)
        if min(s, 1.0 - s) > aside and not (held and points[i, SLIPS] != 0.0):
            total += obstacles[int(points[i, OBSTACLE]), FRICTION_COEFFICIENT] * force
    return total


@njit(**LEAF_ENTRY)
def slip_rows(points, count, obstacles, delta, longest, rows, gives):
    """How many constraint rows hold a slip's direction more than a slip of `longest`, L, does.

    Args:
        points, count, obstacles: as in `touches_rough`.
        delta: (r,) how the rows give, L^3 / EI.
        rows, gives: (count,) filled with their numbers, and with how they would give.
    """
    found = 0
    for i in range(count):
        row, force = int(points[i, SLIP_ROW]), points[i, FORCE]
        if points[i, SLIPS] == 1.0 and row > 0 and force > 0.0:
            cone = obstacles[int(points[i, OBSTACLE]), FRICTION_COEFFICIENT] * force
            give = longest / max(cone, 1e-300)
            if delta[row] < give:
                rows[found], gives[found] = row, give
                found += 1
    return found
