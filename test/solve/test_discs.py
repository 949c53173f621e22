# SPDX-License-Identifier: Apache-2.0
"""Points in discs against the conditions that they must meet, and against cases whose solution is known."""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros.solve.discs import CLOSED, minimum


def solve(A: np.ndarray, b: np.ndarray, start: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    x = np.zeros(len(b)) if start is None else start.copy()
    m = np.empty(len(b) // 2)
    assert minimum(np.ascontiguousarray(A), b, x, m)
    return x, m


def problem(k: int, seed: int, decades: float) -> tuple[np.ndarray, np.ndarray]:
    """A random positive matrix, eigenvalues over so many decades, and a force that many points can't hold."""
    rng = np.random.default_rng([k, seed])
    q, _ = np.linalg.qr(rng.normal(size=(2 * k, 2 * k)))
    A = q @ np.diag(10.0 ** rng.uniform(-decades, 0.0, 2 * k)) @ q.T
    return 0.5 * (A + A.T), A @ rng.normal(size=2 * k) * 2.0


@pytest.mark.parametrize("decades", [0.0, 3.0, 6.0])
@pytest.mark.parametrize("k", [1, 2, 7, 40])
def test_conditions_hold(k: int, decades: float) -> None:
    """No force inside, a push outward on the circle, and no friction but along it; a minimum."""
    rng = np.random.default_rng(k)
    for seed in range(10):
        A, b = problem(k, seed, decades)
        x, m = solve(A, b)
        pairs, force = x.reshape(-1, 2), (A @ x - b).reshape(-1, 2)
        radius = np.linalg.norm(pairs, axis=1)
        assert radius.max() <= 1.0
        # what is left is of the size of the gap, over the mean force at the beginning, that at 0.1 at most
        scale = np.linalg.norm(b.reshape(-1, 2), axis=1).mean() + 0.1 * np.abs(A).sum()
        assert np.abs(m * (1.0 - radius**2)).max() <= 2.0 * k * CLOSED * scale
        assert np.abs(force + m[:, None] * pairs).max() <= 2.0 * np.sqrt(k * CLOSED) * scale
        value = 0.5 * x @ A @ x - b @ x
        for _ in range(20):
            other = rng.normal(size=(k, 2))
            other /= np.maximum(np.linalg.norm(other, axis=1), 1.0)[:, None]
            y = other.ravel()
            assert 0.5 * y @ A @ y - b @ y >= value - 2.0 * k * CLOSED * scale


def test_points_that_do_not_feel_each_other() -> None:
    b = np.array([0.3, -0.4, 3.0, 4.0, 0.0, 1.0])
    x, m = solve(np.eye(6), b)
    assert x == pytest.approx([0.3, -0.4, 0.6, 0.8, 0.0, 1.0], abs=1e-3)  # the last one only just slips
    assert x[:4] == pytest.approx([0.3, -0.4, 0.6, 0.8], abs=1e-6)
    assert m == pytest.approx([0.0, 4.0, 0.0], abs=1e-3)


def test_it_does_not_matter_where_it_begins() -> None:
    """Nor do the order of the points, their directions and a mirror."""
    A, b = problem(12, 3, 4.0)
    x, _ = solve(A, b)
    rng = np.random.default_rng(5)
    other, _ = solve(A, b, rng.normal(size=24))
    assert other == pytest.approx(x, abs=1e-3)
    order = rng.permutation(12)
    turned = np.kron(np.eye(12)[order], np.array([[0.6, 0.8], [0.8, -0.6]]))
    assert solve(turned @ A @ turned.T, turned @ b)[0] == pytest.approx(turned @ x, abs=1e-6)


@pytest.mark.parametrize("softest", [-0.3, 0.0])
def test_a_saddle_is_no_minimum(softest: float) -> None:
    """Of a cable that would buckle but for friction what sticks is one, and not the only solution."""
    assert not minimum(np.diag([softest, 2.0]), np.array([0.1, 0.1]), np.zeros(2), np.zeros(1))


def test_what_is_no_number_is_not_found() -> None:
    assert not minimum(np.full((2, 2), np.nan), np.ones(2), np.zeros(2), np.zeros(1))
    with pytest.raises(np.linalg.LinAlgError):
        minimum(np.eye(2), np.array([np.nan, 0.0]), np.zeros(2), np.zeros(1))
