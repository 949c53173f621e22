# SPDX-License-Identifier: Apache-2.0
"""The log as four readers see it that are not ours: all count the same, checksums on."""

from __future__ import annotations

from collections import Counter

import pytest
import yaml
from log_readers import READERS
from log_samples import JOINT_STATE, JOINTS, SENSOR_QOS, WRENCH, WRENCH_STAMPED, joint_state
from mcap.reader import SeekingReader
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosHistory, QosReliability

from cable_ros.log.joint_state_cdr import trim_joint_state
from cable_ros.log.reader import LogReader
from cable_ros.log.writer import LogWriter

COUNT = 500
EXPECTED = {JOINTS: COUNT, WRENCH: COUNT}


@pytest.fixture
def log_path(write_log):
    return write_log(COUNT, chunk_bytes=8192, attachments={"scene.yaml": "cables: []\n"})


@pytest.mark.parametrize("count", READERS)
def test_all_readers_count_the_same(log_path, count):
    assert count(log_path) == EXPECTED


def test_chunks_are_indexed(log_path):
    with log_path.open("rb") as stream:
        reader = SeekingReader(stream)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert len(summary.chunk_indexes) > 5
        assert all(chunk.message_index_offsets for chunk in summary.chunk_indexes)
        assert {s.encoding for s in summary.schemas.values()} == {"ros2msg"}
        assert {c.message_encoding for c in summary.channels.values()} == {"cdr"}


def test_mcap_ros2_support(log_path):
    library = pytest.importorskip("mcap_ros2.decoder", reason="mcap-ros2-support is not on this machine")
    with log_path.open("rb") as stream:
        reader = SeekingReader(stream, decoder_factories=[library.DecoderFactory()], validate_crcs=True)
        counts: Counter[str] = Counter()
        for _, channel, _, message in reader.iter_decoded_messages():
            i = counts[channel.topic]
            counts[channel.topic] += 1
            if channel.topic == JOINTS:
                assert list(message.position) == [1e-3 * i, 0.0]
                assert list(message.name) == ["orientation", "pitch"]
            else:
                assert message.wrench.force.z == -i
        assert counts == EXPECTED


def test_rosbags(log_path):
    with AnyReader([log_path]) as reader:
        counts: Counter[str] = Counter()
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            i = counts[connection.topic]
            counts[connection.topic] += 1
            value = message.position[0] if connection.topic == JOINTS else message.wrench.torque.z
            assert value == (1e-3 * i if connection.topic == JOINTS else 0.5 * i)
        assert counts == EXPECTED
        (qos,) = next(c.ext.offered_qos_profiles for c in reader.connections if c.topic == JOINTS)
        assert (qos.history, qos.depth) == (QosHistory.KEEP_LAST, 5)
        assert (qos.reliability, qos.durability) == (QosReliability.BEST_EFFORT, QosDurability.VOLATILE)


def test_rosbag2_finds_its_record_and_can_take_every_field(log_path):
    """The fields that rosbag2's yaml decoder asks for in metadata version 9, each of the type it asks for."""
    with log_path.open("rb") as stream:
        reader = SeekingReader(stream)
        names = [index.name for index in reader.get_summary().metadata_indexes]
        assert names.count("rosbag2") == 1
        record = next(r for r in reader.iter_metadata() if r.name == "rosbag2")
        channels = {c.topic: c for c in reader.get_summary().channels.values()}
    bag = yaml.safe_load(record.metadata["serialized_metadata"])
    assert bag["version"] == 9
    assert bag["storage_identifier"] == "mcap"
    assert bag["relative_file_paths"] == ["run.mcap"]
    assert bag["duration"] == {"nanoseconds": (COUNT - 1) * 1_000_000}
    assert bag["message_count"] == 2 * COUNT
    assert (bag["compression_format"], bag["compression_mode"]) == ("", "")
    assert bag["files"][0]["message_count"] == 2 * COUNT
    assert isinstance(bag["custom_data"], dict)
    assert isinstance(bag["ros_distro"], str)
    for entry in bag["topics_with_message_count"]:
        topic = entry["topic_metadata"]
        assert entry["message_count"] == EXPECTED[topic["name"]]
        assert topic["type"] == {JOINTS: JOINT_STATE, WRENCH: WRENCH_STAMPED}[topic["name"]]
        assert topic["serialization_format"] == "cdr"
        assert isinstance(topic["type_description_hash"], str)
        # Named policies: numbers would be read as unknown ones from version 9 on.
        expected = yaml.safe_load(SENSOR_QOS) if topic["name"] == JOINTS else []
        assert topic["offered_qos_profiles"] == expected
        assert (yaml.safe_load(channels[topic["name"]].metadata["offered_qos_profiles"]) or []) == expected


@pytest.mark.parametrize("rates", [False, True])
def test_padding_after_a_joint_state_is_left_out_and_nothing_else(tmp_path, rates):
    """rclpy's serialize_message returns up to eight bytes more than it wrote, which rosbags refuses."""
    exact = joint_state(0.25, rates=rates)
    padded = exact + b"\x17\xf0\x00\x42\x02\x01\x17\xf0"  # what was in that memory before
    assert trim_joint_state(padded) == exact
    assert trim_joint_state(exact) is exact
    for cut in range(4, len(exact)):  # not a whole JointState: logged as it was received
        assert trim_joint_state(exact[:cut]) == exact[:cut]

    with LogWriter(tmp_path / "run.mcap") as log:
        log.write(JOINTS, JOINT_STATE, padded, 1)
    with AnyReader([tmp_path / "run.mcap"]) as reader:
        ((connection, _, raw),) = reader.messages()
        assert list(reader.deserialize(raw, connection.msgtype).position) == [0.25, 0.0]
    with LogReader(tmp_path / "run.mcap") as reader:
        assert next(reader.messages()).cdr == exact


def test_rclpys_own_bytes_of_a_joint_state_can_be_read_by_rosbags(tmp_path):
    serialization = pytest.importorskip("rclpy.serialization", reason="rclpy is not on this machine")
    messages = pytest.importorskip("sensor_msgs.msg", reason="sensor_msgs is not on this machine")
    with LogWriter(tmp_path / "run.mcap") as log:
        for joints in range(4):
            message = messages.JointState(name=[f"j{i}" for i in range(joints)])
            message.position = [0.1 * i for i in range(joints)]
            log.write(JOINTS, JOINT_STATE, serialization.serialize_message(message), joints + 1)
    with AnyReader([tmp_path / "run.mcap"]) as reader:
        read = [list(reader.deserialize(raw, c.msgtype).position) for c, _, raw in reader.messages()]
    assert read == [[0.1 * i for i in range(joints)] for joints in range(4)]
