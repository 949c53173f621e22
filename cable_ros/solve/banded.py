"""Compiled factorisation of symmetric banded systems with a few dense borders.

Row i, column j <= i of the matrix stands at [i, b + j - i] of an array (n, b + 1). The factorisation
A = L D L^T takes pivots as they come: their signs are the inertia, which tells minima from saddles.
"""

from __future__ import annotations

import numpy as np
from numba import njit

OPTIONS = {"cache": True, "fastmath": {"contract", "reassoc", "nsz", "arcp"}, "error_model": "numpy"}


@njit(**OPTIONS)
def factor(A, first, last, order, L, pivots):
    """Factor rows first..last-1 of the banded A = L D L^T; returns (negative pivots, smallest |pivot / diagonal|).

    The unknowns come three a node and the nodes `order` an element: a row reaches back to its element's first node.
    """
    band = A.shape[1] - 1
    negative = 0
    worst = 1.0
    for i in range(first, last):
        low = max(first, 3 * order * ((i // 3 - 1) // order))
        d = A[i, band]
        for j in range(low, i):
            s = A[i, band + j - i]
            for k in range(max(low, 3 * order * ((j // 3 - 1) // order)), j):
                s -= L[i, band + k - i] * L[j, band + k - j]
            L[i, band + j - i] = s  # still times the pivot of j, as the products of this row need it
        for j in range(low, i):
            s = L[i, band + j - i]
            v = s / pivots[j]
            L[i, band + j - i] = v
            d -= s * v
        pivots[i] = d
        if d < 0.0:
            negative += 1
        worst = min(worst, abs(d) / (abs(A[i, band]) + 1e-300))
    return negative, worst


@njit(**OPTIONS)
def solve(L, pivots, first, last, order, x):
    """Solve L D L^T x = x in place, rows first..last-1 of x (n,)."""
    band = L.shape[1] - 1
    for i in range(first, last):
        s = x[i]
        for j in range(max(first, 3 * order * ((i // 3 - 1) // order)), i):
            s -= L[i, band + j - i] * x[j]
        x[i] = s
    for i in range(first, last):
        x[i] /= pivots[i]
    for i in range(last - 1, first - 1, -1):
        s = x[i]
        for j in range(max(first, 3 * order * ((i // 3 - 1) // order)), i):
            x[j] -= L[i, band + j - i] * s


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


@njit(**OPTIONS)
def negative_eigenvalues(S):
    """How many eigenvalues of the small symmetric S are negative."""
    return int(np.sum(np.linalg.eigvalsh(S) < 0.0))
