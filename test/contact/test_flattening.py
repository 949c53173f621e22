# SPDX-License-Identifier: Apache-2.0
"""A rough point that is a patch in turn becomes two points, which bear what it bore."""

from __future__ import annotations

import numpy as np

from cable_ros.contact.flattening import part
from cable_ros.contact.points import (
    ARC_LENGTH,
    BEFORE,
    COLUMNS,
    FORCE,
    FRICTION,
    INTERFACE,
    OBSTACLE,
    SLIPS,
    SWINGS,
    WAS,
)

FORCES = slice(FORCE, BEFORE + 3)
"""Normal force, friction, and friction at the last equilibrium."""


def table(capacity: int) -> np.ndarray:
    """(capacity, COLUMNS) whose first row is a point that slips."""
    points = np.zeros((capacity, COLUMNS))
    points[0, [ARC_LENGTH, OBSTACLE, FORCE, SLIPS, WAS, SWINGS, INTERFACE]] = (
        0.5,
        2.0,
        4.0,
        1.0,
        0.49,
        3.0,
        1.0,
    )
    points[0, FRICTION : BEFORE + 3] = 0.3, -0.6, 0.1, 0.2, -0.5, 0.0
    return points


def test_two_points_bear_what_one_bore() -> None:
    points = table(3)
    before = points[0].copy()
    assert part(points, 1, 0, 0.48, 0.53) == 2
    assert points[:2, ARC_LENGTH].tolist() == [0.48, 0.53]
    assert np.array_equal(points[0, FORCES], points[1, FORCES])
    assert np.array_equal(points[:2, FORCES].sum(axis=0), before[FORCES])
    for column in (OBSTACLE, SLIPS, WAS):
        assert (points[:2, column] == before[column]).all()
    assert points[:2, INTERFACE].tolist() == [1.0, -1.0]  # the boundary goes with the first
    assert not points[:2, SWINGS].any()


def test_without_space_the_point_moves() -> None:
    points = table(1)
    before = points[0].copy()
    assert part(points, 1, 0, 0.48, 0.53) == 1
    assert points[0, ARC_LENGTH] == 0.48
    assert np.array_equal(points[0, FORCES], before[FORCES])
