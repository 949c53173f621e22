# SPDX-License-Identifier: Apache-2.0
"""Logs that mean harm: what they hold is bounded before it is allocated, and each gets one sentence."""

from __future__ import annotations

import fcntl
import os
import struct
import subprocess
import sys
import time

import lz4.frame
import pytest
import zstandard
from log_samples import JOINT_STATE, JOINTS, START, WRENCH, WRENCH_STAMPED, fill, joint_state, wrench
from mcap.writer import CompressionType, Writer

from cable_ros.cli.main import main
from cable_ros.log import chunks, order
from cable_ros.log.definitions import message_definition
from cable_ros.log.errors import LogError
from cable_ros.log.events import decode_event, encode_event, encode_solved_joints
from cable_ros.log.history import read_history
from cable_ros.log.qos import MOST_DEPTH, offered_profiles, qos_from_yaml
from cable_ros.log.reader import PARAMETERS, SCENE, LogReader
from cable_ros.log.recover import recover
from cable_ros.log.resolve import Outcome, logged_scene, logged_tolerance, resolve
from cable_ros.log.run import LoggedRun
from cable_ros.log.writer import LogWriter
from cable_ros.share import share_file
from cable_ros.tracker import Tracker

SOON = 100.0  # s; what hangs never ends, and each takes a second where nothing else runs
SCENE_TEXT = share_file("config", "space_arm.yaml").read_text()
URDF_TEXT = share_file("config", "space_arm.urdf").read_text()

CHANNEL_1 = struct.pack("<HHI", 1, 0, 2) + b"/x" + struct.pack("<I", 3) + b"cdr" + struct.pack("<I", 0)


def record(opcode: int, body: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(body)) + body


def message(data: bytes = b"", log_time: int = START) -> bytes:
    return record(5, struct.pack("<HIQQ", 1, 0, log_time, log_time) + data)


def packed(compression: str, content: bytes) -> bytes:
    if compression == "zstd":
        return zstandard.compress(content)
    return lz4.frame.compress(content) if compression == "lz4" else content


def chunk(compression: str, data: bytes, size: int) -> bytes:
    """A chunk's record; `size` is what it says that it holds."""
    head = struct.pack("<QQQI", START, START, size, 0)
    name = compression.encode()
    return record(6, head + struct.pack("<I", len(name)) + name + struct.pack("<Q", len(data)) + data)


def log_of(path, *parts: bytes):
    """A log without index of these records."""
    header = record(1, struct.pack("<I", 4) + b"ros2" + struct.pack("<I", 0))
    path.write_bytes(b"\x89MCAP0\r\n" + header + b"".join(parts))
    return path


def zeros(compression: str, size: int) -> bytes:
    """`size` zero bytes, compressed bit by bit."""
    block = bytes(1 << 20)
    if compression == "zstd":
        packer = zstandard.ZstdCompressor(write_content_size=False).compressobj()
        return b"".join([packer.compress(block) for _ in range(size >> 20)]) + packer.flush()
    packer = lz4.frame.LZ4FrameCompressor()
    return packer.begin() + b"".join(packer.compress(block) for _ in range(size >> 20)) + packer.flush()


MILLION = 1_100_000
BOMBS = {
    "2 GB of zeros, as said, zstd": lambda: chunk("zstd", zeros("zstd", 1 << 31), 1 << 31),
    "2 GB of zeros, 1 kB said, zstd": lambda: chunk("zstd", zeros("zstd", 1 << 31), 1024),
    "2 GB of zeros, 1 kB said, lz4": lambda: chunk("lz4", zeros("lz4", 1 << 31), 1024),
    "a window of 2 GB": lambda: chunk("zstd", b"\x28\xb5\x2f\xfd\x00\xa8\x01\x00\x00", 1024),
    "100 MB of zeros, lz4": lambda: chunk("lz4", zeros("lz4", 100 << 20), 100 << 20),
    "exabytes said": lambda: chunk("zstd", packed("zstd", b"x"), 1 << 62),
    "zeros": lambda: chunk("", bytes(1 << 20), 1 << 20),
    "zeros, zstd": lambda: chunk("zstd", zeros("zstd", 100 << 20), 100 << 20),
    "empty records": lambda: chunk("zstd", packed("zstd", record(0x90, b"") * MILLION), 9 * MILLION),
    "empty messages": lambda: chunk("lz4", packed("lz4", record(5, b"") * 1000), 9000),
    "many messages": lambda: chunk("lz4", packed("lz4", message() * MILLION), 31 * MILLION),
    "half an lz4 frame": lambda: chunk("lz4", packed("lz4", message(os.urandom(5000)))[:-900], 5031),
    "empty lz4": lambda: chunk("lz4", b"", 5),
    "a kind of compression that there is not": lambda: chunk("brotli\x1b[31m", b"x", 1),
    "a record beyond its chunk": lambda: chunk("", struct.pack("<BQ", 5, 1 << 60), 9),
    "a time after 2262": lambda: chunk("", message(log_time=(1 << 64) - 1), 31),
    "a chunk within a chunk": lambda: chunk("", chunk("", b"", 0), len(chunk("", b"", 0))),
    "a schema of 4 GB": lambda: record(3, struct.pack("<HI", 1, 0xFFFFFFFF)),
    "an attachment of exabytes": lambda: record(
        9, struct.pack("<QQII", 0, 0, 0, 0) + struct.pack("<Q", 1 << 62)
    ),
    "empty records without chunk": lambda: record(5, b"") * 5000,
}


