# SPDX-License-Identifier: Apache-2.0
"""A real node watches a cable's limits and whether its motion is quasi-static."""

from __future__ import annotations

import math
import time

import pytest

pytest.importorskip("rclpy", reason="rclpy is not on this machine")
pytest.importorskip("pinocchio", reason="the arm's kinematics need Pinocchio")

from observer import ERROR, WARN, Observer
from robot import CABLE, NODE

from cable_ros.log.history import read_history
from cable_ros.log.reader import LogReader
from cable_ros.share import share_file

ARM = share_file("config", "space_arm.yaml")
CABLE_ENTRY = f"{NODE[1:]}: camera_cable"
LIMITS = f"{CABLE}/limits"
SECOND = 1_000_000_000


def test_limits_and_motion_are_told(tmp_path):
    """At 0 degrees the radius is 29.7 mm, at -90 it is 38.5 mm: beyond and near a limit of 35 mm."""
    scene, log = tmp_path / "limited.yaml", tmp_path / "run.mcap"
    text = ARM.read_text().replace("space_arm.urdf", str(ARM.parent / "space_arm.urdf"))
    scene.write_text(f"{text}\n    limits: {{bend_radius: 0.035}}\n")
    with Observer(scene=scene, diagnostics_rate="20.0", log__enabled="true", log__path=log) as robot:
        robot.listen(LIMITS, "diagnostic_msgs/msg/DiagnosticArray")
        robot.move(0.0)
        beyond = robot.told("Bend radius 0.02966 m at 0 m, 118 % of its limit of 0.035 m.", CABLE_ENTRY)
        assert beyond.level == ERROR
        robot.wait(lambda: bool(robot.messages[LIMITS]))
        assert "lowest natural frequency [Hz]" not in {value.key for value in beyond.values}

        robot.set_parameter("check_motion", True)
        known = robot.entry(CABLE_ENTRY, lambda entry: "lowest natural" in str(entry.values))
        values = {value.key: float(value.value) for value in known.values if "[" in value.key}
        assert values["lowest natural frequency [Hz]"] == pytest.approx(3.34, rel=0.01)
        assert values["swing [m]"] == 0.0
        begin = time.time_ns()
        # To and fro by 0.3 rad at 2 Hz: about 45 m/s^2 at the clamp, at 0.6 of the lowest frequency.
        for k in range(40):
            angle = 0.3 * math.sin(2.0 * math.pi * 2.0 * 0.02 * k)
            before = len(robot.messages[LIMITS])
            robot.send(["orientation"], [angle], stamp=begin + k * SECOND // 50)
            robot.wait(lambda before=before: len(robot.messages[LIMITS]) > before)
        shaken = robot.told("Not quasi-static: accelerated by ", CABLE_ENTRY)
        assert shaken.level >= WARN
        robot.set_parameter("check_motion", False)
        robot.stop()
    history = read_history(log)
    assert history.limit_use["camera_cable"]["bend radius"][0] == pytest.approx(0.035 / 0.02966, rel=1e-3)
    with LogReader(log) as opened:
        told = [
            status.message
            for _, message in opened.decoded(["/diagnostics"])
            for status in message.status
            if status.name == CABLE_ENTRY
        ]
    assert any("Not quasi-static" in message for message in told)
