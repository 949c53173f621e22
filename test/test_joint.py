# SPDX-License-Identifier: Apache-2.0
"""Joint load: virtual work, its exact derivative, and the angles at which the paper's joint rests."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from cable_ros import Tracker
from cable_ros.joint import (
    RestingAngle,
    joint_load,
    joint_stiffness,
    joint_torque,
    positions_in_gap,
    resting_angles,
)
from cable_ros.scene import load_scene
from cable_ros.share import share_file

ARM = share_file("config", "space_arm.yaml")

# Turning and sliding joints, skew axes, a branch; one cable between two links, one from the world to the
# last.
ROBOT = """<robot name="chain">
  <link name="world"/> <link name="rail"/> <link name="column"/> <link name="hand"/> <link name="lid"/>
  <joint name="slide" type="prismatic">
    <parent link="world"/><child link="rail"/><origin xyz="0 0 0.1" rpy="0.2 0 0.3"/>
    <axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
  <joint name="swivel" type="continuous">
    <parent link="rail"/><child link="column"/><origin xyz="0.1 0 0.1"/><axis xyz="0 0.6 0.8"/>
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="column"/><child link="hand"/><origin xyz="0 0.1 0.2" rpy="0 0.5 0"/><axis xyz="1 0 0"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/>
  </joint>
  <joint name="hinge" type="revolute">
    <parent link="column"/><child link="lid"/><origin xyz="0.1 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/>
  </joint>
