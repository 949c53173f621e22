# SPDX-License-Identifier: Apache-2.0
"""cable_replay as a process of its own, heard by a node of ours: same bytes, same order, clean stop."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
from log_samples import JOINT_STATE, JOINTS, START, WRENCH, WRENCH_STAMPED, joint_state, wrench
from mcap.writer import Writer

from cable_ros.log.definitions import message_definition
from cable_ros.log.reader import LogReader
from cable_ros.log.writer import LogWriter

rclpy = pytest.importorskip("rclpy", reason="rclpy is not on this machine")
from rclpy.context import Context  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: E402

from cable_ros.log.qos import qos_to_yaml  # noqa: E402
from cable_ros.ros.replay_node import message_class  # noqa: E402

COUNT = 60
PERIOD = 10_000_000  # ns
SCENE = "/cable_node/scene"
STRING = "std_msgs/msg/String"
TEXT = b"\x00\x01\x00\x00\x06\x00\x00\x00scene\x00"
TIMEOUT = 60.0  # s; only ever waited for in vain when something is broken


@pytest.fixture(scope="module")
def log_path(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("replay") / "run.mcap"
    with LogWriter(path) as log:
        log.add_topic(JOINTS, JOINT_STATE, qos_to_yaml(QoSProfile(depth=COUNT)))
        log.add_topic(WRENCH, WRENCH_STAMPED, qos_to_yaml(QoSProfile(depth=COUNT)))
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        log.add_topic(SCENE, STRING, qos_to_yaml(latched))
        log.write(SCENE, STRING, TEXT, START)
        for i in range(COUNT):
            now = START + i * PERIOD
            log.write(JOINTS, JOINT_STATE, joint_state(0.01 * i, now), now)
            log.write(WRENCH, WRENCH_STAMPED, wrench([i, 1, 2, 3, 4, 5], now), now)
    return path


class Listener:
    """Takes down every message of some topics as bytes."""

    def __init__(self, topics: dict[str, str]) -> None:
        self.context = Context()
        rclpy.init(context=self.context)
        self.node = Node("replay_listener", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.heard: dict[str, list[bytes]] = {topic: [] for topic in topics}
        for topic, kind in topics.items():
            qos = QoSProfile(depth=10 * COUNT)
            if topic == SCENE:
                qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
            self.node.create_subscription(message_class(kind), topic, self.heard[topic].append, qos, raw=True)

    def until(self, done, process: subprocess.Popen[str] | None = None) -> None:
        deadline = time.monotonic() + TIMEOUT
        while not done():
            assert time.monotonic() < deadline, {k: len(v) for k, v in self.heard.items()}
            assert process is None or process.poll() is None, process.communicate()
            self.executor.spin_once(timeout_sec=0.05)

    def rest(self) -> None:
        """What has arrived already."""
        for _ in range(3 * COUNT):
            self.executor.spin_once(timeout_sec=0)

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


@contextlib.contextmanager
def listening(topics: dict[str, str]) -> Iterator[Listener]:
    listener = Listener(topics)
    try:
        yield listener
    finally:
        listener.close()


def replay(log: Path, options: Sequence[str] = ()) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "cable_ros.ros.replay_node", str(log), "--wait", "20", *options]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def finish(listener: Listener, process: subprocess.Popen[str]) -> str:
    listener.until(lambda: process.poll() is not None)
    listener.rest()
    _, errors = process.communicate()
    assert process.returncode == 0, errors
    return errors


ALL = {JOINTS: JOINT_STATE, WRENCH: WRENCH_STAMPED, SCENE: STRING}


def test_the_logged_bytes_are_published_in_their_order(log_path):
    with LogReader(log_path) as log:
        logged = {topic: [m.cdr for m in log.messages([topic])] for topic in ALL}
    with listening({**ALL, "/clock": "rosgraph_msgs/msg/Clock"}) as listener:
        errors = finish(listener, replay(log_path, ["--rate", "2", "--clock"]))
        clock = listener.heard.pop("/clock")
        assert {k: len(v) for k, v in listener.heard.items()} == {JOINTS: COUNT, WRENCH: COUNT, SCENE: 1}
        for topic, messages in listener.heard.items():
            # On the wire a message is padded to four bytes.
            assert [m[: len(b)] for m, b in zip(messages, logged[topic], strict=True)] == logged[topic]
    assert f"{2 * COUNT + 1} messages published" in errors
    times = [int.from_bytes(m[4:8], "little") * 10**9 + int.from_bytes(m[8:12], "little") for m in clock]
    assert times == sorted(times)
    assert START <= times[0] <= times[-1] <= START + COUNT * PERIOD
    assert len(times) > 5


def test_a_part_of_a_log_brings_what_was_latched_before(log_path):
    with listening(ALL) as listener:
        options = ["--start", "0.2", "--duration", "0.1", "--topics", JOINTS, SCENE]
        finish(listener, replay(log_path, options))
        angles = [joint_state(0.01 * i, START + i * PERIOD) for i in range(20, 30)]
        assert [m[: len(a)] for m, a in zip(listener.heard[JOINTS], angles, strict=True)] == angles
        assert len(listener.heard[SCENE]) == 1
        assert listener.heard[WRENCH] == []


@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
def test_a_loop_goes_on_until_it_is_stopped(log_path, stop):
    with listening({JOINTS: JOINT_STATE}) as listener:
        process = replay(log_path, ["--loop", "--rate", "5", "--topics", JOINTS])
        listener.until(lambda: len(listener.heard[JOINTS]) > 2 * COUNT, process)
        process.send_signal(stop)
        errors = finish(listener, process)
        assert "Traceback" not in errors
        assert "messages published" in errors


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--topics", "/nothing"], "has no topic '/nothing'; it has /cable_node"),
        (["--start", "100"], "is 0.590 s long; take a smaller --start"),
        (["--rate", "0"], "'0' is not a number above 0"),
    ],
)
def test_what_cannot_be_replayed_is_one_sentence(log_path, options, sentence):
    process = replay(log_path, options)
    _, errors = process.communicate(timeout=TIMEOUT)
    assert process.returncode == 2
    assert sentence in errors
    assert "Traceback" not in errors


def test_a_log_that_was_cut_off_names_the_remedy(log_path, tmp_path):
    cut = tmp_path / "cut.mcap.part"
    cut.write_bytes(log_path.read_bytes()[:3000])
    process = replay(cut)
    _, errors = process.communicate(timeout=TIMEOUT)
    assert process.returncode == 2
    assert f"cable log recover {cut}" in errors


def test_topics_that_ros_cannot_have_are_left_out(tmp_path):
    path = tmp_path / "odd.mcap"
    text = message_definition(JOINT_STATE).encode()
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="a test")
        kinds = {
            kind: writer.register_schema(kind, "ros2msg", text) for kind in (JOINT_STATE, "os.path/msg/Join")
        }
        topics = {"/a b": JOINT_STATE, "/x\x1b[31m": JOINT_STATE, "//": JOINT_STATE, "": JOINT_STATE}
        topics |= {"/" + "long" * 500: JOINT_STATE, "/code": "os.path/msg/Join", JOINTS: JOINT_STATE}
        for topic, kind in topics.items():
            damaged = {"offered_qos_profiles": "- {[ damaged"}
            channel = writer.register_channel(topic, "cdr", kinds[kind], damaged)
            writer.add_message(channel, START, joint_state(0.1), START)
        writer.finish()
    with listening({JOINTS: JOINT_STATE}) as listener:
        errors = finish(listener, replay(path))
        assert len(listener.heard[JOINTS]) == 1
    assert "Traceback" not in errors
    assert "\x1b[31m" not in errors
    for name in ("/a b", "/x\\x1b[31m", "//"):
        assert f"Topic '{name}' is left out: ROS has no topics of such a name" in errors
    assert "Topic /code is left out: its type os.path/msg/Join is not installed" in errors


def test_times_that_no_clock_has(tmp_path):
    path = tmp_path / "late.mcap"
    with LogWriter(path) as log:
        log.write(JOINTS, JOINT_STATE, joint_state(0.1), (1 << 63) - 1)
    process = replay(path, ["--clock"])
    _, errors = process.communicate(timeout=TIMEOUT)
    assert process.returncode == 2
    assert "has times that /clock cannot have; leave --clock out" in errors
