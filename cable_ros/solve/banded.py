"""Compiled factorisation of symmetric banded systems with a few dense borders.

Row i, column j <= i of the matrix stands at [i, b + j - i] of an array (n, b + 1). The factorisation
A = L D L^T takes pivots as they come: their signs are the inertia, which tells minima from saddles.
"""

from __future__ import annotations

from cable_ros.compilation import njit

OPTIONS = {"cache": True, "error_model": "numpy"}


@njit(**OPTIONS)
def reach(i, order, last):
    """One past the last column that row i of the upper triangle touches: the end of its node's element."""
    return min(last, 3 * order * (i // 3 // order + 1) + 3)


@njit(**OPTIONS)
def factor(A, first, last, order, U, pivots):
    """Factor rows first..last-1 of A = L D L^T; returns (negative pivots, smallest |pivot / diagonal|).

    Row i of U receives L^T from the diagonal on: U[i, m] = L[i + m, i]. The unknowns come three a node and
    the nodes `order` an element, so that a row reaches to its element's end and no further.
    """
    band = A.shape[1] - 1
    negative = 0
    worst = 1.0
    for i in range(first, last):
        for m in range(reach(i, order, last) - i):
            U[i, m] = A[i + m, band - m]
    for i in range(first, last):
        width = reach(i, order, last) - i
        d = U[i, 0]
        pivots[i] = d
        inverse = 1.0 / d
        for m in range(1, width):
            v = U[i, m] * inverse
            for k in range(width - m):
                U[i + m, k] -= v * U[i, m + k]
        for m in range(1, width):
            U[i, m] *= inverse
        if d < 0.0:
            negative += 1
        worst = min(worst, abs(d) / (abs(A[i, band]) + 1e-300))
    return negative, worst


@njit(**OPTIONS)
def solve(U, pivots, first, last, order, x):
    """Solve L D L^T x = x in place, rows first..last-1 of x (n,)."""
    for i in range(first, last):
        v = x[i]
        for m in range(1, reach(i, order, last) - i):
            x[i + m] -= U[i, m] * v
    for i in range(last - 1, first - 1, -1):
        s = x[i] / pivots[i]
        for m in range(1, reach(i, order, last) - i):
            s -= U[i, m] * x[i + m]
        x[i] = s


@njit(**OPTIONS)
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
