# SPDX-License-Identifier: Apache-2.0
"""Compiled: how all contact points share friction, in the linearised equilibrium, whatever each did before.

Where a patch slips this way and that, an active set does not find out which samples stick: each that changes
moves its neighbours' friction by more than they can hold. With the normal forces of the last iteration the
friction t of all points is the minimum of t.W t / 2 - r.t with |t_i| <= mu lambda_i: W is how far the points
yield to it, stick included, and an interior point finds it (`solve.discs`). A cable that would buckle but for
friction has no such minimum.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, njit
from cable_ros.contact.distance import FRICTION_COEFFICIENT
from cable_ros.contact.friction_kernels import ROUNDING
from cable_ros.contact.points import FORCE, FRICTION, OBSTACLE, SLIPS, STICK_ROW
from cable_ros.linalg import dense
from cable_ros.linalg.copies import copy
from cable_ros.solve.discs import minimum

SETTLING = 8
"""Maximum number of iterations of Newton's method from what an interior point comes close to."""
FARTHEST = 1.0
"""Maximum change in one, over the largest possible friction."""
SETTLED = 1e-6
"""Its maximum change in the last one, over the largest possible friction."""
NOTHING = 1e-9
"""Fraction of the largest possible friction of a point below which another one has none."""


@njit(**INNER)
def share_friction(S, right, contacts, count, lines, obstacles, y):
    """The multipliers of a step with friction within its cones; points are marked as sticking or slipping.

    Args:
        S: (rows or more, rows or more) complement of all constraint rows, each rough point's two of stick
            among them.
        right: (rows,) right-hand side of its equations.
        contacts, count: `ContactSet` and the number of its points, SLIPS of which is overwritten.
        lines: (rows, 3) of `ConstraintRows`.
        obstacles: (o, WIDTH).
        y: (rows or more,) receives the multipliers.

    Returns:
        Whether friction was found; if not, y is not changed.

    Raises:
        LinAlgError: the complement is singular.
    """
    points, rows = contacts.points, right.shape[0]
    rough = np.flatnonzero(points[:count, STICK_ROW] > 0.0)
    k = rough.shape[0]
    others, own = np.ones(rows, np.bool_), np.empty(2 * k, np.int64)
    for j in range(k):
        b = int(points[rough[j], STICK_ROW])
        own[2 * j], own[2 * j + 1] = b, b + 1
        others[b] = others[b + 1] = False
    rest = np.flatnonzero(others)
    W, r, by_friction, without = yielding(S, right, rest, own)
    # the rows of the normals come before those of stick, so that they are at the same places in `rest`
    normals, give = points[rough, FORCE] + without[3 + rough], by_friction[3 + rough]
    mu = obstacles[points[rough, OBSTACLE].astype(np.int64), FRICTION_COEFFICIENT]
    before, after, slips = np.empty(2 * k), np.zeros(2 * k), np.ones(k, np.bool_)
    for j in range(k):
        i = rough[j]
        for d in range(2):
            v = 0.0
            for a in range(3):
                v += points[i, FRICTION + a] * lines[own[2 * j + d], a]
            before[2 * j + d] = v
    if not within_cones(W, r, before, mu * np.maximum(normals, 0.0), after, slips):
        return False
    settle(W, r, before, (mu, normals, give), after, slips)
    for j in range(k):
        points[rough[j], SLIPS] = 1.0 if slips[j] else 0.0
    for i in range(2 * k):
        y[own[i]] = after[i] - before[i]
    for a in range(rest.shape[0]):
        v = without[a]
        for i in range(2 * k):
            v -= by_friction[a, i] * y[own[i]]
        y[rest[a]] = v
    return True


@njit(**INNER)
def yielding(S, right, rest, own):
    """How the points yield to changes of friction, the other rows eliminated.

    Args:
        S, right: as in `share_friction`.
        rest: (n,) numbers of the other rows.
        own: (2 k,) numbers of the rows of stick.

    Returns:
        W (2 k, 2 k) and r (2 k,) of W y = r for what sticks; by how much less the multipliers of the other
        rows are by each change (n, 2 k), and these without any (n,).
    """
    n, k = rest.shape[0], own.shape[0]
    A, swaps = np.empty((n, n)), np.empty(n, np.int64)
    for a in range(n):
        for c in range(n):
            A[a, c] = S[rest[a], rest[c]]
    dense.factor(A, swaps)
    column, solved = np.empty(n), np.empty(n)
    by_friction, without = np.empty((n, k)), np.empty(n)
    for a in range(n):
        column[a] = right[rest[a]]
    dense.solve_factored(A, swaps, column, without)
    for i in range(k):
        for a in range(n):
            column[a] = S[rest[a], own[i]]
        dense.solve_factored(A, swaps, column, solved)
        for a in range(n):
            by_friction[a, i] = solved[a]
    W, r = np.empty((k, k)), np.empty(k)
    for i in range(k):
        r[i] = right[own[i]]
        for j in range(k):
            W[i, j] = S[own[i], own[j]]
        for a in range(n):
            v = S[own[i], rest[a]]
            r[i] -= v * without[a]
            for j in range(k):
                W[i, j] -= v * by_friction[a, j]
    for i in range(k):
        for j in range(i):
            W[i, j] = W[j, i] = 0.5 * (W[i, j] + W[j, i])
    return W, r, by_friction, without


