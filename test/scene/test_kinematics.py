# SPDX-License-Identifier: Apache-2.0
"""Where the clamps are: against the paper's formula, plain trigonometry and finite differences."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cable_ros.scene import Kinematics, SceneError, load_scene
from cable_ros.share import share_file

ARM = share_file("config", "space_arm.yaml")

# A chain with every kind of joint, a branch, turned origins, and axes that are not unit vectors.
MANY = """<?xml version="1.0"?>
<robot name="many">
  <link name="ground"/> <link name="rail"/> <link name="column"/> <link name="bracket"/>
  <link name="hand"/> <link name="finger"/> <link name="idle"/>
  <joint name="slide" type="prismatic">
    <parent link="ground"/><child link="rail"/><origin xyz="0 0 0.5" rpy="0 0 1.5707963267948966"/>
    <axis xyz="2 0 0"/><limit lower="0" upper="1" effort="1" velocity="1"/>
  </joint>
  <joint name="swivel" type="continuous">
    <parent link="rail"/><child link="column"/><origin xyz="0.1 0.2 0.3"/><axis xyz="0 0 -3"/>
  </joint>
  <joint name="weld" type="fixed">
    <parent link="column"/><child link="bracket"/><origin xyz="0 0.4 0" rpy="0.3 -0.2 0.7"/>
  </joint>
  <joint name="elbow" type="revolute">
    <parent link="bracket"/><child link="hand"/><origin xyz="0 0 0.6" rpy="0 0.5 0"/>
    <axis xyz="0.6 0 0.8"/><limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
  <joint name="grip" type="revolute">
    <parent link="hand"/><child link="finger"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
  <joint name="loose" type="floating"><parent link="ground"/><child link="idle"/></joint>
</robot>
"""


def clamp(link: str | None, position: Any = (0, 0, 0), orientation: Any = (0, 0, 0, 1)) -> dict[str, Any]:
    fields = {"position": list(position), "orientation": list(orientation)}
    return fields if link is None else {"link": link, **fields}


def cable(name: str, start: dict[str, Any], end: dict[str, Any]) -> dict[str, Any]:
    return {
        "name": name,
        "length": 1.0,
        "stiffness": [0.02, 0.02, 0.015],
        "linear_density": 0.1,
        "start": start,
        "end": end,
    }


def kinematics(*cables: dict[str, Any], urdf: str | None = MANY) -> Kinematics:
    return Kinematics(load_scene({"gravity": [0, 0, -9.81], "cables": list(cables)}, urdf=urdf))


def refusal(*cables: dict[str, Any], urdf: str) -> str:
    with pytest.raises(SceneError) as caught:
        kinematics(*cables, urdf=urdf)
    return str(caught.value)


@pytest.mark.parametrize("degrees", [-90, -37, 0, 45, 60, 90, 360 + 30])
def test_arm_against_equation_47(degrees: float) -> None:
    arm = Kinematics(load_scene(ARM))
    assert arm.joint_names == ("orientation",)
    g = np.deg2rad(degrees)
    start, end = arm.poses(np.array([g]))[0]
    s, c = np.sin(g), np.cos(g)
    expected = np.array([160 - 145 * s + 80 * c, 80 * s + 145 * c, 75]) / 1000
    np.testing.assert_allclose(end[:3], expected, atol=1e-15)  # a few roundings of 0.3 m
    turn = Rotation.from_quat(end[3:]).as_matrix()
    np.testing.assert_allclose(turn, Rotation.from_rotvec([0, 0, g]).as_matrix(), atol=1e-14)
    np.testing.assert_allclose(start[:3], 0)
    tangent = Rotation.from_quat(start[3:]).apply([0, 0, 1])
    np.testing.assert_allclose(tangent, [0, -1, 0], atol=1e-15)


def by_hand(slide: float, swivel: float, elbow: float) -> tuple[np.ndarray, Rotation]:
    """Pose of `hand` in MANY, joint by joint."""
    position, turn = np.zeros(3), Rotation.identity()
    axis = np.array([0.6, 0, 0.8])
    chain = [
        ([0, 0, 0.5], [0, 0, np.pi / 2], [slide, 0, 0], [0, 0, 0]),
        ([0.1, 0.2, 0.3], [0, 0, 0], [0, 0, 0], [0, 0, -swivel]),
        ([0, 0.4, 0], [0.3, -0.2, 0.7], [0, 0, 0], [0, 0, 0]),
        ([0, 0, 0.6], [0, 0.5, 0], [0, 0, 0], elbow * axis),
    ]
    for origin, rpy, shift, rotation in chain:
        position = position + turn.apply(origin)
        turn = turn * Rotation.from_euler("xyz", rpy)
        position = position + turn.apply(shift)
        turn = turn * Rotation.from_rotvec(rotation)
    return position, turn


def test_every_kind_of_joint() -> None:
    offset, turned = np.array([0.05, -0.02, 0.1]), Rotation.from_rotvec([0.4, 0.5, -0.6])
    many = kinematics(
        cable("a", clamp("rail"), clamp("hand", offset, turned.as_quat())),
        cable("b", clamp("ground", [1, 2, 3]), clamp(None, [4, 5, 6])),
    )
    assert many.joint_names == ("slide", "swivel", "elbow")  # nothing hangs on grip or loose
    for q in ([0, 0, 0], [0.3, 0.7, -0.4], [-0.2, 5 * 2 * np.pi + 0.1, 2.0]):
        position, turn = by_hand(*q)
        poses = many.poses(np.array(q))
        assert poses.shape == (2, 2, 7)
        # A few roundings; of five turns, five times more.
        np.testing.assert_allclose(poses[0, 1, :3], position + turn.apply(offset), atol=1e-14)
        difference = Rotation.from_quat(poses[0, 1, 3:]).inv() * turn * turned
        assert difference.magnitude() < 1e-14
        np.testing.assert_allclose(poses[0, 0, :3], [0, q[0], 0.5], atol=1e-15)
        np.testing.assert_allclose(poses[1], [[1, 2, 3, 0, 0, 0, 1], [4, 5, 6, 0, 0, 0, 1]], atol=0)


def test_jacobians_against_finite_differences() -> None:
    offset = [0.05, -0.02, 0.1]
    many = kinematics(
        cable("a", clamp("rail", offset), clamp("hand", offset)), cable("b", clamp(None), clamp("column"))
    )
    q, step = np.array([0.2, -0.9, 0.6]), 1e-6
    jacobians = many.jacobians(q)
    assert jacobians.shape == (2, 2, 6, 3)
    for j in range(3):
        shift = step * np.eye(3)[j]
        high, low = many.poses(q + shift), many.poses(q - shift)
        linear = (high - low)[..., :3] / (2 * step)
        # Central differences: truncation near step^2 = 1e-12, rounding near 1e-16 / step = 1e-10.
        np.testing.assert_allclose(jacobians[..., :3, j], linear, atol=1e-9)
        for index in np.ndindex(2, 2):
            turn = Rotation.from_quat(high[index][3:]) * Rotation.from_quat(low[index][3:]).inv()
            np.testing.assert_allclose(jacobians[index][3:, j], turn.as_rotvec() / (2 * step), atol=1e-9)


def test_poses_are_the_callers() -> None:
    arm = Kinematics(load_scene(ARM))
    first = arm.poses(np.array([0.1]))
    kept = first.copy()
    arm.poses(np.array([0.7]))
    np.testing.assert_array_equal(first, kept)
    first[:] = np.nan
    np.testing.assert_array_equal(arm.poses(np.array([0.1])), kept)


def test_world_scene_needs_no_pinocchio() -> None:
    code = """
