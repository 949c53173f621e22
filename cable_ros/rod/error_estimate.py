# SPDX-License-Identifier: Apache-2.0
"""Compiled: what is known about a solution beyond its numbers: stability margin and error estimate."""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import njit
from cable_ros.linalg import banded
from cable_ros.linalg.bordered import Factors, complement_factors, end_rows, kkt_solve, kkt_step, solve3
from cable_ros.rod.centreline import increments, tangent_derivative
from cable_ros.rod.energy_kernels import second, strain
from cable_ros.rod.rod_state import Tables, system_of
from cable_ros.rod.units import norm3, relative_change

OPTIONS = {"cache": True, "error_model": "numpy"}

ADMIXTURE = 0.1
"""Weight of a start vector that knows nothing of the last softest mode, in the search for the next."""


@njit(**OPTIONS)
def margin(elastic, V, count, order, factors, mode, start_vector, repeats):
    """Smallest eigenvalue of H v = lambda D v on the tangent space, D elastic, by inverse iteration.

    Ends once the value changes by less than 1e-4 of itself. Only for a factored strict minimum.

    Args:
        elastic: (3n, b) of `Tangents`.
        V: (rows, 3n) constraint rows.
        count: number of rows.
        order: of the elements.
        factors: fields of `bordered.Factors`, as a plain tuple, as `bordered.kkt_factor` leaves them.
        mode: (3n,) start of the search, which receives the eigenvector.
        start_vector: (3n,) of which a little is added to the start, so that no symmetry hides a mode.
        repeats: maximum number of iterations.
    """
    factors = Factors(*factors)
    n = mode.shape[0]
    x = np.empty(n)
    y = np.empty(n)
    zero = np.zeros(count)
    dF = np.empty(count)
    value = np.inf
    for i in range(n):
        mode[i] += ADMIXTURE * start_vector[i]
    banded.multiply(elastic, mode, y)
    small, swaps = complement_factors(factors.S, count)
    for _ in range(repeats):
        for i in range(n):
            y[i] = -y[i]
        kkt_solve(y, zero, V, order, factors, small, swaps, x, dF)
        top = 0.0
        for i in range(n):
            top -= x[i] * y[i]
        banded.multiply(elastic, x, y)
        norm2 = 0.0
        for i in range(n):
            norm2 += x[i] * y[i]
        before, value = value, top / norm2
        scale = 1.0 / np.sqrt(norm2)
        for i in range(n):
            mode[i] = scale * x[i]
            y[i] *= scale
        if abs(before - value) <= 1e-4 * abs(value):
            break
    return value


