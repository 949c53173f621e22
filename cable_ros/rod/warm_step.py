# SPDX-License-Identifier: Apache-2.0
"""Compiled: the warm-started step; and, under one name, all that a rod's owner calls of the compiled statics.

The arrays that these functions share are those of `Rod` (rod.py); `tables` are `ReferenceElement.tables`.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import LEAF, njit
from cable_ros.linalg.bordered import (
    border_factor,
    border_step,
    end_coupling,
    end_rows,
    factor,
    negative3,
    saddle_step,
    solve3,
)
from cable_ros.linalg.copies import copy, copy_rows
from cable_ros.rod import quaternion
from cable_ros.rod.energy_kernels import gradient, hessian, workspace
from cable_ros.rod.error_estimate import error, margin, relative_error
from cable_ros.rod.output import read, read_anywhere, wrenches

__all__ = [
    "ADVANCED",
    "NOT_CONTRACTING",
    "NOT_CONVEX",
    "TOO_FAR",
    "advance",
    "border_factor",
    "border_step",
    "close",
    "correct",
    "end_coupling",
    "end_rows",
    "error",
    "factor",
    "largest",
    "margin",
    "negative3",
    "read",
    "read_anywhere",
    "relative_error",
    "saddle_step",
    "solve3",
    "spread",
    "wrenches",
]

OPTIONS = {"cache": True, "error_model": "numpy"}

ADVANCED, TOO_FAR, NOT_CONTRACTING, NOT_CONVEX = 0, 1, 2, 3
"""How `advance` ended."""

AMPLIFIED = 10.0
"""Extrapolation may add up errors of the last equilibria so many times."""


@njit(**OPTIONS)
def advance(
    q, F, qe, re, f, K, kappa0, h, s0, tables,
    elastic, geometric, parts, C, A, L, pivots, Y, S, acc, g, radial, totals,
    known, shapes, forces, places, tolerance, limit, drift, refresh, q_new, F_new,
):  # fmt: skip
    """From the equilibrium (q, F) to that with the end at (qe, re) and the load f, with the factors at hand.

    The start is ahead on the path of the `known` last equilibria, see `ahead`, or (q, F) itself, whose
    gradient is in `g` and `totals` where any is known. The first step from there takes the end to its place,
    all others correct. The factors may be those of an equilibrium from which some section has turned by
    `drift` rad; once that is more than `refresh`, after a long step, and where they no longer contract, they
    are made anew. Stops TOO_FAR where a section turns by more than `limit`. `tolerance` bounds what is left
    of nodal rotation (rad) and relative end force. Returns (code, corrections, drift, whether the factors are
    new).
    """
    order = tables[0].shape[1] - 1
    n = 3 * q.shape[0]
    gv = g.reshape(n)
    s, dF, c, theta, Fe = np.empty(n), np.empty(3), np.empty(3), np.empty(3), np.empty((h.shape[0], 3))
    lanes = workspace(h, tables)
    there = place(qe, re, f)
    ready = known > 0 and same(f, places[0, 7:])
    jumped = ahead(known, shapes, forces, places, there, q_new, F_new) if known > 1 else 0.0
    if jumped == 0.0:
        copy_rows(q, q_new)
        copy(F, F_new)
    moved, size, rate = jumped, 0.0, 0.0
    fresh = False
    iteration = 0
    while iteration <= 12:
        spread_into(F_new, Fe)
        if iteration > 0 or jumped > 0.0 or not ready:
            acc[:] = 0.0
            gradient(q_new, Fe, f, K, kappa0, h, s0, tables, lanes, acc, g, radial, totals)
        if iteration > 0 and size * rate <= tolerance:
            remember(q_new, F_new, there, shapes, forces, places)
            return ADVANCED, iteration if jumped > 0.0 else iteration - 1, drift + moved, fresh
        # a start ahead is as good as what the first step leads to
        if iteration == (0 if jumped > 0.0 else 1):
            renew = drift + moved > refresh or (jumped == 0.0 and moved > 0.5 * refresh)
        else:
            renew = rate > 0.15
        if renew:
            hessian(
                q_new, Fe, f, K, kappa0, h, s0, tables, radial, elastic, geometric, parts, C
            )  # fmt: skip
            if not factor(elastic, geometric, C, 0.0, order, A, L, pivots, Y, S):
                return NOT_CONVEX, iteration, drift, fresh
            fresh = True
        for a in range(3):
            c[a] = totals[a] - re[a]
        if iteration == 0:
            end_turn(q_new, qe, theta)
            end_coupling(elastic, geometric, C, 3, theta, gv, c)
        saddle_step(gv, c, C, order, L, pivots, Y, S, s, dF)
        if iteration == 0:
            for k in range(3):
                s[n - 3 + k] = theta[k]
        turned = largest(s)
        if jumped > 0.0 and iteration == 0 and not turned <= 0.3 * jumped:
            # the path has bent: from the last equilibrium itself
            copy_rows(q, q_new)
            copy(F, F_new)
            moved, jumped, ready = 0.0, 0.0, False
            drift = np.inf if fresh else drift
            continue
        if not turned <= limit - jumped:
            return TOO_FAR, iteration, drift, fresh
        quaternion.retract(q_new, s, q_new)
        close(q_new, qe)
        new = max(correct(F_new, dF), turned)
        if iteration > 1 and fresh and not new <= 0.5 * size:
            return NOT_CONTRACTING, iteration, drift, fresh
        if iteration == 0:
            moved += turned
        # what the next correction would be: the ratio of the last two, no less than the factors' drift
        old = turned if fresh else drift + moved
        rate = max(min(new / size, 1.0) if iteration > 1 else 0.0, old, 1e-3)
        size = new
        iteration += 1
    return NOT_CONTRACTING, iteration, drift, fresh


@njit(**OPTIONS)
def place(qe, re, f):
    """The conditions as one vector (10,)."""
    out = np.empty(10)
    for a in range(4):
        out[a] = qe[a]
    for a in range(3):
        out[4 + a] = re[a]
        out[7 + a] = f[a]
    return out


@njit(**LEAF)
def ahead(known, shapes, forces, places, there, q, F):
    """Extrapolate the last equilibria to the conditions `there` (10,); returns the farthest turn.

    The `known` ones, 2 or 3, come latest first: their nodal frames `shapes` (3, n, 4), end forces `forces`
    (3, 3), conditions `places` (3, 10). They are taken for points of a smooth path, at distances along it
    that are those of their conditions, straight on or turned back; q (n, 4), F (3,) receive the polynomial
    through them. Its order is that which tells the conditions `there` best, the higher one where both do
    well; nothing happens, 0, where none tells them to a tenth of the step, or where it would add up errors
    more than AMPLIFIED times.
    """
    t = onward(places[1], places[0], there)
    back = -abs(onward(places[0], places[0], places[1]))
    best, w1, w2 = 0.1 * abs(t), 0.0, 0.0
    for order in range(1, known):
        if order == 1:
            v1, v2 = t / back, 0.0
        else:
            before = back - onward(places[0], places[1], places[2])
            v1 = t * (t - before) / (back * (back - before))
            v2 = t * (t - back) / (before * (before - back))
        if not abs(v1) + abs(v2) <= AMPLIFIED:
            continue
        miss = 0.0
        for a in range(there.shape[0]):
            told = v1 * (places[1, a] - places[0, a]) + v2 * (places[2, a] - places[0, a])
            miss += (there[a] - places[0, a] - told) ** 2
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
def onward(origin, at, there):
    """Distance from `at` to `there` (10,), negative where that leads back towards `origin`."""
    size, side = 0.0, 0.0
    for a in range(at.shape[0]):
        way = there[a] - at[a]
        size += way * way
        side += way * (at[a] - origin[a])
    return np.sqrt(size) if side > 0.0 else -np.sqrt(size)


@njit(**OPTIONS)
def remember(q, F, there, shapes, forces, places):
    """Put an equilibrium before the others, of which the last is forgotten."""
    for k in range(places.shape[0] - 1, 0, -1):
        copy_rows(shapes[k - 1], shapes[k])
        copy(forces[k - 1], forces[k])
        copy(places[k - 1], places[k])
    copy_rows(q, shapes[0])
    copy(F, forces[0])
    copy(there, places[0])


@njit(**LEAF)
def same(a, b):
    """Whether two vectors of one length are equal."""
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
    """The same force F (3,) for every element: (elements, 3)."""
    out = np.empty((h.shape[0], 3))
    spread_into(F, out)
    return out


@njit(**LEAF)
def spread_into(F, out):
    """`spread` without a new array."""
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
