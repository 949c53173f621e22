# SPDX-License-Identifier: Apache-2.0
"""Meshes for contact points: a boundary at each, and no element without length."""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros.contact.meshing import LAYERS, fitted, layered, suited
from cable_ros.contact.points import ARC_LENGTH, COLUMNS, KIND, POINT
from cable_ros.rod.elements import Mesh, reference_element

ELEMENT = reference_element(3)


def at(*places: float) -> np.ndarray:
    points = np.zeros((len(places), COLUMNS))
    points[:, ARC_LENGTH], points[:, KIND] = places, POINT
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


def test_beside_a_contact_a_taut_cable_has_elements_as_short_as_it_bends_in() -> None:
    mesh = Mesh(ELEMENT, np.full(4, 0.25))
    assert (layered(mesh, at(0.3), 50.0).lengths == mesh.lengths).all()  # 0.42 is longer than they are
    fine = layered(mesh, at(0.3), 1e4)
    edges = np.concatenate(([0.0], np.cumsum(fine.lengths)))
    assert edges[-1] == pytest.approx(1.0, abs=1e-14)
    assert set(np.round(np.cumsum(mesh.lengths), 12)) <= set(np.round(edges, 12))
    for place in (0.0, 0.3, 1.0):
        e = min(int(np.searchsorted(edges, place, side="right")) - 1, len(fine.lengths) - 1)
        assert fine.lengths[e] <= LAYERS / 100.0
    assert fine.lengths.max() > 0.1  # far from all of them it stays coarse
