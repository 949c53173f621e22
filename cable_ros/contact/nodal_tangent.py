# SPDX-License-Identifier: Apache-2.0
"""Compiled: the tangent of `nodal_kernels.residuals` as a band.

It is exact but for three terms. Friction that slips is changed as by Hueber, Stadler and Wohlmuth (2008), so
that Newton's method does not cycle; the tangent is exact where friction is on its cone, against the motion.
Moments that turn with their own sections vanish with the residuals. The frame of a contact is taken to go
along with the normal without spinning about it, as it does from one equilibrium to the next.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, njit
from cable_ros.contact.distance import FRICTION_COEFFICIENT, gap
from cable_ros.contact.nodal_kernels import (
    OPEN,
    STICK,
    TURNING,
    YIELD,
    project,
    slid,
    tangent_frame,
)
from cable_ros.contact.nodal_stretch import element_reach, strain_tangents, strains
from cable_ros.rod import quaternion
from cable_ros.rod.energy_kernels import hessian

OPTIONS = {"cache": True, "error_model": "numpy"}


@njit(**INNER)
def number(near, order, rows):
    """Number the unknowns boundary by boundary; returns how many, and the bandwidth below the diagonal.

    Args:
        near: (m + 1, o) which contacts' forces are unknowns.
        order: of the elements.
        rows: `Rows`, overwritten.
    """
    rows_r, rows_psi, rows_F, rows_c = rows
    elements = rows_F.shape[0]
    at = 0
    for k in range(elements + 1):
        rows_r[k] = rows_psi[k * order] = -1
        if k > 0:
            rows_r[k] = at
            rows_psi[k * order] = at + 3
            at += 6
        if k < elements:
            for o in range(near.shape[1]):
                rows_c[k, o] = -1
                if k > 0 and near[k, o]:
                    rows_c[k, o] = at
                    at += 3
            rows_F[k] = at
            at += 3
            for i in range(1, order):
                rows_psi[k * order + i] = at
                at += 3
    lower = 0
    for k in range(elements):
        first = rows_F[k] if k == 0 else rows_psi[k * order]
        lower = max(lower, rows_psi[(k + 1) * order] + 2 - first)
        if k > 0:
            lower = max(lower, rows_F[k] + 2 - rows_r[k])
    return at, lower


@njit(**OPTIONS)
def jacobian(state, model, step, work, tangents, rows, a, b):
    """Assemble the tangent of `residuals`, which must be those of the state, and the right-hand side.

    The end's rows impose its position. Returns the number of unknowns and the bandwidth.

    Args:
        state, model, step, work: `State`, `Model`, `Step` and `Work`.
        tangents, rows: `Tangents` and `Rows`, overwritten.
        a, b: of `Band`; receive the matrix and minus the residuals.
    """
    q, r, F = state.q, state.r, state.F
    elastic, geometric, dchord, _ = tangents
    rows_r, rows_psi, rows_F, _ = rows
    elements = F.shape[0]
    order = (q.shape[0] - 1) // elements
    nd = 3 * (order + 1)
    cell = 1.0 / (elements - 1)
    hessian(q, F, model.f, model.section, model.grid, work.evaluation.radial, tangents)
    soft = strains(model.compliance)
    reach = np.zeros((elements, 3, 3))
    if soft:
        strain_tangents(state, model, tangents)
        element_reach(q, model.grid, model.compliance, reach)
    total, low = number(work.near, order, rows)
    for i in range(total):
        for j in range(3 * low + 1):
            a[i, j] = 0.0
    band = nd - 1
    last = q.shape[0] - 1
    for i in range(1, last):
        for c in range(3):
            row = rows_psi[i] + c
            b[row] = -work.evaluation.g[i, c]
            a[row, low] += TURNING * step.drag * cell
            k = 3 * i + c
            for m in range(band + 1):
                j = k - band + m
                if j < 3 or (j // 3) > i:
                    continue
                v = elastic[k, m] + geometric[k, m]
                if v == 0.0:
                    continue
                column = rows_psi[j // 3] + j % 3
                a[row, low + column - row] += v
                if j != k:
                    a[column, low + row - column] += v
    # the last node's frame is given, but moves: its columns, not its rows
    for c in range(3):
        k = 3 * last + c
        for m in range(band):
            j = k - band + m
            if j < 3 or j // 3 == last:
                continue
            row, column = rows_psi[j // 3] + j % 3, rows_psi[last] + c
            a[row, low + column - row] += elastic[k, m] + geometric[k, m]
    for e in range(elements):
        for c in range(3):
            row = rows_F[e] + c
            b[row] = -work.mismatch[e, c]
            if soft:
                for k in range(3):
                    a[row, low + k - c] -= reach[e, c, k]
            if e > 0:
                k = rows_r[e] + c
                a[row, low + k - row] -= 1.0
                a[k, low + row - k] -= 1.0
            k = rows_r[e + 1] + c
            a[row, low + k - row] += 1.0
            if e + 1 < elements:
                a[k, low + row - k] += 1.0
            for j in range(nd):
                i = e * order + j // 3
                if i == 0:
                    continue
                column = rows_psi[i] + j % 3
                a[row, low + column - row] -= dchord[e, c, j]
                if i < last:
                    a[column, low + row - column] -= dchord[e, c, j]
    for c in range(3):
        row = rows_r[elements] + c
        a[row, low] = 1.0
        b[row] = step.re[c] - r[elements, c]
        a[rows_psi[last] + c, low] = 1.0
    back = q[last, 0], -q[last, 1], -q[last, 2], -q[last, 3]
    theta = quaternion.turn(quaternion.product(back, step.qe))
    for c in range(3):
        b[rows_psi[last] + c] = theta[c]
    for k in range(1, elements):
        for c in range(3):
            b[rows_r[k] + c] = -work.balance[k, c]
            a[rows_r[k] + c, low] += step.drag * cell
    press_tangent(state, step, rows, a, b, low)
    return total, low


@njit(**OPTIONS)
def press_tangent(state, step, rows, a, b, low):
    """The contacts' part of `jacobian`.

    Args:
        state, step, rows, a, b: as in `jacobian`.
        low: the bandwidth.
    """
    r, lam, tau, obstacles = state.r, state.lam, state.tau, step.obstacles
    rho, rho_t = step.normal, step.tangential
    n, d, u, out = np.empty(3), np.empty((2, 3)), np.empty(2), np.empty(3)
    directions, bends = np.empty((2, 3)), np.empty(2)
    B, D, N = np.empty((3, 3)), np.empty((2, 3)), np.empty(2)
    for k in range(1, r.shape[0] - 1):
        at = rows.r[k]
        for o in range(obstacles.shape[0]):
            row = rows.contact[k, o]
            if row < 0:
                continue
            phi = gap(obstacles[o], r[k], n, directions, bends)
            tangent_frame(n, step.turned[k, o], d)
            slid(r[k], step.carried[k, o], d, u)
            away = 0.0
            for c in range(3):
                away += n[c] * (r[k, c] - step.carried[k, o, c])
            mu, give = obstacles[o, FRICTION_COEFFICIENT], step.give[k, o]
            kind, t0, t1, radius = project(
                lam[k, o], tau[k, o], step.tau[k, o], phi, u, mu, (rho, rho_t, give), out
            )
            # B: second derivative of the gap; the directions across turn as the normal does
            for i in range(3):
                for j in range(3):
                    B[i, j] = (
                        bends[0] * directions[0, i] * directions[0, j]
                        + bends[1] * directions[1, i] * directions[1, j]
                    )
            for i in range(2):
                for j in range(3):
                    D[i, j] = d[i, j]
                    for c in range(3):
                        D[i, j] -= away * d[i, c] * B[c, j]
            for i in range(3):
                a[at + i, low + row - at - i] -= n[i]
                a[at + i, low + row + 1 - at - i] -= d[0, i]
                a[at + i, low + row + 2 - at - i] -= d[1, i]
                for j in range(3):
                    turn = 0.0
                    for c in range(3):
                        turn += (tau[k, o, 0] * d[0, c] + tau[k, o, 1] * d[1, c]) * B[c, j]
                    a[at + i, low + j - i] -= lam[k, o] * B[i, j] - n[i] * turn
            for c in range(3):
                b[row + c] = -out[c]
            if kind == OPEN:
                for c in range(3):
                    a[row + c, low] = 1.0
                continue
            # phi + c lambda = 0
            a[row, low] = rho * YIELD
            for j in range(3):
                a[row, low + at + j - row] = rho * n[j]
            if kind == STICK:
                for i in range(2):
                    a[row + 1 + i, low] = rho_t * give
                    for j in range(3):
                        a[row + 1 + i, low + at + j - row - 1 - i] = rho_t * D[i, j]
                continue
            size = np.sqrt(t0 * t0 + t1 * t1)
            if size == 0.0:
                a[row + 1, low] = a[row + 2, low] = 1.0
                continue
            N[0], N[1] = t0 / size, t1 / size
            ratio = radius / size
            # as Hueber, Stadler and Wohlmuth (2008) have it: the old friction, cut to the cone, stands in for
            # one of the two directions, and counts for less if it points the other way
            size_then = np.sqrt(tau[k, o, 0] ** 2 + tau[k, o, 1] ** 2)
            cut = 1.0 / max(radius, size_then, 1e-300)
            cosine = (tau[k, o, 0] * N[0] + tau[k, o, 1] * N[1]) * cut
            beta = 1.0 / (1.0 - cosine) if cosine < 0.0 else 1.0
            for i in range(2):
                m = row + 1 + i
                # tau_i - mu push N_i, push = lambda - rho (phi + c lambda)
                a[m, low] += 1.0
                a[m, low + row - m] -= mu * N[i] * (1.0 - rho * YIELD)
                for j in range(3):
                    a[m, low + at + j - m] += mu * N[i] * rho * n[j]
                for p in range(2):
                    w = ratio * ((1.0 if i == p else 0.0) - beta * cut * tau[k, o, i] * N[p])
                    a[m, low + row + 1 + p - m] -= w * (1.0 - rho_t * give)
                    for j in range(3):
                        a[m, low + at + j - m] += w * rho_t * D[p, j]
