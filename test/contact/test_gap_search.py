# SPDX-License-Identifier: Apache-2.0
"""Where a cable dips into an obstacle between two samples, against the depth that it was given."""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros.contact.distance import AXES, CENTRE, DIMENSIONS, PLANE, WIDTH
from cable_ros.contact.touching_rod import TouchingRod
from cable_ros.rod.elements import Mesh, reference_element

RISE, WAVE, LENGTH = 0.5, 0.0048, 0.03
"""A cable that rises on both sides, rad / L; and waves in its slope, rad, of this length, L."""
LOPSIDED, WITHIN = 5.0, 0.02
"""What makes one of two dips deeper, rad / L^2; and within about which distance, L."""
ELEMENTS, ORDER = 64, 4
SAMPLES = 41
PARTS = 200_000
SPACING = 1.0 / (SAMPLES - 1)

PLACES = (-0.01, -1e-3, -1e-4, -1e-6, 1e-6, 1e-4, 1e-3, 0.01, 0.0125)
"""Of the highest point from half way between two samples, L."""


def slope(x: np.ndarray) -> np.ndarray:
    """Slope of the cable at a distance x from where it is highest between its two dips."""
    waves = RISE * x - WAVE * np.sin(2.0 * np.pi * x / LENGTH)
    return waves + LOPSIDED * x**2 * np.exp(-((x / WITHIN) ** 2))


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("beside", PLACES)
def test_a_dip_is_found_wherever_the_samples_are(side, beside):
    """Where it is highest half way between two samples, one was missed: 2.5e-6 L inside, and not told.

    Where both are as near to the same sample, it was the other one that was looked at.
    """
    mesh = Mesh(reference_element(ORDER), np.full(ELEMENTS, 1.0 / ELEMENTS))
    top = (SAMPLES // 2 + 0.5) * SPACING - side * beside
    turn = 0.5 * (0.5 * np.pi - side * slope(side * (mesh.nodes - top)))
    q = np.column_stack([np.cos(turn), 0.0 * turn, np.sin(turn), 0.0 * turn])
    s = np.linspace(0.0, 1.0, PARTS + 1)
    tangents = np.sin(side * slope(side * (0.5 * (s[1:] + s[:-1]) - top)))
    height = np.concatenate([[0.0], np.cumsum(tangents) / PARTS])
    level = 0.5 * (height[s < top].min() + height[s > top].min())
    plane = np.zeros((1, WIDTH))
    plane[0, 0], plane[0, CENTRE + 2] = PLANE, level
    plane[0, AXES:DIMENSIONS] = np.eye(3).ravel()
    rod = TouchingRod(mesh, np.ones(3), tolerance=1e-4)
    rod.set_conditions(q[-1], np.ones(3), np.zeros(3), plane)
    assert len(rod.samples) == SAMPLES
    assert not rod.clear(q)
