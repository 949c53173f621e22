# SPDX-License-Identifier: Apache-2.0
"""What sticks yields a little; where a patch begins, it is as long as the gap's curvature says."""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros.contact.contact_state import History
from cable_ros.contact.distance import FRICTION_COEFFICIENT, WIDTH
from cable_ros.contact.flattening import half_patch
from cable_ros.contact.friction_kernels import COULOMB, STICK, stick_stiffness
from cable_ros.contact.points import (
    BEFORE,
    COLUMNS,
    FORCE,
    FRICTION,
    KIND,
    LENGTH,
    OBSTACLE,
    POINT,
    SAMPLE,
    SLIPS,
)
from cable_ros.contact.slip_kernels import slip_change


def history(presliding: float, bedding: float) -> History:
    curve = np.zeros((1, 1, 3))
    friction = COULOMB, np.zeros(3), presliding, bedding, False, 1.0
    return History(*friction, curve, curve, np.ones(1), np.zeros(1), np.zeros((0, WIDTH)))


def contact(kind: float, length: float = 0.0) -> np.ndarray:
    out = np.zeros(COLUMNS)
    out[KIND], out[LENGTH] = kind, length
    return out


@pytest.mark.parametrize("kind", [POINT, SAMPLE])
@pytest.mark.parametrize("cone", [0.01, 1.0, 300.0])
def test_presliding_takes_the_whole_cone(cone: float, kind: float) -> None:
    assert stick_stiffness(contact(kind, 1.0), cone, history(0.003, 1e9)) * 0.003 == pytest.approx(cone)


def test_nothing_is_stiffer_than_stick() -> None:
    point = contact(POINT)
    assert stick_stiffness(point, 1.0, history(0.0, 1e7)) == STICK
    assert stick_stiffness(point, 0.0, history(0.01, 1e7)) == STICK
    assert stick_stiffness(point, 1e3, history(1e-9, 1e7)) == STICK
    assert stick_stiffness(contact(SAMPLE, 0.02), 1.0, history(0.0, 1e13)) == STICK


def test_a_sample_is_as_stiff_as_the_length_that_it_stands_for() -> None:
    assert stick_stiffness(contact(SAMPLE, 0.02), 1.0, history(0.0, 1e7)) == pytest.approx(2e5)


def test_change_of_friction_counts_what_slips_and_the_cones_of_all() -> None:
    points, obstacles = np.zeros((5, COLUMNS)), np.zeros((2, WIDTH))
    obstacles[:, FRICTION_COEFFICIENT] = 0.5, 0.25
    points[:3, OBSTACLE], points[:3, FORCE], points[:3, SLIPS] = [0, 1, 1], [2.0, 4.0, 8.0], [1, 0, 1]
    points[:3, FRICTION] = 1.0, 1.0, -2.0
    points[:3, BEFORE] = 0.25, -1.0, 0.5
    assert slip_change(points, 3, obstacles) == (0.75 + 2.5, 1.0 + 1.0 + 2.0)


def test_a_patch_ends_where_the_cable_is_as_curved_as_the_surface() -> None:
    """A point force P bends the gap's curvature up by P / 2 per length on each side."""
    force, curvature = 36.0, -0.05
    x = np.linspace(-0.1, 0.1, 20_001)
    bent = curvature + 0.5 * force * np.abs(x)
    within = x[bent < 0.0]
    half = half_patch(0.5, curvature, force, 1.0)
    assert half == pytest.approx(0.5 * (within[-1] - within[0]), abs=2e-5)
    # it keeps away from the clamps
    assert half_patch(1e-3, curvature, force, 1.0) == pytest.approx(0.45e-3)
