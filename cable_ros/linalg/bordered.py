# SPDX-License-Identifier: Apache-2.0
"""Compiled: the saddle system of the rod's Hessian and its conditions, factored once and solved often.

The Hessian is banded; the end position's derivative and whatever else holds the rod are a few dense borders.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import LEAF, njit
from cable_ros.linalg import banded, dense

OPTIONS = {"cache": True, "error_model": "numpy"}

NEUTRAL = 1e-6
"""Part of the elastic stiffness that is always added to the Hessian: an equilibrium that may turn freely, as
that of a round weightless rod about the line of its clamps, then counts as stable, and can be followed."""


@njit(**LEAF)
def solve3(S, b, x):
    """x = S^-1 b for the symmetric 3 x 3 matrix S, by elimination with the largest pivot."""
    r0 = S[0, 0], S[0, 1], S[0, 2], b[0]
    r1 = S[1, 0], S[1, 1], S[1, 2], b[1]
    r2 = S[2, 0], S[2, 1], S[2, 2], b[2]
    if abs(r1[0]) > abs(r0[0]):
        r0, r1 = r1, r0
    if abs(r2[0]) > abs(r0[0]):
        r0, r2 = r2, r0
    v = r1[0] / r0[0]
    s1 = r1[1] - v * r0[1], r1[2] - v * r0[2], r1[3] - v * r0[3]
    v = r2[0] / r0[0]
    s2 = r2[1] - v * r0[1], r2[2] - v * r0[2], r2[3] - v * r0[3]
    if abs(s2[0]) > abs(s1[0]):
        s1, s2 = s2, s1
    v = s2[0] / s1[0]
    x[2] = (s2[2] - v * s1[2]) / (s2[1] - v * s1[1])
    x[1] = (s1[2] - s1[1] * x[2]) / s1[0]
    x[0] = (r0[3] - r0[1] * x[1] - r0[2] * x[2]) / r0[0]


@njit(**LEAF)
def inner(v, s):
    """v.s at the inner nodes, of two vectors (3n,)."""
    out = 0.0
    for i in range(3, s.shape[0] - 3, 3):
        out += v[i] * s[i] + v[i + 1] * s[i + 1] + v[i + 2] * s[i + 2]
    return out


@njit(**LEAF)
def relax(g, order, U, pivots, s):
    """s = -H^-1 g (3n,) at the inner nodes, 0 at the ends."""
    n = s.shape[0]
    for i in range(n):
        s[i] = -g[i] if 3 <= i < n - 3 else 0.0
    banded.solve(U, pivots, 3, n - 3, order, s)


@njit(**LEAF)
def missing(c, V, rows, s, b):
    """b = -c - V s for the first rows."""
    for a in range(rows):
        b[a] = -c[a] - inner(V[a], s)


@njit(**LEAF)
def respond(Y, rows, y, s):
    """Add Y^T y of the first rows to s (3n,) at the inner nodes."""
    n = s.shape[0]
    free = s[3 : n - 3]
    for a in range(rows):
        v, row = y[a], Y[a, 3 : n - 3]
        for i in range(free.shape[0]):
            free[i] += row[i] * v


@njit(**LEAF)
def negative3(S):
    """Number of negative eigenvalues of the symmetric 3 x 3 matrix S, from its characteristic polynomial."""
    trace = S[0, 0] + S[1, 1] + S[2, 2]
    minors = (
        (S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0])
        + (S[0, 0] * S[2, 2] - S[0, 2] * S[2, 0])
        + (S[1, 1] * S[2, 2] - S[1, 2] * S[2, 1])
    )
    det = (
        S[0, 0] * (S[1, 1] * S[2, 2] - S[1, 2] * S[2, 1])
        - S[0, 1] * (S[1, 0] * S[2, 2] - S[1, 2] * S[2, 0])
        + S[0, 2] * (S[1, 0] * S[2, 1] - S[1, 1] * S[2, 0])
    )
    # all roots are real, so Descartes' rule counts the positive ones exactly
    count, last = 0, 1.0
    for v in (-trace, minors, -det):
        if v * last < 0.0:
            count += 1
        if v != 0.0:
            last = v
    return 3 - count


@njit(**LEAF)
def schur(elastic, geometric, C, mu, order, A, L, pivots, Y, S):
    """Factor H + mu D and form S = C (H + mu D)^-1 C^T.

    Returns the number of negative eigenvalues of H + mu D and the pivots' worst quality.
    """
    n = A.shape[0]
    for i in range(n):
        for j in range(A.shape[1]):
            A[i, j] = (1.0 + NEUTRAL + mu) * elastic[i, j] + geometric[i, j]
    negative, worst = banded.factor(A, 3, n - 3, order, L, pivots)
    for a in range(3):
        for i in range(n):
            Y[a, i] = C[a, i] if 3 <= i < n - 3 else 0.0
        banded.solve(L, pivots, 3, n - 3, order, Y[a])
    for a in range(3):
        for b in range(a + 1):
            S[a, b] = inner(C[a], Y[b])
            S[b, a] = S[a, b]
    return negative, worst


@njit(**LEAF)
def factor(elastic, geometric, C, mu, order, A, L, pivots, Y, S):
    """Factor the saddle system of H + mu D; whether that is positive on the end condition's tangent space.

    The matrix has the inertia of H + mu D and that of -S together; a strict minimum has three negative
    eigenvalues in all (Gould 1985).
    """
    negative, worst = schur(elastic, geometric, C, mu, order, A, L, pivots, Y, S)
    return worst > 1e-11 and negative3(S) == negative


@njit(**LEAF)
def saddle_step(g, c, C, order, L, pivots, Y, S, s, dF):
    """s (3n,), dF (3,) with H s - C^T dF = -g, C s = -c at the inner nodes; s = 0 at the ends."""
    relax(g, order, L, pivots, s)
    missing(c, C, 3, s, dF)
    solve3(S, dF, dF)
    respond(Y, 3, dF, s)


@njit(**OPTIONS)
def border_factor(elastic, geometric, mu, order, A, U, pivots, V, delta, rows, equalities, Y, S):
    """`factor` with more borders: form their Schur complement S; whether the whole is a strict minimum.

    With H' = H + mu D + sum v v^T / delta over the rows of V beyond the equalities, the bordered matrix has
    as many negative eigenvalues as there are equalities and positive deltas exactly where H' is positive on
    the equalities' tangent space. A row with delta 0 is an equality, too.
    """
    n = elastic.shape[0]
    for i in range(n):
        for j in range(A.shape[1]):
            A[i, j] = (1.0 + NEUTRAL + mu) * elastic[i, j] + geometric[i, j]
    negative, worst = banded.factor(A, 3, n - 3, order, U, pivots)
    expected = equalities
    complement(V, V, rows, order, U, pivots, Y, S)
    for a in range(rows):
        for b in range(a):
            S[b, a] = S[a, b]
        S[a, a] += delta[a]
        if a >= equalities and delta[a] >= 0.0:
            expected += 1
    return worst > 1e-11 and negative + dense.positive(S[:rows, :rows]) == expected


@njit(**OPTIONS)
def complement(V, W, rows, order, U, pivots, Y, S):
    """Y (rows, 3n) = H^-1 W^T and S = V H^-1 W^T at the inner nodes, from the factors U of H."""
    n = U.shape[0]
    X = np.empty((n, rows))
    for i in range(n):
        for a in range(rows):
            X[i, a] = W[a, i]
    banded.solve_all(U, pivots, 3, n - 3, order, X)
    S[:rows, :rows] = 0.0
    # for what is nearer to the start clamp a border reads nothing of what comes later
    for a in range(rows):
        for i in range(3, n - 3):
            v = V[a, i]
            if v != 0.0:
                for b in range(rows):
                    S[a, b] += v * X[i, b]
    for a in range(rows):
        for i in range(n):
            Y[a, i] = X[i, a] if 3 <= i < n - 3 else 0.0


@njit(**OPTIONS)
def complement_factors(S, rows):
    """What `border_solve` needs of the complement S: its factors and their swaps, of three rows itself."""
    swaps = np.empty(rows, np.int64)
    if rows == 3:
        return S, swaps
    factors = S[:rows, :rows].copy()
    dense.factor(factors, swaps)
    return factors, swaps


@njit(**OPTIONS)
def border_solve(g, c, V, rows, order, U, pivots, Y, factors, swaps, s, y):
    """`border_step` with what `complement_factors` made of the complement."""
    b = np.empty(rows)
    relax(g, order, U, pivots, s)
    missing(c, V, rows, s, b)
    if rows == 3:
        solve3(factors, b, y)
    else:
        dense.solve_factored(factors, swaps, b, y)
    respond(Y, rows, y, s)


@njit(**OPTIONS)
def border_step(g, c, V, rows, order, U, pivots, Y, S, s, y):
    """s (3n,), y (rows,) with H s - V^T y = -g, V s + delta y = -c; s = 0 at the ends."""
    factors, swaps = complement_factors(S, rows)
    border_solve(g, c, V, rows, order, U, pivots, Y, factors, swaps, s, y)


@njit(**LEAF)
def end_coupling(elastic, geometric, V, rows, theta, g, c):
    """Add to g (3n,) and c (rows,) what turning the end section by theta (3,) does to them."""
    n, band = elastic.shape[0], elastic.shape[1] - 1
    for k in range(3):
        row = n - 3 + k
        for j in range(row - band, n - 3):
            at = band + j - row
            g[j] += (elastic[row, at] + geometric[row, at]) * theta[k]
        for a in range(rows):
            c[a] += V[a, row] * theta[k]


@njit(**OPTIONS)
def end_rows(elastic, geometric, V, rows, s, dF):
    """What the step (s, dF), s = 0 at the end, adds to the gradient at the end node: (3,)."""
    n, band = elastic.shape[0], elastic.shape[1] - 1
    out = np.zeros(3)
    for k in range(3):
        row = n - 3 + k
        for j in range(row - band, n - 3):
            at = band + j - row
            out[k] += (elastic[row, at] + geometric[row, at]) * s[j]
        for a in range(rows):
            out[k] -= V[a, row] * dF[a]
    return out
