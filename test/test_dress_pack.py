# SPDX-License-Identifier: Apache-2.0
"""A hose with clips and a ring on a real arm, as the example has it; needs example-robot-data."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest
from scripts import need_arm, script

from cable_ros import Tracker, load_scene
from cable_ros.joint import joint_load

pytest.importorskip("trimesh", reason="the arm's meshes need trimesh")


@pytest.fixture(scope="module")
def example() -> ModuleType:
    module = script("examples/dress_pack.py")
    need_arm(module)
    return module


def test_the_hose_follows_a_pick_and_place_outside_the_links(example, capsys):
    path = example.poses(75)
    found = example.run(0.2, path)
    told = capsys.readouterr().out
    assert [one.status.name for one in found if not one.status.trusted] == []
    assert "75 CONVERGED" in told
    assert "deepest 0.000 mm" in told
    assert any(one.contacts for one in found)
    assert "bend_radius: up to" in told
    turns = [joints["wrist_3_joint"] for joints in path]
    assert max(turns) > 2.9
    assert min(turns) < -2.9
    # there and back to the first pose: friction in the ring is all that may differ
    np.testing.assert_allclose(found[-1].end_wrench, found[0].end_wrench, atol=0.2)


def test_the_hose_may_rub_on_the_links(example):
    """It slips along an edge: see `test_rough_wrist`."""
    values = example.scene(links=0.2)
    few, many = (
        [tracker.arrive(joints)["hose"] for joints in example.poses(poses + 1)]
        for poses in (75, 1500)
        for tracker in [Tracker(load_scene(values))]
    )
    assert {one.status.name for one in few + many} == {"CONVERGED"}
    assert sum(contact.sliding for one in many for contact in one.contacts) > 50
    coarse, fine = (
        np.array([one.support_wrenches["ring"][:3] for one in results]) for results in (few, many[::20])
    )
    np.testing.assert_allclose(coarse, fine, atol=0.02 * np.abs(fine).max())


def test_joint_loads_of_the_arm_are_the_slope_of_the_energy(example):
    values = {key: value for key, value in example.scene(0.0).items() if key != "obstacles"}
    tracker = Tracker(load_scene(values), tolerance=1e-8)
    pose = example.poses(75)[7]
    tracker.arrive(pose)
    load = joint_load(tracker, tracker.arrive(pose), pose)
    step = 1e-4
    for i, name in enumerate(tracker.joint_names):
        energies, torques = [], []
        for sign in (1.0, -1.0):
            moved = pose | {name: pose[name] + sign * step}
            found = tracker.arrive(moved)
            energies.append(found["hose"].energy)
            torques.append(joint_load(tracker, found, moved).torque)
        slope = (energies[1] - energies[0]) / (2 * step)
        assert load.torque[i] == pytest.approx(slope, abs=1e-6 * np.abs(load.torque).max())
        column = (torques[0] - torques[1]) / (2 * step)
        np.testing.assert_allclose(load.stiffness[:, i], column, atol=1e-5 * np.abs(load.stiffness).max())
