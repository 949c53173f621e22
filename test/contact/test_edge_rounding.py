# SPDX-License-Identifier: Apache-2.0
"""Blunt obstacles: the same faces, rounded edges, and never more of them."""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros.contact.distance import BOX, CYLINDER, SPHERE, WIDTH, gaps
from cable_ros.contact.edge_rounding import CORE, ROUNDING, rounded


def obstacle(kind: float, *sizes: float) -> np.ndarray:
    row = np.zeros((1, WIDTH))
    row[0, 0], row[0, 4:13], row[0, 13 : 13 + len(sizes)] = kind, np.eye(3).ravel(), sizes
    row[0, 16] = 0.002
    return row


@pytest.mark.parametrize("solid", [obstacle(BOX, 0.1, 0.2, 0.3), obstacle(CYLINDER, 0.2, 0.3)])
def test_faces_stay_and_edges_are_rounded(solid: np.ndarray) -> None:
    blunt = rounded(solid)
    rng = np.random.default_rng(0)
    for point in rng.uniform(-0.5, 0.5, (300, 3)):
        sharp, soft = gaps(solid, point)[0], gaps(blunt, point)[0]
        # a corner of three right angles loses (sqrt 3 - 1) of the rounding
        assert sharp - 1e-12 <= soft <= sharp + 0.74 * ROUNDING
    above = np.array([0.0, 0.05, 0.4])
    assert gaps(blunt, above)[0] == pytest.approx(gaps(solid, above)[0], abs=1e-15)
    edge = np.array([0.1 if solid[0, 0] == BOX else 0.2, 0.0, 0.3])
    assert gaps(blunt, edge)[0] - gaps(solid, edge)[0] == pytest.approx((np.sqrt(2) - 1) * ROUNDING)


def test_a_thin_body_keeps_a_core() -> None:
    thin = rounded(obstacle(BOX, 0.001, 0.2, 0.3))
    assert thin[0, 13] == pytest.approx((1.0 - CORE) * 0.001)


def test_what_has_no_edges_is_left_alone() -> None:
    ball = obstacle(SPHERE, 0.1)
    assert rounded(ball) is ball
    box = obstacle(BOX, 0.1, 0.1, 0.1)
    assert rounded(box, 0.0) is box
