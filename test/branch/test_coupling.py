# SPDX-License-Identifier: Apache-2.0
"""Compiled arithmetic of supports against its formulas in plain NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cable_ros.branch.coupled_state import Shared
from cable_ros.branch.coupling import PER, WRENCH, Ends, Section, step_size

RNG = np.random.default_rng(5)
NOTHING = np.zeros(2)


def test_ends_are_read_from_wrenches():
    """H = F.t + 1/2 m.K^-1 m + m.kappa0 with what is beyond the point pulling: signs of start and end."""
    wrenches, section = RNG.normal(size=12), Section(np.array([0.2, 0.3, 0.1]), np.array([0.5, -1.0, 2.0]))
    ends = Ends.of(wrenches, section)
    for i, sign in enumerate((1.0, -1.0)):
        force, moment = sign * wrenches.reshape(2, 2, 3)[i]
        assert ends.curvatures[i] == pytest.approx(moment / section.stiffness + section.natural)
        elastic = 0.5 * moment @ (moment / section.stiffness) + moment @ section.natural
        assert ends.forces[i] == pytest.approx(force[2] + elastic)


@pytest.mark.parametrize("supports", [1, 3])
def test_a_step_is_as_large_as_its_largest_part(supports):
    step, shortest = RNG.normal(size=PER * supports), 0.3
    lengths = np.arange(len(step)) % PER == PER - 1
    wrenches = RNG.normal(size=12 * (supports + 1))
    spread = RNG.normal(size=(len(wrenches) + 6, len(step)))  # the last rows are those of an obstacle
    each = step.reshape(-1, PER)
    plain = max(np.abs(each[:, :3]).max(), np.abs(each[:, 3]).max() / shortest)
    unknown = np.empty((0, len(step)))
    assert step_size(step, lengths, shortest, unknown, wrenches, NOTHING) == pytest.approx(plain)
    change = np.abs(spread[: len(wrenches)] @ step).reshape(-1, 2, 3).max(axis=(0, 2))
    whole = np.abs(wrenches).reshape(-1, 2, 3).max(axis=(0, 2))
    for factor in (1e-3, 1e3):  # either part decides
        found = step_size(step, lengths, shortest, factor * spread, wrenches, NOTHING)
        assert found == pytest.approx(max(plain, WRENCH * factor * (change / whole).max()))
    step[-1] = np.nan
    assert np.isnan(step_size(step, lengths, shortest, spread, wrenches, NOTHING))


def test_sections_turn_in_their_mounts():
    count = 3
    mounts = np.concatenate([RNG.normal(size=(count, 2, 3)), np.empty((count, 2, 4))], axis=2)
    mounts[:, :, 3:] = Rotation.random(2 * count, random_state=RNG).as_quat().reshape(count, 2, 4)
    mounts[1:, 0] = mounts[:-1, 1]
    turns = Rotation.random(count - 1, random_state=RNG)
    state = Shared(turns.as_quat()[:, [3, 0, 1, 2]], np.array([0.2, 0.7]))
    places = state.places(mounts, 1.0)
    assert [place.length for place in places] == pytest.approx([0.2, 0.5, 0.3])
    for j, turn in enumerate(turns):
        expected = (Rotation.from_quat(mounts[j, 1, 3:]) * turn).as_matrix()
        for pose in (places[j].poses[1], places[j + 1].poses[0]):
            np.testing.assert_allclose(Rotation.from_quat(pose[3:]).as_matrix(), expected, atol=1e-14)
    for place, mount in zip(places, mounts, strict=True):
        assert np.array_equal(place.poses[:, :3], mount[:, :3])
    assert np.array_equal(places[0].poses[0], mounts[0, 0])
    assert np.array_equal(places[-1].poses[1], mounts[-1, 1])
