# SPDX-License-Identifier: Apache-2.0
"""A logged run solved again: the same bits, and an honest report where they are not."""

from __future__ import annotations

import platform
from pathlib import Path

import numpy as np
import pytest
from log_samples import JOINT_STATE, JOINTS, START, WRENCH_STAMPED, joint_state, wrench

from cable_ros.cli.main import main
from cable_ros.joint import joint_torque
from cable_ros.log import events
from cable_ros.log.errors import LogError
from cable_ros.log.events import encode_event, encode_solved_joints
from cable_ros.log.history import read_history
from cable_ros.log.reader import LogReader
from cable_ros.log.resolve import Outcome, logged_scene, logged_tolerance, resolve
from cable_ros.log.run import Gap, LoggedRun
from cable_ros.log.writer import LogWriter
from cable_ros.scene import load_scene
from cable_ros.share import share_file
from cable_ros.tracker import Tracker

pytest.importorskip("pinocchio", reason="the arm's kinematics need Pinocchio")

ARM = share_file("config", "space_arm.yaml")
PARAMETERS = "/cable_node:\n  ros__parameters: {tolerance: 0.0001, polyline_points: 5}\n"
SOLVED = "/cable_node/solved_joints"
EVENTS = "/cable_node/events"


class FakeNode:
    """Solves and logs as the node does."""

    def __init__(self, path: Path, *, exact: bool = True, scene: Path = ARM, **arguments) -> None:
        scene = load_scene(scene)
        attachments = {
            "scene.yaml": scene.text,
            "robot.urdf": scene.robot.urdf,
            "parameters.yaml": PARAMETERS,
        }
        self.log = LogWriter(path, attachments=attachments, **arguments)
        self.tracker = Tracker(scene, 1e-4, 5)
        self.exact = exact
        self.time = START
        if exact:
            self.event(events.START, tolerance=1e-4, polyline_points=5, fresh=True)

    def event(self, kind: str, **values) -> None:
        self.log.write(EVENTS, events.STRING, encode_event(kind, **values), self.time)

    def solve(self, angle: float, *, log: bool = True, alter: float = 0.0) -> None:
        self.time += 1_000_000
        found = self.tracker.solve({"orientation": angle})
        if not log:
            self.log._topics[SOLVED].sequence += 1  # as when a full queue drops it
            return
        self.log.write(JOINTS, JOINT_STATE, joint_state(angle, self.time), self.time)
        if self.exact:
            solved = encode_solved_joints(("orientation",), [angle], self.time)
            self.log.write(SOLVED, JOINT_STATE, solved, self.time)
        for cable, equilibrium in found.items():
            if equilibrium.status.trusted:
                for clamp in ("end", "start"):
                    values = getattr(equilibrium, f"{clamp}_wrench") + alter * (clamp == "end")
                    topic = f"/cable_node/{cable}/{clamp}_wrench"
                    self.log.write(topic, WRENCH_STAMPED, wrench(list(values), self.time), self.time)

    def close(self) -> None:
        self.log.close()
        assert self.log.error is None


def again(*paths: Path) -> Outcome:
    logs = [LogReader(path) for path in paths]
    outcome = Outcome()
    run = LoggedRun(logs)
    tracker = Tracker(logged_scene(run.logs[0]), logged_tolerance(run.logs[0]))
    for _ in resolve(run, tracker, outcome):
        pass
    for log in logs:
        log.close()
    return outcome


ANGLES = 1.2 * np.sin(np.linspace(0.0, 6.0, 40))  # there and back: the result depends on the way


@pytest.mark.parametrize("exact", [True, False])
def test_a_run_is_reproduced_bit_for_bit(tmp_path, exact):
    node = FakeNode(tmp_path / "run.mcap", exact=exact)
    for angle in ANGLES:
        node.solve(float(angle))
    node.close()
    outcome = again(tmp_path / "run.mcap")
    assert outcome.solves == len(ANGLES)
    assert {key: (c.compared, c.identical) for key, c in outcome.comparisons.items()} == {
        ("camera_cable", clamp): (40, 40) for clamp in ("end", "start")
    }
    assert outcome.within(0.0)
    assert outcome.relative == 0.0


