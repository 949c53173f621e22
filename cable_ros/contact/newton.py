# SPDX-License-Identifier: Apache-2.0
"""Compiled: from one equilibrium that touches to the next, by Newton's method on a changing active set."""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import njit
from cable_ros.contact.assembly import system
from cable_ros.contact.detection import flatten, revise
from cable_ros.contact.friction_kernels import COULOMB, FRICTIONLESS
from cable_ros.contact.interfaces import place_points
from cable_ros.contact.patches import SAMPLES, coarse, cover, fill, move_ends, shrink
from cable_ros.contact.points import FORCE, FRICTION, GRIP, HELD, KIND, POINT, ROW, SAMPLE
from cable_ros.linalg import banded
from cable_ros.linalg.bordered import (
    border_factor,
    border_solve,
    complement,
    complement_factors,
    end_coupling,
)
from cable_ros.linalg.copies import copy, copy_rows
from cable_ros.rod import quaternion
from cable_ros.rod.centreline import curve
from cable_ros.rod.warm_step import ADVANCED, NOT_CONTRACTING, NOT_CONVEX, TOO_FAR, close, largest

OPTIONS = {"cache": True, "error_model": "numpy"}

SLOW = 0.15
"""Factors that take away less than all but this part of an error are made anew."""
MOST_REVISIONS, MOST_ITERATIONS = 44, 25
"""Revisions of the set in a solve, and iterations between two of them."""
ROUNDING = 10.0
"""Steps that no longer shrink and are no longer than so many times the tolerance come of rounding."""
MOST_IN_ALL = 250
"""Iterations of a solve after which no more revisions are tried: a set that keeps changing is none."""


@njit(**OPTIONS)
def skew_factor(elastic, geometric, order, A, U, pivots, V, W, delta, rows, Y, S):
    """`border_factor` where multipliers act along W, constraints read V; says nothing about stability."""
    n = elastic.shape[0]
    for i in range(n):
        for j in range(A.shape[1]):
            A[i, j] = elastic[i, j] + geometric[i, j]
    banded.factor(A, 3, n - 3, order, U, pivots)
    complement(V, W, rows, order, U, pivots, Y, S)
    for a in range(rows):
        S[a, a] += delta[a]


