# SPDX-License-Identifier: Apache-2.0
"""Logs are decoded by mcap-ros2-support, or by rclpy where there is only that; both say the same."""

from __future__ import annotations

import sys

import pytest

pytest.importorskip("rclpy", reason="rclpy is not on this machine")
pytest.importorskip("mcap_ros2", reason="mcap-ros2-support is not on this machine")

from log_samples import JOINT_STATE, JOINTS, WRENCH, joint_state

from cable_ros.log.errors import LogError
from cable_ros.log.reader import LogReader
from cable_ros.log.writer import LogWriter


def decoded(path):
    """What is in a log, as plain numbers and texts."""
    found = []
    with LogReader(path) as log:
        for logged, message in log.decoded([JOINTS, WRENCH]):
            stamp = message.header.stamp
            values = (
                (list(message.name), list(message.position), list(message.effort))
                if logged.topic == JOINTS
                else (message.wrench.force.z, message.wrench.torque.x)
            )
            found.append((logged.topic, stamp.sec, stamp.nanosec, message.header.frame_id, values))
    return found


def without_mcap_ros2(monkeypatch):
    monkeypatch.setitem(sys.modules, "mcap_ros2.decoder", None)


def test_both_decode_the_same(write_log, monkeypatch):
    path = write_log(100)
    expected = decoded(path)
    without_mcap_ros2(monkeypatch)
    assert len(expected) == 200
    assert decoded(path) == expected


def write(path, kind, data):
    writer = LogWriter(path)
    writer.put(JOINTS, kind, data, 1)
    writer.close()
    assert writer.error is None
    return path


def test_what_is_no_message_is_told(tmp_path, monkeypatch):
    path = write(tmp_path / "run.mcap", JOINT_STATE, b"\x00\x01\x00\x00" + b"\xff" * 60)
    without_mcap_ros2(monkeypatch)
    with LogReader(path) as log, pytest.raises(LogError, match="is not a sensor_msgs/msg/JointState"):
        list(log.decoded())


def test_neither_library_is_told(tmp_path, monkeypatch):
    path = write(tmp_path / "run.mcap", JOINT_STATE, joint_state(0))
    without_mcap_ros2(monkeypatch)
    monkeypatch.setitem(sys.modules, "rclpy.serialization", None)
    with LogReader(path) as log, pytest.raises(LogError, match="pip install mcap-ros2-support"):
        list(log.decoded())
    monkeypatch.undo()
    without_mcap_ros2(monkeypatch)
    monkeypatch.setitem(sys.modules, "sensor_msgs.msg", None)
    with LogReader(path) as log, pytest.raises(LogError, match="install the ROS package 'sensor_msgs'"):
        list(log.decoded())
