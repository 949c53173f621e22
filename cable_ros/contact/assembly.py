# SPDX-License-Identifier: Apache-2.0
"""Compiled: the equations of a cable that touches.

The unknowns of a contact point are its normal force and its place, those of the end of a stretch the couple
that holds its slope, too (see `patches.move_ends`); they are eliminated as borders of the rod's
banded system. Units of the cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import LEAF, njit
from cable_ros.contact.distance import across, pull
from cable_ros.contact.friction_kernels import FRICTIONLESS, STICK, carry, rub
from cable_ros.contact.interfaces import gap_at
from cable_ros.contact.points import (
    FIRST,
    FORCE,
    FRICTION,
    GRIP,
    HELD,
    KIND,
    LENGTH,
    OBSTACLE,
    PLACE,
    POINT,
    ROW,
    SAMPLE,
    YIELD,
)
from cable_ros.linalg.copies import copy
from cable_ros.rod.centreline import find_element, position, shape, tangent
from cable_ros.rod.energy_kernels import gradient, hessian, increments, tangent_derivative, workspace

OPTIONS = {"cache": True, "error_model": "numpy"}

STIFFER = 1.5
"""Borders serve while what they hold is not so many times as stiff, nor as soft."""


@njit(**OPTIONS)
def point_forces(q, F, h, s0, N, gauss, primitives, points, normals, count, Fe, acc):
    """Internal force Fe (elements, 3) beside weight; pull acc (n, 4) of the points inside elements."""
    order = N.shape[1] - 1
    elements = h.shape[0]
    P, qs, gT, H = np.empty(3), np.empty(4), np.empty(4), np.empty((4, 4))
    acc[:] = 0.0
    for e in range(elements):
        for a in range(3):
            Fe[e, a] = F[a]
    for i in range(count):
        e, x = find_element(points[i, PLACE], s0, h)
        for a in range(3):
            P[a] = points[i, FORCE] * normals[i, a] + points[i, FRICTION + a]
            for k in range(e):
                Fe[k, a] += P[a]
        if x == 0.0:
            continue
        for k in range(gauss.shape[0]):
            for a in range(4):
                qs[a] = 0.0
                for j in range(order + 1):
                    qs[a] += N[k, j] * q[e * order + j, a]
            pull(qs, P, h[e] * part(primitives, k, x), gT, H)
            for j in range(order + 1):
                for a in range(4):
                    acc[e * order + j, a] += N[k, j] * gT[a]


@njit(**LEAF)
def part(primitives, k, x):
    """Weight of the tangent at Gauss point k in the way from the element's start to the place x."""
    v = 0.0
    for m in range(primitives.shape[0] - 1, -1, -1):
        v = (v + primitives[m, k]) * x
    return v


