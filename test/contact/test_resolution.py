# SPDX-License-Identifier: Apache-2.0
"""What is told of elements too long for what contacts hold, and of friction between its samples."""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros.contact.patches import NODES, SAMPLES, WEIGHTS
from cable_ros.contact.points import COLUMNS, FRICTION, KIND, LENGTH, NUMBER, SAMPLE
from cable_ros.contact.resolution import highest_mode

H = 0.2


def rubbing(traction: np.ndarray, first: int = 0) -> np.ndarray:
    """Samples (SAMPLES, COLUMNS) of one element of length H, with this `traction` (SAMPLES,) along y."""
    points = np.zeros((SAMPLES, COLUMNS))
    points[:, KIND], points[:, LENGTH] = SAMPLE, H * WEIGHTS
    points[:, NUMBER] = first + np.arange(SAMPLES)
    points[:, FRICTION + 1] = traction * points[:, LENGTH]
    return points


def mode(points: np.ndarray) -> np.ndarray:
    out = np.full((len(points), 3), np.nan)
    highest_mode(points, len(points), out)
    return out


def test_friction_that_the_other_modes_tell_has_none_of_the_highest() -> None:
    for power in range(SAMPLES - 1):
        assert mode(rubbing(NODES**power)) == pytest.approx(0.0, abs=1e-15)  # sums of numbers of order 0.1


def test_what_is_left_without_the_highest_mode_is_the_best_fit() -> None:
    traction = np.array([1.0, -0.5, 2.0, 0.3])
    rest = traction - mode(rubbing(traction))[:, 1] / (H * WEIGHTS)
    fit = np.polynomial.Polynomial.fit(NODES, traction, SAMPLES - 2, w=np.sqrt(WEIGHTS))
    assert rest == pytest.approx(fit(NODES), abs=1e-12)  # a fit of four numbers of order 1


def test_elements_are_looked_at_one_by_one() -> None:
    alone = mode(rubbing(NODES**3))
    both = mode(np.vstack([rubbing(NODES**3), rubbing(np.ones(SAMPLES), SAMPLES)]))
    assert both[:SAMPLES] == pytest.approx(alone, abs=1e-15)
    assert both[SAMPLES:] == pytest.approx(0.0, abs=1e-15)
    assert np.abs(alone).max() > 1e-4
