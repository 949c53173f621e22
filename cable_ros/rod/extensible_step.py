# SPDX-License-Identifier: Apache-2.0
"""Compiled: the warm-started step of a rod that stretches and shears, and what it is made of.

The arrays are those of `StretchingRod` (stretching.py).
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import njit
from cable_ros.linalg.bordered import negative3, schur
from cable_ros.linalg.copies import copy, copy_rows
from cable_ros.rod import quaternion
from cable_ros.rod.energy_kernels import gradient, hessian, workspace
from cable_ros.rod.extensible_kernels import stretch_gradient, stretch_hessian
from cable_ros.rod.warm_step import (
    ADVANCED,
    NOT_CONTRACTING,
    NOT_CONVEX,
    TOO_FAR,
    close,
    correct,
    end_coupling,
    end_rows,
    largest,
    saddle_step,
    spread,
)

OPTIONS = {"cache": True, "error_model": "numpy"}


@njit(**OPTIONS)
def stretch_linearize(
    q, F, f, K, kappa0, compliance, h, s0, tables,
    elastic, geometric, parts, C, reach, acc, g, radial, totals, stretch, full,
):  # fmt: skip
    """`energy_kernels.gradient` and, where `full`, `energy_kernels.hessian` with the stretch."""
    N, points, weights = tables[0], tables[4], tables[5]
    Fe = spread(F, h)
    acc[:] = 0.0
    stretch_gradient(q, Fe, f, compliance, h, s0, N, points, weights, acc, stretch)
    gradient(q, Fe, f, K, kappa0, h, s0, tables, workspace(h, tables), acc, g, radial, totals)
    for a in range(4):
        totals[a] += stretch[a]
    if full:
        hessian(q, Fe, f, K, kappa0, h, s0, tables, radial, elastic, geometric, parts, C)
        stretch_hessian(q, Fe, f, compliance, h, s0, N, points, weights, geometric, parts, C, reach)


@njit(**OPTIONS)
def stretch_factor(elastic, geometric, C, reach, mu, order, A, L, pivots, Y, S):
    """`bordered.factor` with the reach in the Schur complement.

    With the strains eliminated, the inertia that tells a strict minimum stays the same.
    """
    negative, worst = schur(elastic, geometric, C, mu, order, A, L, pivots, Y, S)
    for a in range(3):
        for b in range(3):
            S[a, b] += reach[a, b]
    return worst > 1e-11 and negative3(S) == negative


@njit(**OPTIONS)
def advance_stretching(
    q, F, qe, re, f, K, kappa0, compliance, h, s0, tables,
    elastic, geometric, parts, C, reach, A, L, pivots, Y, S, acc, g, radial, totals, stretch,
    tolerance, limit, drift, refresh, q_new, F_new,
):  # fmt: skip
    """As `warm_step.advance`; the end force's relative change ages the factors as a section's turn does.

    What a taut cable answers to its force hardly shows in its shape.
    """
    order = tables[0].shape[1] - 1
    n = 3 * q.shape[0]
    gv = g.reshape(n)
    s, dF, c = np.empty(n), np.empty(3), np.empty(3)
    last = q.shape[0] - 1
    theta = quaternion.rotation_vector(quaternion.multiply(quaternion.conjugate(q[last]), qe))
    copy_rows(q, q_new)
    copy(F, F_new)
    size, rate = 0.0, 0.0
    fresh = False
    for iteration in range(16):  # the first one predicts
        renew = rate > 0.15 or (iteration == 1 and (drift > refresh or size > 0.5 * refresh))
        stretch_linearize(
            q_new, F_new, f, K, kappa0, compliance, h, s0, tables,
            elastic, geometric, parts, C, reach, acc, g, radial, totals, stretch, renew,
        )  # fmt: skip
        if iteration > 1 and size * rate <= tolerance:
            return ADVANCED, iteration - 1, drift, fresh
        if renew:
            if not stretch_factor(elastic, geometric, C, reach, 0.0, order, A, L, pivots, Y, S):
                return NOT_CONVEX, iteration, drift, fresh
            fresh = True
        for a in range(3):
            c[a] = totals[a] - re[a]
        if iteration == 0:
            end_coupling(elastic, geometric, C, 3, theta, gv, c)
        saddle_step(gv, c, C, order, L, pivots, Y, S, s, dF)
        if iteration == 0:
            for k in range(3):
                s[n - 3 + k] = theta[k]
        moved = largest(s)
        if not moved <= limit:
            return TOO_FAR, iteration, drift, fresh
        quaternion.retract(q_new, s, q_new)
        close(q_new, qe)
        new = max(correct(F_new, dF), moved)
        if iteration == 0:
            drift += new
        else:
            if iteration > 1 and fresh and not new <= 0.5 * size:
                return NOT_CONTRACTING, iteration, drift, fresh
            rate = max(min(new / size, 1.0) if iteration > 1 else 0.0, 0.0 if fresh else drift, 1e-3)
        size = new
    return NOT_CONTRACTING, iteration, drift, fresh


@njit(**OPTIONS)
def moments(right, s, dF, qe, elastic, geometric, C):
    """Both wrenches (12,) that a step (s, dF) makes; `right` (3n,): the gradient's own change."""
    n, band = elastic.shape[0], elastic.shape[1] - 1
    out = np.empty(12)
    moment = end_rows(elastic, geometric, C, 3, s, dF)
    dFb = quaternion.rotate(quaternion.conjugate(qe), dF)
    for i in range(3):
        out[i] = -dF[i]
        out[3 + i] = right[i]
        for j in range(3, min(band + 1 + i, n - 3)):
            out[3 + i] += (elastic[j, band + i - j] + geometric[j, band + i - j]) * s[j]
        for a in range(3):
            out[3 + i] -= C[a, i] * dF[a]
        out[6 + i] = dFb[i]
        out[9 + i] = moment[i] + right[n - 3 + i]
    return out
