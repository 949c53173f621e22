# SPDX-License-Identifier: Apache-2.0
"""Joint load with obstacles that links carry: virtual work, balance of moments, finite differences."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cable_ros import Status, Tracker
from cable_ros.joint import joint_load, joint_torque
from cable_ros.rod.quaternion import matrices_from_ros
from cable_ros.scene import load_scene

GRAVITY = [0.0, 0.0, -9.81]

# A vertical pan axis carries everything; the start clamp and the obstacle move on links of their own.
ROBOT = """<robot name="chain">
  <link name="world"/> <link name="base"/> <link name="column"/> <link name="hand"/> <link name="roller"/>
  <joint name="pan" type="continuous">
    <parent link="world"/><child link="base"/><origin xyz="0.1 0.05 0.1"/><axis xyz="0 0 1"/>
  </joint>
  <joint name="slide" type="prismatic">
    <parent link="base"/><child link="column"/><origin xyz="0 0 0.1" rpy="0.1 0.05 0.2"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="column"/><child link="hand"/><origin xyz="0 0 0.1"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/>
  </joint>
  <joint name="tilt" type="revolute">
    <parent link="column"/><child link="roller"/><origin xyz="0.1 0 0"/><axis xyz="0.6 0.8 0"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/>
  </joint>
</robot>
"""
POSE = {"pan": 0.3, "slide": 0.02, "elbow": 0.1, "tilt": 0.05}
CABLE = {
    "name": "cable",
    "length": 0.55,
    "stiffness": [1.0e-3, 1.4e-3, 0.8e-3],
    "outer_diameter": 0.006,
    "linear_density": 0.12,
    "start": {"link": "hand", "position": [0, 0, 0.1], "orientation": [0, 0.5, 0, 3**0.5 / 2]},
    "end": {"link": "roller", "position": [0.3, 0.02, 0.12], "orientation": [0, 0.8, 0, 0.6]},
}
SHAPES: dict[str, dict[str, Any]] = {
    "sphere": {"sphere": {"center": [0.2, 0.03, 0.08], "radius": 0.06}},
    "capsule": {"capsule": {"start": [0.2, -0.2, 0.08], "end": [0.22, 0.3, 0.08], "radius": 0.06}},
    "plane": {"plane": {"point": [0, 0, 0.13], "normal": [0.05, 0.1, 1.0]}},
    "box": {"box": {"center": [0.2, 0.05, 0.1], "size": [0.1, 0.5, 0.06], "orientation": [0, 0, 0.28, 0.96]}},
}  # fmt: skip


def tracker(shape: dict[str, Any], friction: float = 0.0, tolerance: float = 1e-8, **more: Any) -> Tracker:
    obstacle = {"name": "obstacle", "link": "roller", "friction": friction, **shape}
    scene = {"robot": {"urdf": "robot.urdf"}, "gravity": GRAVITY, "obstacles": [obstacle], "cables": [CABLE]}
    return Tracker(load_scene({**scene, **more}, urdf=ROBOT), tolerance=tolerance)


def led(tracker: Tracker, pose: dict[str, float], steps: int = 10):
    """The equilibria at `pose`, reached from all joints at zero."""
    for k in range(steps + 1):
        found = tracker.solve({name: value * k / steps for name, value in pose.items()})
    assert all(one.status is Status.CONVERGED for one in found.values()), found
    return found


def derivative(tracker: Tracker, function, pose: dict[str, float], joint: str, step: float = 1e-4):
    """Central difference of fourth order by a joint, each time from the same equilibrium."""
    start = tracker.snapshot()
    values = []
    for k in (-2, -1, 1, 2):
        tracker.restore(start)
        joints = {**pose, joint: pose[joint] + k * step}
        values.append(function(tracker.solve(joints), joints))
    tracker.restore(start)
    return (8 * (values[2] - values[1]) - (values[3] - values[0])) / (12 * step)


@pytest.mark.parametrize("shape", SHAPES)
def test_virtual_work_and_stiffness_with_an_obstacle_on_a_link(shape: str) -> None:
    model = tracker(SHAPES[shape])
    found = led(model, POSE)
    assert "obstacle" in found["cable"].obstacle_wrenches
    load = joint_load(model, found, POSE)
    assert joint_torque(model, found, POSE) == pytest.approx(load.torque, rel=1e-12, abs=1e-14)

    def energy(found, joints):
        return found["cable"].energy

    def torque(found, joints):
        return joint_torque(model, found, joints)

    work = [-derivative(model, energy, POSE, name) for name in model.joint_names]
    assert load.torque == pytest.approx(work, rel=0, abs=1e-6 * np.abs(load.torque).max())
    numeric = np.stack([derivative(model, torque, POSE, name) for name in model.joint_names], axis=1)
    assert load.stiffness == pytest.approx(numeric, rel=0, abs=1e-5 * np.abs(numeric).max())
    # an energy's second derivative is symmetric
    assert load.stiffness == pytest.approx(load.stiffness.T, rel=0, abs=1e-9 * np.abs(numeric).max())


def test_what_the_obstacle_bears_is_what_the_weight_and_the_clamps_leave() -> None:
    model = tracker(SHAPES["capsule"], friction=0.4, tolerance=1e-6)
    found = led(model, POSE)["cable"]
    q = np.array([POSE[name] for name in model.joint_names])
    force, moment = np.zeros(3), np.zeros(3)
    for pose, wrench in zip(
        model.kinematics.poses(q)[0], (found.start_wrench, found.end_wrench), strict=True
    ):
        turn = matrices_from_ros(np.ascontiguousarray(pose[None, 3:]))[0]
        force += turn @ wrench[:3]
        moment += np.cross(pose[:3], turn @ wrench[:3]) + turn @ wrench[3:]
    (bears,) = found.obstacle_wrenches.values()
    by_contacts = -sum(contact.force for contact in found.contacts)
    assert bears[:3] == pytest.approx(by_contacts, rel=1e-12)
    weight = CABLE["linear_density"] * CABLE["length"] * np.array(GRAVITY)
    assert force + bears[:3] == pytest.approx(weight, rel=0, abs=1e-9)
    # the weight has no moment about a vertical axis
    assert moment[2] + bears[5] == pytest.approx(0.0, abs=1e-6 * np.linalg.norm(moment))


def test_sticking_contacts_go_with_their_obstacle() -> None:
    model = tracker(SHAPES["sphere"], friction=2.0, tolerance=1e-7)
    found = led(model, POSE)
    assert found["cable"].contacts
    assert not any(contact.sliding for contact in found["cable"].contacts)
    load = joint_load(model, found, POSE)

    def torque(found, joints):
        assert not any(contact.sliding for contact in found["cable"].contacts)
        return joint_torque(model, found, joints)

    numeric = np.stack([derivative(model, torque, POSE, name, 1e-5) for name in model.joint_names], axis=1)
    assert load.stiffness == pytest.approx(numeric, rel=0, abs=1e-5 * np.abs(numeric).max())


PLANAR = """<robot name="planar">
  <link name="world"/> <link name="cart"/> <link name="bar"/>
  <joint name="x" type="prismatic">
    <parent link="world"/><child link="cart"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
  <joint name="lift" type="prismatic">
    <parent link="world"/><child link="bar"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
