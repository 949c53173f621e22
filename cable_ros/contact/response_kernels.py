# SPDX-License-Identifier: Apache-2.0
"""Compiled: what the linearised equations of a cable in contact are made of; see `contact.response`."""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import njit
from cable_ros.contact.constraint_rows import strain_slopes
from cable_ros.contact.distance import gap
from cable_ros.linalg import banded
from cable_ros.rod.centreline import (
    direction,
    find_element,
    increments,
    interpolate_frame,
    position,
    tangent,
    tangent_derivative,
    weight_up_to,
)
from cable_ros.rod.centreline import shape as shape_functions
from cable_ros.rod.rod_state import grid_of

OPTIONS = {"cache": True, "error_model": "numpy"}


@njit(**OPTIONS)
def displacements(shape, dchord, arc_lengths, soft, G, displacement, turn):
    """Derivatives of position and tangent at given arc lengths by the nodal rotations.

    Args:
        shape: fields of `contact_state.Shape`, as plain tuples.
        dchord: (m, 3, b) of `rod_state.Tangents`.
        arc_lengths: (k,) arc lengths, L.
        soft, G: compliance against tension, L^2 / EI, and (m, g, 3) internal forces at the Gauss points if it
            is not 0.
        displacement, turn: (k, 3, 3n) receive the derivatives of position and tangent.
    """
    q, _, grid = shape
    h, s0, tables = grid_of(grid)
    N = tables.values
    order = N.shape[1] - 1
    nd = 3 * (order + 1)
    frame, D = np.empty((4, nd)), np.empty((4, nd))
    Nx, dNx = np.empty(order + 1), np.empty(order + 1)
    qs, t, tilt = np.empty(4), np.empty(3), np.empty((3, nd))
    displacement[:] = 0.0
    turn[:] = 0.0
    for i in range(arc_lengths.shape[0]):
        e, x = find_element(arc_lengths[i], s0, h)
        first = e * order
        for j in range(order + 1):
            increments(q[first + j], 3 * j, frame)
        for k in range(e):
            for a in range(3):
                for j in range(nd):
                    displacement[i, a, 3 * k * order + j] += dchord[k, a, j]
        for k in range(N.shape[0]):
            if x == 0.0:
                break
            interpolate_frame(q, first, order, N[k], frame, qs, D)
            norm = tangent(qs, t)
            weight = h[e] * weight_up_to(tables.primitives, k, x)
            if soft > 0.0:
                tilt[:] = 0.0
                tangent_derivative(qs, t, 2.0 * weight / norm, D, tilt, 0, nd)
                strain_slopes(soft, G[e, k], t, tilt, displacement[i, :, 3 * first : 3 * first + nd])
            else:
                tangent_derivative(qs, t, 2.0 * weight / norm, D, displacement[i], 3 * first, nd)
        shape_functions(tables.nodes, x, Nx, dNx)
        interpolate_frame(q, first, order, Nx, frame, qs, D)
        norm = tangent(qs, t)
        tangent_derivative(qs, t, 2.0 / norm, D, turn[i], 3 * first, nd)


@njit(**OPTIONS)
def surfaces(shape, arc_lengths, which, obstacles):
    """Centreline and obstacle surfaces at given arc lengths.

    Args:
        shape: fields of `contact_state.Shape`, as plain tuples.
        arc_lengths: (m,) arc lengths, L.
        which: (m,) the obstacle of each.
        obstacles: (o, WIDTH).

    Returns:
        Position, tangent, curvature vector and normal, each (m, 3), then the principal directions (m, 2, 3)
        of the gap's Hessian and its eigenvalues (m, 2).
    """
    q, c, grid = shape
    h, s0, tables = grid_of(grid)
    m = arc_lengths.shape[0]
    r, t, dt, n = np.empty((m, 3)), np.empty((m, 3)), np.empty((m, 3)), np.empty((m, 3))
    directions, bends = np.empty((m, 2, 3)), np.empty((m, 2))
    for i in range(m):
        position(c, h, s0, arc_lengths[i], r[i])
        direction(q, h, s0, tables.nodes, arc_lengths[i], t[i], dt[i])
        gap(obstacles[which[i]], r[i], n[i], directions[i], bends[i])
    return r, t, dt, n, directions, bends


@njit(**OPTIONS)
def columns(elastic, geometric, first, count):
    """Columns `first` to `first + count` of the Hessian, dense (3n, count).

    `elastic`, `geometric`: of `rod_state.Tangents`.
    """
    n, band = elastic.shape[0], elastic.shape[1] - 1
    out = np.zeros((n, count))
    for k in range(count):
        j = first + k
        for i in range(max(0, j - band), min(n, j + band + 1)):
            row, at = max(i, j), band - abs(i - j)
            out[i, k] = elastic[row, at] + geometric[row, at]
    return out


@njit(**OPTIONS)
def solve_inner(elastic, geometric, order, X):
    """X (3n, k) = H^-1 X at the inner nodes, and 0 at the ends; returns the pivots' worst quality.

    `elastic`, `geometric`: of `rod_state.Tangents`; `order`: of the elements.
    """
    n = elastic.shape[0]
    U, pivots = np.empty_like(elastic), np.empty(n)
    _, worst = banded.factor(elastic + geometric, 3, n - 3, order, U, pivots)
    X[:3] = 0.0
    X[n - 3 :] = 0.0
    banded.solve_all(U, pivots, 3, n - 3, order, X)
    return worst
