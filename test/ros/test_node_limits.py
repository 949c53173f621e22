# SPDX-License-Identifier: Apache-2.0
"""Joint values and jumps that the URDF does not allow, at a real node."""

from __future__ import annotations

import time

import pytest

pytest.importorskip("rclpy", reason="rclpy is not on this machine")
pytest.importorskip("pinocchio", reason="the arm's kinematics need Pinocchio")

from observer import ERROR, OK, WARN, Observer
from robot import CABLE, NODE

from cable_ros.cli.main import main

END_WRENCH = f"{CABLE}/end_wrench"
CABLE_ENTRY = f"{NODE[1:]}: camera_cable"
OUTSIDE = "Joint 'orientation' is 1.7 rad, outside its limits of -1.5708 to 1.5708 rad in the URDF."
NAMES = ["pitch", "orientation"]
SECOND = 1_000_000_000


def answers(robot) -> int:
    return len(robot.messages[END_WRENCH])


def send_and_wait(robot, angle, **more):
    before = answers(robot)
    robot.send(NAMES, [0.0, angle], **more)
    robot.wait(lambda: answers(robot) > before)


def test_limits_are_told_refused_or_ignored_and_jumps_told(tmp_path, capsys):
    log = tmp_path / "run.mcap"
    with Observer(diagnostics_rate="20.0", log__enabled="true", log__path=log) as robot:
        robot.listen(END_WRENCH, "geometry_msgs/msg/WrenchStamped")
        robot.move(0.0)
        begin = time.time_ns()
        # Slow enough: 1 rad/s is the limit, and values near the end are inside.
        for number, angle in enumerate((0.5, 1.0, 1.5)):
            send_and_wait(robot, angle, stamp=begin + (2 * number + 2) * SECOND)
        assert robot.entry().level == OK

        send_and_wait(robot, 1.7, stamp=begin + 10 * SECOND)
        assert robot.told(OUTSIDE).level == WARN
        send_and_wait(robot, 1.7, stamp=begin + 10 * SECOND + 1)
        assert robot.told(OUTSIDE, CABLE_ENTRY).message.startswith("Converged")

        robot.set_parameter("joint_limits", "refuse")
        before = answers(robot)
        robot.send(NAMES, [0.0, 1.7], stamp=begin + 11 * SECOND)
        refused = robot.told("Not solved, as joint_limits is 'refuse'", CABLE_ENTRY)
        assert (refused.level, answers(robot)) == (ERROR, before)

        send_and_wait(robot, 1.2, stamp=begin + 12 * SECOND)
        send_and_wait(robot, 0.2, stamp=begin + 12 * SECOND + SECOND // 10)
        jump = robot.told(
            "Joint 'orientation' went 1 rad in 0.1 s; its velocity limit in the URDF is 1 rad/s."
        )
        assert jump.level == WARN

        robot.set_parameter("joint_limits", "ignore")
        send_and_wait(robot, 1.7, stamp=begin + 12 * SECOND + SECOND // 5)
        robot.rest(0.2)
        assert robot.entry().level == OK
        taken, why = robot.try_parameter("joint_limits", "clip")
        assert (taken, why) == (
            False,
            "Parameter 'joint_limits' is 'clip'; it must be warn, refuse or ignore.",
        )
        robot.stop()
    # What was refused did not move the cable, nor does it when the log is solved again.
    assert main(["replay", str(log), "--resolve"]) == 0, capsys.readouterr()
