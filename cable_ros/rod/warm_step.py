# SPDX-License-Identifier: Apache-2.0
"""Compiled: the warm-started step of a rod, by Newton's method with factors that are kept."""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import LEAF, njit
from cable_ros.linalg.bordered import Factors, end_coupling, factor, saddle_step
from cable_ros.linalg.copies import copy, copy_rows
from cable_ros.rod import quaternion
from cable_ros.rod.energy_kernels import gradient, hessian
from cable_ros.rod.rod_state import Evaluation, Grid, Path, Section, Tables, Tangents

OPTIONS = {"cache": True, "error_model": "numpy"}

ADVANCED, TOO_FAR, NOT_CONTRACTING, NOT_CONVEX = 0, 1, 2, 3
"""How `advance` ended."""

MOST_ITERATIONS = 12
"""Maximum number of corrections."""
SLOW = 0.15
"""Factors are made again if an iteration leaves more than this fraction of the error."""
LEAST_RATE = 1e-3
"""Smallest fraction of the error that an iteration is taken to leave."""
AMPLIFIED = 10.0
"""Maximum sum of the weights with which extrapolation adds up the errors of the last equilibria."""
POSITION, LOAD = 4, 7
"""Slots of end position and load in a vector of conditions, after the end frame."""


@njit(**OPTIONS)
def advance(
    q, F, qe, re, f, K, natural, h, s0, tables,
    acc, g, radial, totals, lanes, elastic, geometric, dchord, C, A, U, pivots, Y, S,
    shapes, forces, conditions, known, tolerance, limit, rotation, refactor_at, q_new, F_new,
):  # fmt: skip
    """From the equilibrium (q, F) to that under new conditions, with the factors at hand.

    The start is extrapolated along the path of the last equilibria, see `extrapolate`, or (q, F) itself,
    whose gradient is in the evaluation if any is known. The first step from there satisfies the end position,
    all others correct. The factors may be those of another equilibrium; they are made again once a section
    has turned too far since, after a long step, and when the iteration no longer contracts.

    Python calls this at every pose, and takes least time to pass numbers and arrays one by one. In here they
    are groups.

    Args:
        q, F: (n, 4) nodal frames, (3,) end force.
        qe, re, f: the new conditions, fields of `rod_state.Conditions`.
        K, natural: of `Section`.
        h, s0, tables: of `Grid`; the last one a tuple of the fields of `Tables`.
        acc, g, radial, totals, lanes: of `Evaluation`, overwritten.
        elastic, geometric, dchord, C: of `Tangents`, overwritten.
        A, U, pivots, Y, S: of `bordered.Factors`, overwritten.
        shapes, forces, conditions: of `Path`; an equilibrium that is found is put first.
        known: number of equilibria on the path that are known, 0 to 3.
        tolerance, limit, rotation, refactor_at: of `StepControl`.
        q_new, F_new: receive the equilibrium.

    Returns:
        How it ended, number of corrections, rotation since the last factorisation, rad, whether the factors
        are new.
    """
    section, grid = Section(K, natural), Grid(h, s0, Tables(*tables))
    evaluation = Evaluation(acc, g, radial, totals, lanes)
    tangents, factors = Tangents(elastic, geometric, dchord, C), Factors(A, U, pivots, Y, S)
    path = Path(shapes, forces, conditions)
    order = grid.tables.values.shape[1] - 1
    n = 3 * q.shape[0]
    gv = evaluation.g.reshape(n)
    s, dF, c, theta = np.empty(n), np.empty(3), np.empty(3), np.empty(3)
    Fe = np.empty((grid.h.shape[0], 3))
    target = np.empty(conditions.shape[1])
    as_vector(qe, re, f, target)
    ready = known > 0 and same(f, conditions[0, LOAD:])
    jumped = extrapolate(path, known, target, q_new, F_new) if known > 1 else 0.0
    if jumped == 0.0:
        copy_rows(q, q_new)
        copy(F, F_new)
    moved, size, rate = jumped, 0.0, 0.0
    fresh = False
    iteration = 0
    while iteration <= MOST_ITERATIONS:
        spread_into(F_new, Fe)
        if iteration > 0 or jumped > 0.0 or not ready:
            evaluation.acc[:] = 0.0
            gradient(q_new, Fe, f, section, grid, evaluation)
        if iteration > 0 and size * rate <= tolerance:
            remember(q_new, F_new, target, path)
            return ADVANCED, iteration if jumped > 0.0 else iteration - 1, rotation + moved, fresh
        # an extrapolated start is as good as what the first step leads to
        if iteration == (0 if jumped > 0.0 else 1):
            renew = rotation + moved > refactor_at or (jumped == 0.0 and moved > 0.5 * refactor_at)
        else:
            renew = rate > SLOW
        if renew:
            hessian(q_new, Fe, f, section, grid, evaluation.radial, tangents)
            if not factor(tangents, 0.0, order, factors):
                return NOT_CONVEX, iteration, rotation, fresh
            fresh = True
        for a in range(3):
            c[a] = totals[a] - re[a]
        if iteration == 0:
            end_turn(q_new, qe, theta)
            end_coupling(tangents, C, 3, theta, gv, c)
        saddle_step(gv, c, C, order, factors, s, dF)
        if iteration == 0:
            for k in range(3):
                s[n - 3 + k] = theta[k]
        turned = largest(s)
        if jumped > 0.0 and iteration == 0 and not turned <= 0.3 * jumped:
            # the path has bent: start from the last equilibrium itself
            copy_rows(q, q_new)
            copy(F, F_new)
            moved, jumped, ready = 0.0, 0.0, False
            rotation = np.inf if fresh else rotation
            continue
        if not turned <= limit - jumped:
            return TOO_FAR, iteration, rotation, fresh
        quaternion.retract(q_new, s, q_new)
        close(q_new, qe)
        new = max(correct(F_new, dF), turned)
        if iteration > 1 and fresh and not new <= 0.5 * size:
            return NOT_CONTRACTING, iteration, rotation, fresh
        if iteration == 0:
            moved += turned
        # estimates the next correction: the ratio of the last two, no less than the rotation since factoring
        old = turned if fresh else rotation + moved
        rate = max(min(new / size, 1.0) if iteration > 1 else 0.0, old, LEAST_RATE)
        size = new
        iteration += 1
    return NOT_CONTRACTING, iteration, rotation, fresh


