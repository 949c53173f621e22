# SPDX-License-Identifier: Apache-2.0
"""Compiled: friction that acts at a cable's surface, a force at a rigid arm from its centreline.

The arm is fixed in the section, so a force P at its end has the potential -P.(r + R arm): beside the force at
the centreline there is the couple (R arm) x P, about the tangent, too. Units of the cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, LEAF, njit
from cable_ros.contact.distance import pull
from cable_ros.contact.points import ARC_LENGTH, ARM, FRICTION
from cable_ros.rod.centreline import find_element
from cable_ros.rod.centreline import shape as shape_functions


@njit(**LEAF)
def has_arm(points, i):
    """Whether the friction of contact point i acts at an arm; `points` (CAPACITY, COLUMNS)."""
    return points[i, ARM] != 0.0 or points[i, ARM + 1] != 0.0 or points[i, ARM + 2] != 0.0


@njit(**INNER)
def arm_pull(qs, P, arm, gT, H):
    """Gradient gT (4,) and Hessian H (4, 4) of - P.(R arm) by the quaternion qs (4,) of R, of any length.

    It is `distance.pull` of a frame whose tangent is along the arm.

    Args:
        qs: (4,).
        P: (3,) force, EI / L^2.
        arm: (3,) along the section's axes, L; not along minus the tangent.
        gT, H: overwritten.
    """
    size = np.sqrt(arm[0] ** 2 + arm[1] ** 2 + arm[2] ** 2)
    a, b, c = size + arm[2], -arm[1], arm[0]
    norm = 1.0 / np.sqrt(a * a + b * b + c * c)
    a, b, c = a * norm, b * norm, c * norm
    turn = np.zeros((4, 4))  # from qs to the product of qs with (a, b, c, 0), which turns z to the arm
    turn[0, 0] = turn[1, 1] = turn[2, 2] = turn[3, 3] = a
    turn[0, 1], turn[1, 0], turn[2, 3], turn[3, 2] = -b, b, b, -b
    turn[0, 2], turn[2, 0], turn[1, 3], turn[3, 1] = -c, c, -c, c
    turned, slope, bend = np.empty(4), np.empty(4), np.empty((4, 4))
    for i in range(4):
        turned[i] = 0.0
        for j in range(4):
            turned[i] += turn[i, j] * qs[j]
    pull(turned, P, size, slope, bend)
    for i in range(4):
        gT[i] = 0.0
        for k in range(4):
            gT[i] += turn[k, i] * slope[k]
        for j in range(4):
            v = 0.0
            for k in range(4):
                for m in range(4):
                    v += turn[k, i] * bend[k, m] * turn[m, j]
            H[i, j] = v


@njit(**INNER)
def add_couples(shape, points, count, acc):
    """Add what friction at arms pulls at the nodal quaternions.

    Args:
        shape: `Shape`.
        points, count: (CAPACITY, COLUMNS) the contact points and their number.
        acc: (n, 4) receives the sum.
    """
    q, (h, s0, tables) = shape.q, shape.grid
    order = tables.nodes.shape[0] - 1
    N, dN = np.empty(order + 1), np.empty(order + 1)
    qs, gT, H, P = np.empty(4), np.empty(4), np.empty((4, 4)), np.empty(3)
    for i in range(count):
        if not has_arm(points, i):
            continue
        e, x = find_element(points[i, ARC_LENGTH], s0, h)
        first = e * order
        shape_functions(tables.nodes, x, N, dN)
        for a in range(4):
            qs[a] = 0.0
            for j in range(order + 1):
                qs[a] += N[j] * q[first + j, a]
        for a in range(3):
            P[a] = points[i, FRICTION + a]
        arm_pull(qs, P, points[i, ARM : ARM + 3], gT, H)
        for j in range(order + 1):
            for a in range(4):
                acc[first + j, a] += N[j] * gT[a]


@njit(**INNER)
def add_stiffness(points, i, qs, D, at, geometric):
    """Add what friction at the arm of contact point i adds to the geometric stiffness.

    Args:
        points, i: (CAPACITY, COLUMNS) the contact points, and which.
        qs, D: (4,), (4, b) interpolated quaternion there and its derivative, see `interpolate_frame`.
        at: number of the first unknown of its element.
        geometric: (3n, band + 1) of `Tangents`.
    """
    nd, band = D.shape[1], geometric.shape[1] - 1
    gT, H, P, Y = np.empty(4), np.empty((4, 4)), np.empty(3), np.empty((4, nd))
    for a in range(3):
        P[a] = points[i, FRICTION + a]
    arm_pull(qs, P, points[i, ARM : ARM + 3], gT, H)
    for a in range(4):
        for j in range(nd):
            Y[a, j] = H[a, 0] * D[0, j] + H[a, 1] * D[1, j] + H[a, 2] * D[2, j] + H[a, 3] * D[3, j]
    for j in range(nd):
        for m in range(j + 1):
            geometric[at + j, band + m - j] += (
                D[0, j] * Y[0, m] + D[1, j] * Y[1, m] + D[2, j] * Y[2, m] + D[3, j] * Y[3, m]
            )