@njit(**OPTIONS)
def touch(
    q, F, qe, re, f, K, kappa0, h, s0, tables, nodes, primitives, samples,
    obstacles, old_obstacles, sense, model, points, count, rows, ready, known, old_f, gaps, normals,
    elastic, geometric, parts, C, A, U, pivots, V, W, delta, lines, upto, Y, S, acc, g, radial, totals,
    tolerance, depth, give, finest, limit, drift, refresh, q_new, F_new,
):  # fmt: skip
    """From the equilibrium (q, F) with contact to the one under new conditions; see `warm_step.advance`.

    A tangent step from the old state, Newton's method on the active set, and revisions of the set until no
    point pulls and nothing is deeper inside than `depth`, beside stretches than `give`. Changes points, h and
    s0 in place. Where factors of an equilibrium with the same `rows` borders are there, `ready`, from which
    some section has turned by `drift` rad, they serve until that is more than `refresh` or no longer
    contract. `known`: the gradient at (q, F) is still there, that for the load `old_f`. Returns (code,
    iterations, count, rows, whether another mesh would hold the points better, drift; 0: factors are new).
    """
    N, gauss = tables[0], tables[4]
    order = N.shape[1] - 1
    n = 3 * q.shape[0]
    gv = g.reshape(n)
    s, b, y = np.empty(n), np.zeros(V.shape[0]), np.empty(V.shape[0])
    elements = h.shape[0]
    cells = samples.shape[0] - 1
    spacing = 1.0 / cells
    phi = np.empty((obstacles.shape[0], cells + 1))
    covered = np.empty((obstacles.shape[0], SAMPLES * elements), np.bool_)
    cover(points, count, h, s0, covered)
    c = np.empty((elements, gauss.shape[0] + 1, 3))
    old_c = np.empty_like(c)
    curve(q, h, N, primitives, old_c)
    old_h, old_s0 = h.copy(), s0.copy()
    for i in range(points.shape[0]):
        for a in range(3):
            points[i, HELD + a] = points[i, FRICTION + a]
    last = q.shape[0] - 1
    copy_rows(q, q_new)
    copy(F, F_new)
    theta = quaternion.rotation_vector(quaternion.multiply(quaternion.conjugate(q[last]), qe))
    total, size, new = 0, 0.0, 0.0
    factors, swaps = S, np.empty(0, np.int64)
    lift, moved, convex = True, False, True  # `lift`: the tangent step, which takes the end to its new place
    steady = model != COULOMB  # whether no friction's direction is part of the iteration
    holds, fresh, rate = ready, False, 0.0  # `holds`: the factors are those of the present set of points
    known = known and ready and (f == old_f).all() and (obstacles == old_obstacles).all()
    for _ in range(MOST_REVISIONS):
        if total > MOST_IN_ALL:
            return NOT_CONTRACTING, total, count, rows, moved, drift
        converged = False
        for iteration in range(MOST_ITERATIONS):
            changes = 0
            curve(q_new, h, N, primitives, c)
            if not lift:
                flattened, count = flatten(q_new, h, s0, nodes, c, spacing, obstacles, give, points, count)
                moved = not place_points(
                    q_new, h, s0, N, nodes, primitives, c, obstacles, spacing, points, count
                )
                shrunk, count = shrink(points, count, spacing, depth)
                changes, count = fill(points, count, h, s0, covered)
                changes += flattened + shrunk
            holds = holds and changes == 0
            full = not holds or (not lift and (drift > refresh or rate > SLOW))
            if not full:
                gaps[count : rows - 3] = 0.0
            borders, same, flips = 0, True, 0
            if not (lift and known):
                borders, same, flips = system(
                    q_new, F_new, f, K, kappa0, h, s0, tables, nodes, primitives, c, obstacles, old_c, old_h,
                    old_s0, old_obstacles, sense, model, lift, points, count, gaps, normals,
                    acc, g, radial, totals, elastic, geometric, parts, C, V, W, delta, lines, upto, full,
                )  # fmt: skip
            if not full and (flips > 0 or (not lift and not same)):
                full = True
                borders, same, _ = system(
                    q_new, F_new, f, K, kappa0, h, s0, tables, nodes, primitives, c, obstacles, old_c, old_h,
                    old_s0, old_obstacles, sense, model, lift, points, count, gaps, normals,
                    acc, g, radial, totals, elastic, geometric, parts, C, V, W, delta, lines, upto, full,
                )  # fmt: skip
            changes += flips
            if full:
                rows, holds, fresh, drift = borders, True, True, 0.0
                steady = same or model != COULOMB
            if full and same:
                convex = border_factor(
                    elastic, geometric, 0.0, order, A, U, pivots, V, delta, rows, 3 + count, Y, S
                )
            elif full:
                skew_factor(elastic, geometric, order, A, U, pivots, V, W, delta, rows, Y, S)
            if full or swaps.shape[0] != rows:
                factors, swaps = complement_factors(S, rows)
            b[:] = 0.0
            for a in range(3):
                b[a] = totals[a] - re[a]
            for i in range(3, rows):
                b[i] = gaps[i - 3]
            if lift:
                end_coupling(elastic, geometric, V, rows, theta, gv, b)
            border_solve(gv, b, V, rows, order, U, pivots, Y, factors, swaps, s, y)
            if lift:
                for k in range(3):
                    s[n - 3 + k] = theta[k]
            new = largest(s)
            if not new <= limit:
                return TOO_FAR, total, count, rows, moved, drift
            drift += new
            quaternion.retract(q_new, s, q_new)
            close(q_new, qe)
            scale, change, couple = 1e-3, 0.0, 0.0
            for a in range(3):
                F_new[a] += y[a]
                scale = max(scale, abs(F_new[a]))
                change = max(change, abs(y[a]))
            for i in range(count):
                points[i, FORCE] += y[3 + i]
                k = int(points[i, GRIP])
                if k > 0:
                    for a in range(3):
                        points[i, FRICTION + a] += y[k] * lines[k, a] + y[k + 1] * lines[k + 1, a]
                if points[i, KIND] != SAMPLE:
                    change = max(change, abs(y[3 + i]))
                # the couple is the force times the way that its place has still to go
                if points[i, KIND] == POINT and points[i, ROW] > 0.0:
                    couple = max(couple, abs(y[int(points[i, ROW])]))
            shape = max(new, couple / scale, move_ends(points, count, y, spacing))
            new = max(shape, change / scale)
            if not lift:
                total += 1
                rate = max(min(new / size, 1.0) if iteration > 0 and size > 0.0 else 0.1, drift)
                # friction's direction may be held less stiffly than its border says
                trusted = rate if steady or full else max(rate, 0.5)
                if changes == 0 and (new * trusted <= tolerance or new < 1e-13):
                    converged = True
                    break
                stays = same and steady and changes == 0 and iteration > 4 and new > 0.9 * size
                if stays and shape <= ROUNDING * tolerance:
                    # the shape hardly tells how places side by side share their force
                    new, converged = shape, True
                    break
                if iteration > 12 and new > 0.9 * size and model == FRICTIONLESS:
                    return NOT_CONTRACTING, total, count, rows, moved, drift
            lift = False
            size = new
        if not converged:
            return NOT_CONTRACTING, total, count, rows, moved, drift
        # what is left of the iteration is nothing that sinks in
        left = depth + new * rate
        changed, count = revise(
            q_new, h, s0, N, nodes, primitives, c, samples, spacing, obstacles, left, left - depth + give,
            points, count, phi,
        )  # fmt: skip
        if not changed:
            moved = moved or coarse(points, count, h, s0, finest)
            if not convex and model == FRICTIONLESS:
                return NOT_CONVEX, total, count, rows, moved, drift
            system(
                q_new, F_new, f, K, kappa0, h, s0, tables, nodes, primitives, c, obstacles, old_c, old_h,
                old_s0, old_obstacles, sense, model, False, points, count, gaps, normals,
                acc, g, radial, totals, elastic, geometric, parts, C, V, W, delta, lines, upto, False,
            )  # fmt: skip
            return ADVANCED, total, count, rows, moved, 0.0 if fresh else drift
        size, rate, holds = 0.0, 0.0, False
    return NOT_CONTRACTING, total, count, rows, moved, drift
