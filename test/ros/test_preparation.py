# SPDX-License-Identifier: Apache-2.0
"""What a real node does while it compiles, or loads what is compiled."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="rclpy is not on this machine")
pytest.importorskip("pinocchio", reason="the arm's kinematics need Pinocchio")

from observer import ERROR, JOINTS_ENTRY, LOG_ENTRY, OK, WARN, Observer, arm_scene
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from robot import CABLE, NODE
from std_msgs.msg import String

from cable_ros.log import events
from cable_ros.log.reader import LogReader
from cable_ros.share import share_file
from cable_ros.tracker import Tracker

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Early(Observer):
    """There before the node has a tracker."""

    timeout = 300.0  # it compiles all beside other tests

    def wait_for_node(self) -> None:
        pass


@pytest.mark.timeout(600)
def test_while_it_compiles_it_says_so_and_answers_parameters(tmp_path, monkeypatch):
    # An empty cache makes it compile for half a minute; what is kept may load sooner than we ask.
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "compiled"))
    path = tmp_path / "logs" / "run.mcap"
    path.parent.mkdir()
    with Early(diagnostics_rate="50.0", log__enabled="true", log__path=path) as robot:
        client = robot.node.create_client(SetParameters, f"{NODE}/set_parameters")
        robot.wait(client.service_is_ready)
        tolerance = Parameter("tolerance", value=1e-3).to_parameter_msg()
        answer = client.call_async(SetParameters.Request(parameters=[tolerance]))
        report = robot.entry(JOINTS_ENTRY)
        assert (report.level, report.message) == (
            WARN,
            "Compiling the solver; joint states are taken after that.",
        )
        robot.wait(answer.done)
        assert answer.result().results[0].successful
        robot.node.destroy_client(client)
        assert robot.entry(JOINTS_ENTRY).message.startswith("Compiling"), "it was answered before that ended"
        assert robot.publisher.get_subscription_count() == 0
        super(Early, robot).wait_for_node()
        robot.move(0.3)
        assert robot.entry(JOINTS_ENTRY).level == OK
        assert robot.entry(LOG_ENTRY).message == f"Writing {path}."
        robot.stop()
    with LogReader(path) as log:  # the only one: begun with the scene, and with the tolerance set meanwhile
        assert "scene.yaml" in log.attachments
        assert "tolerance: 0.001" in log.attachments["parameters.yaml"]
        _, first = next(log.decoded([f"{NODE}/events"]))
        assert events.decode_event(first.data)["tolerance"] == 1e-3
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.timeout(600)
def test_until_it_is_compiled_the_interpreter_answers(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "compiled"))
    monkeypatch.setenv("CABLE_ROS_INTERPRET", "1")
    with Early(diagnostics_rate="20.0") as robot:
        wrenches = robot.listen(f"{CABLE}/end_wrench", "geometry_msgs/msg/WrenchStamped")
        super(Early, robot).wait_for_node()
        robot.move(0.3)
        report = robot.entry(JOINTS_ENTRY)
        assert report.level == WARN
        assert "until then the interpreter solves" in report.message
        robot.wait(lambda: "interpreter" not in robot.entry(JOINTS_ENTRY).message)
        robot.move(0.3)
        assert robot.entry(JOINTS_ENTRY).level == OK
    forces = [[getattr(one.wrench.force, axis) for axis in "xyz"] for one in wrenches]
    tracker, joints = Tracker(str(share_file("config", "space_arm.yaml"))), {"orientation": 0.3, "pitch": 0.0}
    compiled = tracker.solve(joints)["camera_cable"].end_wrench[:3]
    np.testing.assert_allclose(forces, [compiled] * len(forces), rtol=1e-11)  # NumPy's powers and sines


@pytest.mark.timeout(600)
def test_a_signal_amid_an_interpreted_solve_ends_it(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "compiled"))
    monkeypatch.setenv("CABLE_ROS_INTERPRET", "1")
    with Early(scene=share_file("config", "space_arm_sphere.yaml")) as robot:
        wrenches = robot.listen(f"{CABLE}/end_wrench", "geometry_msgs/msg/WrenchStamped")
        super(Early, robot).wait_for_node()
        robot.send(["orientation", "pitch"], [0.3, 0.0])
        robot.rest(2.0)  # of ten or more
        threads = Path(f"/proc/{robot.process.pid}/task").iterdir()
        children = [pid for thread in threads for pid in (thread / "children").read_text().split()]
        begin = time.monotonic()
        robot.end(signal.SIGINT)
        assert time.monotonic() - begin < 5.0, "far less, but other tests run beside"
        assert not wrenches
    assert children
    assert not any(Path(f"/proc/{pid}").exists() for pid in children), "what compiled goes on"


def test_a_robot_without_the_scenes_link_is_an_error_until_one_with_it_comes(tmp_path):
    scene = arm_scene(tmp_path, robot=None)
    with Early(scene=scene, diagnostics_rate="20.0") as robot:
        described = robot.node.create_publisher(String, "/robot_description", LATCHED)
        robot.wait(lambda: described.get_subscription_count() > 0)
        urdf = share_file("config", "space_arm.urdf").read_text()
        described.publish(String(data=urdf.replace('"turret"', '"tower"')))
        assert robot.told("the robot has no link 'turret'").level == ERROR
        described.publish(String(data=urdf))
        super(Early, robot).wait_for_node()
        robot.move(0.3)
        assert robot.entry(JOINTS_ENTRY).level == OK
