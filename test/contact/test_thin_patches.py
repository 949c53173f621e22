# SPDX-License-Identifier: Apache-2.0
"""Patches that press at their ends alone become two points."""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros.contact.points import (
    ARC_LENGTH,
    COLUMNS,
    FIRST,
    FORCE,
    FRICTION,
    KIND,
    LAST,
    OBSTACLE,
    POINT,
    SAMPLE,
)
from cable_ros.contact.thin_patches import THIN, with_ends_alone

ROWS = [(0.4, FIRST, 1.0), (0.5, LAST, 1.0), (0.7, POINT, 3.0), (0.44, SAMPLE, 0.0), (0.46, SAMPLE, 0.0)]


def contacts(inner: float, *more: tuple[float, float, float], obstacle: float = 0.0) -> np.ndarray:
    """(k, COLUMNS): ROWS, whose samples bear so much each, and others on an obstacle."""
    out = np.zeros((len(ROWS) + len(more), COLUMNS))
    out[:, [ARC_LENGTH, KIND, FORCE]] = [*ROWS, *more]
    out[3:5, FORCE], out[5:, OBSTACLE] = inner, obstacle
    out[:, FRICTION] = out[:, ARC_LENGTH]
    return out


def test_ends_become_points_and_keep_their_friction() -> None:
    left = with_ends_alone(contacts(0.4 * THIN))
    assert left is not None
    assert left[:, ARC_LENGTH].tolist() == left[:, FRICTION].tolist() == [0.4, 0.5, 0.7]
    assert (left[:, KIND] == POINT).all()


@pytest.mark.parametrize(
    "points",
    [
        contacts(1.1 * THIN),
        contacts(0.4 * THIN)[1:],  # it begins at the clamp
        contacts(0.4 * THIN)[2:3],
    ],
    ids=["pressed", "at a clamp", "a point"],
)
def test_what_is_no_such_patch_stays(points: np.ndarray) -> None:
    assert with_ends_alone(points) is None


def test_each_patch_is_judged_by_itself() -> None:
    """One that presses beside it on the same obstacle, and one around it on another, stay as they are."""
    beside = (0.8, FIRST, 1.0), (0.9, LAST, 1.0), (0.85, SAMPLE, 5.0)
    left = with_ends_alone(contacts(0.4 * THIN, *beside))
    assert left is not None
    assert left[:, KIND].tolist() == [POINT, POINT, POINT, FIRST, LAST, SAMPLE]
    around = (0.3, FIRST, 1.0), (0.6, LAST, 1.0), (0.45, SAMPLE, 5.0)
    left = with_ends_alone(contacts(0.4 * THIN, *around, obstacle=1.0))
    assert left is not None
    assert left[:, KIND].tolist() == [POINT, POINT, POINT, FIRST, LAST, SAMPLE]
