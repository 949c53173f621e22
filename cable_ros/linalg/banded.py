# SPDX-License-Identifier: Apache-2.0
"""Compiled factorisation of symmetric banded systems with a few dense constraint rows.

Row i, column j <= i of the matrix stands at [i, b + j - i] of an array (n, b + 1). The factorisation
A = L D L^T takes pivots as they come: their signs are the inertia, which tells minima from saddles.
"""

from __future__ import annotations

from cable_ros.compilation import LEAF, LEAF_ENTRY, njit


@njit(**LEAF)
def reach(i, order, last):
    """One past the last column that row i of the upper triangle touches: the end of its node's element."""
    return min(last, 3 * order * (i // 3 // order + 1) + 3)


@njit(**LEAF_ENTRY)
def factor(A, first, last, order, U, pivots):
    """Factor rows first..last-1 of A = L D L^T; returns (negative pivots, smallest |pivot / diagonal|).

    Row i of U receives L^T from the diagonal on: U[i, m] = L[i + m, i]. The unknowns come three a node and
    the nodes `order` an element, so that a row reaches to its element's end and no further; `first` and
    `last` are whole nodes, which are eliminated one after the other.
    """
    band = A.shape[1] - 1
    negative = 0
    worst = 1.0
    for i in range(first, last):
        for m in range(reach(i, order, last) - i):
            U[i, m] = A[i + m, band - m]
    for i in range(first, last, 3):
        end = reach(i, order, last)
        d0 = U[i, 0]
        v0 = U[i, 1] / d0
        for k in range(end - i - 1):
            U[i + 1, k] -= v0 * U[i, 1 + k]
        d1 = U[i + 1, 0]
        v0, v1 = U[i, 2] / d0, U[i + 1, 1] / d1
        for k in range(end - i - 2):
            U[i + 2, k] -= v0 * U[i, 2 + k] + v1 * U[i + 1, 1 + k]
        d2 = U[i + 2, 0]
        for m in range(3, end - i):
            v0, v1, v2 = U[i, m] / d0, U[i + 1, m - 1] / d1, U[i + 2, m - 2] / d2
            for k in range(end - i - m):
                U[i + m, k] -= v0 * U[i, m + k] + v1 * U[i + 1, m - 1 + k] + v2 * U[i + 2, m - 2 + k]
        for j in range(i, i + 3):
            d = U[j, 0]
            pivots[j] = d
            inverse = 1.0 / d
            for m in range(1, end - j):
                U[j, m] *= inverse
            if d < 0.0:
                negative += 1
            worst = min(worst, abs(d) / (abs(A[j, band]) + 1e-300))
    return negative, worst


@njit(**LEAF_ENTRY)
def solve(U, pivots, first, last, order, x):
    """Solve L D L^T x = x in place, rows first..last-1 of x (n,); node by node, as `factor`."""
    for i in range(first, last, 3):
        v0 = x[i]
        v1 = x[i + 1] - U[i, 1] * v0
        v2 = x[i + 2] - U[i, 2] * v0 - U[i + 1, 1] * v1
        x[i + 1], x[i + 2] = v1, v2
        y, r0, r1, r2 = x[i + 3 : reach(i, order, last)], U[i, 3:], U[i + 1, 2:], U[i + 2, 1:]
        for k in range(y.shape[0]):
            y[k] -= r0[k] * v0 + r1[k] * v1 + r2[k] * v2
    for i in range(first, last):
        x[i] /= pivots[i]
    for i in range(last - 3, first - 1, -3):
        v0, v1, v2 = x[i], x[i + 1], x[i + 2]
        y, r0, r1, r2 = x[i + 3 : reach(i, order, last)], U[i, 3:], U[i + 1, 2:], U[i + 2, 1:]
        for k in range(0, y.shape[0], 3):
            v0 -= r0[k] * y[k] + r0[k + 1] * y[k + 1] + r0[k + 2] * y[k + 2]
            v1 -= r1[k] * y[k] + r1[k + 1] * y[k + 1] + r1[k + 2] * y[k + 2]
            v2 -= r2[k] * y[k] + r2[k + 1] * y[k + 1] + r2[k + 2] * y[k + 2]
        v1 -= U[i + 1, 1] * v2
        x[i], x[i + 1], x[i + 2] = v0 - U[i, 1] * v1 - U[i, 2] * v2, v1, v2


@njit(**LEAF)
def solve_all(U, pivots, first, last, order, X):
    """`solve` for each column of X (n, k) in place, all columns side by side."""
    columns = X.shape[1]
    for i in range(first, last, 3):
        end = reach(i, order, last) - i
        for k in range(columns):
            v0 = X[i, k]
            v1 = X[i + 1, k] - U[i, 1] * v0
            X[i + 2, k] = X[i + 2, k] - U[i, 2] * v0 - U[i + 1, 1] * v1
            X[i + 1, k] = v1
        for m in range(3, end):
            u0, u1, u2 = U[i, m], U[i + 1, m - 1], U[i + 2, m - 2]
            for k in range(columns):
                X[i + m, k] -= u0 * X[i, k] + u1 * X[i + 1, k] + u2 * X[i + 2, k]
    for i in range(first, last):
        for k in range(columns):
            X[i, k] /= pivots[i]
    for i in range(last - 3, first - 1, -3):
        for m in range(3, reach(i, order, last) - i):
            u0, u1, u2 = U[i, m], U[i + 1, m - 1], U[i + 2, m - 2]
            for k in range(columns):
                v = X[i + m, k]
                X[i, k] -= u0 * v
                X[i + 1, k] -= u1 * v
                X[i + 2, k] -= u2 * v
        for k in range(columns):
            v1 = X[i + 1, k] - U[i + 1, 1] * X[i + 2, k]
            X[i, k] = X[i, k] - U[i, 1] * v1 - U[i, 2] * X[i + 2, k]
            X[i + 1, k] = v1


@njit(**LEAF_ENTRY)
def multiply(A, x, y):
    """y = A x for the symmetric banded A, vectors (n,)."""
    band = A.shape[1] - 1
    y[:] = 0.0
    for i in range(x.shape[0]):
        low = max(0, i - band)
        xi = x[i]
        s = A[i, band] * xi
        for j in range(low, i):
            a = A[i, band + j - i]
            s += a * x[j]
            y[j] += a * xi
        y[i] += s
