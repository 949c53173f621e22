# SPDX-License-Identifier: Apache-2.0
"""Compiled: a force at a rigid arm from a cable's centreline, and a spring that holds its end.

The arm is fixed in a section. A force P at its end x = r + R arm has the potential -P.x: beside the force at
the centreline there is the couple (R arm) x P, about the tangent, too. With a spring it is P = given + K
(place - x). The section is that at the arc length HOLD, which does not go with the contact point. Units of
the cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, LEAF, njit
from cable_ros.contact.distance import pull
from cable_ros.contact.points import ARM, FRICTION, GIVEN, HOLD, SPRING, TARGET
from cable_ros.rod.centreline import (
    find_element,
    increments,
    interpolate_frame,
    position,
    tangent,
    tangent_derivative,
    weight_up_to,
)
from cable_ros.rod.centreline import shape as shape_functions


@njit(**LEAF)
def has_arm(points, i):
    """Whether the friction of contact point i acts at an arm; `points` (CAPACITY, COLUMNS)."""
    return points[i, ARM] != 0.0 or points[i, ARM + 1] != 0.0 or points[i, ARM + 2] != 0.0


@njit(**INNER)
def arm_turn(arm, turn):
    """Length of an arm (3,); `turn` (4, 4) receives the product with a quaternion that turns z to the arm."""
    size = np.sqrt(arm[0] ** 2 + arm[1] ** 2 + arm[2] ** 2)
    a, b, c = size + arm[2], -arm[1], arm[0]
    norm = 1.0 / np.sqrt(a * a + b * b + c * c)
    a, b, c = a * norm, b * norm, c * norm
    turn[:] = 0.0
    turn[0, 0] = turn[1, 1] = turn[2, 2] = turn[3, 3] = a
    turn[0, 1], turn[1, 0], turn[2, 3], turn[3, 2] = -b, b, b, -b
    turn[0, 2], turn[2, 0], turn[1, 3], turn[3, 1] = -c, c, -c, c
    return size


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
    turn, turned, slope, bend = np.empty((4, 4)), np.zeros(4), np.empty(4), np.empty((4, 4))
    size = arm_turn(arm, turn)
    for i in range(4):
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
def hold_points(shape, points, count, Fe, acc):
    """Add the forces at arms to the internal force Fe and to what pulls at the nodes, as `point_forces` does.

    Args:
        shape: `Shape`, of which the centreline is read if a spring acts.
        points, count: (CAPACITY, COLUMNS) the contact points and their number; their friction is overwritten
            with these forces.
        Fe, acc: see `assembly.point_forces`.
    """
    q, (h, s0, tables) = shape.q, shape.grid
    values = tables.values
    order = values.shape[1] - 1
    N, dN = np.empty(order + 1), np.empty(order + 1)
    qs, gT, H, P, r, along = np.empty(4), np.empty(4), np.empty((4, 4)), np.empty(3), np.empty(3), np.empty(3)
    turn, turned = np.empty((4, 4)), np.empty(4)
    for i in range(count):
        if not has_arm(points, i):
            continue
        arm = points[i, ARM : ARM + 3]
        e, x = find_element(points[i, HOLD], s0, h)
        first = e * order
        shape_functions(tables.nodes, x, N, dN)
        for a in range(4):
            qs[a] = 0.0
            for j in range(order + 1):
                qs[a] += N[j] * q[first + j, a]
        position(shape.c, h, s0, points[i, HOLD], r)
        size = arm_turn(arm, turn)
        for a in range(4):
            turned[a] = 0.0
            for b in range(4):
                turned[a] += turn[a, b] * qs[b]
        tangent(turned, along)
        for a in range(3):
            off = points[i, TARGET + a] - r[a] - size * along[a]
            P[a] = points[i, GIVEN + a] + points[i, SPRING] * off
            points[i, FRICTION + a] = P[a]
            for k in range(e):
                Fe[k, a] += P[a]
        arm_pull(qs, P, arm, gT, H)
        for j in range(order + 1):
            for a in range(4):
                acc[first + j, a] += N[j] * gT[a]
        for k in range(values.shape[0]):
            if x == 0.0:
                break
            for a in range(4):
                qs[a] = 0.0
                for j in range(order + 1):
                    qs[a] += values[k, j] * q[first + j, a]
            pull(qs, P, h[e] * weight_up_to(tables.primitives, k, x), gT, H)
            for j in range(order + 1):
                for a in range(4):
                    acc[first + j, a] += values[k, j] * gT[a]


@njit(**LEAF)
def add_bend(H, D, at, geometric):
    """Add D^T H D, H (4, 4) and D (4, b), to the geometric stiffness (3n, band + 1) from unknown `at` on."""
    nd, band = D.shape[1], geometric.shape[1] - 1
    for m in range(nd):
        y0 = H[0, 0] * D[0, m] + H[0, 1] * D[1, m] + H[0, 2] * D[2, m] + H[0, 3] * D[3, m]
        y1 = H[1, 0] * D[0, m] + H[1, 1] * D[1, m] + H[1, 2] * D[2, m] + H[1, 3] * D[3, m]
        y2 = H[2, 0] * D[0, m] + H[2, 1] * D[1, m] + H[2, 2] * D[2, m] + H[2, 3] * D[3, m]
        y3 = H[3, 0] * D[0, m] + H[3, 1] * D[1, m] + H[3, 2] * D[2, m] + H[3, 3] * D[3, m]
        for j in range(m, nd):
            geometric[at + j, band + m - j] += D[0, j] * y0 + D[1, j] * y1 + D[2, j] * y2 + D[3, j] * y3


@njit(**INNER)
def hold_rows(shape, points, count, tangents, rows, total, gaps):
    """Geometric stiffness of the forces at arms, and three rows of the bordered system for each spring.

    Args:
        shape, points, count: as in `hold_points`.
        tangents: `Tangents`.
        rows: `ConstraintRows`.
        total: number of rows so far.
        gaps: of `ContactSet`.

    Returns:
        The number of rows.
    """
    q, (h, s0, tables) = shape.q, shape.grid
    values = tables.values
    order = values.shape[1] - 1
    nd = 3 * (order + 1)
    geometric, dchord, V = tangents.geometric, tangents.dchord, rows.V
    frame, D, T = np.empty((4, nd)), np.empty((4, nd)), np.zeros((4, nd))
    N, dN = np.empty(order + 1), np.empty(order + 1)
    qs, gT, H, P, t = np.empty(4), np.empty(4), np.empty((4, 4)), np.empty(3), np.empty(3)
    turn, turned, own = np.empty((4, 4)), np.empty(4), np.empty((3, nd))
    for i in range(count):
        if not has_arm(points, i):
            continue
        arm = points[i, ARM : ARM + 3]
        e, x = find_element(points[i, HOLD], s0, h)
        first = e * order
        own[:] = 0.0
        for a in range(3):
            P[a] = points[i, FRICTION + a]
        for j in range(order + 1):
            increments(q[first + j], 3 * j, frame)
        for k in range(values.shape[0]):
            if x == 0.0:
                break
            interpolate_frame(q, first, order, values[k], frame, qs, D)
            weight = h[e] * weight_up_to(tables.primitives, k, x)
            norm = tangent(qs, t)
            tangent_derivative(qs, t, 2.0 * weight / norm, D, own, 0, nd)
            pull(qs, P, weight, gT, H)
            add_bend(H, D, 3 * first, geometric)
        shape_functions(tables.nodes, x, N, dN)
        interpolate_frame(q, first, order, N, frame, qs, D)
        arm_pull(qs, P, arm, gT, H)
        add_bend(H, D, 3 * first, geometric)
        if points[i, SPRING] == 0.0:
            continue
        size = arm_turn(arm, turn)
        for a in range(4):
            turned[a] = 0.0
            for b in range(4):
                turned[a] += turn[a, b] * qs[b]
            for j in range(nd):
                T[a, j] = (
                    turn[a, 0] * D[0, j] + turn[a, 1] * D[1, j] + turn[a, 2] * D[2, j] + turn[a, 3] * D[3, j]
                )
        norm = tangent(turned, t)
        tangent_derivative(turned, t, 2.0 * size / norm, T, own, 0, nd)
        for a in range(3):
            V[total] = 0.0
            for k in range(e):
                for j in range(nd):
                    V[total, 3 * k * order + j] += dchord[k, a, j]
            for j in range(nd):
                V[total, 3 * first + j] += own[a, j]
            rows.delta[total] = 1.0 / points[i, SPRING]
            rows.lines[total] = 0.0
            rows.upto[total], rows.owners[total] = e, i
            gaps[total - 3] = 0.0
            total += 1
    return total
