# SPDX-License-Identifier: Apache-2.0
"""A point that moves, or becomes a patch, does so beside the patches that are there, not across them."""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros.contact.points import ARC_LENGTH, COLUMNS, FIRST, KIND, LAST, OBSTACLE, POINT, space_at


def patch_and_points() -> np.ndarray:
    """(5, COLUMNS) a point and a patch, and a point and the end of a patch on another obstacle."""
    points = np.zeros((5, COLUMNS))
    points[:, KIND] = POINT, POINT, FIRST, LAST, LAST
    points[:, ARC_LENGTH] = 0.30, 0.31, 0.40, 0.45, 0.35
    points[[1, 4], OBSTACLE] = 1.0
    return points


@pytest.mark.parametrize(
    ("place", "space"), [(0.30, 0.10), (0.37, 0.03), (0.41, 0.0), (0.50, 0.0), (0.10, 0.30)]
)
def test_room_ends_at_the_next_patch_on_the_same_obstacle(place: float, space: float) -> None:
    assert space_at(patch_and_points(), 5, 0, place) == pytest.approx(space)


def test_without_a_patch_there_is_all_room() -> None:
    assert space_at(patch_and_points(), 2, 0, 0.5) == np.inf
