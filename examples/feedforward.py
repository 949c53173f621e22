# SPDX-License-Identifier: Apache-2.0
"""Feed-forward against the cable: what `cable_node` says that the cable does to each joint, taken off again.

    python3 examples/feedforward.py --ros-args -p joints:="['orientation']"

Publishes the effort of each of `joints`, N m, on `effort_controller/commands` (`std_msgs/Float64MultiArray`),
as the effort controllers of ros2_control take it; a robot with a position controller adds it to what that one
wants. It needs rclpy and nothing of cable_ros: it may as well be part of a controller.

While the status is not trusted, or old, or there is none, the feed-forward goes to zero along a ramp, from
the last load that was trusted; and along a ramp it comes back.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

# Best effort, one: a lost message is not worth waiting for, the next one is better.
NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


class FeedForward:
    """Effort to add at each joint, from what was heard and when it was true. Times in seconds.

    Args:
        joints: those that are compensated, in the order of the command.
        timeout: age, by its stamp, up to which an answer is used.
        ramp: time from full feed-forward to none, and back.
    """

    def __init__(self, joints: Sequence[str], timeout: float, ramp: float) -> None:
        self.joints = tuple(joints)
        self.timeout = timeout
        self.ramp = ramp
        self.share = 0.0
        """Of the load that is taken off, from 0 to 1."""
        self._load = dict.fromkeys(self.joints, 0.0)
        self._load_time = self._trusted_time = -math.inf

    def take_load(self, time: float, load: Mapping[str, float]) -> None:
        """What the cables exert on the joints at that time; it is only published if it can be trusted."""
        self._load = {joint: load.get(joint, 0.0) for joint in self.joints}
        self._load_time = time

    def take_status(self, time: float, trusted: bool) -> None:
        """Whether all cables could be trusted at that time."""
        self._trusted_time = time if trusted else -math.inf

    def usable(self, now: float) -> bool:
        """Whether load and status are trusted and recent; one of the future is of a clock set back."""
        return all(abs(now - time) <= self.timeout for time in (self._load_time, self._trusted_time))

    def command(self, now: float, step: float) -> list[float]:
        """Effort of each joint, `step` seconds after the last call."""
        change = step / self.ramp
        self.share += max(-change, min(change, float(self.usable(now)) - self.share))
        return [-self.share * self._load[joint] for joint in self.joints]


class FeedForwardNode(Node):
    """Hears `cable_node`, relative to its own namespace, and publishes the command at a fixed rate."""

    def __init__(self) -> None:
        super().__init__("feedforward")
        joints = self.declare_parameter("joints", ["orientation"]).value
        timeout = self.declare_parameter("timeout", 0.1).value
        ramp = self.declare_parameter("ramp", 0.5).value
        rate = self.declare_parameter("rate", 200.0).value
        self._logic = FeedForward(joints, timeout, ramp)
        self._longest_step = 2 / rate  # after a stall of this process the ramp goes on where it was
        self._last = self._now()
        self._was_usable = True
        self._commands = self.create_publisher(Float64MultiArray, "effort_controller/commands", 1)
        self.create_subscription(JointState, "cable_node/joint_load", self._on_load, NEWEST)
        self.create_subscription(DiagnosticArray, "cable_node/status", self._on_status, NEWEST)
        self.create_timer(1 / rate, self._on_timer)

    def _now(self) -> float:
        return self.get_clock().now().nanoseconds * 1e-9

    def _on_load(self, message: JointState) -> None:
        load = dict(zip(message.name, message.effort, strict=True))
        self._logic.take_load(_seconds(message.header.stamp), load)

    def _on_status(self, message: DiagnosticArray) -> None:
        # The key "trusted" is always the third one; see docs/ros.md.
        trusted = all(cable.values[2].value == "true" for cable in message.status)
        self._logic.take_status(_seconds(message.header.stamp), trusted)

    def _on_timer(self) -> None:
        now = self._now()
        step, self._last = min(max(now - self._last, 0.0), self._longest_step), now
        self._commands.publish(Float64MultiArray(data=self._logic.command(now, step)))
        usable = self._logic.usable(now)
        if usable != self._was_usable:
            text = "on again" if usable else "fading out: the cable's status is not trusted, old or missing"
            self.get_logger().warning(f"Feed-forward {text}.")
        self._was_usable = usable


def _seconds(stamp: object) -> float:
    return stamp.sec + stamp.nanosec * 1e-9


def main() -> None:
    """Run until SIGINT or SIGTERM; what drives the joint must see to it that an old command fades, too."""
    try:
        rclpy.init()
        rclpy.spin(FeedForwardNode())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass


if __name__ == "__main__":
    main()
