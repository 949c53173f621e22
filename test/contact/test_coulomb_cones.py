# SPDX-License-Identifier: Apache-2.0
"""Which contact points slip, as Coulomb's law of a linear system says; scenes that need it are in the zoo."""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros.contact.coulomb_cones import FIRST, LAST, slide

POINTS = 4


def system(seed: int, soft: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Stiffness against slip (8, 8), eigenvalues from `soft` to 1e8, friction if all stick, lead, cones."""
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.normal(size=(2 * POINTS, 2 * POINTS))).Q
    stiffness = turn @ np.diag(np.geomspace(soft, 1e8, 2 * POINTS)) @ turn.T
    return stiffness, 20.0 * rng.normal(size=2 * POINTS), np.zeros(2 * POINTS), rng.uniform(1.0, 20.0, POINTS)


@pytest.mark.parametrize("soft", [1e2, 1e5, 1e8])
@pytest.mark.parametrize("seed", range(10))
def test_what_slips_is_on_its_cone_and_what_sticks_inside(seed, soft):
    K, tau, lead, cones = system(seed, soft)
    slip = np.zeros(2 * POINTS)
    assert slide(K, tau, lead, cones, FIRST, slip)
    friction, slips = (tau + K @ slip).reshape(-1, 2), slip.reshape(-1, 2)
    sizes, ways = np.linalg.norm(friction, axis=1), np.linalg.norm(slips, axis=1)
    assert np.all(sizes <= cones * (1.0 + 1e-9))
    for f, size, s, way, cone in zip(friction, sizes, slips, ways, cones, strict=True):
        if way > 1e3 * LAST:
            # less than all by the square of the tip over the slip
            assert size == pytest.approx(cone, rel=1e-6)
            np.testing.assert_allclose(f / size, -s / way, atol=1e-9)
    assert np.any(ways > 1e3 * LAST)


def test_two_points_that_bear_against_each_other_slip_together():
    # along a straight cable that keeps its length: one alone would need 1e6 times the force
    pair = np.array([[1.0, -1.0], [-1.0, 1.0]])
    K = np.kron(1e8 * pair + 1e2 * np.eye(2), np.eye(2))
    tau, cones, slip = np.array([5.0, 0.0, 3.0, 0.0]), np.array([1.0, 2.0]), np.zeros(4)
    assert slide(K, tau, np.zeros(4), cones, FIRST, slip)
    # both are at their limits: 8 - 3 = 2 * 1e2 s, but for their own difference
    np.testing.assert_allclose(slip, [-0.025, 0.0, -0.025, 0.0], atol=1e-7)
    np.testing.assert_allclose(tau + K @ slip, [1.0, 0.0, 2.0, 0.0], atol=1e-6)


def test_it_says_so_where_slip_is_not_resisted():
    assert not slide(-np.eye(2), np.ones(2), np.zeros(2), np.ones(1), FIRST, np.zeros(2))