@njit(**OPTIONS)
def system(
    q, F, f, K, kappa0, h, s0, tables, nodes, primitives, c, obstacles, old_c, old_h, old_s0, old_obstacles,
    sense, model, anew, points, count, gaps, normals,
    acc, g, radial, totals, elastic, geometric, parts, C, V, W, delta, lines, upto, full,
):  # fmt: skip
    """Gradient, and where `full` the Hessian with its borders, at (q, F) with `count` contact points.

    `gaps` receives the constraints: gaps (count), then zeros but for the slopes of the gap along the cable,
    which vanish where stretches end and where a point has slid to, and what is amiss with the springs of what
    sticks. `V` (rows, 3n) receives their derivatives: end position (3), gaps (count), then a row for each
    slope, and for each direction in which a gap is curved or friction is stiff, with its weight's inverse in
    `delta`; `W` the directions in which the multipliers act, the same but where friction follows the normal
    force; `lines`
    (rows, 3) the direction that each reads the position in, of the point before which there are `upto`
    (rows,) elements. `old_c`, `old_h`, `old_s0` are the curve of the last equilibrium, `old_obstacles` where
    they were; `anew`: friction is at first what it was there. Returns (rows, whether W is V, how many points
    began to stick or to slip); where not `full`, the second says whether friction's direction is held about
    as stiffly as in the borders.
    """
    N, gauss = tables[0], tables[4]
    order = N.shape[1] - 1
    nd = 3 * (order + 1)
    band = nd - 1
    r, t, dt, n = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    before, turned = np.empty(3), np.empty(3)
    directions, bends = np.empty((2, 3)), np.empty(2)
    size = max(count, 1)
    frames = np.empty((size, 2, 3))
    curved = np.empty((size, 3))
    slopes = np.zeros((size, 3))
    limits = np.zeros((size, 7))
    tilts = np.empty(size)
    amiss = np.zeros((size, 3))
    flips = 0
    for i in range(count):
        o = int(points[i, OBSTACLE])
        ob = obstacles[o]
        s = points[i, PLACE]
        gaps[i], tilts[i], curvature = gap_at(q, h, s0, nodes, c, s, ob, r, t, dt, n, directions, bends)
        curved[i, 2] = max(curvature, 1e-9) if points[i, KIND] == POINT else 0.0
        for a in range(3):
            normals[i, a] = n[a]
        for k in range(2):
            curved[i, k] = bends[k]
            along = 0.0
            for a in range(3):
                frames[i, k, a] = directions[k, a]
                along += directions[k, a] * t[a]
            for a in range(3):
                slopes[i, a] += bends[k] * along * directions[k, a]
        if model != FRICTIONLESS and ob[17] > 0.0:
            position(old_c, old_h, old_s0, points[i, PLACE], before)
            for a in range(3):
                turned[a] = points[i, HELD + a]
            carry(old_obstacles[o], ob, before, turned)
            for a in range(3):
                before[a] = r[a] - before[a]
            flips += rub(points, i, n, t, ob[17], model, before, turned, sense, anew, limits[i])
            for a in range(3):
                amiss[i, a] = before[a] + (points[i, FRICTION + a] - turned[a]) / STICK
    Fe = np.empty((h.shape[0], 3))
    point_forces(q, F, h, s0, N, gauss, primitives, points, normals, count, Fe, acc)
    gradient(q, Fe, f, K, kappa0, h, s0, tables, workspace(h, tables), acc, g, radial, totals)
    if not full:
        as_stiff = True
        for i in range(count):
            grip(points, i, amiss, lines, gaps)
            if points[i, GRIP] < 0.0:
                ratio = limits[i, 6] * delta[int(-points[i, GRIP])]
                as_stiff = as_stiff and 1.0 / STIFFER < ratio < STIFFER
            if points[i, KIND] != SAMPLE and points[i, ROW] > 0.0:
                gaps[int(points[i, ROW]) - 3] = tilts[i]
        return 3 + count, as_stiff, flips
    hessian(q, Fe, f, K, kappa0, h, s0, tables, radial, elastic, geometric, parts, C)
    columns = C.shape[1]
    for a in range(3):
        for j in range(columns):
            V[a, j] = C[a, j]
        delta[a] = 0.0
    rows = 3 + count
    same = True
    D, Y = np.empty((4, nd)), np.empty((4, nd))
    frame = np.empty((4, nd))
    own, turn = np.empty((3, nd)), np.empty((3, nd))
    way = np.empty((3, columns))
    Nx, dNx = np.empty(order + 1), np.empty(order + 1)
    qs, gT, H, P = np.empty(4), np.empty(4), np.empty((4, 4)), np.empty(3)
    for i in range(count):
        e, x = find_element(points[i, PLACE], s0, h)
        first = e * order
        for j in range(order + 1):
            increments(q[first + j], 3 * j, frame)
        own[:] = 0.0
        turn[:] = 0.0
        for a in range(3):
            P[a] = points[i, FORCE] * normals[i, a] + points[i, FRICTION + a]
        for k in range(gauss.shape[0]):
            if x == 0.0:
                break
            at_place(q, first, order, N[k], frame, qs, D)
            norm = tangent(qs, t)
            weight = h[e] * part(primitives, k, x)
            tangent_derivative(qs, t, 2.0 * weight / norm, D, own, 0, nd)
            pull(qs, P, weight, gT, H)
            for a in range(4):
                for j in range(nd):
                    Y[a, j] = H[a, 0] * D[0, j] + H[a, 1] * D[1, j] + H[a, 2] * D[2, j] + H[a, 3] * D[3, j]
            for j in range(nd):
                for m in range(j + 1):
                    geometric[3 * first + j, band + m - j] += (
                        D[0, j] * Y[0, m] + D[1, j] * Y[1, m] + D[2, j] * Y[2, m] + D[3, j] * Y[3, m]
                    )
        shape(nodes, x, Nx, dNx)
        at_place(q, first, order, Nx, frame, qs, D)
        norm = tangent(qs, t)
        tangent_derivative(qs, t, 2.0 / norm, D, turn, 0, nd)
        way[:] = 0.0
        for k in range(e):
            for a in range(3):
                for j in range(nd):
                    way[a, 3 * k * order + j] += parts[k, a, j]
        for a in range(3):
            for j in range(nd):
                way[a, 3 * first + j] += own[a, j]
        row(V, 3 + i, normals[i], way)
        delta[3 + i] = YIELD * points[i, LENGTH] ** 3 if points[i, KIND] == SAMPLE else 0.0
        copy(normals[i], lines[3 + i])
        begin = rows
        upto[3 + i] = e
        points[i, GRIP] = 0.0
        slip = limits[i, 0] != 0.0 or limits[i, 1] != 0.0 or limits[i, 2] != 0.0
        if slip:
            same = False
            mu = obstacles[int(points[i, OBSTACLE]), 17]
            for a in range(3):
                P[a] = normals[i, a] + mu * limits[i, a]
            row(W, 3 + i, P, way)
        else:
            copy(V[3 + i], W[3 + i])
        if limits[i, 6] > 0.0:
            if slip:
                row(V, rows, limits[i, 3:6], way)
                copy(limits[i, 3:6], lines[rows])
                delta[rows] = 1.0 / limits[i, 6]
                gaps[rows - 3] = 0.0
                points[i, GRIP] = -rows
                rows += 1
            else:
                across(normals[i], directions)
                points[i, GRIP] = rows
                for k in range(2):
                    row(V, rows, directions[k], way)
                    copy(directions[k], lines[rows])
                    delta[rows] = 1.0 / limits[i, 6]
                    gaps[rows - 3] = 0.0
                    rows += 1
        for k in range(2):
            if curved[i, k] > 0.0 and abs(points[i, FORCE]) >= 1e-9:
                row(V, rows, frames[i, k], way)
                copy(frames[i, k], lines[rows])
                delta[rows] = -1.0 / (points[i, FORCE] * curved[i, k])
                gaps[rows - 3] = 0.0
                rows += 1
        ends = points[i, KIND] >= FIRST
        if points[i, KIND] == POINT:
            points[i, ROW] = 0.0
        if ends or (curved[i, 2] > 0.0 and abs(points[i, FORCE]) >= 1e-9):
            row(V, rows, slopes[i], way)
            copy(slopes[i], lines[rows])
            for j in range(nd):
                for a in range(3):
                    V[rows, 3 * first + j] += normals[i, a] * turn[a, j]
            delta[rows] = 0.0 if ends else curved[i, 2] / points[i, FORCE]
            gaps[rows - 3] = tilts[i]
            points[i, ROW] = rows
            rows += 1
        for b in range(begin, rows):
            upto[b] = e
    for b in range(3):
        copy(V[b], W[b])
    for b in range(3 + count, rows):
        copy(V[b], W[b])
    for i in range(count):
        grip(points, i, amiss, lines, gaps)
    return rows, same, flips


