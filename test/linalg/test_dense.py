# SPDX-License-Identifier: Apache-2.0
"""Small dense systems against LAPACK."""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros.linalg import dense

SIZES = (1, 2, 3, 4, 5, 7, 12, 40)


def symmetric(n: int, seed: int, kind: str) -> np.ndarray:
    """Random, with nothing on the diagonal, or with eigenvalues of both signs over ten decades."""
    rng = np.random.default_rng([n, seed])
    m = rng.normal(size=(n, n))
    if kind == "wide":
        q, _ = np.linalg.qr(m)
        return q @ np.diag(10 ** rng.uniform(-10.0, 0.0, n) * rng.choice([-1.0, 1.0], n)) @ q.T
    return m + m.T - (np.diag(2.0 * np.diag(m)) if kind == "hollow" else 0.0)


@pytest.mark.parametrize("kind", ["any", "hollow", "wide"])
@pytest.mark.parametrize("n", SIZES)
def test_positive_eigenvalues_are_counted(n: int, kind: str) -> None:
    for seed in range(20):
        S = symmetric(n, seed, kind)
        eigenvalues = np.linalg.eigvalsh(S)
        if np.abs(eigenvalues).min() < 1e-13 * np.abs(eigenvalues).max():
            continue  # rounding alone has given it its sign
        lower = np.tril(S) + np.triu(np.full((n, n), np.nan), 1)
        assert dense.positive(lower) == np.sum(eigenvalues > 0.0)


def test_what_is_no_number_is_not_positive() -> None:
    assert dense.positive(np.full((3, 3), np.nan)) == 0
    assert dense.positive(np.zeros((3, 3))) == 0
    assert dense.positive(np.array([[0.0, 1.0], [1.0, 0.0]])) == 1


def solve(S: np.ndarray, b: np.ndarray) -> np.ndarray:
    factors, swaps, x = S.copy(), np.empty(len(S), int), np.empty(len(S))
    dense.factor(factors, swaps)
    dense.solve_factored(factors, swaps, b, x)
    return x


@pytest.mark.parametrize("n", SIZES)
def test_solution(n: int) -> None:
    rng = np.random.default_rng(n)
    for _ in range(20):
        S, x = rng.normal(size=(n, n)), rng.normal(size=n)
        S[0, 0] = 0.0 if n > 1 else S[0, 0]
        found = solve(S, S @ x)
        # rounding times the condition
        assert found == pytest.approx(x, abs=1e-15 * 100 * n * np.linalg.cond(S))


@pytest.mark.parametrize("bad", [np.zeros((2, 2)), np.ones((2, 2)), np.full((2, 2), np.nan)])
def test_a_singular_matrix_is_told(bad: np.ndarray) -> None:
    with pytest.raises(np.linalg.LinAlgError):
        solve(bad, np.ones(2))