import sys
sys.modules["pinocchio"] = None
import numpy as np
from cable_ros.scene import Kinematics, SceneError, load_scene
at = {"position": [0, 0, 0], "orientation": [0, 0, 0, 1]}
cable = dict(name="a", length=1, stiffness=[1, 1, 1], linear_density=0, start=at, end=at)
scene = {"gravity": [0, 0, 0], "cables": [cable]}
world = Kinematics(load_scene(scene))
assert world.joint_names == ()
assert world.poses(np.zeros(0)).shape == (1, 2, 7)
assert world.jacobians(np.zeros(0)).shape == (1, 2, 6, 0)
cable["end"] = {"link": "hand", **at}
try:
    Kinematics(load_scene(scene, urdf="<robot name='r'><link name='hand'/></robot>"))
except SceneError as error:
    print(error)
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "pip install pin" in run.stdout
    assert "ros-jazzy-pinocchio" in run.stdout


def test_clamp_on_the_root_link() -> None:
    fixed = kinematics(cable("a", clamp("ground", [0, 0, 1]), clamp("ground", [0, 0, 2])))
    assert fixed.joint_names == ()
    np.testing.assert_array_equal(fixed.poses(np.zeros(0))[0, :, 2], [1, 2])
    assert fixed.jacobians(np.zeros(0)).shape == (1, 2, 6, 0)


MIMIC = '<mimic joint="slide"/>'
BROKEN = {
    "mimic": (
        MANY.replace('<axis xyz="0 0 -3"/>', '<axis xyz="0 0 1"/>' + MIMIC),
        "joint 'swivel': it mimics",
    ),
    "floating": (MANY.replace('"continuous"', '"floating"'), "joint 'swivel': its type 'floating'"),
    "zero axis": (MANY.replace("0 0 -3", "0 0 0"), "joint 'swivel': its axis is zero"),
    "axis of words": (MANY.replace("0 0 -3", "up"), "joint 'swivel': its xyz 'up'"),
    "origin not finite": (MANY.replace("0.1 0.2 0.3", "0.1 nan 0"), "joint 'swivel': its xyz '0.1 nan 0'"),
    "ring": (
        MANY.replace(
            '<parent link="ground"/><child link="rail"/>', '<parent link="hand"/><child link="rail"/>'
        ),
        "form a ring",
    ),
    "two parents": (MANY.replace('<child link="idle"/>', '<child link="hand"/>'), "already hangs on joint"),
    "no child": (MANY.replace('<child link="hand"/>', ""), "joint 'elbow': it has no child link"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_urdf_that_cannot_be_used(name: str) -> None:
    urdf, told = BROKEN[name]
    assert told in refusal(cable("a", clamp("rail"), clamp("hand")), urdf=urdf)


def test_two_roots() -> None:
    urdf = "<robot name='r'><link name='left'/><link name='right'/></robot>"
    text = refusal(cable("a", clamp("left"), clamp("right")), urdf=urdf)
    assert "no joints connect the links left, right" in text