@njit(**LEAF)
def grip(points, i, amiss, lines, gaps):
    """What is amiss (count, 3) with the springs of point i, if it sticks, along the two that hold it."""
    b = int(points[i, GRIP])
    if b > 0:
        for k in range(b, b + 2):
            gaps[k - 3] = amiss[i, 0] * lines[k, 0] + amiss[i, 1] * lines[k, 1] + amiss[i, 2] * lines[k, 2]


@njit(**LEAF)
def row(V, at, v, way):
    """V[at] = v (3,) times way (3, 3n)."""
    for j in range(way.shape[1]):
        V[at, j] = v[0] * way[0, j] + v[1] * way[1, j] + v[2] * way[2, j]


@njit(**LEAF)
def at_place(q, first, order, N, frame, qs, D):
    """Interpolated quaternion qs (4,) and its derivative D (4, 3 (order + 1)) with the shape functions N."""
    for a in range(4):
        qs[a] = 0.0
        for j in range(order + 1):
            qs[a] += N[j] * q[first + j, a]
            for m in range(3 * j, 3 * j + 3):
                D[a, m] = N[j] * frame[a, m]


@njit(**LEAF)
def nodal(q, acc, out):
    """The pull acc (n, 4) at the nodal quaternions as moments out (3n,)."""
    for i in range(q.shape[0]):
        w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        a, b, c, d = acc[i, 0], acc[i, 1], acc[i, 2], acc[i, 3]
        out[3 * i] = 0.5 * (-x * a + w * b + z * c - y * d)
        out[3 * i + 1] = 0.5 * (-y * a - z * b + w * c + x * d)
        out[3 * i + 2] = 0.5 * (-z * a + y * b - x * c + w * d)
