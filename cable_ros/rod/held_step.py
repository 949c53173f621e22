# SPDX-License-Identifier: Apache-2.0
"""Compiled: the warm-started step of a rod whose ends are not both clamped; see `held_kernels`."""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import LEAF, njit
from cable_ros.linalg.copies import copy, copy_rows
from cable_ros.rod import quaternion
from cable_ros.rod.held_kernels import Hold, evaluate, factored, held_solve, put_force, residual
from cable_ros.rod.rod_state import Path, Section, grid_of, system_of
from cable_ros.rod.warm_step import (
    ADVANCED,
    LEAST_RATE,
    MOST_ITERATIONS,
    NOT_CONTRACTING,
    NOT_CONVEX,
    POSITION,
    SLOW,
    TOO_FAR,
    as_vector,
    correct,
    extrapolate,
    largest,
    remember,
)

OPTIONS = {"cache": True, "error_model": "numpy"}

REACHED = 0.5
"""Fraction of the linear rate that a step must reach at least with factors of its own."""


@njit(**LEAF)
def tilt(q, qe, free, theta):
    """Rotation theta (3,) of the last of q (n, 4), in its own axes, that puts it on the end frame `qe`.

    A section that may turn about its tangent is tilted by the shortest way; one that turns freely stays.
    `free` (3n,): of `Hold`.
    """
    n = free.shape[0]
    theta[0], theta[1], theta[2] = 0.0, 0.0, 0.0
    if free[n - 3] > 0.0:
        return
    last = q[q.shape[0] - 1]
    inverse = last[0], -last[1], -last[2], -last[3]
    apart = quaternion.product(inverse, (qe[0], qe[1], qe[2], qe[3]))
    if free[n - 1] == 0.0:
        theta[0], theta[1], theta[2] = quaternion.turn(apart)
        return
    t0, t1, t2 = quaternion.turned(apart, (0.0, 0.0, 1.0))
    across = np.sqrt(t0 * t0 + t1 * t1)
    angle = np.arctan2(across, t2)
    scale = angle / across if across > 1e-300 else 0.0
    theta[0], theta[1] = -scale * t1, scale * t0


@njit(**LEAF)
def couple_end(tangents, theta, g, c):
    """Add to g (3n,) and c (3,) what turning the end section by theta (3,) does to them."""
    elastic, geometric, C = tangents.elastic, tangents.geometric, tangents.C
    n, band = elastic.shape[0], elastic.shape[1] - 1
    for k in range(3):
        row = n - 3 + k
        if theta[k] != 0.0:
            for j in range(max(row - band, 0), n):
                i, m = max(row, j), min(row, j)
                g[j] += (elastic[i, band + m - i] + geometric[i, band + m - i]) * theta[k]
            for a in range(3):
                c[a] += C[a, row] * theta[k]


@njit(**OPTIONS)
def advance_held(q, F, conditions, section, grid, system, hold, path, known, control, q_new, F_new):
    """As `warm_step.advance`, for ends of any kind: what they release stays as the solution has it.

    Args:
        q, F, known, q_new, F_new: as in `warm_step.advance`.
        conditions: fields of `Conditions`, as a plain tuple, see `entry_points`; so are the next ones.
        section, grid: of `Section` and `Grid`.
        system: of `System`, overwritten.
        hold: of `Hold`, under the new conditions.
        path: of `Path`; an equilibrium that is found is put first.
        control: of `StepControl`.
    """
    qe, re, f = conditions
    section, grid, system, hold, path = (
        Section(*section), grid_of(grid), system_of(system), Hold(*hold), Path(*path)
    )  # fmt: skip
    evaluation, tangents, factors = system
    tolerance, limit, rotation, refactor_at = control
    order = grid.tables.values.shape[1] - 1
    n = 3 * q.shape[0]
    r, s, dF, c, theta = np.empty(n), np.empty(n), np.empty(3), np.empty(3), np.empty(3)
    target = np.empty(path.conditions.shape[1])
    as_vector(qe, re, f, target)
    if hold.held == 0:  # the end may be anywhere
        for a in range(3):
            target[POSITION + a] = 0.0
    jumped = extrapolate(path, known, target, q_new, F_new) if known > 1 else 0.0
    if jumped == 0.0:
        copy_rows(q, q_new)
        copy(F, F_new)
    put_force(F_new, hold)
    moved, size, rate = jumped, 0.0, 0.0
    fresh = False
    iteration = 0
    while iteration <= MOST_ITERATIONS:
        if iteration == (0 if jumped > 0.0 else 1):
            renew = rotation + moved > refactor_at or (jumped == 0.0 and moved > 0.5 * refactor_at)
        else:
            renew = rate > SLOW
        evaluate(q_new, F_new, f, section, grid, system, hold, renew)
        if iteration > 0 and size * rate <= tolerance:
            remember(q_new, F_new, target, path)
            return ADVANCED, iteration if jumped > 0.0 else iteration - 1, rotation + moved, fresh
        if renew:
            if not factored(q_new, tangents, 0.0, order, factors, hold):
                return NOT_CONVEX, iteration, rotation, fresh
            fresh = True
        residual(q_new, evaluation.g, hold, r)
        for a in range(3):
            c[a] = evaluation.totals[a] - re[a]
        if iteration == 0:
            tilt(q_new, qe, hold.free, theta)
            couple_end(tangents, theta, r, c)
        held_solve(q_new, r, c, tangents.C, order, factors, hold, s, dF)
        if iteration == 0:
            for k in range(3):
                s[n - 3 + k] += theta[k]
        turned = largest(s)
        if jumped > 0.0 and iteration == 0 and not turned <= 0.3 * jumped:
            # the path has bent: start from the last equilibrium itself
            copy_rows(q, q_new)
            copy(F, F_new)
            put_force(F_new, hold)
            moved, jumped = 0.0, 0.0
            rotation = np.inf if fresh else rotation
            continue
        if not turned <= limit - jumped:
            return TOO_FAR, iteration, rotation, fresh
        quaternion.retract(q_new, s, q_new)
        new = max(correct(F_new, dF), turned)
        put_force(F_new, hold)
        if iteration > 1 and fresh and not new <= REACHED * size:
            return NOT_CONTRACTING, iteration, rotation, fresh
        if iteration == 0:
            moved += turned
        # estimates the next correction, as `warm_step.advance` does
        old = turned if fresh else rotation + moved
        rate = max(min(new / size, 1.0) if iteration > 1 else 0.0, old, LEAST_RATE)
        size = new
        iteration += 1
    return NOT_CONTRACTING, iteration, rotation, fresh