def test_friction_remembers_in_a_replay_what_it_did_in_the_run(tmp_path):
    node = FakeNode(tmp_path / "run.mcap", scene=share_file("config", "space_arm_sphere.yaml"))
    for angle in np.radians([*range(20, 70, 2), *range(70, 40, -2)]):
        node.solve(float(angle))
    node.close()
    outcome = again(tmp_path / "run.mcap")
    assert outcome.comparisons["camera_cable", "end"].compared == 40
    assert outcome.within(0.0)


def test_resets_and_settings_are_repeated_where_they_happened(tmp_path):
    node = FakeNode(tmp_path / "run.mcap")
    for i, angle in enumerate(ANGLES):
        if i == 10:
            node.tracker.reset()
            node.event(events.RESET)
        if i == 20:
            node.tracker.tolerance = 1e-7
            node.event(events.SET, tolerance=1e-7)
        node.solve(float(angle))
    node.close()
    assert again(tmp_path / "run.mcap").within(0.0)

    # Without the events the bits differ: the test can fail.
    run = FakeNode(tmp_path / "silent.mcap")
    for i, angle in enumerate(ANGLES):
        if i == 20:
            run.tracker.tolerance = 1e-7
        run.solve(float(angle))
    run.close()
    outcome = again(tmp_path / "silent.mcap")
    assert not outcome.within(0.0)
    assert outcome.within(2e-4)  # twice the tolerance of the coarser of both


def test_the_environment_is_repeated_or_left_to_another_scene(tmp_path, capsys):
    cold = share_file("config", "space_arm_cold.yaml")
    node = FakeNode(tmp_path / "run.mcap", scene=cold)
    for i, angle in enumerate(ANGLES):
        if i in (0, 15):
            node.tracker.set_environment({"temperature": -3.0 * i})
            node.event(events.ENVIRONMENT, environment={"temperature": -3.0 * i})
        node.solve(float(angle))
    node.close()
    assert again(tmp_path / "run.mcap").within(0.0)

    assert main(["replay", str(tmp_path / "run.mcap"), "--with", str(cold), "--out", str(tmp_path)]) == 0
    assert "temperatures and doses of the log were left out" in capsys.readouterr().out
    tracker, joints = Tracker(load_scene(cold)), {"orientation": float(ANGLES[3])}
    equilibria = tracker.solve(joints)
    coldest = equilibria["camera_cable"].end_wrench
    new = read_history(tmp_path / "run_with_space_arm_cold.mcap").end_wrenches["camera_cable"][3]
    # The one cold, the other tracked, each within 1e-4 of the truth.
    assert np.linalg.norm(new - coldest) <= 2e-4 * np.linalg.norm(coldest)
    with LogReader(tmp_path / "run_with_space_arm_cold.mcap") as log:
        loads = [message for _, message in log.decoded(["/cable_node/joint_load"])]
    assert len(loads) == len(ANGLES)
    assert loads[3].effort[0] == pytest.approx(joint_torque(tracker, equilibria, joints)[0], rel=1e-3)
    logged = read_history(tmp_path / "run.mcap").end_wrenches["camera_cable"][3]
    assert np.linalg.norm(new - logged) > 0.01 * np.linalg.norm(coldest)


def test_a_split_run_is_reproduced_from_all_its_files(tmp_path):
    node = FakeNode(tmp_path / "run.mcap", max_seconds=0.15)
    import time

    for angle in ANGLES:
        node.solve(float(angle))
        time.sleep(0.01)
    node.close()
    assert len(node.log.paths) > 1
    assert again(*reversed(node.log.paths)).within(0.0)


def test_poses_without_a_result_are_compared_as_well(tmp_path):
    node = FakeNode(tmp_path / "run.mcap")
    for angle in (0.1, float("nan"), 0.2, 0.3):
        node.solve(angle)
    node.close()
    outcome = again(tmp_path / "run.mcap")
    assert outcome.solves == 4
    end = outcome.comparisons["camera_cable", "end"]
    assert (end.compared, end.identical, end.unanswered) == (3, 3, 0)