@njit(**INNER)
def within_cones(W, r, before, cones, after, slips):
    """Friction within the cones.

    Args:
        W, r: of `yielding`.
        before: (2 k,) friction of the last iteration.
        cones: (k,) largest possible friction.
        after: (2 k,) receives the new friction, zeros before.
        slips: (k,) which points slip, True before.

    Returns:
        Whether it was found.
    """
    largest = 0.0
    for cone in cones:
        largest = max(largest, cone)
    live = np.flatnonzero(cones > NOTHING * largest)
    n = 2 * live.shape[0]
    if n == 0:
        return True
    # in units of each point's cone
    A, b, x, multipliers = np.empty((n, n)), np.empty(n), np.empty(n), np.empty(live.shape[0])
    for p in range(n):
        i, cone = 2 * live[p // 2] + p % 2, cones[live[p // 2]]
        v = r[i]
        for j in range(before.shape[0]):
            v += W[i, j] * before[j]
        b[p], x[p] = cone * v, before[i] / cone
        for q in range(n):
            A[p, q] = cone * W[i, 2 * live[q // 2] + q % 2] * cones[live[q // 2]]
    if not minimum(A, b, x, multipliers):
        return False
    mean = np.mean(multipliers)
    for p in range(live.shape[0]):
        j, u, v = live[p], x[2 * p], x[2 * p + 1]
        after[2 * j], after[2 * j + 1] = cones[j] * u, cones[j] * v
        # of slack and multiplier the smaller one is what is left of the iteration
        slips[j] = (1.0 - np.hypot(u, v)) * mean < multipliers[p]
    return True


@njit(**INNER)
def settle(W, r, before, normal, after, slips):
    """Solve for friction to the last digit, with what it does to the normal forces; whether that settles.

    Of a point whose friction is small beside that of others the interior point tells the direction of slip
    to a few digits only.

    Args:
        W, r, before: as in `within_cones`.
        normal: (k,) coefficients of friction, (k,) normal forces without a change of friction, and (k, 2 k)
            by how much less they are by each.
        after: (2 k,) friction, overwritten if it settles.
        slips: (k,) which points slip, overwritten as well.
    """
    mu, _, give = normal
    k = slips.shape[0]
    n = 2 * k
    t, side, M, g, d = after.copy(), slips.copy(), np.empty((n, n)), np.empty(n), np.empty(n)
    e, cones, swaps = np.empty(n), np.empty(k), np.empty(n, np.int64)
    misfits(W, r, before, normal, t, e, cones)
    for _ in range(SETTLING):
        for j in range(k):
            p, q = 2 * j, 2 * j + 1
            size = np.hypot(t[p], t[q])
            for c in range(n):
                M[p, c], M[q, c] = W[p, c], W[q, c]
            g[p], g[q] = -e[p], -e[q]
            if side[j] and (size == 0.0 or cones[j] <= 0.0):
                M[p], M[q], g[p], g[q] = 0.0, 0.0, -t[p], -t[q]
                M[p, p] = M[q, q] = 1.0
            elif side[j]:
                # along the friction it is as large as its cone, across it the misfit is along the friction
                u, v = t[p] / size, t[q] / size
                stiffness = -(e[p] * u + e[q] * v) / size
                for c in range(n):
                    M[p, c], M[q, c] = mu[j] * give[j, c], u * W[q, c] - v * W[p, c]
                M[p, p] += u
                M[p, q] += v
                M[q, p] -= v * stiffness
                M[q, q] += u * stiffness
                g[p], g[q] = cones[j] - size, v * e[p] - u * e[q]
        dense.factor(M, swaps)
        dense.solve_factored(M, swaps, g, d)
        change, changed = 0.0, False
        for c in range(n):
            t[c] += d[c]
            change = max(change, abs(d[c]))
        largest = misfits(W, r, before, normal, t, e, cones)
        for j in range(k):
            p, q = 2 * j, 2 * j + 1
            size, cone = np.hypot(t[p], t[q]), max(cones[j], 0.0)
            slides = size > (1.0 + ROUNDING) * cone
            if side[j] and size > 0.0:
                goes_on = t[p] * (t[p] - d[p]) + t[q] * (t[q] - d[q]) >= 0.0
                slides = goes_on and e[p] * t[p] + e[q] * t[q] <= 0.0
            elif side[j]:
                slides = True
            changed = changed or slides != side[j]
            side[j] = slides
        if not changed and change <= SETTLED * largest:
            copy(t, after)
            copy(side, slips)
            return True
        if not change <= FARTHEST * largest:
            return False
    return False


@njit(**INNER)
def misfits(W, r, before, normal, t, e, cones):
    """How far the springs of stick are off under the friction t (2 k,), and the cones.

    Args:
        W, r, before, normal, t: as in `settle`.
        e: (2 k,) receives W (t - before) - r.
        cones: (k,) receives the largest possible friction; negative where a point pulls.

    Returns:
        The largest of the cones.
    """
    mu, normals, give = normal
    largest = 0.0
    for j in range(cones.shape[0]):
        force = normals[j]
        for c in range(t.shape[0]):
            force -= give[j, c] * (t[c] - before[c])
        cones[j] = mu[j] * force
        largest = max(largest, cones[j])
    for i in range(t.shape[0]):
        e[i] = -r[i]
        for c in range(t.shape[0]):
            e[i] += W[i, c] * (t[c] - before[c])
    return largest
