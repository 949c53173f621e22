# SPDX-License-Identifier: Apache-2.0
"""Two arms side by side: real nodes in two namespaces; topics, frames, logs and diagnostics told apart."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="rclpy is not on this machine")
pytest.importorskip("pinocchio", reason="the arm's kinematics need Pinocchio")

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Path
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from robot import TIMEOUT, end
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from cable_ros import Tracker
from cable_ros.log.reader import LogReader
from cable_ros.share import share_file

SCENES = {"left": "space_arm.yaml", "right": "space_arm_sphere.yaml"}
ANGLES = {"left": 0.3, "right": 0.5}
CABLE = "camera_cable"


class Cell:
    """Both nodes, and what they publish by topic."""

    def __init__(self, folder):
        self.nodes = {side: self.start(side, scene, folder) for side, scene in SCENES.items()}
        self.context = Context()
        rclpy.init(context=self.context)
        self.node = Node("cell", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.heard = {}
        self.listen("/diagnostics", DiagnosticArray)
        self.publishers = {}
        for side in SCENES:
            own = f"/{side}/cable_node"
            self.listen(f"{own}/{CABLE}/end_wrench", WrenchStamped)
            self.listen(f"{own}/{CABLE}/start_wrench", WrenchStamped)
            self.listen(f"{own}/{CABLE}/polyline", Path)
            self.listen(f"{own}/status", DiagnosticArray)
            self.listen(f"{own}/markers", MarkerArray)
            self.publishers[side] = self.node.create_publisher(JointState, f"/{side}/joint_states", 10)

    @staticmethod
    def start(side, scene, folder):
        parameters = {
            "scene": share_file("config", scene),
            "frame_prefix": f"{side}/",
            "log.enabled": "true",
            "log.path": folder,
            "diagnostics_rate": "20.0",
        }
        command = [sys.executable, "-m", "cable_ros.ros.cable_node", "--ros-args", "-r", f"__ns:=/{side}"]
        for name, value in parameters.items():
            command += ["-p", f"{name}:={value}"]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)

    def listen(self, topic, kind):
        self.heard[topic] = []
        self.node.create_subscription(kind, topic, self.heard[topic].append, QoSProfile(depth=100))

    def wait(self, done, meanwhile=lambda: None):
        deadline = time.monotonic() + TIMEOUT
        while not done():
            assert time.monotonic() < deadline, {topic: len(heard) for topic, heard in self.heard.items()}
            for process in self.nodes.values():
                assert process.poll() is None, process.communicate()
            meanwhile()
            for _ in range(10):
                self.executor.spin_once(timeout_sec=0.02)

    def move(self):
        for side, publisher in self.publishers.items():
            message = JointState(name=["orientation"], position=[ANGLES[side]])
            message.header.stamp = self.node.get_clock().now().to_msg()
            publisher.publish(message)

    def entries(self):
        """Every diagnostics entry by name."""
        return {status.name: status for message in self.heard["/diagnostics"] for status in message.status}

    def markers(self, side):
        """What viewers got."""
        return [one for message in self.heard[f"/{side}/cable_node/markers"] for one in message.markers]

    def cable_seen(self, side):
        """Whether obstacles, sent first, are not all that they got."""
        return any(one.ns.startswith(CABLE) for one in self.markers(side))

    def stop(self):
        for process in self.nodes.values():
            process.send_signal(signal.SIGINT)
        for process in self.nodes.values():
            output, _ = process.communicate(timeout=TIMEOUT)
            assert process.returncode == 0, output

    def close(self):
        for process in self.nodes.values():
            end(process)
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    found = Cell(folder)
    try:
        found.wait(lambda: all(found.heard.values()), found.move)
        found.wait(lambda: len(found.entries()) == 6)
        found.wait(lambda: all(map(found.cable_seen, SCENES)), found.move)
        found.stop()
    finally:
        found.close()
    found.logs = sorted(folder.iterdir())
    return found


@pytest.mark.parametrize("side", SCENES)
def test_each_answers_its_own_arm(cell, side):
    message = cell.heard[f"/{side}/cable_node/{CABLE}/end_wrench"][-1]
    tracker = Tracker(str(share_file("config", SCENES[side])))
    expected = tracker.solve({"orientation": ANGLES[side]})[CABLE].end_wrench
    force = message.wrench.force
    found = np.array([force.x, force.y, force.z])
    np.testing.assert_allclose(found, expected[:3], atol=1e-2 * np.linalg.norm(expected[:3]))


@pytest.mark.parametrize("side", SCENES)
def test_every_frame_has_the_prefix(cell, side):
    frames = {"base": set(), f"{CABLE}_end": set(), f"{CABLE}_start": set()}
    own = f"/{side}/cable_node"
    for clamp in ("end", "start"):
        heard = cell.heard[f"{own}/{CABLE}/{clamp}_wrench"]
        frames[f"{CABLE}_{clamp}"] |= {message.header.frame_id for message in heard}
    for message in cell.heard[f"{own}/{CABLE}/polyline"]:
        frames["base"] |= {message.header.frame_id, *(pose.header.frame_id for pose in message.poses)}
    markers = cell.markers(side)
    frames["base"] |= {marker.header.frame_id for marker in markers}
    assert frames == {name: {f"{side}/{name}"} for name in frames}
    shown = {marker.ns.partition("/")[0] for marker in markers}
    assert shown == ({CABLE} if side == "left" else {CABLE, "obstacle"})


def test_the_diagnostics_are_of_two_nodes(cell):
    entries = cell.entries()
    assert set(entries) == {
        f"{side}/cable_node: {what}" for side in SCENES for what in ("joint states", "log", CABLE)
    }
    for name, entry in entries.items():
        assert entry.hardware_id == "/" + name.partition(":")[0]
    for side, scene in SCENES.items():
        values = {pair.key: pair.value for pair in entries[f"{side}/cable_node: joint states"].values}
        assert values["scene"] == str(share_file("config", scene))
        (status,) = cell.heard[f"/{side}/cable_node/status"][-1].status
        assert (status.name, status.hardware_id) == (CABLE, f"/{side}/cable_node")


def test_each_has_a_log_of_its_own(cell):
    assert [path.name.rpartition("_")[0] for path in cell.logs] == ["left_cable_node", "right_cable_node"]
    for side, path in zip(SCENES, cell.logs, strict=True):
        with LogReader(path) as log:
            own = {topic for topic in log.topics if topic not in ("/diagnostics", "/tf_static")}
            assert all(topic.startswith(f"/{side}/") for topic in own)


def test_the_clamps_frames_lie_in_links_with_the_prefix(cell):
    pytest.importorskip("mcap_ros2", reason="rclpy decodes no tf2_msgs where there are only wheels")
    for side, path in zip(SCENES, cell.logs, strict=True):
        with LogReader(path) as log:
            ((_, message),) = log.decoded(["/tf_static"])
        frames = {(one.header.frame_id, one.child_frame_id) for one in message.transforms}
        clamps = {("base", f"{CABLE}_start"), ("turret", f"{CABLE}_end")}
        assert frames == {(f"{side}/{parent}", f"{side}/{child}") for parent, child in clamps}


def test_a_prefix_that_tf2_would_refuse_is_refused():
    command = [sys.executable, "-m", "cable_ros.ros.cable_node", "--ros-args", "-p", "frame_prefix:=/left/"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=TIMEOUT)
    assert done.returncode == 2
    sentence = "'frame_prefix' is '/left/'; frames of tf2 do not begin with '/': leave it out"
    assert sentence in done.stderr
