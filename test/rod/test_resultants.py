# SPDX-License-Identifier: Apache-2.0
"""Moment and force from the balance: their extremes against a plain twin, and how fast they converge."""

from __future__ import annotations

import numpy as np
import pytest
from references.rods import STILL, reference, uniform

from cable_ros.branch.cold_start import Found
from cable_ros.branch.extremes import Obstacles, extremes
from cable_ros.contact.distance import WIDTH
from cable_ros.rod import quaternion
from cable_ros.rod.units import Units
from cable_ros.scene.cable_limits import CableLimits

NOTHING = Obstacles(np.zeros((0, WIDTH)), np.zeros((0, 7)), ())


def worst(found: Found) -> np.ndarray:
    """(3,) largest curvature, tension and twist, in units of the cable."""
    radius, tension, torsion, _ = extremes(
        found.rod, found.q, found.F, STILL, Units(1.0, 1.0), CableLimits(), NOTHING
    )()
    return np.array([1.0 / radius.value, tension.value, torsion.value])


def plain(found: Found, count: int = 20001) -> np.ndarray:
    """`worst` by samples: the moment as a sum of t x G, from the end back to the start."""
    rod, s = found.rod, np.linspace(0.0, 1.0, count)
    frames = rod.mesh.interpolate(found.q, s)
    t = quaternion.tangents(frames)
    G = found.F + (1.0 - s)[:, None] * rod.f
    slope = np.cross(t, G)  # -M'
    beyond = np.cumsum(0.5 * (slope[1:] + slope[:-1])[::-1] / (count - 1), axis=0)[::-1]
    M = quaternion.rotate(found.q[-1], rod.g[-1]) + np.vstack([beyond, np.zeros(3)])
    turn = quaternion.matrices_from_ros(quaternion.to_ros(frames))
    strain = np.einsum("nij,ni->nj", turn, M) / rod.K
    return np.array(
        [np.hypot(*strain[:, :2].T).max(), np.einsum("na,na->n", t, G).max(), np.abs(strain[:, 2]).max()]
    )


@pytest.mark.parametrize("name", ["space_arm_+0.0deg", "space_arm_+90.0deg", "cable_02", "cable_05"])
def test_they_are_those_of_a_plain_sum(name):
    found = uniform(name, 4, 12)
    # The trapezoidal rule on 20,000 intervals is off by about 1e-8 of moments of some tens.
    np.testing.assert_allclose(worst(found), plain(found), rtol=1e-6)


@pytest.mark.parametrize(("order", "counts"), [(3, (16, 32)), (4, (12, 16))])
@pytest.mark.parametrize("name", ["space_arm_+0.0deg", "cable_08"])
def test_they_gain_an_order_over_the_elements_own_strain(name, order, counts):
    coarse, fine = (np.abs(worst(uniform(name, order, n)) / worst(reference(name)) - 1.0) for n in counts)
    rates = np.log(coarse / fine) / np.log(counts[1] / counts[0])
    # Interpolated frames are of order p + 1, their derivative of order p.
    assert (rates > order + 0.5).all()
    # Where it is largest at a clamp, the moment is the end wrench's, of order 2 p.
    assert rates[0] > 2 * order - 0.8
