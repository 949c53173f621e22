"""What the real node logs: everything it published, readable by others, and solved again bit for bit."""

from __future__ import annotations

import math
import signal
import subprocess
import sys
import time
from collections import Counter

import pytest
from log_readers import READERS

rclpy = pytest.importorskip("rclpy", reason="rclpy is not on this machine")
pytest.importorskip("pinocchio", reason="the arm's kinematics need Pinocchio")

from rcl_interfaces.srv import SetParameters  # noqa: E402
from rclpy.context import Context  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rclpy.qos import QoSProfile  # noqa: E402
from sensor_msgs.msg import JointState  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

from cable_ros.cli.main import main  # noqa: E402
from cable_ros.log.reader import LogReader  # noqa: E402
from cable_ros.ros.replay_node import message_class  # noqa: E402
from cable_ros.share import share_file  # noqa: E402

TIMEOUT = 90.0  # s; a first start compiles
NODE = "/cable_node"
CABLE = f"{NODE}/camera_cable"
PUBLISHED = {
    f"{CABLE}/end_wrench": "geometry_msgs/msg/WrenchStamped",
    f"{CABLE}/start_wrench": "geometry_msgs/msg/WrenchStamped",
    f"{CABLE}/polyline": "nav_msgs/msg/Path",
    f"{NODE}/joint_load": "sensor_msgs/msg/JointState",
}


class Robot:
    """The other side of the node."""

    def __init__(self, log: str) -> None:
        command = [sys.executable, "-m", "cable_ros.ros.cable_node", "--ros-args"]
        scene = share_file("config", "space_arm.yaml")
        for parameter in (f"scene:={scene}", "log.enabled:=true", f"log.path:={log}"):
            command += ["-p", parameter]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        self.context = Context()
        rclpy.init(context=self.context)
        self.node = Node("robot", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.publisher = self.node.create_publisher(JointState, "/joint_states", QoSProfile(depth=100))
        self.heard: Counter[str] = Counter()
        for topic, kind in PUBLISHED.items():
            self.node.create_subscription(
                message_class(kind), topic, self._counter(topic), QoSProfile(depth=1000), raw=True
            )
        self.wait(lambda: all(map(self.node.count_publishers, PUBLISHED)))
        self.wait(lambda: self.publisher.get_subscription_count() > 0)

    def _counter(self, topic):
        def count(_: bytes) -> None:
            self.heard[topic] += 1

        return count

    def wait(self, done) -> None:
        deadline = time.monotonic() + TIMEOUT
        while not done():
            assert time.monotonic() < deadline, self.heard
            assert self.process.poll() is None, self.process.communicate()
            self.executor.spin_once(timeout_sec=0.02)

    def move(self, angle: float, wait: bool = True) -> None:
        before = self.heard[f"{NODE}/joint_load"]
        message = JointState(name=["pitch", "orientation"], position=[0.0, angle])
        message.header.stamp = self.node.get_clock().now().to_msg()
        self.publisher.publish(message)
        if wait:
            self.wait(lambda: self.heard[f"{NODE}/joint_load"] > before)

    def call(self, kind, name: str, request) -> object:
        client = self.node.create_client(kind, name)
        self.wait(client.service_is_ready)
        future = client.call_async(request)
        self.wait(future.done)
        return future.result()

    def stop(self) -> None:
        for _ in range(20):  # what is still on its way
            self.executor.spin_once(timeout_sec=0.02)
        self.process.send_signal(signal.SIGINT)
        output, _ = self.process.communicate(timeout=TIMEOUT)
        assert self.process.returncode == 0, output

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.communicate()
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run with a cold start on the way, another tolerance, and joint states in a burst."""
    path = tmp_path_factory.mktemp("node") / "run.mcap"
    robot = Robot(str(path))
    try:
        for i in range(60):
            robot.move(1.2 * math.sin(0.1 * i))
        assert robot.call(Trigger, f"{NODE}/reset", Trigger.Request()).success
        for i in range(20):
            robot.move(0.7 + 0.01 * i)
        request = SetParameters.Request(parameters=[Parameter("tolerance", value=1e-7).to_parameter_msg()])
        assert robot.call(SetParameters, f"{NODE}/set_parameters", request).results[0].successful
        for i in range(300):
            robot.move(0.9 - 0.004 * i, wait=False)
        robot.move(-0.4)
        robot.stop()
    finally:
        robot.close()
    return path, robot.heard


@pytest.mark.parametrize("count", READERS)
def test_every_reader_counts_what_was_published(run, count):
    path, heard = run
    read = count(path)
    assert {topic: read[topic] for topic in PUBLISHED} == dict(heard)


def test_what_belongs_to_the_run_is_in_the_log(run):
    path, heard = run
    with LogReader(path) as log:
        assert log.topics[f"{NODE}/solved_joints"].count == heard[f"{CABLE}/end_wrench"] >= 81
        assert {"scene.yaml", "robot.urdf", "parameters.yaml"} <= set(log.attachments)
        assert log.metadata["cable_ros_log_end"] == {"dropped": "0"}


def test_the_run_is_solved_again_bit_for_bit(run, capsys):
    path, heard = run
    assert main(["replay", str(path), "--resolve"]) == 0
    printed = capsys.readouterr().out
    count = heard[f"{CABLE}/end_wrench"]
    assert f"camera_cable end: {count} of {count} wrenches bit for bit" in printed
    assert f"camera_cable start: {count} of {count} wrenches bit for bit" in printed