@pytest.mark.parametrize("name", BOMBS)
def test_recovery_leaves_bombs_out(tmp_path, name):
    path = log_of(tmp_path / "bomb.mcap", record(4, CHANNEL_1), message(b"before"), BOMBS[name]())
    out = tmp_path / "out.mcap"
    code = "from pathlib import Path\nfrom cable_ros.log.recover import recover\n"
    code += f"found = recover(Path({str(path)!r}), Path({str(out)!r}))\n"
    # not ru_maxrss, which counts the process that this one was forked from
    code += "peak = Path('/proc/self/status').read_text().split('VmHWM:')[1].split()[0]\n"
    code += "print(len(found.damages), peak)"
    begin = time.monotonic()
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    damages, memory = map(int, done.stdout.split())
    assert time.monotonic() - begin < SOON
    assert 1 < damages < 1100  # and that it ends without an index
    assert memory < 700_000  # kB; with 128 MB of content, its compressed form, and the interpreter
    with LogReader(out) as saved:
        assert [message.cdr for message in saved.messages()] == [b"before"]


def indexed(path, contents, *, schema=None, topic=JOINTS, profiles="", attachments=(), chunk_size=1000):
    """A finished log of messages (log time, bytes) on one topic, by mcap's own writer."""
    text = message_definition(JOINT_STATE) if schema is None else schema
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=chunk_size, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="a test")
        number = writer.register_schema(JOINT_STATE, "ros2msg", text.encode())
        channel = writer.register_channel(topic, "cdr", number, {"offered_qos_profiles": profiles})
        for name, content in attachments:
            writer.add_attachment(0, 0, name, "text/plain", content)
        for log_time, content in contents:
            writer.add_message(channel, log_time, content, log_time)
        writer.finish()
    return path


def told(action) -> str:
    """The one sentence of a LogError that comes soon."""
    begin = time.monotonic()
    with pytest.raises(LogError) as caught:
        action()
    assert time.monotonic() - begin < SOON
    text = str(caught.value)
    assert text.isprintable()
    return text


def test_all_chunks_together_are_bounded(tmp_path, monkeypatch):
    path = indexed(tmp_path / "run.mcap", [(START + i, bytes(100_000)) for i in range(40)])
    monkeypatch.setattr(chunks, "LEAST_ALLOWANCE", 1 << 20)
    monkeypatch.setattr(chunks, "MOST_EXPANSION", 100)
    with LogReader(path) as log:
        for as_written in (False, True):
            said = told(lambda which=as_written: list(log.messages(as_written=which)))
            assert "and 100 times the file" in said
    found = recover(path)
    assert 0 < found.messages[JOINTS] < 40
    assert "all from here on" in found.damages[-1].what


def test_messages_of_one_time_are_not_all_held(tmp_path, monkeypatch):
    path = indexed(tmp_path / "run.mcap", [(START, os.urandom(2000)) for _ in range(200)])
    monkeypatch.setattr(order, "MOST_HELD", 100_000)
    with LogReader(path) as log:
        assert "too many of its chunks are of the same time" in told(lambda: list(log.messages()))
        assert len(list(log.messages(as_written=True))) == 200


def test_order_is_that_of_time_then_place(tmp_path):
    times = [5, 3, 3, 9, 1, 1, 7, 2, 2, 2]
    path = indexed(tmp_path / "run.mcap", [(t, bytes([i]) * 600) for i, t in enumerate(times)])
    with LogReader(path) as log:
        found = [(m.log_time, m.cdr[0]) for m in log.messages()]
        assert found == sorted((t, i) for i, t in enumerate(times))
        assert [m.cdr[0] for m in log.messages(as_written=True)] == list(range(10))
        assert [m.log_time for m in log.messages(start=3, end=7)] == [3, 3, 5]
        assert [*log.messages(["/other"])] == []


