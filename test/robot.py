# SPDX-License-Identifier: Apache-2.0
"""The other side of the node in tests: starts it in a process of its own, moves joints, hears the answers."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from cable_ros.ros.replay_node import message_class
from cable_ros.share import share_file

TIMEOUT = 90.0  # s; a first start compiles
LEAVES = 0.2
"""s in which the middleware hears that the node has left: in taking down a participant while another one
leaves, Fast DDS has ended in a segmentation fault."""
WITHOUT_SHARED_MEMORY = "FASTDDS_BUILTIN_TRANSPORTS", "UDPv4"
"""For tests that kill a node: what it had locked there stays locked, and whoever it talked to may hang."""
NODE = "/cable_node"
CABLE = f"{NODE}/camera_cable"
PUBLISHED = {
    f"{CABLE}/end_wrench": "geometry_msgs/msg/WrenchStamped",
    f"{CABLE}/start_wrench": "geometry_msgs/msg/WrenchStamped",
    f"{CABLE}/polyline": "nav_msgs/msg/Path",
    f"{NODE}/joint_load": "sensor_msgs/msg/JointState",
}


def end(process: subprocess.Popen[str]) -> None:
    """Ask a node to end, and wait for it: see `WITHOUT_SHARED_MEMORY`."""
    process.terminate()
    try:
        process.communicate(timeout=30.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()


class Robot:
    """The space arm with a cable_node that has these parameters. Use as a context manager."""

    timeout = TIMEOUT

    def __init__(self, **parameters: object) -> None:
        command = [sys.executable, "-m", "cable_ros.ros.cable_node", "--ros-args"]
        values = {"scene": share_file("config", "space_arm.yaml"), **parameters}
        for name, value in values.items():
            command += ["-p", f"{name.replace('__', '.')}:={value}"]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        self.context = Context()
        rclpy.init(context=self.context)
        self.node = Node("robot", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.publisher = self._new_publisher()
        self.heard: Counter[str] = Counter()
        """By topic of PUBLISHED, the messages that arrived; being best effort, some may be lost."""
        self.published: dict[str, int] = {}
        """How many the node had published, by the number that came with the last one."""
        self.diagnostics: dict[str, DiagnosticStatus] = {}
        """The latest entry of each name, such as 'cable_node: log'."""
        for topic, kind in PUBLISHED.items():
            self.node.create_subscription(
                message_class(kind), topic, self._counter(topic), QoSProfile(depth=1000), raw=True
            )
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._take_diagnostics, 10)
        try:
            self.wait_for_node()
        except BaseException:  # a node that is left over would answer the next test
            self.close()
            raise

    def __enter__(self) -> Robot:
        return self

    def wait_for_node(self) -> None:
        """Until the node hears us, and we hear it."""
        self.wait(lambda: all(map(self.node.count_publishers, PUBLISHED)))
        # Now and then the middleware misses an announcement; another publisher is announced anew.
        self.wait(lambda: self.publisher.get_subscription_count() > 0, self._advertise_again, 10.0)
        # We see the node's subscription before it sees our publisher, and it is best effort.
        for _ in range(25):
            self.executor.spin_once(timeout_sec=0.02)

    def __exit__(self, *exc_info: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave nothing behind, not even a node that does not end."""
        end(self.process)
        time.sleep(LEAVES)
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()

    def _new_publisher(self) -> Publisher:
        return self.node.create_publisher(JointState, "/joint_states", QoSProfile(depth=100))

    def _advertise_again(self) -> None:
        self.node.destroy_publisher(self.publisher)
        self.publisher = self._new_publisher()

    def _counter(self, topic: str) -> Callable[[bytes, dict[str, Any]], None]:
        def count(_: bytes, info: dict[str, Any]) -> None:
            self.heard[topic] += 1
            self.published[topic] = info["publication_sequence_number"]

        return count

    def _take_diagnostics(self, message: DiagnosticArray) -> None:
        self.diagnostics |= {status.name: status for status in message.status}

    def wait(
        self, done: Callable[[], bool], meanwhile: Callable[[], None] = lambda: None, every: float = 2.0
    ) -> None:
        """Spin until `done()`, with `meanwhile()` now and then; fails if it takes long or the node dies."""
        deadline = time.monotonic() + self.timeout
        due = time.monotonic() + every
        while not done():
            assert time.monotonic() < deadline, (self.heard, self.diagnostics)
            assert self.process.poll() is None, self.process.communicate()
            self.executor.spin_once(timeout_sec=0.02)
            if time.monotonic() > due:
                due += every
                meanwhile()

    def move(self, angle: float, wait: bool = True) -> None:
        """Publish one joint state; and wait for the last of what answers it."""
        before = self.heard[f"{NODE}/joint_load"]
        message = JointState(name=["pitch", "orientation"], position=[0.0, angle])
        message.header.stamp = self.node.get_clock().now().to_msg()
        self.publisher.publish(message)
        if wait:  # on a busy machine the very first may still be lost
            again = self.publisher.publish if not before else lambda _: None
            self.wait(lambda: self.heard[f"{NODE}/joint_load"] > before, lambda: again(message))

    def call(self, kind: Any, name: str, request: Any) -> Any:
        """The answer of a service."""
        client = self.node.create_client(kind, name)
        self.wait(client.service_is_ready)
        future = client.call_async(request)
        self.wait(future.done)
        return future.result()

    def trigger(self, name: str) -> Trigger.Response:
        """The answer of one of the node's own services."""
        return self.call(Trigger, f"{NODE}/{name}", Trigger.Request())

    def set_parameter(self, name: str, value: object) -> None:
        """Set a parameter of the node, which must take it."""
        request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
        assert self.call(SetParameters, f"{NODE}/set_parameters", request).results[0].successful

    def stop(self) -> str:
        """Interrupt the node, which must end cleanly; returns what it printed."""
        heard = -1
        while heard != sum(self.heard.values()):  # what is still on its way
            heard = sum(self.heard.values())
            for _ in range(25):
                self.executor.spin_once(timeout_sec=0.02)
        self.process.send_signal(signal.SIGINT)
        output, _ = self.process.communicate(timeout=TIMEOUT)
        assert self.process.returncode == 0, output
        return output
