# SPDX-License-Identifier: Apache-2.0
"""The banded factorisation against dense linear algebra."""

from __future__ import annotations

import numpy as np
import pytest
from references.plain_rod import dense

from cable_ros.linalg import banded


def assembled(order: int, elements: int, seed: int, shift: float = 0.0) -> np.ndarray:
    """Lower band storage of a symmetric matrix of elements in a row, three unknowns a node."""
    rng = np.random.default_rng([order, elements, seed])
    size = 3 * (order + 1)
    out = np.zeros((3 * (order * elements + 1), size))
    for e in range(elements):
        block = rng.normal(size=(size, size))
        block = block @ block.T / size + shift * np.eye(size)
        for i in range(size):
            out[3 * order * e + i, size - 1 - i : size] += block[i, : i + 1]
    return out


CASES = [(2, 1), (3, 2), (6, 4), (6, 1), (7, 3), (1, 9)]


def factored(A: np.ndarray, order: int) -> tuple[np.ndarray, np.ndarray, int, float]:
    n = len(A)
    U, pivots = np.full_like(A, np.nan), np.full(n, np.nan)
    negative, worst = banded.factor(A, 3, n - 3, order, U, pivots)
    return U, pivots, negative, worst


# 1e-14 times the condition of the few hundred matrices at hand, which is below 1e5 here.
@pytest.mark.parametrize(("order", "elements"), [c for c in CASES if 3 * (c[0] * c[1] + 1) > 6])
@pytest.mark.parametrize("shift", [0.0, -0.7])
def test_solution(order: int, elements: int, shift: float) -> None:
    A = assembled(order, elements, 0, shift)
    n = len(A)
    inner = slice(3, n - 3)
    U, pivots, _, worst = factored(A, order)
    assert worst > 1e-6
    b = np.random.default_rng(1).normal(size=n)
    x = b.copy()
    banded.solve(U, pivots, 3, n - 3, order, x)
    assert x[inner] == pytest.approx(np.linalg.solve(dense(A)[inner, inner], b[inner]), abs=1e-9)
    # The clamps' rows are nobody's.
    assert np.array_equal(x[:3], b[:3])
    assert np.array_equal(x[-3:], b[-3:])


@pytest.mark.parametrize(("order", "elements"), [c for c in CASES if 3 * (c[0] * c[1] + 1) > 6])
def test_many_at_once_are_each_alone(order: int, elements: int) -> None:
    A = assembled(order, elements, 0, -0.7)
    n = len(A)
    U, pivots, _, _ = factored(A, order)
    X = np.random.default_rng(1).normal(size=(n, 5))
    alone = X.copy()
    for x in alone.T:
        column = x.copy()
        banded.solve(U, pivots, 3, n - 3, order, column)
        x[:] = column
    banded.solve_all(U, pivots, 3, n - 3, order, X)
    # the same but for the order of sums, of a matrix with a condition of up to 1e4
    assert pytest.approx(alone, abs=1e-10) == X


@pytest.mark.parametrize(("order", "elements"), CASES[1:])
@pytest.mark.parametrize("shift", [0.5, 0.0, -0.3, -0.7, -1.5, -5.0])
@pytest.mark.parametrize("seed", range(3))
def test_signs_of_the_pivots_are_the_inertia(order: int, elements: int, shift: float, seed: int) -> None:
    A = assembled(order, elements, seed, shift)
    _, pivots, negative, _ = factored(A, order)
    inner = slice(3, len(A) - 3)
    eigenvalues = np.linalg.eigvalsh(dense(A)[inner, inner])
    assert np.abs(eigenvalues).min() > 1e-8  # otherwise there would be nothing to count
    assert negative == np.sum(eigenvalues < 0)
    assert negative == np.sum(pivots[inner] < 0)


def test_a_singular_matrix_is_told_by_its_smallest_pivot() -> None:
    A = assembled(3, 2, 0)
    inner = slice(3, len(A) - 3)
    lowest = np.linalg.eigvalsh(dense(A)[inner, inner])[0]
    A[:, -1] -= lowest
    *_, worst = factored(A, 3)
    assert worst < 1e-10
    A[:, -1] += 0.1
    *_, worst = factored(A, 3)
    assert worst > 1e-4


@pytest.mark.parametrize(("order", "elements"), CASES)
def test_product(order: int, elements: int) -> None:
    A = assembled(order, elements, 2, -0.3)
    x, y = np.random.default_rng(3).normal(size=len(A)), np.full(len(A), np.nan)
    banded.multiply(A, x, y)
    assert y == pytest.approx(dense(A) @ x, abs=1e-12)
