# SPDX-License-Identifier: Apache-2.0
"""Hoses of benchmarks/random_dress_packs.py whose branch was lost; needs example-robot-data."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest
from scripts import need_arm, script

from cable_ros import Tracker, load_scene
from cable_ros.equilibrium import Status

pytest.importorskip("trimesh", reason="the arm's meshes need trimesh")
pytest.importorskip("tqdm", reason="the benchmark shows its progress")


@pytest.fixture(scope="module")
def packs() -> ModuleType:
    module = script("benchmarks/random_dress_packs.py")
    need_arm(module.dress_pack)
    return module


LOST = {
    # squeezed between two links, a third lets go: no soft obstacles lead away from there
    "in a tube, between three links": (1, 31, 0.0, 150, 120),
    # sliding over one link it lands on the next one, whose normal is almost the same
    "in a tube, from link to link": (1, 7, 0.3, 100, 40),
    # a long fall, past a second link
    "between clips, from link to link": (1, 22, 0.3, 100, 85),
}
"""Seed, index, friction of the links, poses of the whole path, and how many of them."""


@pytest.mark.parametrize("name", LOST)
def test_a_hose_falls_to_another_equilibrium(packs, name):
    seed, index, friction, count, last = LOST[name]
    g = np.random.default_rng([seed, index])
    _, values = packs.hose(g, friction)
    tracker = Tracker(load_scene(values))
    path = packs.dress_pack.poses(count, packs.round_trip(g))
    found = [tracker.arrive(joints)["hose"] for joints in path[:last]]
    assert {one.status for one in found} == {Status.CONVERGED, Status.SNAPPED}, found[-1].message
