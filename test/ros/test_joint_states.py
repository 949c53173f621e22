# SPDX-License-Identifier: Apache-2.0
"""Joint states as bytes: merged by name from several publishers, and counted."""

from __future__ import annotations

import struct

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="rclpy is not on this machine")

from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from cable_ros.ros.joint_motion import JointMotion
from cable_ros.ros.joint_states import JointStates, LostMessages
from cable_ros.scene.joint_limits import JointLimit


def message(names, position, stamp=1_000_000_000, **fields):
    state = JointState(name=list(names), position=[float(value) for value in position], **fields)
    state.header.stamp.sec, state.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
    return serialize_message(state)


def big_endian(names, position):
    """The same in the other byte order, which a publisher on another machine may use."""
    body = struct.pack(">iI", 1, 0) + struct.pack(">I", 1) + b"\0"

    def align(data, size):
        return data + bytes(-len(data) % size)

    body = align(body, 4) + struct.pack(">I", len(names))
    for name in names:
        text = name.encode() + b"\0"
        body = align(body, 4) + struct.pack(">I", len(text)) + text
    body = align(body, 4) + struct.pack(">I", len(position))
    body = align(body, 8) + struct.pack(f">{len(position)}d", *position)
    return b"\x00\x00\x00\x00" + body + struct.pack(">II", 0, 0)


@pytest.fixture
def states():
    return JointStates(("shoulder", "elbow"), "/joint_states")


def test_parts_from_several_publishers_are_merged(states):
    assert states.missing() == ["shoulder", "elbow"]
    assert states.take(message(["gripper", "elbow"], [9.0, 0.5]))
    assert states.missing() == ["shoulder"]
    assert states.joints() == {"elbow": 0.5}
    assert states.take(message(["shoulder"], [0.25]))
    assert states.missing() == []
    assert states.take(message(["elbow", "wrist", "shoulder"], [1.0, 2.0, 3.0]))
    np.testing.assert_array_equal(states.positions, [3.0, 1.0])
    assert not states.take(message(["gripper"], [1.0]))
    assert (states.counters.received, states.counters.other) == (4, 1)


def test_the_same_names_in_another_order_are_told_apart(states):
    for i in range(3):  # from the cache the second time
        assert states.take(message(["shoulder", "elbow"], [i, 10 + i]))
        np.testing.assert_array_equal(states.positions, [i, 10 + i])
        assert states.take(message(["elbow", "shoulder"], [20 + i, 30 + i]))
        np.testing.assert_array_equal(states.positions, [30 + i, 20 + i])


def test_either_byte_order(states):
    assert states.take(big_endian(["elbow", "shoulder"], [0.5, -0.25]))
    np.testing.assert_array_equal(states.positions, [-0.25, 0.5])
    assert states.stamp == 1_000_000_000
    assert states.take(message(["elbow", "shoulder"], [1.5, 1.25]))
    np.testing.assert_array_equal(states.positions, [1.25, 1.5])


def test_a_rejected_message_changes_nothing(states):
    states.take(message(["shoulder", "elbow"], [1.0, 2.0]))
    for position in ([np.nan, 3.0], [3.0, np.inf], [3.0], []):
        assert not states.take(message(["shoulder", "elbow"], position))
        assert states.fault.endswith("; the message is ignored.")
        np.testing.assert_array_equal(states.positions, [1.0, 2.0])
    # What is not needed may be anything.
    assert states.take(message(["gripper", "elbow"], [np.nan, 4.0]))
    assert states.fault == ""
    assert states.counters.rejected == 4


def test_every_cut_of_a_message_is_rejected_or_read_as_it_is(states):
    data = message(["shoulder", "elbow"], [1.0, 2.0], velocity=[0.0, 0.0], effort=[0.0, 0.0])
    for size in range(len(data)):
        assert not states.take(data[:size]) or size >= len(data) - 3  # padding
    assert states.take(data)


@given(st.binary(max_size=200))
def test_rubbish_is_rejected(data):
    states = JointStates(("a",), "/joint_states")
    assert not states.take(data) or np.isfinite(states.positions).all()


def test_names_without_end_do_not_fill_the_memory(states):
    for i in range(500):
        states.take(message(["elbow", f"joint_{i}"], [i, 0.0]))
    assert states.positions[1] == 499
    assert len(states._layouts) <= 64


def test_what_was_lost_between_two_messages_is_counted():
    lost = LostMessages()
    assert [lost.before(number) for number in (5, 6, 7, 10, 11)] == [0, 0, 0, 2, 0]


def test_losses_of_two_publishers_add_up():
    """The middleware does not say whose number it is; the sum is right all the same."""
    lost = LostMessages()
    first, second = list(range(1, 50)), list(range(20_000, 20_049))
    gone = {7, 8, 30, 20_010}
    total = 0
    for a, b in zip(first, second, strict=True):
        total += sum(lost.before(number) for number in (a, b) if number not in gone)
    assert total == len(gone)


def test_counting_goes_on_in_another_scene(states):
    states.take(message(["elbow"], [1.0]), 1)
    other = JointStates(("wrist",), "/joint_states")
    other.carry_on(states)
    other.take(message(["wrist"], [1.0]), 4)
    assert (other.counters.received, other.counters.lost) == (2, 2)


def test_names_are_told_escaped() -> None:
    states = JointStates(("elbow",), "/joint_states")
    assert not states.take(message(["x\x1b[31m", "elbow", "x\x1b[31m"], [1.0, 2.0, 3.0]))
    assert "names 'x\\x1b[31m' twice" in states.fault


def test_jumps_are_told_from_each_joints_own_last_position() -> None:
    limits = [JointLimit("shoulder", "rad", velocity=1.0), JointLimit("elbow", "rad")]
    states = JointStates(("shoulder", "elbow"), "/joint_states", JointMotion(limits))
    second = 1_000_000_000

    def told(names: list[str], positions: list[float], stamp: int) -> str:
        assert states.take(message(names, positions, stamp=stamp))
        return states.fault

    assert told(["shoulder", "elbow"], [0.0, 0.0], second) == ""
    # Another publisher's messages in between neither hide nor make a jump; without a limit there is none.
    assert told(["elbow"], [9.0], 2 * second) == ""
    assert told(["shoulder"], [1.5], 3 * second) == ""
    assert told(["elbow"], [0.0], 3 * second + 1) == ""
    assert "Joint 'shoulder' went 1.5 rad in 1 s" in told(["shoulder"], [0.0], 4 * second)
    # Stamps that go back begin anew.
    assert "went back" in told(["shoulder"], [3.0], 2 * second)
    assert told(["shoulder"], [3.1], 2 * second + second // 10) == ""
