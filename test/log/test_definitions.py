# SPDX-License-Identifier: Apache-2.0
"""Schemas, QoS and the log's own messages, each against what a library or ROS itself makes of them."""

from __future__ import annotations

import sys

import numpy as np
import pytest
import yaml
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from cable_ros.log import definitions, events
from cable_ros.log.definitions import message_definition, type_hash
from cable_ros.log.errors import LogError

TYPES = [
    "sensor_msgs/msg/JointState",
    "geometry_msgs/msg/WrenchStamped",
    "nav_msgs/msg/Path",
    "diagnostic_msgs/msg/DiagnosticArray",
    "visualization_msgs/msg/MarkerArray",
    "std_msgs/msg/String",
    "tf2_msgs/msg/TFMessage",
]


@pytest.fixture
def no_cache():
    message_definition.cache_clear()
    type_hash.cache_clear()
    yield
    message_definition.cache_clear()
    type_hash.cache_clear()


@pytest.mark.parametrize("name", TYPES)
def test_a_definition_means_the_type_that_rosbags_knows(name):
    known = get_typestore(Stores.ROS2_JAZZY).fielddefs
    for type_name, (_, fields) in get_types_from_msg(message_definition(name), name).items():
        assert fields == known[type_name][1]


def test_without_ros_the_common_interfaces_are_known_all_the_same(no_cache, monkeypatch, tmp_path):
    installed = message_definition("nav_msgs/msg/Path")
    message_definition.cache_clear()
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    alone = message_definition("nav_msgs/msg/Path")
    assert get_types_from_msg(alone, "nav_msgs/msg/Path") == get_types_from_msg(
        installed, "nav_msgs/msg/Path"
    )
    assert type_hash("nav_msgs/msg/Path") == ""


def test_a_robots_own_type_is_found_below_the_ament_prefix(no_cache, monkeypatch, tmp_path):
    folder = tmp_path / "share" / "arm_msgs" / "msg"
    folder.mkdir(parents=True)
    (folder / "Hand.msg").write_text(
        "uint8 MAX=5  # Finger count\nFinger[<=5] fingers\nstring<=10 label\nbuiltin_interfaces/Time stamp\n"
    )
    (folder / "Finger.msg").write_text("float64[3] position\nbool touching\n")
    times = tmp_path / "share" / "builtin_interfaces" / "msg"
    times.mkdir(parents=True)
    (times / "Time.msg").write_text("int32 sec\nuint32 nanosec\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path}")
    types = get_types_from_msg(message_definition("arm_msgs/msg/Hand"), "arm_msgs/msg/Hand")
    assert set(types) == {"arm_msgs/msg/Hand", "arm_msgs/msg/Finger", "builtin_interfaces/msg/Time"}

    (folder / "Finger.msg").unlink()
    message_definition.cache_clear()
    with pytest.raises(LogError, match="arm_msgs/msg/Finger, a part of arm_msgs/msg/Hand, is not installed"):
        message_definition("arm_msgs/msg/Hand")


def test_the_hash_is_the_one_that_rosbags_computes():
    if definitions._find("sensor_msgs", "JointState.json") is None:
        pytest.skip("no ROS packages on this machine")
    store = get_typestore(Stores.ROS2_JAZZY)
    for name in TYPES[:-1]:  # tf2_msgs is not among the wheels
        assert type_hash(name) == store.hash_rihs01(name)


def test_qos_survives_the_yaml():
    qos = pytest.importorskip("rclpy.qos", reason="rclpy is not on this machine")
    from cable_ros.log.qos import qos_from_yaml, qos_to_yaml

    latched = qos.QoSProfile(depth=1, durability=qos.DurabilityPolicy.TRANSIENT_LOCAL)
    for profile in (qos.qos_profile_sensor_data, latched, qos.QoSProfile(depth=7)):
        again = qos_from_yaml(qos_to_yaml(profile))
        for name in ("history", "depth", "reliability", "durability"):
            assert getattr(again, name) == getattr(profile, name)
    assert yaml.safe_load(qos_to_yaml(latched))[0]["deadline"] == {"sec": 9223372036, "nsec": 854775807}
    for foreign in ("", "[]", "- history: 1\n  depth: 3\n  reliability: 2\n  durability: 2\n"):
        profile = qos_from_yaml(foreign)
        assert profile.durability == qos.DurabilityPolicy.VOLATILE
    assert (profile.depth, profile.reliability) == (3, qos.ReliabilityPolicy.BEST_EFFORT)


@pytest.mark.parametrize("names", [(), ("a",), ("orientation", "pitch"), ("ä", "abc", "d")])
def test_solved_joints_are_a_joint_state_with_exactly_these_numbers(names):
    store = get_typestore(Stores.ROS2_JAZZY)
    positions = np.random.default_rng(3).normal(size=len(names))
    cdr = events.encode_solved_joints(names, positions, 1_234_567_890_123_456_789)
    message = store.deserialize_cdr(cdr, "sensor_msgs/msg/JointState")
    assert tuple(message.name) == names
    assert message.position.tobytes() == positions.tobytes()
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1_234_567_890, 123_456_789)
    assert bytes(store.serialize_cdr(message, "sensor_msgs/msg/JointState")) == cdr


def test_an_event_keeps_its_numbers_exactly():
    store = get_typestore(Stores.ROS2_JAZZY)
    cdr = events.encode_event(events.SET, tolerance=0.1 + 0.2, text="ä")
    text = store.deserialize_cdr(cdr, events.STRING).data
    assert events.decode_event(text) == {"event": "set", "tolerance": 0.1 + 0.2, "text": "ä"}
    assert events.decode_event("hello") == {} == events.decode_event("[1]")
