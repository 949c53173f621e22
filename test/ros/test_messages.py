# SPDX-License-Identifier: Apache-2.0
"""Every message that the node fills in place, byte for byte what rclpy makes of the same message.

But for padding, which rclpy leaves as its buffer happened to be and the node sets to zero.
"""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="rclpy is not on this machine")

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import Point, Pose, PoseStamped, TransformStamped, WrenchStamped
from nav_msgs.msg import Path
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint
from visualization_msgs.msg import MarkerArray

from cable_ros.log.events import decode_event, encode_event, encode_solved_joints
from cable_ros.ros import messages
from cable_ros.ros.cdr_template import HEADER, Template, serialise
from cable_ros.ros.frames import tf_static
from cable_ros.scene.model import Mount

STAMP = 1_234_567_890_987_654_321  # ns
FRAMES = ["", "a", "ab", "abc", "abcd", "camera_cable_end"]
"""Lengths that put what follows at every offset modulo 8."""


def check(data, expected, empty=1):
    """`data` are the bytes of the message `expected`; `empty`: pairs of sequences in it that are empty."""
    theirs = serialize_message(expected)
    # rclpy's end may be padded to four bytes, and counts eight for an empty velocity and effort.
    assert 0 <= len(theirs) - len(data) < 4 + 8 * empty
    # A reader takes in all bytes but the padding: none of those differs ...
    assert deserialize_message(data, type(expected)) == expected
    # ... and the others are zero.
    assert not any(ours for ours, other in zip(data, theirs, strict=False) if ours != other)


def stamped(message):
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(STAMP, 1_000_000_000)
    return message


def pose(values):
    out = Pose()
    out.position.x, out.position.y, out.position.z = values[:3]
    out.orientation.x, out.orientation.y, out.orientation.z, out.orientation.w = values[3:]
    return out


@pytest.mark.parametrize("frame", FRAMES)
def test_wrench(frame):
    values = np.random.default_rng(0).normal(size=6)
    expected = stamped(WrenchStamped())
    expected.header.frame_id = frame
    force, torque = expected.wrench.force, expected.wrench.torque
    force.x, force.y, force.z, torque.x, torque.y, torque.z = values.tolist()
    template = messages.WrenchMessage(frame)
    template.fill(7, np.ones(6))  # what was there before leaves no trace
    check(template.fill(STAMP, values), expected)


@pytest.mark.parametrize("frame", FRAMES)
@pytest.mark.parametrize("count", [2, 3, 101, 1000])
def test_path(frame, count):
    poses = np.random.default_rng(count).normal(size=(count, 7))
    expected = stamped(Path())
    expected.header.frame_id = frame
    for values in poses.tolist():
        expected.poses.append(PoseStamped(header=expected.header, pose=pose(values)))
    template = messages.PathMessage(frame, count)
    template.fill(7, np.ones((count, 3)), np.ones((count, 4)))
    check(template.fill(STAMP, poses[:, :3], poses[:, 3:]), expected)


JOINTS = [["orientation"], ["a", "bc"], ["joint", "elbow_2", "w"], [f"joint_{i}" for i in range(12)]]


@pytest.mark.parametrize("names", JOINTS)
def test_joint_load(names):
    position, effort = np.random.default_rng(1).normal(size=(2, len(names)))
    expected = stamped(JointState(name=names, position=position.tolist(), effort=effort.tolist()))
    data = messages.JointLoadMessage(names).fill(STAMP, position, effort)
    check(data, expected)


@pytest.mark.parametrize("names", [[], *JOINTS])
def test_solved_joints(names):
    position = np.random.default_rng(2).normal(size=len(names))
    expected = stamped(JointState(name=names, position=position.tolist()))
    check(messages.SolvedJointsMessage(names).fill(STAMP, position), expected)
    check(encode_solved_joints(tuple(names), position, STAMP), expected)  # what a sweep logs


@pytest.mark.parametrize("names", JOINTS)
def test_joint_stiffness(names):
    stiffness = np.random.default_rng(3).normal(size=(len(names), len(names)))
    expected = stamped(JointTrajectory(joint_names=names))
    for j in range(len(names)):  # what joint j does to the effort on each
        expected.points.append(JointTrajectoryPoint(effort=stiffness[:, j].tolist()))
    template = messages.JointStiffnessMessage(names)
    template.fill(7, np.ones_like(stiffness))
    check(template.fill(STAMP, stiffness), expected, empty=2 * len(names))


@pytest.mark.parametrize("count", range(4))
def test_diagnostics(count):
    statuses = [
        messages.diagnostic(
            "cable_node: " + "x" * i, DiagnosticStatus.WARN, "Sentence. " * i, {"a" * i: 1.5, "b": i}, "scene"
        )
        for i in range(count)
    ]
    message = messages.diagnostics(STAMP, statuses)
    check(serialise(message), message)


@pytest.mark.parametrize("text", ["", "a", "Größe", "cables:\n" * 1000])
def test_text(text):
    check(serialise(String(data=text)), String(data=text))


def test_events():
    data = encode_event("set", tolerance=1e-4)
    check(data, deserialize_message(data, String))
    assert decode_event(deserialize_message(data, String).data) == {"event": "set", "tolerance": 1e-4}


def test_clamp_frames():
    rng = np.random.default_rng(4)
    mounts = [Mount(rng.normal(size=3), rng.normal(size=4), link) for link in (None, "turret", "ab")]
    transforms = [
        messages.clamp_transform(f"clamp_{i}", mount.link or "base", mount) for i, mount in enumerate(mounts)
    ]
    assert [transform.header.frame_id for transform in transforms] == ["base", "turret", "ab"]
    # tf2_msgs is not among the wheels; a TFMessage is nothing but a sequence of these. One alone, at the
    # offset 0 that it has in a message of its own, must be rclpy's; several must follow one another.
    for transform in transforms:
        check(serialise(transform), transform)
    data = tf_static(transforms)
    assert int.from_bytes(data[4:8], "little") == 3
    stamped_frames = [transform.child_frame_id.encode() for transform in transforms]
    assert sorted(stamped_frames, key=data.index) == stamped_frames
    assert isinstance(transforms[0], TransformStamped)


def test_negative_times_are_kept():
    template = messages.WrenchMessage("a")
    read = deserialize_message(template.fill(-1_500_000_000, np.zeros(6)), WrenchStamped)
    assert (read.header.stamp.sec, read.header.stamp.nanosec) == (-2, 500_000_000)


def test_a_view_of_what_is_not_there_is_refused():
    message = MarkerArray()
    with pytest.raises(KeyError):
        Template(message).view("markers[0].pose.position.x", 3)
    path = Path(poses=[PoseStamped(), PoseStamped(), PoseStamped()])
    path.poses[1].header.frame_id = "longer"
    with pytest.raises(ValueError, match="equal distances"):
        Template(path).view("poses[{}].pose.position.x", 7, rows=3)


def test_a_type_that_is_not_known_is_refused():
    class Odd:
        text = "a"

        def get_fields_and_field_types(self):
            return {"text": "wide"}

    with pytest.raises(TypeError, match="'text' has the type 'wide'"):
        serialise(Odd())


def test_the_header_is_plain_little_endian_cdr():
    assert serialize_message(Point())[:4] == HEADER