def test_dropped_solves_are_reported(tmp_path):
    node = FakeNode(tmp_path / "run.mcap")
    for i, angle in enumerate(ANGLES):
        node.solve(float(angle), log=i not in (7, 8))
    node.close()
    with LogReader(tmp_path / "run.mcap") as log:
        assert [item.count for item in LoggedRun([log]) if isinstance(item, Gap)] == [2]
    assert again(tmp_path / "run.mcap").gaps == 2


def test_the_command_says_how_far_off_a_wrench_is(tmp_path, capsys):
    node = FakeNode(
        tmp_path / "run.mcap", metadata={"host": {"python": "2.7", "machine": platform.machine()}}
    )
    for i, angle in enumerate(ANGLES):
        node.solve(float(angle), alter=1e-5 if i == 17 else 0.0)
    node.close()
    path = str(tmp_path / "run.mcap")
    assert main(["replay", path, "--resolve"]) == 1
    printed = capsys.readouterr().out
    assert "camera_cable end: 39 of 40 wrenches bit for bit, largest difference 1.73e-05 N" in printed
    assert "(at 0.018 s)" in printed
    assert "camera_cable start: 40 of 40 wrenches bit for bit" in printed
    assert f"of another machine or version: python 2.7, here {platform.python_version()}." in printed
    assert "not the same bit for bit" in printed
    # A moment of some mN m, off by 1e-5 sqrt(3) N m.
    assert main(["replay", path, "--resolve", "--tolerance", "0.01"]) == 0
    assert main(["replay", path, "--resolve", "--tolerance", "1e-4"]) == 1


def test_another_scene_gives_a_picture_and_a_log(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    pytest.importorskip("rclpy", reason="rclpy is not on this machine")
    node = FakeNode(tmp_path / "run.mcap")
    for angle in ANGLES:
        node.solve(float(angle))
    node.close()
    stiff = tmp_path / "stiff.yaml"
    text = ARM.read_text().replace("youngs_modulus: 6.70e6", "youngs_modulus: 13.4e6")
    assert text != ARM.read_text()
    stiff.write_text(text.replace("space_arm.urdf", str(share_file("config", "space_arm.urdf"))))
    command = ["replay", str(tmp_path / "run.mcap"), "--with", str(stiff), "--out", str(tmp_path / "out")]
    assert main(command) == 0
    assert "side by side" in capsys.readouterr().out
    assert (tmp_path / "out" / "run_with_stiff.png").stat().st_size > 10_000
    with LogReader(tmp_path / "out" / "run_with_stiff.mcap") as log:
        assert "13.4e6" in log.scene_text
        assert log.topics["/cable_node/camera_cable/end_wrench"].count == len(ANGLES)
        times = [m.log_time for m in log.messages(["/cable_node/camera_cable/end_wrench"])]
        assert times == [START + (i + 1) * 1_000_000 for i in range(len(ANGLES))]
    # What was written is what that scene gives, and a log that can be solved again itself.
    assert main(["replay", str(tmp_path / "out" / "run_with_stiff.mcap"), "--resolve"]) == 0
    assert main(command) == 2  # never overwritten
    assert "exists already" in capsys.readouterr().err


def test_what_cannot_be_solved_again_is_one_sentence(tmp_path, write_log, capsys):
    path = str(write_log(3))
    assert main(["replay", path, "--resolve"]) == 2
    assert "has no attachment 'scene.yaml'; name a scene with --with" in capsys.readouterr().err
    assert main(["replay", path]) == 2
    assert "--resolve, or --with SCENE" in capsys.readouterr().err
    assert main(["replay", path, "--resolve", "--tolerance", "-1"]) == 2
    with LogWriter(tmp_path / "joints.mcap") as log:
        log.write(JOINTS, JOINT_STATE, joint_state(0.0), 1)
    with LogReader(tmp_path / "joints.mcap") as reader, pytest.raises(LogError, match="holds no wrench"):
        LoggedRun([reader])
