"""Meshes for contact points: a boundary at each, and no element without length."""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros.mechanics.elements import Mesh, reference_element
from cable_ros.statics.touch_meshes import fitted, suited
from cable_ros.statics.touch_points import COLUMNS, KIND, PLACE, POINT

ELEMENT = reference_element(3)


def at(*places: float) -> np.ndarray:
    points = np.zeros((len(places), COLUMNS))
    points[:, PLACE], points[:, KIND] = places, POINT
    return points


@pytest.mark.parametrize("places", [(0.3,), (0.25,), (0.25, 0.5), (0.4, 0.4), (0.4, 0.4 + 1e-9)])
def test_every_point_has_a_boundary_and_every_element_a_length(places: tuple[float, ...]) -> None:
    mesh = Mesh(ELEMENT, np.full(4, 0.25))
    for lengths in (
        suited(mesh, at(*places)).lengths,
        fitted(ELEMENT, [0.25, 0.5, 0.75], at(*places), 0.025).lengths,
    ):
        assert lengths.sum() == pytest.approx(1.0, abs=1e-14)
        # what counts as one place is a millionth; all else is farther apart here
        assert lengths.min() > 1e-3
        edges = np.cumsum(lengths)
        for place in places:
            assert np.abs(edges - place).min() < 1e-8