@njit(**LEAF)
def as_vector(qe, re, f, out):
    """The conditions qe (4,), re (3,), f (3,) as one vector out (10,)."""
    for a in range(4):
        out[a] = qe[a]
    for a in range(3):
        out[POSITION + a] = re[a]
        out[LOAD + a] = f[a]


@njit(**LEAF)
def extrapolate(path, known, target, q, F):
    """Extrapolate the last equilibria to the conditions `target`; returns the largest rotation, rad.

    They are taken for points of a smooth path, at distances along it that are those of
    their conditions, straight on or turned back; q and F receive the polynomial through them. Its order is
    that which predicts the conditions `target` best, the higher one where both do well. Nothing happens, and
    0 is returned, if none predicts them to a tenth of the step, or if the weights amplify errors more than
    AMPLIFIED times.

    Args:
        path: `Path`.
        known: number of equilibria on it that are known, 2 or 3.
        target: (10,) conditions, see `as_vector`.
        q, F: (n, 4) nodal frames and (3,) end force, overwritten.
    """
    shapes, forces, conditions = path
    t = signed_distance(conditions[1], conditions[0], target)
    back = -abs(signed_distance(conditions[0], conditions[0], conditions[1]))
    best, w1, w2 = 0.1 * abs(t), 0.0, 0.0
    for order in range(1, known):
        if order == 1:
            v1, v2 = t / back, 0.0
        else:
            before = back - signed_distance(conditions[0], conditions[1], conditions[2])
            v1 = t * (t - before) / (back * (back - before))
            v2 = t * (t - back) / (before * (before - back))
        if not abs(v1) + abs(v2) <= AMPLIFIED:
            continue
        miss = 0.0
        for a in range(target.shape[0]):
            predicted = v1 * (conditions[1, a] - conditions[0, a]) + v2 * (
                conditions[2, a] - conditions[0, a]
            )
            miss += (target[a] - conditions[0, a] - predicted) ** 2
        miss = np.sqrt(miss)
        if miss <= max(best, 1e-3 * abs(t)):
            best, w1, w2 = miss, v1, v2
    if w1 == 0.0:
        return 0.0
    farthest = 0.0
    for i in range(q.shape[0]):
        norm = 0.0
        for a in range(4):
            change = w1 * (shapes[1, i, a] - shapes[0, i, a]) + w2 * (shapes[2, i, a] - shapes[0, i, a])
            farthest = max(farthest, abs(change))
            q[i, a] = shapes[0, i, a] + change
            norm += q[i, a] ** 2
        norm = 1.0 / np.sqrt(norm)
        for a in range(4):
            q[i, a] *= norm
    for a in range(3):
        F[a] = forces[0, a] + w1 * (forces[1, a] - forces[0, a]) + w2 * (forces[2, a] - forces[0, a])
    return 2.0 * farthest


