"""Compiled: the saddle system of the rod's Hessian and its conditions, factored once and solved often.

The Hessian is banded; the end position's derivative and whatever else holds the rod are a few dense borders.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import njit
from cable_ros.solve import banded

OPTIONS = {"cache": True, "error_model": "numpy"}

NEUTRAL = 1e-6
"""Part of the elastic stiffness that is always added to the Hessian: an equilibrium that may turn freely, as
that of a round weightless rod about the line of its clamps, then counts as stable, and can be followed."""


@njit(**OPTIONS)
def solve3(S, b, x):
    """x = S^-1 b for the symmetric 3 x 3 matrix S, by elimination with the largest pivot."""
    M = np.empty((3, 4))
    for i in range(3):
        for j in range(3):
            M[i, j] = S[i, j]
        M[i, 3] = b[i]
    for k in range(3):
        p = k
        for i in range(k + 1, 3):
            if abs(M[i, k]) > abs(M[p, k]):
                p = i
        for j in range(4):
            M[k, j], M[p, j] = M[p, j], M[k, j]
        for i in range(k + 1, 3):
            v = M[i, k] / M[k, k]
            for j in range(k, 4):
                M[i, j] -= v * M[k, j]
    for k in range(2, -1, -1):
        v = M[k, 3]
        for j in range(k + 1, 3):
            v -= M[k, j] * x[j]
        x[k] = v / M[k, k]


@njit(**OPTIONS)
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


@njit(**OPTIONS)
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
            s = 0.0
            for i in range(3, n - 3):
                s += C[a, i] * Y[b, i]
            S[a, b] = s
            S[b, a] = s
    return negative, worst


@njit(**OPTIONS)
def factor(elastic, geometric, C, mu, order, A, L, pivots, Y, S):
    """Factor the saddle system of H + mu D; whether that is positive on the end condition's tangent space.

    The matrix has the inertia of H + mu D and that of -S together; a strict minimum has three negative
    eigenvalues in all (Gould 1985).
    """
    negative, worst = schur(elastic, geometric, C, mu, order, A, L, pivots, Y, S)
    return worst > 1e-11 and negative3(S) == negative


@njit(**OPTIONS)
def saddle_step(g, c, C, order, L, pivots, Y, S, s, dF):
    """s (3n,), dF (3,) with H s - C^T dF = -g, C s = -c at the inner nodes; s = 0 at the ends."""
    n = s.shape[0]
    for i in range(n):
        s[i] = -g[i] if 3 <= i < n - 3 else 0.0
    banded.solve(L, pivots, 3, n - 3, order, s)
    b = np.empty(3)
    for a in range(3):
        v = -c[a]
        for i in range(3, n - 3):
            v -= C[a, i] * s[i]
        b[a] = v
    solve3(S, b, dF)
    for i in range(3, n - 3):
        s[i] += Y[0, i] * dF[0] + Y[1, i] * dF[1] + Y[2, i] * dF[2]


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
    for a in range(rows):
        for i in range(n):
            Y[a, i] = V[a, i] if 3 <= i < n - 3 else 0.0
        banded.solve(U, pivots, 3, n - 3, order, Y[a])
    for a in range(rows):
        for b in range(a + 1):
            s = 0.0
            for i in range(3, n - 3):
                s += V[a, i] * Y[b, i]
            S[a, b] = s
            S[b, a] = s
        S[a, a] += delta[a]
        if a >= equalities and delta[a] >= 0.0:
            expected += 1
    positive = 0
    for v in np.linalg.eigvalsh(S[:rows, :rows]):
        if v > 0.0:
            positive += 1
    return worst > 1e-11 and negative + positive == expected


@njit(**OPTIONS)
def border_step(g, c, V, rows, order, U, pivots, Y, S, s, y):
    """s (3n,), y (rows,) with H s - V^T y = -g, V s + delta y = -c; s = 0 at the ends."""
    n = s.shape[0]
    for i in range(n):
        s[i] = -g[i] if 3 <= i < n - 3 else 0.0
    banded.solve(U, pivots, 3, n - 3, order, s)
    b = np.empty(rows)
    for a in range(rows):
        v = -c[a]
        for i in range(3, n - 3):
            v -= V[a, i] * s[i]
        b[a] = v
    if rows == 3:
        solve3(S, b, y)
    else:
        y[:rows] = np.linalg.solve(S[:rows, :rows], b)
    for a in range(rows):
        for i in range(3, n - 3):
            s[i] += Y[a, i] * y[a]


@njit(**OPTIONS)
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
