# SPDX-License-Identifier: Apache-2.0
"""How a real node starts, with what it refuses to, what it waits for, and how it stops."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="rclpy is not on this machine")
pytest.importorskip("pinocchio", reason="the arm's kinematics need Pinocchio")

from observer import ERROR, LOG_ENTRY, OK, WARN, Observer, arm_scene
from rclpy.qos import DurabilityPolicy, QoSProfile
from robot import CABLE, NODE, PUBLISHED, TIMEOUT
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from cable_ros import Tracker
from cable_ros.joint import joint_load
from cable_ros.log.reader import LogReader
from cable_ros.scene.text import parse_yaml
from cable_ros.share import share_file

NAMES = ["pitch", "orientation"]
END_WRENCH = f"{CABLE}/end_wrench"
WRENCH = "geometry_msgs/msg/WrenchStamped"
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Early(Observer):
    """There before the node has a scene."""

    def wait_for_node(self) -> None:
        pass


def start(*parameters: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "cable_ros.ros.cable_node", "--ros-args"]
    for parameter in parameters:
        command += ["-p", parameter]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def test_a_missing_joint_is_an_error_until_it_comes():
    with Observer(diagnostics_rate="20.0") as robot:
        answers = robot.listen(END_WRENCH, WRENCH)
        status = robot.told("No position of the joint 'orientation' was seen on '/joint_states'")
        assert status.level == ERROR
        robot.send(["pitch"], [0.3])
        robot.wait(lambda: robot.counters()["without a needed joint"] > 0)
        assert robot.entry().level == ERROR
        assert not answers
        robot.move(0.3)
        assert robot.entry().level == OK
        assert robot.told("No joint state on '/joint_states' for").level == WARN  # it is silent now


def test_simulated_time_that_jumps_back_is_told(tmp_path):
    path = tmp_path / "run.mcap"
    with Observer(use_sim_time="true", diagnostics_rate="20.0", log__enabled="true", log__path=path) as robot:
        clock = robot.node.create_publisher(Clock, "/clock", 10)

        def tell(seconds: int) -> None:
            message = Clock()
            message.clock.sec = seconds
            clock.publish(message)
            robot.rest(0.1)

        robot.move(0.1)
        answers = robot.listen(END_WRENCH, WRENCH)
        robot.wait(lambda: clock.get_subscription_count() > 0)
        tell(1000)

        def answer() -> int:
            """Seconds of the stamp of the answer to a joint state without one."""
            before = len(answers)
            robot.send(NAMES, [0.0, 0.1], stamp=0)
            robot.wait(lambda: len(answers) > before)
            return answers[-1].header.stamp.sec

        # A moment may pass before the node has seen our publishers.
        robot.wait(lambda: tell(1000) or answer() == 1000)
        tell(5)
        assert robot.told("The clock went back by 995 s; nothing is reset").level == WARN
        assert answer() == 5
        robot.stop()
    with LogReader(path) as log:
        assert log.topics[END_WRENCH].count == robot.heard[END_WRENCH]


@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
def test_a_stop_in_the_midst_of_a_storm_leaves_a_whole_log(tmp_path, stop):
    for attempt in range(2):
        path = tmp_path / f"{attempt}.mcap"
        with Observer(log__enabled="true", log__path=path) as robot:
            robot.move(0.0)

            def storm(seconds: float, robot: Observer = robot) -> None:
                end = time.monotonic() + seconds
                while time.monotonic() < end:
                    robot.send(NAMES, [0.0, math.sin(time.monotonic())])
                    robot.executor.spin_once(timeout_sec=0.0002)

            storm(0.3 + 0.1 * attempt)
            robot.process.send_signal(stop)
            storm(0.05)
            output = robot.end(stop)  # the second one must not cut off the end of the log
            robot.rest()
        assert "is complete" in output
        with LogReader(path) as log:
            counts = {topic: log.topics[topic].count for topic in PUBLISHED}
        for topic, count in counts.items():
            # Best effort loses some under way: the node's own count matters. What was published last may not
            # reach us any more, as its publisher is gone.
            assert robot.published[topic] <= count <= robot.published[topic] + 30


@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_it_starts_ends_it(stop):
    process = start(f"scene:={share_file('config', 'space_arm.yaml')}")
    for line in process.stdout:
        if "Compiling" in line:
            break
    process.send_signal(stop)
    output, _ = process.communicate(timeout=TIMEOUT)
    assert process.returncode == 0, output
    assert "Traceback" not in output


@pytest.mark.parametrize(
    ("parameters", "sentence"),
    [
        ([], "Parameter 'scene' is empty; name a scene file, such as -p scene:=space_arm.yaml"),
        (["scene:=/nowhere.yaml"], "/nowhere.yaml"),
        (["scene:=3"], "Parameter 'scene' must be a text"),
        (["scene:=space_arm.yaml", "tolerance:=1"], "'tolerance' must be a number with a decimal point from"),
        (["scene:=space_arm.yaml", "tolerance:=.nan"], "'tolerance' must be a number with a decimal point"),
        (["scene:=space_arm.yaml", "polyline_points:=1"], "Parameter 'polyline_points' must be an integer"),
    ],
)
def test_what_it_cannot_start_with_is_one_sentence(parameters, sentence):
    process = start(*parameters)
    output, _ = process.communicate(timeout=TIMEOUT)
    assert process.returncode == 2, output
    (line,) = [line for line in output.splitlines() if line.startswith("cable_node: ")]
    assert sentence in line
    assert "Traceback" not in output


def test_a_log_that_would_overwrite_is_refused(tmp_path):
    path = tmp_path / "run.mcap"
    path.write_bytes(b"a log of long ago")
    process = start("scene:=space_arm.yaml", "log.enabled:=true", f"log.path:={path}")
    output, _ = process.communicate(timeout=TIMEOUT)
    assert process.returncode == 2
    assert f"{path} exists already and logs never overwrite; choose another name" in output
    assert path.read_bytes() == b"a log of long ago"


def test_the_robot_description_is_waited_for(tmp_path):
    scene, path = arm_scene(tmp_path, robot=None), tmp_path / "run.mcap"
    with Early(scene=scene, log__enabled="true", log__path=path, diagnostics_rate="20.0") as robot:
        described = robot.node.create_publisher(String, "/robot_description", LATCHED)
        robot.wait(lambda: described.get_subscription_count() > 0)
        assert robot.told("names no robot; waiting for its URDF on '/robot_description'").level == WARN
        described.publish(String(data="<robot"))
        robot.wait(lambda: robot.entry().message.startswith("robot description: this is not"))
        urdf = share_file("config", "space_arm.urdf").read_text()
        described.publish(String(data=urdf))
        super(Early, robot).wait_for_node()
        robot.move(0.3)
        # A late joiner gets the scene that is in use.
        texts = robot.listen(f"{NODE}/scene", "std_msgs/msg/String", LATCHED)
        robot.wait(lambda: texts)
        assert texts[0].data == scene.read_text()
        assert "Writing" in robot.entry(LOG_ENTRY).message
        robot.stop()
    with LogReader(path.with_name("run-2.mcap")) as log:  # begun with the robot; the first one has no scene
        assert {"scene.yaml", "robot.urdf", "parameters.yaml"} <= set(log.attachments)
        assert log.attachments["robot.urdf"] == urdf
        assert log.topics[END_WRENCH].count == robot.heard[END_WRENCH]


def test_several_cables_have_their_own_topics_and_share_the_joint_load(tmp_path):
    scene = parse_yaml(arm_scene(tmp_path).read_text(), "scene")
    twin = scene["cables"][0] | {"name": "other_cable"}
    path = arm_scene(tmp_path, cables=[scene["cables"][0], twin])
    with Observer(scene=path) as robot:
        first, second = (
            robot.listen(f"{NODE}/{name}/end_wrench", WRENCH) for name in ("camera_cable", "other_cable")
        )
        loads = robot.listen(f"{NODE}/joint_load", "sensor_msgs/msg/JointState")
        robot.rest()
        robot.move(0.2)
        robot.wait(lambda: first and second and loads)
        assert first[-1].wrench == second[-1].wrench
        assert (first[-1].header.frame_id, second[-1].header.frame_id) == (
            "camera_cable_end",
            "other_cable_end",
        )
        both = loads[-1].effort[0]
        # One cable's torque about the joint, (r x F + M) . z, r being the clamp seen from the axis.
        wrench = first[-1].wrench
        force = np.array([wrench.force.x, wrench.force.y, wrench.force.z])
        torque = np.cross([0.080, 0.145, 0.075], force)[2] + wrench.torque.z
        assert both == pytest.approx(2 * torque, rel=1e-9)  # rounding: the same numbers in another order


def test_an_arm_of_two_joints_has_a_load_on_each(tmp_path):
    cable = parse_yaml(arm_scene(tmp_path).read_text(), "scene")["cables"][0]
    # The same place as on the turret, on the link that the pitch joint tilts, 0.12 m above.
    cable["end"] |= {"link": "camera", "position": [0.080, 0.145, -0.045]}
    path = arm_scene(tmp_path, cables=[cable])
    joints = {"orientation": 0.2, "pitch": 0.1}
    with Observer(scene=path, diagnostics_rate="20.0") as robot:
        loads = robot.listen(f"{NODE}/joint_load", "sensor_msgs/msg/JointState")
        stiffness = robot.listen(f"{NODE}/joint_stiffness", "trajectory_msgs/msg/JointTrajectory")
        robot.rest()
        # Each joint from a publisher of its own; nothing is solved before both are known.
        robot.send(["pitch"], [joints["pitch"]])
        assert robot.told("No position of the joint 'orientation'").level == ERROR
        assert not loads
        robot.wait(
            lambda: (robot.send(["orientation"], [joints["orientation"]]) and robot.rest(0.2)) or loads
        )
        robot.wait(lambda: stiffness)
    assert dict(zip(loads[-1].name, loads[-1].position, strict=True)) == joints
    tracker = Tracker(str(path))
    expected = joint_load(tracker, tracker.solve(joints), joints)
    assert list(loads[-1].name) == list(tracker.joint_names)
    # Both within the tolerance, 1e-4, of the same truth; a derivative is less exact than its function.
    scale = np.abs(expected.torque).max()
    np.testing.assert_allclose(loads[-1].effort, expected.torque, atol=1e-3 * scale)
    assert list(stiffness[-1].joint_names) == list(tracker.joint_names)
    found = np.transpose([point.effort for point in stiffness[-1].points])
    np.testing.assert_allclose(found, expected.stiffness, atol=1e-2 * np.abs(expected.stiffness).max())
