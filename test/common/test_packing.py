# SPDX-License-Identifier: Apache-2.0
"""Packed objects come back to the last bit, and what is mostly zeros takes little room."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from cable_ros import Tracker, load_scene
from cable_ros.common.packing import LARGE, pack, unpack
from cable_ros.share import share_file


@pytest.mark.parametrize("order", ["C", "F"])
def test_every_bit_comes_back(order):
    array = np.zeros((LARGE // 50, 100), order=order)
    array[3, 4:8] = 1.0, -0.0, np.nan, np.inf
    array[-1, -1] = 5e-324
    back = unpack(pack({"of": array}))["of"]
    assert back.shape == array.shape
    assert back.tobytes("A") == array.tobytes("A")
    assert np.signbit(back[3, 5])


def test_room_is_that_of_what_is_not_zero():
    rng = np.random.default_rng(1)
    sparse, dense = np.zeros(100 * LARGE), rng.random(100 * LARGE)
    sparse[rng.integers(0, sparse.size, 50)] = 1.0
    assert len(pack(sparse)) < 2_000
    assert len(pack(dense)) == pytest.approx(dense.nbytes, rel=0.01)
    assert np.array_equal(unpack(pack(dense)), dense)


def test_the_state_of_a_cable_in_contact_can_be_sent():
    """Its work arrays alone have 37 MB; a state goes to a process and back for every 64 poses."""
    scene = load_scene(share_file("config", "space_arm_sphere.yaml"))
    smooth = tuple(dataclasses.replace(obstacle, friction=0.0) for obstacle in scene.obstacles)
    tracker = Tracker(dataclasses.replace(scene, obstacles=smooth))
    assert tracker.arrive({"orientation": 1.0})["camera_cable"].contacts
    (tracked,) = tracker._tracked_cables
    # memory that was another's before
    tracked.rod.complement[tracked.rod.rows :] = np.pi
    tracked.rod.V[tracked.rod.rows :] = np.pi
    assert len(tracker.snapshot()) < 1_000_000
