# SPDX-License-Identifier: Apache-2.0
"""Temperature and dose from their topics: a real node stiffens its cable, and its log solves again."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="rclpy is not on this machine")
pytest.importorskip("pinocchio", reason="the arm's kinematics need Pinocchio")

from observer import WARN, Observer
from rclpy.qos import QoSProfile
from robot import CABLE, NODE
from sensor_msgs.msg import Temperature
from std_msgs.msg import Float64

from cable_ros import Tracker
from cable_ros.cli.main import main
from cable_ros.share import share_file

END_WRENCH = f"{CABLE}/end_wrench"
ANGLE = 0.3


def test_the_cable_follows_its_temperature_and_dose(tmp_path, capsys):
    scene, path = share_file("config", "space_arm_cold.yaml"), tmp_path / "run.mcap"
    tracker = Tracker(str(scene))
    with Observer(scene=scene, diagnostics_rate="20.0", log__enabled="true", log__path=path) as robot:
        sensors = {
            "temperature": robot.node.create_publisher(Temperature, "/camera_cable/temperature", 10),
            "dose": robot.node.create_publisher(Float64, "/camera_cable/dose", QoSProfile(depth=1)),
        }
        for sensor in sensors.values():
            robot.wait(lambda sensor=sensor: sensor.get_subscription_count() > 0)
        answers = robot.listen(END_WRENCH, "geometry_msgs/msg/WrenchStamped")
        robot.rest()

        def holds(key, value):
            """Move until the diagnostics say that a value holds; the wrench (6,) then."""

            def told():
                robot.move(ANGLE)
                entry = robot.entry(f"{NODE[1:]}: camera_cable", lambda status: len(status.values) > 2)
                return float({pair.key: pair.value for pair in entry.values}[key]) == value

            robot.wait(told)
            robot.rest(0.1)
            wrench = answers[-1].wrench
            return [getattr(part, axis) for part in (wrench.force, wrench.torque) for axis in "xyz"]

        found = [({}, holds("temperature [degC]", -80.0))]  # the scene's own
        for value in (-100.0, 20.0):
            sensors["temperature"].publish(Temperature(temperature=value))
            found.append(({"temperature": value}, holds("temperature [degC]", value)))
        sensors["dose"].publish(Float64(data=1e6))
        found.append(({"dose": 1e6}, holds("dose [Gy]", 1e6)))
        for message, sentence in (
            (Temperature(temperature=math.nan), "must be a finite number in degC"),
            (
                Temperature(temperature=500.0),
                "500 degC is outside the table, which ends at -150 and 100",
            ),
        ):
            robot.rest(0.2)  # changes are taken ten times in a second
            sensors["temperature"].publish(message)
            robot.rest(0.1)
            robot.move(ANGLE)
            assert robot.told(sentence).level == WARN
        holds("temperature [degC]", 20.0)
        robot.stop()
    for environment, wrench in found:
        tracker.set_environment(environment)
        expected = tracker.solve({"orientation": ANGLE})["camera_cable"].end_wrench
        for part in (slice(0, 3), slice(3, 6)):
            # Both are within the tolerance, 1e-4, of the same truth, whatever the way there.
            scale = np.linalg.norm(expected[part])
            assert np.linalg.norm(np.subtract(wrench[part], expected[part])) < 3e-4 * scale
    stiff, soft = (np.linalg.norm(wrench) for _, wrench in found[1:3])
    assert stiff > 1.5 * soft  # 3.2 times the bending stiffness, part of which the weight hides
    assert main(["replay", str(path), "--resolve"]) == 0
    assert "wrenches bit for bit" in capsys.readouterr().out
