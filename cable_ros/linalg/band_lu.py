# SPDX-License-Identifier: Apache-2.0
"""Compiled LU factorisation of a banded matrix with row pivoting.

Row i, column j of the matrix stands at [i, lower + j - i] of an array (n, 3 lower + 1): equal bandwidths
below and above the diagonal, and as many columns more for what pivoting fills in.
"""

from __future__ import annotations

from cable_ros.compilation import LEAF_ENTRY, njit


@njit(**LEAF_ENTRY)
def band_factor(a, n, lower, pivots):
    """Factor the first n rows of a banded matrix in place; False if it is singular.

    Args:
        a: (n or more, 3 lower + 1) row i, column j at [i, lower + j - i].
        n: number of rows.
        lower: number of bands below the diagonal, and above it.
        pivots: (n,) receives the row swaps.
    """
    reach = 2 * lower
    for i in range(n):
        p, size = i, abs(a[i, lower])
        last = min(n - 1, i + lower)
        for k in range(i + 1, last + 1):
            v = abs(a[k, lower + i - k])
            if v > size:
                p, size = k, v
        pivots[i] = p
        if not size > 0.0:
            return False
        end = min(n - 1, i + reach) - i + 1
        if p != i:
            shift = lower + i - p
            for j in range(end):
                a[i, lower + j], a[p, shift + j] = a[p, shift + j], a[i, lower + j]
        row = a[i, lower + 1 : lower + end]
        inverse = 1.0 / a[i, lower]
        for k in range(i + 1, last + 1):
            shift = lower + i - k
            v = a[k, shift] * inverse
            a[k, shift] = v
            if v != 0.0:
                other = a[k, shift + 1 : shift + end]
                for j in range(row.shape[0]):
                    other[j] -= v * row[j]
    return True


@njit(**LEAF_ENTRY)
def band_solve(a, n, lower, pivots, b):
    """Solve in place, b (n,), with the factors of `band_factor`; `a`, `n`, `lower`, `pivots` as there."""
    for i in range(n):
        p = pivots[i]
        if p != i:
            b[i], b[p] = b[p], b[i]
        v = b[i]
        if v != 0.0:
            for k in range(i + 1, min(n - 1, i + lower) + 1):
                b[k] -= a[k, lower + i - k] * v
    for i in range(n - 1, -1, -1):
        count = min(n - 1, i + 2 * lower) - i
        row, known = a[i, lower + 1 : lower + 1 + count], b[i + 1 : i + 1 + count]
        v = b[i]
        for j in range(row.shape[0]):
            v -= row[j] * known[j]
        b[i] = v / a[i, lower]
