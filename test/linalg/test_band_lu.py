# SPDX-License-Identifier: Apache-2.0
"""Band LU against LAPACK's, on matrices that need their rows swapped and on ones that are scaled badly."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import solve_banded

from cable_ros.linalg.band_lu import band_factor, band_solve

SIZES = [(1, 1), (2, 1), (7, 1), (9, 4), (40, 3), (60, 17), (25, 30)]
"""Unknowns and bandwidths; the last is wider than its matrix."""


def dense(n: int, lower: int, seed: int) -> np.ndarray:
    """Random, zero outside the band."""
    A = np.random.default_rng([n, lower, seed]).normal(size=(n, n))
    i, j = np.indices((n, n))
    A[np.abs(i - j) > lower] = 0.0
    return A


def banded(A: np.ndarray, lower: int) -> np.ndarray:
    """In `band_factor`'s storage."""
    n = len(A)
    out = np.zeros((n, 3 * lower + 1))
    for i, j in zip(*np.nonzero(A), strict=True):
        out[i, lower + j - i] = A[i, j]
    return out


def solved(A: np.ndarray, lower: int, b: np.ndarray) -> np.ndarray:
    a, x, pivots = banded(A, lower), b.copy(), np.empty(len(A), np.int64)
    assert band_factor(a, len(A), lower, pivots)
    band_solve(a, len(A), lower, pivots, x)
    return x


def lapack(A: np.ndarray, lower: int, b: np.ndarray) -> np.ndarray:
    n = len(A)
    width = min(lower, n - 1)
    ab = np.zeros((2 * width + 1, n))
    for i, j in zip(*np.nonzero(A), strict=True):
        ab[width + i - j, j] = A[i, j]
    return solve_banded((width, width), ab, b)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(("n", "lower"), SIZES)
def test_agrees_with_lapack(n: int, lower: int, seed: int) -> None:
    A, b = dense(n, lower, seed), np.random.default_rng(seed).normal(size=n)
    rounding = 1e-14 * n * np.linalg.cond(A)
    exact = lapack(A, lower, b)
    assert np.abs(solved(A, lower, b) - exact).max() <= rounding * np.abs(exact).max()


@pytest.mark.parametrize("seed", range(5))
def test_zeros_on_the_diagonal_are_swapped_away(seed: int) -> None:
    A = dense(30, 4, seed)
    np.fill_diagonal(A, 0.0)
    b = np.random.default_rng(seed).normal(size=30)
    exact = lapack(A, 4, b)
    assert np.abs(solved(A, 4, b) - exact).max() <= 1e-14 * 30 * np.linalg.cond(A) * np.abs(exact).max()


@pytest.mark.parametrize("seed", range(5))
def test_badly_scaled_rows_and_columns_leave_a_small_residual(seed: int) -> None:
    """Rows and columns over 16 orders of magnitude: the residual of each row stays at its rounding."""
    rng = np.random.default_rng(seed)
    rows, columns = 10.0 ** rng.uniform(-8, 8, 50), 10.0 ** rng.uniform(-8, 8, 50)
    A = rows[:, None] * dense(50, 5, seed) * columns
    b = rng.normal(size=50) * rows
    x = solved(A, 5, b)
    # growth of rounding with partial pivoting is by the largest row at hand, as LAPACK's
    mine, theirs = (np.abs(A @ y - b).max() for y in (x, lapack(A, 5, b)))
    assert mine <= 10.0 * theirs + 1e-14 * np.abs(b).max()


def test_only_the_first_rows_count() -> None:
    A, b = dense(20, 3, 0), np.arange(20.0)
    a, x, pivots = np.full((25, 10), np.nan), np.full(25, np.nan), np.empty(25, np.int64)
    a[:20], x[:20] = banded(A, 3), b
    assert band_factor(a, 20, 3, pivots)
    band_solve(a, 20, 3, pivots, x)
    assert x[:20] == pytest.approx(np.linalg.solve(A, b))
    assert np.isnan(x[20:]).all()


@pytest.mark.parametrize("n", [1, 2, 30])
def test_singular_is_told(n: int) -> None:
    A = dense(n, min(2, n - 1) or 1, 1)
    A[:, n // 2] = 0.0  # a column without entries leaves an exact zero
    assert not band_factor(banded(A, 2), n, 2, np.empty(n, np.int64))
    A = dense(n, 2, 1)
    A[n - 1] = 0.0
    assert not band_factor(banded(A, 2), n, 2, np.empty(n, np.int64))


def test_what_is_not_a_number_is_told() -> None:
    A = dense(10, 2, 0)
    A[4, 4] = np.nan
    A[3:7, 4] = np.nan
    assert not band_factor(banded(np.nan_to_num(A), 2) * np.nan, 10, 2, np.empty(10, np.int64))
