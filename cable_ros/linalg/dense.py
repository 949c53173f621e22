# SPDX-License-Identifier: Apache-2.0
"""Compiled: small dense systems, by elimination as it is written.

Of a hundred unknowns at most, for which a library's threads take longer to start than the work does.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, LEAF, njit

PANEL = 4
"""Number of columns that `factor` eliminates at a time, as many as it writes out."""
GROWTH = (1.0 + np.sqrt(17.0)) / 8.0
"""Ratio of a pivot to its column below which it is not taken alone (Bunch & Kaufman 1977)."""


@njit(**INNER)
def positive(S):
    """Number of positive eigenvalues of the symmetric matrix S (n, n), of which the lower half is read.

    By the inertia of D in P S P^T = L D L^T with blocks of one or two rows (Bunch & Kaufman 1977; Golub & Van
    Loan, 4.4.4).
    """
    n = S.shape[0]
    A, w, z = S.copy(), np.empty(n), np.empty(n)
    count, k = 0, 0
    while k < n:
        size, pivot = 1, k
        if k < n - 1:
            r = k + 1
            for i in range(k + 2, n):
                if abs(A[i, k]) > abs(A[r, k]):
                    r = i
            largest = abs(A[r, k])
            if abs(A[k, k]) < GROWTH * largest:
                other = 0.0
                for j in range(k, n):
                    if j != r:
                        other = max(other, abs(A[max(r, j), min(r, j)]))
                if abs(A[k, k]) * other < GROWTH * largest**2:
                    pivot = r
                    if abs(A[r, r]) < GROWTH * other:
                        size = 2
        last = k + size - 1
        if pivot != last:
            interchange(A, k, last, pivot)
        for i in range(last + 1, n):
            w[i], z[i] = A[i, k], A[i, last]
        if size == 1:
            d = A[k, k]
            if d > 0.0:
                count += 1
            if d != 0.0:
                for i in range(k + 1, n):
                    v = w[i] / d
                    if v != 0.0:
                        for j in range(k + 1, i + 1):
                            A[i, j] -= v * w[j]
        else:
            a, b, c = A[k, k], A[k + 1, k], A[k + 1, k + 1]
            count += 1  # such a block has one eigenvalue of each sign
            det = a * c - b * b
            for i in range(k + 2, n):
                u = (w[i] * c - z[i] * b) / det
                v = (z[i] * a - w[i] * b) / det
                for j in range(k + 2, i + 1):
                    A[i, j] -= u * w[j] + v * z[j]
        k += size
    return count


@njit(**LEAF)
def interchange(A, first, p, q):
    """Exchange rows and columns p < q of a symmetric matrix, whose lower half from `first` on counts."""
    for j in range(first, p):
        A[p, j], A[q, j] = A[q, j], A[p, j]
    for j in range(p + 1, q):
        A[j, p], A[q, j] = A[q, j], A[j, p]
    for j in range(q + 1, A.shape[0]):
        A[j, p], A[j, q] = A[j, q], A[j, p]
    A[p, p], A[q, q] = A[q, q], A[p, p]


@njit(**INNER)
def factor(A, swaps):
    """Replace the matrix A (n, n) by its factors L and U, with the largest pivot of each column.

    Columns are eliminated PANEL at a time, so that what is left is read and written a quarter as often.
    swaps (n,) receives the row that came to stand in each place.

    Raises:
        LinAlgError: A is singular or not finite.
    """
    n = A.shape[0]
    for first in range(0, n, PANEL):
        last = min(first + PANEL, n)
        for k in range(first, last):
            p = k
            for i in range(k + 1, n):
                if abs(A[i, k]) > abs(A[p, k]):
                    p = i
            d = A[p, k]
            if not 0.0 < abs(d) < np.inf:
                raise np.linalg.LinAlgError("a singular matrix")
            swaps[k] = p
            if p != k:
                for j in range(n):
                    A[k, j], A[p, j] = A[p, j], A[k, j]
            for i in range(k + 1, n):
                v = A[i, k] / d
                A[i, k] = v
                for j in range(k + 1, last):
                    A[i, j] -= v * A[k, j]
        for k in range(first, last):
            for i in range(k + 1, last):
                v = A[i, k]
                for j in range(last, n):
                    A[i, j] -= v * A[k, j]
        if last == n:
            break
        r0, r1, r2, r3 = A[first, last:], A[first + 1, last:], A[first + 2, last:], A[first + 3, last:]
        for i in range(last, n):
            v0, v1, v2, v3 = A[i, first], A[i, first + 1], A[i, first + 2], A[i, first + 3]
            row = A[i, last:]
            for j in range(row.shape[0]):
                row[j] = (((row[j] - v0 * r0[j]) - v1 * r1[j]) - v2 * r2[j]) - v3 * r3[j]


@njit(**INNER)
def solve_factored(A, swaps, b, x):
    """x (n,) = A^-1 b for what `factor` made of A."""
    n = A.shape[0]
    for i in range(n):
        x[i] = b[i]
    for k in range(n):
        p = swaps[k]
        x[k], x[p] = x[p], x[k]
    for k in range(1, n):
        v = x[k]
        for j in range(k):
            v -= A[k, j] * x[j]
        x[k] = v
    for k in range(n - 1, -1, -1):
        v = x[k]
        for j in range(k + 1, n):
            v -= A[k, j] * x[j]
        x[k] = v / A[k, k]