</robot>
"""


@pytest.mark.parametrize(("joint", "friction"), [("x", 0.01), ("lift", 0.05)])
def test_what_slides_lengthwise_slides_on(joint: str, friction: float) -> None:
    cable = {
        **CABLE,
        "stiffness": [0.1, 1e-3, 0.1],  # stays in its plane
        "start": {"position": [0, 0, 0.4], "orientation": [1, 0, 0, 0]},
        "end": {"link": "cart", "position": [0.3, 0, 0.4], "orientation": [0, 0, 1, 0]},
    }
    bar = {"name": "bar", "link": "bar", "friction": friction,
           "capsule": {"start": [0.13, -1, 0.1], "end": [0.13, 1, 0.1], "radius": 0.03}}  # fmt: skip
    scene = {"robot": {"urdf": "r.urdf"}, "gravity": GRAVITY, "obstacles": [bar], "cables": [cable]}
    model = Tracker(load_scene(scene, urdf=PLANAR), tolerance=1e-7)
    pose = {"x": 0.0, "lift": 0.0}
    model.solve(pose)
    for lift in np.linspace(0.01, 0.15, 15):
        model.solve(pose := {"x": 0.0, "lift": lift})
    for _ in range(10):
        found = model.solve(pose := {**pose, joint: pose[joint] + 0.003})
    assert found["cable"].contacts
    assert all(contact.sliding for contact in found["cable"].contacts)
    load = joint_load(model, found, pose)
    step, torques = 2e-4, [load.torque]
    for _ in range(2):
        pose = {**pose, joint: pose[joint] + step}
        torques.append(joint_torque(model, model.solve(pose), pose))
    onward = (-3 * torques[0] + 4 * torques[1] - torques[2]) / (2 * step)
    column = load.stiffness[:, model.joint_names.index(joint)]
    # one-sided, of second order
    assert column == pytest.approx(onward, rel=0, abs=1e-3 * np.abs(onward).max())


def six_axes() -> str:
    """An arm with the proportions of a UR10e: pan, two long links about level axes, a wrist of three axes."""
    joints = [
        ("pan", "world", "shoulder", "0 0 0.18", "0 0 1"),
        ("lift", "shoulder", "upper", "0 0.18 0", "0 1 0"),
        ("elbow", "upper", "forearm", "0 -0.14 0.61", "0 1 0"),
        ("wrist_1", "forearm", "wrist", "0 0 0.57", "0 1 0"),
        ("wrist_2", "wrist", "second", "0 0.12 0", "0 0 1"),
        ("wrist_3", "second", "tool", "0 0 0.12", "0 1 0"),
    ]
    links = ["world", *(child for _, _, child, _, _ in joints)]
    return (
        '<robot name="arm">'
        + "".join(f'<link name="{name}"/>' for name in links)
        + "".join(
            f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{origin}"/><axis xyz="{axis}"/>'
            '<limit lower="-7" upper="7" effort="1" velocity="1"/></joint>'
            for name, parent, child, origin, axis in joints
        )
        + "</robot>"
    )


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_no_torque_about_a_vertical_pan_axis_that_carries_all(friction: float) -> None:
    def capsule(name: str, link: str, length: float) -> dict[str, Any]:
        shape = {"start": [0, 0, 0.0], "end": [0, 0, length], "radius": 0.06}
        return {"name": name, "link": link, "capsule": shape, "friction": friction}

    hose = {
        "name": "hose",
        "length": 1.6,
        "stiffness": [0.3, 0.3, 0.24],
        "outer_diameter": 0.03,
        "linear_density": 0.6,
        "start": {"link": "shoulder", "position": [0.12, 0.1, 0.1], "orientation": [0, 0, 0, 1]},
        "end": {"link": "wrist", "position": [0, 0.1, 0.1], "orientation": [0, 0, 0, 1]},
    }
    scene = {
        "robot": {"urdf": "arm.urdf"},
        "gravity": GRAVITY,
        "obstacles": [capsule("upper arm", "upper", 0.61), capsule("lower arm", "forearm", 0.5)],
        "cables": [hose],
    }
    model = Tracker(load_scene(scene, urdf=six_axes()), tolerance=1e-6)
    pose = {"pan": 0.5, "lift": 0.6, "elbow": 0.9, "wrist_1": -0.8, "wrist_2": 0.3}
    assert set(model.joint_names) >= {"pan", "lift", "elbow", "wrist_1"}
    touched = False
    for k in range(13):
        joints = {name: pose.get(name, 0.0) * k / 12 for name in model.joint_names}
        found = model.arrive(joints)
        assert found["hose"].status.trusted, found["hose"].message
        load = joint_load(model, found, joints)
        others = np.abs(load.torque).max()
        assert load.torque[0] == pytest.approx(0.0, abs=1e-6 * others)
        if bears := found["hose"].obstacle_wrenches:
            # without the reactions it would not be
            touched = touched or max(abs(wrench[5]) for wrench in bears.values()) > 1e-2 * others
        # turning all about the vertical changes nothing
        assert load.stiffness[:, 0] == pytest.approx(0.0, abs=1e-6 * np.abs(load.stiffness).max())
    assert touched