@njit(**LEAF)
def signed_distance(origin, at, target):
    """Distance from the conditions `at` to `target`, all (10,); negative if it leads back to `origin`."""
    size, side = 0.0, 0.0
    for a in range(at.shape[0]):
        change = target[a] - at[a]
        size += change * change
        side += change * (at[a] - origin[a])
    return np.sqrt(size) if side > 0.0 else -np.sqrt(size)


@njit(**LEAF)
def remember(q, F, target, path):
    """Put the equilibrium q (n, 4), F (3,) under the conditions `target` (10,) first in the `Path` path."""
    shapes, forces, conditions = path
    for k in range(conditions.shape[0] - 1, 0, -1):
        copy_rows(shapes[k - 1], shapes[k])
        copy(forces[k - 1], forces[k])
        copy(conditions[k - 1], conditions[k])
    copy_rows(q, shapes[0])
    copy(F, forces[0])
    copy(target, conditions[0])


@njit(**LEAF)
def same(a, b):
    """Whether two vectors a and b of one length are equal."""
    equal = True
    for i in range(a.shape[0]):
        equal = equal and a[i] == b[i]
    return equal


@njit(**LEAF)
def end_turn(q, qe, theta):
    """The rotation vector theta (3,) of the end frame qe as seen from the last of q (n, 4)."""
    last = q[q.shape[0] - 1]
    inverse = last[0], -last[1], -last[2], -last[3]
    theta[0], theta[1], theta[2] = quaternion.turn(quaternion.product(inverse, (qe[0], qe[1], qe[2], qe[3])))


@njit(**OPTIONS)
def spread(F, h):
    """The same force F (3,) for every element: (m, 3), with h (m,) of `Grid`."""
    out = np.empty((h.shape[0], 3))
    spread_into(F, out)
    return out


@njit(**LEAF)
def spread_into(F, out):
    """`spread` of F (3,) into `out` (m, 3)."""
    for e in range(out.shape[0]):
        out[e, 0], out[e, 1], out[e, 2] = F[0], F[1], F[2]


@njit(**LEAF)
def correct(F, dF):
    """Add dF to the end force F (3,); returns its relative size, F being 1e-3 at least."""
    force, change = 1e-3, 0.0
    for a in range(3):
        F[a] += dF[a]
        force = max(force, abs(F[a]))
        change = max(change, abs(dF[a]))
    return change / force


@njit(**LEAF)
def largest(s):
    """Largest absolute entry of s; NaN where one is."""
    out = 0.0
    for i in range(s.shape[0]):
        if not abs(s[i]) <= out:
            out = abs(s[i])
    return out


@njit(**LEAF)
def close(q, qe):
    """Put the last of q (n, 4) on the end frame qe or on its negative, whichever is nearer."""
    last = q.shape[0] - 1
    d = q[last, 0] * qe[0] + q[last, 1] * qe[1] + q[last, 2] * qe[2] + q[last, 3] * qe[3]
    for a in range(4):
        q[last, a] = qe[a] if d > 0.0 else -qe[a]
