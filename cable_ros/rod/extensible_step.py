# SPDX-License-Identifier: Apache-2.0
"""Compiled: the warm-started step of a rod that stretches and shears, and what it is made of."""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, njit
from cable_ros.linalg.bordered import SINGULAR, end_coupling, end_rows, negative3, saddle_step, schur
from cable_ros.linalg.copies import copy, copy_rows
from cable_ros.rod import quaternion
from cable_ros.rod.energy_kernels import gradient, hessian
from cable_ros.rod.extensible_kernels import internal_forces, stretch_gradient, stretch_hessian
from cable_ros.rod.rod_state import Section, Stretch, Tangents, grid_of, system_of
from cable_ros.rod.warm_step import (
    ADVANCED,
    LEAST_RATE,
    NOT_CONTRACTING,
    NOT_CONVEX,
    SLOW,
    TOO_FAR,
    close,
    correct,
    largest,
    spread,
)

OPTIONS = {"cache": True, "error_model": "numpy"}

MOST_ITERATIONS = 16
"""Maximum number of iterations; the first one predicts."""


@njit(**INNER)
def stretch_linearize(q, F, f, section, stretch, grid, system, full):
    """`energy_kernels.gradient` and, if `full`, `energy_kernels.hessian` with the stretch.

    Args:
        q, F: (n, 4) nodal frames, (3,) end force.
        f: (3,) load per length.
        section, stretch, grid: `Section`, `Stretch` and `Grid`.
        system: `System`; evaluation and tangents are overwritten.
        full: whether to compute the second derivatives.
    """
    evaluation, tangents, _ = system
    totals = evaluation.totals
    Fe = spread(F, grid.h)
    evaluation.acc[:] = 0.0
    G = internal_forces(Fe, f, grid)
    stretch_gradient(q, G, f, grid, stretch, evaluation.acc)
    gradient(q, Fe, f, section, grid, evaluation)
    for a in range(stretch.totals.shape[0]):
        totals[a] += stretch.totals[a]
    if full:
        hessian(q, Fe, f, section, grid, evaluation.radial, tangents)
        stretch_hessian(q, G, grid, stretch, tangents)


@njit(**INNER)
def stretch_factor(system, reach, mu, order):
    """`bordered.factor` with the reach in the Schur complement.

    With the strains eliminated, the inertia that tells a strict minimum stays the same.

    Args:
        system: `System`; the factors are overwritten.
        reach: (3, 3) of `Stretch`.
        mu, order: as in `bordered.factor`.
    """
    _, tangents, factors = system
    negative, worst = schur(tangents, mu, order, factors)
    for a in range(3):
        for b in range(3):
            factors.S[a, b] += reach[a, b]
    return worst > SINGULAR and negative3(factors.S) == negative


@njit(**OPTIONS)
def advance_stretching(q, F, conditions, section, stretch, give, grid, system, control, q_new, F_new):
    """As `warm_step.advance`; the end force's relative change ages the factors as a section's turn does.

    The shape of a taut cable hardly shows how it answers to its force. There is no extrapolation.

    Args:
        q, F, q_new, F_new: as in `warm_step.advance`.
        conditions: fields of `Conditions`, as a plain tuple, see `entry_points`; so are the next ones.
        section, grid: of `Section` and `Grid`.
        stretch: of `Stretch`, overwritten but for the compliance.
        give: (3, 3) how far the end gives way to changes of the end force; zeros: it is held.
        system: of `System`, overwritten.
        control: of `StepControl`.
    """
    qe, re, f = conditions
    section, stretch, grid = Section(*section), Stretch(*stretch), grid_of(grid)
    system = system_of(system)
    evaluation, tangents, factors = system
    C, totals = tangents.C, evaluation.totals
    tolerance, limit, rotation, refactor_at = control
    order = grid.tables.values.shape[1] - 1
    n = 3 * q.shape[0]
    gv = evaluation.g.reshape(n)
    s, dF, c = np.empty(n), np.empty(3), np.empty(3)
    last = q.shape[0] - 1
    theta = quaternion.rotation_vector(quaternion.multiply(quaternion.conjugate(q[last]), qe))
    copy_rows(q, q_new)
    copy(F, F_new)
    size, rate = 0.0, 0.0
    fresh = False
    for iteration in range(MOST_ITERATIONS):
        late = iteration == 1 and (rotation > refactor_at or size > 0.5 * refactor_at)
        renew = rate > SLOW or late
        stretch_linearize(q_new, F_new, f, section, stretch, grid, system, renew)
        if iteration > 1 and size * rate <= tolerance:
            return ADVANCED, iteration - 1, rotation, fresh
        if renew:
            for a in range(3):
                for b in range(3):
                    stretch.reach[a, b] += give[a, b]
            if not stretch_factor(system, stretch.reach, 0.0, order):
                return NOT_CONVEX, iteration, rotation, fresh
            fresh = True
        for a in range(3):
            c[a] = totals[a] - re[a]
            for b in range(3):
                c[a] += give[a, b] * (F_new[b] - F[b])
        if iteration == 0:
            end_coupling(tangents, C, 3, theta, gv, c)
        saddle_step(gv, c, C, order, factors, s, dF)
        if iteration == 0:
            for k in range(3):
                s[n - 3 + k] = theta[k]
        moved = largest(s)
        if not moved <= limit:
            return TOO_FAR, iteration, rotation, fresh
        quaternion.retract(q_new, s, q_new)
        close(q_new, qe)
        new = max(correct(F_new, dF), moved)
        if iteration == 0:
            rotation += new
        else:
            if iteration > 1 and fresh and not new <= 0.5 * size:
                return NOT_CONTRACTING, iteration, rotation, fresh
            rate = max(min(new / size, 1.0) if iteration > 1 else 0.0, 0.0 if fresh else rotation, LEAST_RATE)
        size = new
    return NOT_CONTRACTING, iteration, rotation, fresh


@njit(**OPTIONS)
def moments(right, s, dF, qe, tangents):
    """Both wrenches (12,) that a step makes.

    Args:
        right: (3n,) the gradient's own change.
        s, dF: (3n,), (3,) the step.
        qe: (4,) end frame.
        tangents: fields of `Tangents`, as a plain tuple.
    """
    tangents = Tangents(*tangents)
    elastic, geometric, _, C = tangents
    n, band = elastic.shape[0], elastic.shape[1] - 1
    out = np.empty(12)
    moment = end_rows(tangents, C, 3, s, dF)
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