@njit(**OPTIONS)
def condense(q, Fe, conditions, section, grid, enrichment, marks, estimate, c):
    """Eliminate the added polynomials: what is left of the gradient and of the constraints.

    Args:
        q, Fe, conditions, section, grid, enrichment: as in `error`.
        marks: lines and upto of `ConstraintRows`.
        estimate: of `Estimate`; the residual receives the gradient, given forces on nodes left out.
        c: (count,) overwritten: how far the end is off, and positions at contact points.
    """
    _, re, f = conditions
    K, natural = section
    h, s0, _ = grid
    fine, bubble = enrichment
    tables = Tables(*fine)
    N, dN, points, weights = tables.values, tables.slopes, tables.points, tables.weights
    lines, upto = marks
    boundaries, residual, shares = estimate
    order = N.shape[1] - 1
    nd = 3 * (order + 1)
    qs, ds, G = np.empty(4), np.empty(4), np.empty(3)
    Db = np.empty((8, 3))
    frame = np.empty((4, nd))
    middle = np.empty((4, 3))
    # by the nodal quaternions themselves, summed over the points: rows of Hbc, then the gradient
    sums = np.empty((order + 1, 16))
    H = np.empty((8, 8))
    k8 = np.empty((3, 8))
    Z = np.empty((3, 8))
    Hbb = np.empty((3, 3))
    Hbc = np.empty((3, nd))
    Cb = np.zeros((3, 3))
    rb = np.empty(3)
    change, x = np.empty(3), np.empty(3)
    count = c.shape[0]
    c[:] = 0.0
    for a in range(3):
        c[a] = -re[a]
    for e in range(h.shape[0]):
        first = e * order
        for i in range(order + 1):
            increments(q[first + i], 3 * i, frame)
        j = 3 * (order // 2)
        for a in range(4):
            for b in range(3):
                middle[a, b] = frame[a, j + b]
        Hbb[:] = 0.0
        sums[:] = 0.0
        Cb[:] = 0.0
        rb[:] = 0.0
        for k in range(N.shape[0]):
            for a in range(4):
                qs[a] = 0.0
                ds[a] = 0.0
            for i in range(order + 1):
                v, d = N[k, i], dN[k, i] / h[e]
                for a in range(4):
                    qs[a] += v * q[first + i, a]
                    ds[a] += d * q[first + i, a]
            for a in range(4):
                for b in range(3):
                    Db[a, b] = bubble[0, k] * middle[a, b]
                    Db[4 + a, b] = bubble[1, k] / h[e] * middle[a, b]
            rest = 1.0 - s0[e] - h[e] * points[k]
            for a in range(3):
                G[a] = Fe[e, a] + rest * f[a]
            density = strain(qs, ds, K, natural, G)
            t, gq, gd, norm = density[2], density[3], density[4], density[5]
            wh = weights[k] * h[e]
            second(qs, ds, G, density, wh, k8, H)
            for b in range(3):
                for i in range(3):
                    v = 0.0
                    for a in range(8):
                        v += k8[i, a] * Db[a, b]
                    change[i] = K[i] * v
                for a in range(8):
                    v = change[0] * k8[0, a] + change[1] * k8[1, a] + change[2] * k8[2, a]
                    for i in range(8):
                        v += Db[i, b] * H[i, a]
                    Z[b, a] = v
                for b2 in range(3):
                    v = 0.0
                    for a in range(8):
                        v += Z[b, a] * Db[a, b2]
                    Hbb[b, b2] += v
                v = 0.0
                for a in range(4):
                    v += Db[a, b] * gq[a] + Db[4 + a, b] * gd[a]
                rb[b] += wh * v
            tangent_derivative(qs, t, 2.0 * wh / norm, Db, Cb, 0, 3)
            for a in range(3):
                c[a] += wh * t[a]
            for i in range(order + 1):
                v, d = N[k, i], dN[k, i] / h[e]
                for a in range(4):
                    for b in range(3):
                        sums[i, 4 * b + a] += v * Z[b, a] + d * Z[b, 4 + a]
                    sums[i, 12 + a] += wh * (v * gq[a] + d * gd[a])
        for i in range(order + 1):
            for j in range(3 * i, 3 * i + 3):
                for b in range(4):
                    v = 0.0
                    for a in range(4):
                        v += sums[i, 4 * b + a] * frame[a, j]
                    if b < 3:
                        Hbc[b, j] = v
                    else:
                        residual[3 * first + j] += v
        solve3(Hbb, rb, x)
        shares[e] = abs(rb[0] * x[0] + rb[1] * x[1] + rb[2] * x[2])
        for b in range(3):
            for j in range(nd):
                residual[3 * first + j] -= Hbc[b, j] * x[b]
            for a in range(3):
                c[a] -= Cb[a, b] * x[b]
        for i in range(3, count):
            if upto[i] == e + 1:
                for a in range(3):
                    c[i] += lines[i, a] * (c[a] + re[a] - boundaries[e + 1, a])


@njit(**OPTIONS)
def error(q, Fe, conditions, section, grid, enrichment, system, rows, count, estimate):
    """First-order change (6,) of end force and end moment when every element gets one order more.

    The enriched space adds one polynomial an element, which is eliminated there; the rest is one solve with
    the factors at hand.

    Args:
        q: (n, 4) nodal frames.
        Fe: (m, 3) constant part of the internal force, see `energy_kernels.gradient`.
        conditions: fields of `Conditions`, as a plain tuple, see `entry_points`; so are the next ones.
        section, grid: of `Section` and `Grid`.
        enrichment: of `Enrichment`.
        system: of `System` at the equilibrium, factored.
        rows: of `ConstraintRows`, the first six, those beyond the third of contact points.
        count: number of rows.
        estimate: of `Estimate`.
    """
    V, _, _, lines, upto, _ = rows
    _, residual, _ = estimate
    c = np.zeros(count)
    condense(q, Fe, conditions, section, grid, enrichment, (lines, upto), estimate, c)
    system = system_of(system)
    g = system.evaluation.g
    n = 3 * q.shape[0]
    order = enrichment[0][0].shape[1] - 1
    s = np.empty(n)
    dF = np.empty(count)
    kkt_step(residual, c, V, count, order, system.factors, s, dF)
    at_end = end_rows(system.tangents, V, count, s, dF)
    out = np.empty(6)
    for a in range(3):
        out[a] = dF[a]
        out[3 + a] = residual[n - 3 + a] + at_end[a] - g[q.shape[0] - 1, a]
    return out


@njit(**OPTIONS)
def relative_error(change, F, moment, shares, least):
    """The estimated relative error of an end wrench, see `units.relative_change`.

    Args:
        change: (6,) from `error`.
        F, moment: (3,) end force and moment.
        shares: (m,) of `Estimate`.
        least: wrench that counts as nothing.
    """
    wrench = np.empty(6)
    for a in range(3):
        wrench[a], wrench[3 + a] = F[a], moment[a]
    signed = relative_change(change, wrench, least)
    # the signed change can cancel; the energy that a finer mesh would set free cannot
    size = max(norm3(moment), np.sqrt(norm3(F)), least)
    energy = 0.0
    for share in shares:
        energy += share
    return max(signed, 0.5 * energy / size)
