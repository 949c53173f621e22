# SPDX-License-Identifier: Apache-2.0
"""Units of the cable and the start clamp's frame."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cable_ros.rod import quaternion
from cable_ros.rod.units import Units, relative

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


def test_units_of_force_and_moment() -> None:
    unit = Units(0.5, 2.0)
    assert unit.force == 8.0
    assert unit.moment == 4.0
    assert unit.force * unit.length == unit.moment


def clamps(seed: int) -> tuple[np.ndarray, Rotation, Rotation]:
    rng = np.random.default_rng(seed)
    first, last = Rotation.random(2, random_state=rng)
    poses = np.stack([np.append(rng.normal(size=3), r.as_quat()) for r in (first, last)])
    return poses, first, last


@pytest.mark.parametrize("seed", range(5))
def test_conditions_in_the_start_clamps_frame(seed: int) -> None:
    poses, first, last = clamps(seed)
    weight = np.array([0.3, -2.0, 5.0])
    qe, re, f = relative(poses, IDENTITY, weight, 0.5, 8.0)
    # Products of a few numbers of the order of 1 to 10.
    assert re == pytest.approx(first.inv().apply(poses[1, :3] - poses[0, :3]) / 0.5, abs=1e-14)
    assert f == pytest.approx(first.inv().apply(weight) * 0.5 / 8.0, abs=1e-14)
    expected = (first.inv() * last).as_quat()
    assert abs(quaternion.to_ros(qe) @ expected) == pytest.approx(1.0, abs=1e-14)
    assert qe @ IDENTITY >= 0.0


def test_the_sign_of_the_end_frame_follows_the_one_before() -> None:
    # Two turns of the end clamp about its tangent, in steps: the quaternion comes back after two, not one.
    before = IDENTITY
    frames = []
    for angle in np.linspace(0.0, 4.0 * np.pi, 41):
        end = Rotation.from_rotvec([0.0, 0.0, angle]).as_quat()
        poses = np.array([[0.0] * 6 + [1.0], [0.0, 0.0, 0.5, *end]])
        before, _, _ = relative(poses, before, np.zeros(3), 1.0, 1.0)
        frames.append(before)
    steps = np.sum(np.array(frames[:-1]) * frames[1:], axis=1)
    assert steps == pytest.approx(np.full(40, np.cos(np.pi / 20)), abs=1e-14)
    assert frames[20] == pytest.approx(-IDENTITY, abs=1e-14)
    assert frames[40] == pytest.approx(IDENTITY, abs=1e-14)