</robot>
"""
POSE = {"slide": 0.05, "swivel": 0.4, "elbow": -0.3, "hinge": 0.2}
SECTION = {"length": 0.5, "stiffness": [1.0e-3, 1.4e-3, 0.8e-3], "linear_density": 0.08}
CABLES = [
    {
        "name": "inner",
        "start": {"link": "lid", "position": [0.1, 0.0, 0.0], "orientation": [0.0, 0.6, 0.0, 0.8]},
        "end": {"link": "hand", "position": [0.0, 0.1, 0.2], "orientation": [0.5, 0.5, 0.5, 0.5]},
    },
    {
        "name": "outer",
        "start": {"position": [-0.2, 0.1, 0.3], "orientation": [0.0, 0.0, 0.0, 1.0]},
        "end": {"link": "hand", "position": [0.05, 0.0, 0.1], "orientation": [0.6, 0.0, 0.0, 0.8]},
    },
]


@pytest.fixture(scope="module")
def chain():
    cables = [{**SECTION, **cable} for cable in CABLES]
    scene = {"robot": {"urdf": "robot.urdf"}, "gravity": [1.0, -2.0, -9.0], "cables": cables}
    return Tracker(load_scene(scene, urdf=ROBOT), tolerance=1e-9)


@pytest.fixture
def arm():
    return Tracker(load_scene(ARM), tolerance=1e-6)


def moved(joint, by):
    return {**POSE, joint: POSE[joint] + by}


def derivative(function, joint, step=1e-4):
    """Central difference of fourth order: here truncation and rounding stay below 1e-7 (measured)."""
    near = function(moved(joint, step)) - function(moved(joint, -step))
    far = function(moved(joint, 2 * step)) - function(moved(joint, -2 * step))
    return (8 * near - far) / (12 * step)


def potential(tracker, joints):
    """Energy of all cables; their start clamps rise and fall with the joints."""
    return sum(one.energy for one in tracker.solve(joints).values())


def test_torque_is_minus_the_derivative_of_the_energy(chain):
    torque = joint_load(chain, chain.solve(POSE), POSE).torque
    by_energy = [-derivative(lambda joints: potential(chain, joints), name) for name in chain.joint_names]
    assert set(chain.joint_names) == set(POSE)
    assert torque == pytest.approx(by_energy, rel=0, abs=1e-8 * np.abs(torque).max())


def test_stiffness_is_the_derivative_of_the_torque(chain):
    def torque(joints):
        return joint_torque(chain, chain.solve(joints), joints)

    stiffness = joint_stiffness(chain, chain.solve(POSE), POSE)
    by_torque = np.stack([derivative(torque, name) for name in chain.joint_names], axis=1)
    assert stiffness == pytest.approx(by_torque, rel=0, abs=1e-7 * np.abs(stiffness).max())
    # dead weights and elastic cables have an energy: its second derivative is symmetric, to rounding
    assert stiffness == pytest.approx(stiffness.T, rel=0, abs=1e-10 * np.abs(stiffness).max())


def test_torque_of_a_force_and_a_moment_about_the_joints_axis(arm):
    joints = {"orientation": 0.7}
    found = arm.solve(joints)
    c, s = np.cos(0.7), np.sin(0.7)
    force = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ found["camera_cable"].end_wrench[:3]
    lever = np.array([0.08 * c - 0.145 * s, 0.08 * s + 0.145 * c])
    arm_alone = lever[0] * force[1] - lever[1] * force[0]
    assert joint_torque(arm, found, joints, moments=False) == pytest.approx([arm_alone], rel=1e-12)
    # the clamp turns about Z with the joint, so the moment's Z counts as it is; the start is in the world
    whole = arm_alone + found["camera_cable"].end_wrench[5]
    assert joint_torque(arm, found, joints) == pytest.approx([whole], rel=1e-12)
    assert joint_load(arm, found, joints).torque == pytest.approx([whole], rel=1e-12)


def test_a_scene_without_joints_has_no_load():
    start = CABLES[1]["start"]
    still = {**SECTION, "name": "still", "start": start, "end": start | {"position": [0, 0.1, 0.5]}}
    tracker = Tracker({"gravity": [0, 0, -9.8], "cables": [still]})
    load = joint_load(tracker, tracker.solve({}), {})
    assert load.torque.shape == (0,)
    assert load.stiffness.shape == (0, 0)


def test_no_number_where_the_equilibrium_is_not_trusted(arm):
    joints = {"orientation": float("nan")}
    load = joint_load(arm, arm.solve(joints), {"orientation": 0.0})
    assert np.isnan(load.torque).all()
    assert np.isnan(load.stiffness).all()


def test_the_papers_joint_rests_where_force_and_moment_balance(arm):
    found = resting_angles(arm, "orientation", np.radians(np.arange(-90, 91, 10)))
    # model: near -37 and +45 deg, read off a coarser curve
    assert np.degrees([one.angle for one in found]) == pytest.approx([-37, 45], abs=1)
    assert [one.stable for one in found] == [False, True]
    for one in found:
        joints = {"orientation": one.angle}
        torque, stiffness = joint_load(arm, arm.solve(joints), joints)
        # the scale is the torque at 0 deg, 7.7 mN m; a zero good to 1e-12 rad leaves far less than the
        # solver's 1e-6
        assert abs(torque[0]) < 1e-6 * 7.7e-3
        assert one.stiffness == pytest.approx(stiffness[0, 0], rel=1e-6)


def test_the_forces_arm_alone_would_put_it_elsewhere(arm):
    def torque(angle):
        joints = {"orientation": angle}
        return joint_torque(arm, arm.solve(joints), joints, moments=False)[0]

    crossings = [brentq(torque, *np.radians(bracket), xtol=1e-6) for bracket in ((-45, 0), (0, 45))]
    # model: near -27 and +16 deg
    assert np.degrees(crossings) == pytest.approx([-27, 16], abs=1)


def test_a_joint_with_backlash_waits_at_a_stable_angle_and_jumps_at_an_unstable_one(arm):
    unstable, stable = resting_angles(arm, "orientation", np.radians([-60, -30, 0, 30, 60]))
    gap = np.radians(0.8)
    for offset in (-0.3, 0.0, 0.3):  # of the gap: the drive passes, the joint does not move
        (at,) = positions_in_gap(arm, "orientation", stable.angle + offset * gap, gap)
        assert at == pytest.approx(stable.angle, abs=1e-9)
    for side in (-1, 1):
        drive = stable.angle + side * 0.7 * gap
        assert positions_in_gap(arm, "orientation", drive, gap) == pytest.approx([drive - side * gap / 2])
    drive = unstable.angle + 0.3 * gap
    ends = [drive - gap / 2, drive + gap / 2]
    assert positions_in_gap(arm, "orientation", drive, gap) == pytest.approx(ends)
    drive = unstable.angle + 0.7 * gap
    assert positions_in_gap(arm, "orientation", drive, gap) == pytest.approx([drive + gap / 2])


def test_friction_holds_a_joint_about_its_resting_angle():
    low, high = RestingAngle(0.8, -0.01).held_range(1e-4)
    assert (low, high) == pytest.approx((0.79, 0.81))


def test_errors_name_joint_and_cable(arm):
    with pytest.raises(ValueError, match=r"'pitch' moves no cable; those that do: orientation"):
        resting_angles(arm, "pitch", [0.0, 1.0])
    with pytest.raises(ValueError, match=r"cable 'camera_cable' at orientation = nan: .*finite"):
        resting_angles(arm, "orientation", [0.0, float("nan")])
