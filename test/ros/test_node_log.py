# SPDX-License-Identifier: Apache-2.0
"""What the real node logs: everything it published, readable by others, and solved again bit for bit."""

from __future__ import annotations

import itertools
import math
import subprocess
import time

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from log_readers import READERS

pytest.importorskip("rclpy", reason="rclpy is not on this machine")
pytest.importorskip("pinocchio", reason="the arm's kinematics need Pinocchio")

from robot import CABLE, NODE, PUBLISHED, WITHOUT_SHARED_MEMORY, Robot

from cable_ros.cli.main import main
from cable_ros.log.reader import LogReader
from cable_ros.log.recover import recover


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run with a cold start on the way, another tolerance, and joint states in a burst."""
    path = tmp_path_factory.mktemp("node") / "run.mcap"
    with Robot(log__enabled="true", log__path=path) as robot:
        for i in range(60):
            robot.move(1.2 * math.sin(0.1 * i))
        assert robot.trigger("reset").success
        for i in range(20):
            robot.move(0.7 + 0.01 * i)
        robot.set_parameter("tolerance", 1e-7)
        for i in range(300):
            robot.move(0.9 - 0.004 * i, wait=False)
        robot.move(-0.4)
        robot.stop()
    return path, robot.published


@pytest.mark.parametrize("count", READERS)
def test_every_reader_counts_what_was_published(run, count):
    path, published = run
    read = count(path)
    assert {topic: read[topic] for topic in PUBLISHED} == published


def test_what_belongs_to_the_run_is_in_the_log(run):
    path, published = run
    with LogReader(path) as log:
        assert log.topics[f"{NODE}/solved_joints"].count == published[f"{CABLE}/end_wrench"] >= 81
        assert {"scene.yaml", "robot.urdf", "parameters.yaml"} <= set(log.attachments)
        assert log.metadata["cable_ros_log_end"] == {"dropped": "0"}


def test_the_run_is_solved_again_bit_for_bit(run, capsys):
    path, published = run
    assert main(["replay", str(path), "--resolve"]) == 0
    printed = capsys.readouterr().out
    count = published[f"{CABLE}/end_wrench"]
    assert f"camera_cable end: {count} of {count} wrenches bit for bit" in printed
    assert f"camera_cable start: {count} of {count} wrenches bit for bit" in printed


def test_a_killed_node_loses_at_most_a_second(tmp_path, monkeypatch):
    monkeypatch.setenv(*WITHOUT_SHARED_MEMORY)
    path = tmp_path / "run.mcap"
    with Robot(log__enabled="true", log__path=path) as robot:
        robot.move(0.0)
        begin = time.monotonic()
        while time.monotonic() < begin + 2.0:
            robot.move(math.sin(time.monotonic()))
        killed = time.time_ns()
        robot.process.kill()
    saved = recover(path.with_name("run.mcap.part"))
    assert killed - saved.end <= 1_000_000_000
    assert main(["replay", str(path), "--resolve"]) == 0


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 256 kB, which starting and moving the node for a second or two fills."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(disk)]
    if subprocess.run(mount, capture_output=True, check=False).returncode != 0:
        pytest.skip("mounting a small tmpfs needs root")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


def test_a_full_disk_ends_the_log_and_not_the_node(small_disk, tmp_path):
    path = small_disk / "run.mcap"
    angles = (math.sin(0.01 * i) for i in itertools.count())
    with Robot(log__enabled="true", log__path=path) as robot:
        while log_level(robot) != DiagnosticStatus.ERROR:
            robot.move(next(angles))
        assert "the disk is full; free some space" in robot.diagnostics["cable_node: log"].message
        for _ in range(10):  # each is answered
            robot.move(next(angles))
        solved = robot.heard[f"{CABLE}/end_wrench"]
        recover(path.with_name("run.mcap.part"), tmp_path / "saved.mcap")
        robot.set_parameter("log.path", str(tmp_path / "other.mcap"))
        assert robot.trigger("start_log").success
        robot.move(0.0)
        output = robot.stop()
    assert output.count("the disk is full; free some space") == 1  # a line of the node's log, once
    with LogReader(tmp_path / "saved.mcap") as log:
        sequences = [message.sequence for message in log.messages([f"{CABLE}/end_wrench"])]
        assert sequences == list(range(len(sequences)))
        assert 0 < len(sequences) < solved
    with LogReader(tmp_path / "other.mcap") as log:
        assert log.topics[f"{CABLE}/end_wrench"].count == 1


def test_a_folder_that_cannot_be_written_leaves_the_node_publishing(tmp_path):
    (tmp_path / "file").write_text("not a folder")
    with Robot(log__enabled="true", log__path=tmp_path / "file" / "run.mcap") as robot:
        robot.move(0.3)
        robot.wait(lambda: log_level(robot) == DiagnosticStatus.ERROR)
        sentence = robot.diagnostics["cable_node: log"].message
        assert "a part of its path is a file, not a folder; write the log to another folder" in sentence
        again = robot.trigger("start_log")
        assert (again.success, again.message) == (False, sentence)
        robot.set_parameter("log.path", str(tmp_path / "run.mcap"))
        assert robot.trigger("start_log").success
        robot.move(0.4)
        stopped = robot.trigger("stop_log")
        assert (stopped.success, stopped.message) == (True, f"{tmp_path / 'run.mcap'} is complete.")
        robot.stop()
    with LogReader(tmp_path / "run.mcap") as log:
        assert log.topics[f"{CABLE}/end_wrench"].count == 1


def test_a_slip_in_the_name_of_a_folder_makes_none(tmp_path):
    wrong = tmp_path / "run.mcpa"
    with Robot(log__enabled="true", log__path=wrong) as robot:
        robot.wait(lambda: log_level(robot) == DiagnosticStatus.ERROR)
        assert f"there is no folder {wrong}; make it" in robot.diagnostics["cable_node: log"].message
        assert not robot.trigger("start_log").success
        wrong.mkdir()
        assert robot.trigger("start_log").success
        robot.stop()
    assert [path.suffix for path in wrong.iterdir()] == [".mcap"]


def log_level(robot):
    status = robot.diagnostics.get("cable_node: log")
    return None if status is None else status.level