def test_attachments_are_bounded(tmp_path):
    few = indexed(tmp_path / "few.mcap", [], attachments=[(SCENE, b"a"), ("large", bytes(70 << 20))])
    assert "more than 64 MB" in told(lambda: LogReader(few))
    many = indexed(tmp_path / "many.mcap", [], attachments=[(f"a{i}", b"") for i in range(1001)])
    assert "more than 1000 attachments" in told(lambda: LogReader(many))


@pytest.mark.parametrize("kind", ["fifo", "device", "folder"])
def test_only_regular_files_are_logs(tmp_path, kind):
    path = tmp_path / "run.mcap"
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    else:
        path.mkdir()
    for action in (LogReader, recover):
        sentence = told(lambda action=action: action(path))
        assert ("it is a folder" if kind == "folder" else "name a regular file") in sentence


SCHEMAS = {
    "no schema": "\x00\x1b[31m",
    "a type that is not there": "geometry_msgs/Wrench wrench",
    "itself": "sensor_msgs/JointState again",
    "too long": "# " + "x" * 300_000,
    "many of itself": "sensor_msgs/JointState[1000000] again",
    "other fields": "float64 x",
    "long fixed arrays": "float64[1000000000] x",
}


@pytest.mark.parametrize("name", SCHEMAS)
def test_damaged_schemas(tmp_path, name):
    path = indexed(tmp_path / "run.mcap", [(START, joint_state(0.1))] * 2, schema=SCHEMAS[name])
    if name not in ("too long", "other fields"):
        pytest.importorskip("mcap_ros2", reason="without mcap-ros2-support nobody reads the schema")
    with LogReader(path) as log:
        if name != "other fields":
            sentence = told(lambda: list(log.decoded()))
            assert "is damaged" in sentence or "is not a sensor_msgs/msg/JointState" in sentence
        assert len(list(log.messages())) == 2


def node_log(path, **attachments):
    """A log as the node's of two joint states, with these attachments."""
    texts = {"scene.yaml": SCENE_TEXT, "robot.urdf": URDF_TEXT} | attachments
    log = LogWriter(path, attachments={name: text for name, text in texts.items() if text is not None})
    fill(log, 2)
    return log


def test_a_log_opens_no_file_that_its_scene_names(tmp_path, capsys):
    robot = tmp_path / "robot.urdf"
    robot.write_text(URDF_TEXT)
    scene = SCENE_TEXT.replace("urdf: space_arm.urdf", f"urdf: {robot}")
    assert str(robot) in scene
    path = tmp_path / "run.mcap"
    node_log(path, **{"scene.yaml": scene, "robot.urdf": None}).close()
    with LogReader(path) as log:
        assert "names a URDF, and the log holds none" in told(lambda: logged_scene(log))
    for command in (["replay", str(path), "--resolve"], ["plot", str(path), "--out", str(tmp_path)]):
        main(command)
    assert "names a URDF" in capsys.readouterr().err


@pytest.mark.parametrize(
    "text",
    [
        "\x00",
        "{[",
        "/cable_node: {ros__parameters: {tolerance: 7.0}}",
        "/cable_node: {ros__parameters: {tolerance: -1}}",
        "/cable_node: {ros__parameters: {tolerance: .nan}}",
        "a: &a [*a]",
        "x" * 300_000,
    ],
)
def test_damaged_parameters(tmp_path, text):
    path = tmp_path / "run.mcap"
    node_log(path, **{PARAMETERS: text}).close()
    with LogReader(path) as log:
        assert "parameters.yaml" in (said := told(lambda: logged_tolerance(log))) or "tolerance" in said


@pytest.mark.parametrize("text", ["[]", "3", "/cable_node: []", "/cable_node: {ros__parameters: [1]}", "  "])
def test_parameters_of_others(tmp_path, text):
    path = tmp_path / "run.mcap"
    node_log(path, **{PARAMETERS: text}).close()
    with LogReader(path) as log:
        assert logged_tolerance(log) == 1e-4


@pytest.mark.parametrize("text", ["{[", "\x00", "- &a [*a]", "x" * 30_000, "3", "- 3", "a: &a {<<: *a}"])
def test_damaged_quality_of_service(tmp_path, text):
    assert offered_profiles(text) == []
    path = indexed(tmp_path / "run.mcap", [(START, joint_state(0.1))], profiles=text)
    saved = recover(path)
    with LogReader(saved.path) as log:
        assert log.topics[JOINTS].count == 1


