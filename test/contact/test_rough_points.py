# SPDX-License-Identifier: Apache-2.0
"""What contact points say of friction, against the same in NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros.contact.distance import FRICTION_COEFFICIENT, WIDTH
from cable_ros.contact.points import ARC_LENGTH, COLUMNS, FORCE, OBSTACLE, SLIP_ROW, SLIPS
from cable_ros.contact.rough_points import bearable_friction, slip_rows, touches_rough

COUNT, ASIDE, LONGEST = 200, 0.1, 1e-4


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(10)


@pytest.fixture
def points(rng: np.random.Generator) -> np.ndarray:
    """On three obstacles; some pull, some slip, some have no row for that."""
    points = np.zeros((COUNT + 5, COLUMNS))
    points[:, ARC_LENGTH] = rng.random(len(points))
    points[:, FORCE] = rng.standard_normal(len(points))
    points[:, OBSTACLE] = rng.integers(0, 3, len(points))
    points[:, SLIPS] = rng.integers(0, 2, len(points))
    points[:, SLIP_ROW] = np.where(rng.random(len(points)) < 0.7, 3 + np.arange(len(points)), 0)
    return points


@pytest.fixture
def obstacles() -> np.ndarray:
    """The first one is smooth."""
    obstacles = np.zeros((3, WIDTH))
    obstacles[:, FRICTION_COEFFICIENT] = 0.0, 0.3, 0.7
    return obstacles


def test_only_what_counts_is_looked_at(points: np.ndarray, obstacles: np.ndarray) -> None:
    points[:COUNT, OBSTACLE] = 0.0
    points[COUNT:, OBSTACLE] = 1.0
    assert not touches_rough(points, COUNT, obstacles)
    assert bearable_friction(points, COUNT, obstacles, ASIDE, False) == 0.0
    points[COUNT - 1, OBSTACLE] = 2.0
    assert touches_rough(points, COUNT, obstacles)
    assert not touches_rough(points, 0, obstacles)


@pytest.mark.parametrize("held", [False, True])
def test_bearable_friction_is_the_sum_of_the_cones(
    points: np.ndarray, obstacles: np.ndarray, held: bool
) -> None:
    known = points[:COUNT]
    s, cone = known[:, ARC_LENGTH], obstacles[known[:, OBSTACLE].astype(int), FRICTION_COEFFICIENT]
    counts = (np.minimum(s, 1.0 - s) > ASIDE) & ((known[:, SLIPS] == 0.0) | (not held))
    expected = float(np.sum(cone * np.maximum(known[:, FORCE], 0.0) * counts))
    assert expected > 0.0
    np.testing.assert_allclose(bearable_friction(points, COUNT, obstacles, ASIDE, held), expected, rtol=1e-14)


def test_rows_of_slip_are_those_that_give_less(
    points: np.ndarray, obstacles: np.ndarray, rng: np.random.Generator
) -> None:
    delta = 10.0 ** rng.uniform(-7.0, 0.0, 3 + len(points))
    rows, gives = np.empty(COUNT, np.int64), np.empty(COUNT)
    n = slip_rows(points, COUNT, obstacles, delta, LONGEST, rows, gives)
    known = points[:COUNT]
    cone = obstacles[known[:, OBSTACLE].astype(int), FRICTION_COEFFICIENT] * known[:, FORCE]
    slips = (known[:, SLIPS] == 1.0) & (known[:, SLIP_ROW] > 0.0) & (known[:, FORCE] > 0.0)
    # what slips on a smooth obstacle may go any way, and what holds it does so more
    give = np.where(cone > 0.0, LONGEST / np.where(cone > 0.0, cone, 1.0), np.inf)
    expected = slips & (delta[known[:, SLIP_ROW].astype(int)] < give)
    assert 0 < expected.sum() < slips.sum()
    assert list(rows[:n]) == list(known[expected, SLIP_ROW])
    finite = np.isfinite(give[expected])
    np.testing.assert_allclose(gives[:n][finite], give[expected][finite], rtol=1e-14)
