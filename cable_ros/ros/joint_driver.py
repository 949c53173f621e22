# SPDX-License-Identifier: Apache-2.0
"""Plays the robot: publishes joint states and waits for what the cable node answers."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import JointState

_SETTLE = 0.5  # s
_FIRST_ANSWER = 2.0  # s; a first equilibrium takes some ms


class NoAnswerError(Exception):
    """The cable node is not there or does not answer; the text is one sentence that says more."""


class JointDriver:
    """One node that publishes `joint_states` and subscribes to each cable's end wrench.

    Args:
        cables: names of the cables that are expected to answer.
        node_name: fully qualified name of the cable node.
        check: called while waiting; raises what is to end the waiting, such as that the node has died.

    Use as a context manager. The ROS domain is the environment's.
    """

    def __init__(
        self, cables: Sequence[str], node_name: str = "/cable_node", check: Callable[[], None] = lambda: None
    ) -> None:
        self._check = check
        self._node_name = node_name
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self._node = rclpy.create_node("joint_driver", context=self._context, enable_rosout=False)
        self._executor = rclpy.executors.SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._publisher = self._node.create_publisher(JointState, "/joint_states", QoSProfile(depth=10))
        self._answers: dict[str, WrenchStamped] = {}
        self._complaint = ""
        self._topics = {cable: f"{node_name}/{cable}/end_wrench" for cable in cables}
        for cable, topic in self._topics.items():
            self._node.create_subscription(WrenchStamped, topic, self._taker(cable), qos_profile_sensor_data)
        self._node.create_subscription(DiagnosticArray, "/diagnostics", self._take_diagnostics, 10)

    def __enter__(self) -> JointDriver:
        return self

    def __exit__(self, *exc_info: object) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def wait_for_node(self, timeout: float) -> None:
        """Return once the node listens to joint states and offers every cable's wrench.

        Raises:
            NoAnswerError: it does not within `timeout` seconds.
        """

        def ready() -> bool:
            heard = self._publisher.get_subscription_count() > 0
            return heard and all(self._node.count_publishers(topic) for topic in self._topics.values())

        if not self._spin_until(ready, timeout):
            raise NoAnswerError(f"the node {self._node_name} did not come up within {timeout:.0f} s")
        # We see the node's subscription before it sees our publisher, and it is best effort.
        self._spin_until(lambda: False, _SETTLE)

    def send(self, joints: Mapping[str, float], timeout: float) -> dict[str, np.ndarray]:
        """Publish one joint state and return the wrenches (6,) that answer it, by cable.

        Raises:
            NoAnswerError: a cable has not answered within `timeout` seconds.
        """
        message = JointState(name=list(joints), position=[float(value) for value in joints.values()])
        message.header.stamp = self._node.get_clock().now().to_msg()

        def answered() -> bool:
            return all(
                cable in self._answers and self._answers[cable].header.stamp == message.header.stamp
                for cable in self._topics
            )

        # On a busy machine the very first joint state may still be lost.
        tries = 1 if self._answers else max(1, int(timeout / _FIRST_ANSWER))
        for _ in range(tries):
            self._publisher.publish(message)
            if self._spin_until(answered, timeout / tries):
                return {cable: _wrench(self._answers[cable]) for cable in self._topics}
        pose = ", ".join(f"{name} = {value:.4g}" for name, value in joints.items())
        reason = f"; it reports: {self._complaint}" if self._complaint else ""
        raise NoAnswerError(f"{self._node_name} did not answer {pose} within {timeout:.0f} s{reason}")

    def _spin_until(self, done: Callable[[], bool], timeout: float) -> bool:
        deadline = time.monotonic() + timeout
        while not done():
            self._check()
            if time.monotonic() > deadline:
                return False
            self._executor.spin_once(timeout_sec=0.05)
        return True

    def _taker(self, cable: str) -> Callable[[WrenchStamped], None]:
        def take(message: WrenchStamped) -> None:
            self._answers[cable] = message

        return take

    def _take_diagnostics(self, message: DiagnosticArray) -> None:
        bad = [status.message for status in message.status if status.level != DiagnosticStatus.OK]
        self._complaint = bad[0] if bad else ""


def _wrench(message: WrenchStamped) -> np.ndarray:
    force, torque = message.wrench.force, message.wrench.torque
    return np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z])