def test_quality_of_service_that_cannot_be():
    pytest.importorskip("rclpy")
    found = qos_from_yaml(f"- {{depth: {10**30}, reliability: [x], durability: 99, history: {{}}}}")
    assert found.depth == MOST_DEPTH


@pytest.mark.parametrize(
    "event",
    [
        {"tolerance": "x"},
        {"tolerance": 5.0},
        {"tolerance": True},
        {"polyline_points": 10**12},
        {"polyline_points": 1},
        {"environment": {"temperature": "cold"}},
        {"environment": [1]},
        {"environment": {"nothing": 1e999}},
    ],
)
def test_events_that_cannot_be_repeated(tmp_path, event):
    path = tmp_path / "run.mcap"
    log = node_log(path)
    log.write("/cable_node/events", "std_msgs/msg/String", encode_event("start", **event), START + 10**9)
    log.close()
    assert log.error is None
    with LogReader(path) as reader:
        tracker = Tracker(logged_scene(reader))
        said = told(lambda: list(resolve(LoggedRun([reader]), tracker, Outcome())))
    assert "event" in said


@pytest.mark.parametrize("text", ["[" * 100_000, '{"a":' * 100_000, "1" * 10_000, "{", "\x00", "[1]", "NaN"])
def test_json_that_is_no_event(text):
    assert decode_event(text) == {}


def test_names_out_of_a_log_are_printed_escaped(tmp_path, capsys):
    red = "/x\x1b[31m\u202e"
    path = indexed(tmp_path / "run.mcap", [(START, joint_state(0.1))], topic=red, attachments=[(red, b"")])
    assert main(["log", "info", str(path)]) == 0
    assert main(["log", "recover", str(path)]) == 0
    out = capsys.readouterr().out
    assert out.replace("\n", "").isprintable()
    assert out.count("/x\\x1b[31m\\u202e") == 3


def test_wrenches_and_joints_without_numbers(tmp_path):
    # A topic named as ours whose schema, of the name that we know, has other fields.
    path = tmp_path / "run.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2", library="a test")
        for topic, kind, text in (
            (JOINTS, JOINT_STATE, "string name"),
            (WRENCH, WRENCH_STAMPED, "string wrench"),
            ("end_wrench", WRENCH_STAMPED, "string wrench"),
        ):
            channel = writer.register_channel(
                topic, "cdr", writer.register_schema(kind, "ros2msg", text.encode())
            )
            writer.add_message(channel, START, encode_event("x"), START)
        writer.finish()
    sentence = told(lambda: read_history(path))
    # Decoded by the log's schema, or, without mcap-ros2-support, by the type that has that name.
    assert any(
        f"{how} a sensor_msgs/msg/JointState" in sentence for how in ("has not the fields of", "is not")
    )


def test_names_of_joints_are_drawn_as_they_are(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    names = ("$\\frac$", "x\x1b[31m")
    path = tmp_path / "run.mcap"
    with LogWriter(path) as log:
        for i in range(3):
            log.write(JOINTS, JOINT_STATE, encode_solved_joints(names, [0.1 * i, 0.0], START), START + i)
            log.write(WRENCH, WRENCH_STAMPED, wrench([i, 1, 2, 3, 4, 5]), START + i)
            log.write("/$\\frac$/end_wrench", WRENCH_STAMPED, wrench([i, 1, 2, 3, 4, 5]), START + i)
    assert main(["plot", str(path)]) == 0, capsys.readouterr().err
    assert list(read_history(path).end_wrenches) == ["camera_cable"]


def test_recovering_nothing_is_told_with_exit_code_1(tmp_path, capsys):
    path = log_of(tmp_path / "run.mcap", record(4, CHANNEL_1))
    assert main(["log", "recover", str(path)]) == 1
    assert "holds no whole message" in capsys.readouterr().err


def test_a_killed_recovery_does_not_block_the_next(tmp_path):
    path = indexed(tmp_path / "run.mcap", [(START, joint_state(0.1))])
    left = tmp_path / "run_recovered.mcap.recovery"
    left.write_bytes(b"half of a log")
    with left.open("rb") as other:
        fcntl.flock(other, fcntl.LOCK_EX)  # as one that still runs has it
        assert "another process is writing" in told(lambda: recover(path))
    assert recover(path).messages == {JOINTS: 1}
    assert not left.exists()
    with LogReader(tmp_path / "run_recovered.mcap") as log:
        assert len(list(log.messages())) == 1
