# SPDX-License-Identifier: Apache-2.0
"""What a real node tells, and where: unknown parameters, start-up errors, faults, idleness."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import pytest

pytest.importorskip("rclpy", reason="rclpy is not on this machine")
pytest.importorskip("pinocchio", reason="the arm's kinematics need Pinocchio")

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from observer import OK, Observer
from rcl_interfaces.msg import Log
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.logging import LoggingSeverity
from rclpy.node import Node
from robot import TIMEOUT, end

CABLE_ENTRY = "cable_node: camera_cable"


def test_an_unknown_parameter_is_told():
    with Observer(tolerence="1.0e-5", log__enable="true") as robot:
        printed = robot.stop()
    assert "There is no parameter 'tolerence' (did you mean 'tolerance'?); it is ignored." in printed
    assert "There is no parameter 'log.enable' (did you mean 'log.enabled'?); it is ignored." in printed


def test_what_it_knows_is_not_told_as_unknown():
    with Observer(use_sim_time="false", tolerance="1.0e-5") as robot:
        assert "There is no parameter" not in robot.stop()


class Listener:
    """Hears one topic while a node with these arguments runs. Use as a context manager."""

    def __init__(self, topic: str, kind: type, *arguments: str) -> None:
        self.context = Context()
        rclpy.init(context=self.context)
        self.node = Node("listener", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.heard: list[Any] = []
        self.node.create_subscription(kind, topic, self.heard.append, 100)
        command = [sys.executable, "-m", "cable_ros.ros.cable_node", "--ros-args", *arguments]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)

    def spin_until(self, done: Callable[[], bool]) -> None:
        deadline = time.monotonic() + TIMEOUT
        while not done():
            assert time.monotonic() < deadline, self.heard
            self.executor.spin_once(timeout_sec=0.02)

    def __enter__(self) -> Listener:
        return self

    def __exit__(self, *exc: object) -> None:
        end(self.process)
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


def test_topics_are_remapped():
    arguments = ["-p", "scene:=space_arm.yaml", "-r", "joint_states:=/arm/joint_states"]
    with Listener("/diagnostics", DiagnosticArray, *arguments) as listener:
        sentence = "No position of the joint 'orientation' was seen on '/arm/joint_states'"
        listener.spin_until(
            lambda: any(sentence in entry.message for report in listener.heard for entry in report.status)
        )
        assert listener.node.count_subscribers("/arm/joint_states") == 1
        assert listener.node.count_subscribers("/joint_states") == 0


def test_why_it_does_not_start_is_on_rosout():
    with Listener("/rosout", Log, "-p", "scene:=/nowhere.yaml") as listener:
        listener.spin_until(lambda: listener.process.poll() is not None)
        for _ in range(50):  # what is still on its way
            listener.executor.spin_once(timeout_sec=0.02)
        heard, code = listener.heard, listener.process.returncode
    assert code == 2
    (message,) = [message for message in heard if message.name == "cable_node"]
    assert message.level == LoggingSeverity.FATAL
    assert "/nowhere.yaml" in message.msg


def test_two_kinds_of_fault_are_both_told_at_once():
    with Observer() as robot:
        robot.move(0.1)
        for _ in range(3):
            robot.send(["orientation"], [0.1, 0.2])
            robot.send(["orientation", "orientation"], [0.1, 0.2])
        robot.wait(lambda: robot.counters()["rejected"] >= 2)
        robot.rest()
        printed = robot.stop()
    assert printed.count("has 2 positions for 1 names") == 1
    assert printed.count("names 'orientation' twice") == 1


def test_an_idle_cable_is_as_well_as_it_was():
    with Observer(diagnostics_rate="20.0") as robot:
        robot.move(0.1)
        entry = robot.told("Converged to a stable equilibrium. Nothing solved since.", CABLE_ENTRY)
        assert entry.level == OK
        assert {pair.key: pair.value for pair in entry.values}["status"] == "CONVERGED"
