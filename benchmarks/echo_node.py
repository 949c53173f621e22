# SPDX-License-Identifier: Apache-2.0
"""A node that answers every JointState with a WrenchStamped and solves nothing: the yardstick for latency."""

from __future__ import annotations

import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState

from cable_ros.ros.lifetime import Lifetime


class EchoNode(Node):
    """Written as a tutorial would have it."""

    def __init__(self) -> None:
        super().__init__("echo_node")
        self._publisher = self.create_publisher(WrenchStamped, "~/wrench", 10)
        self.create_subscription(JointState, "joint_states", self._answer, qos_profile_sensor_data)

    def _answer(self, state: JointState) -> None:
        message = WrenchStamped()
        message.header.stamp = state.header.stamp
        message.header.frame_id = "echo"
        message.wrench.force.x = state.position[0]
        self._publisher.publish(message)


def main() -> None:
    """Run until a signal."""
    with Lifetime():
        rclpy.init()
        rclpy.spin(EchoNode())


if __name__ == "__main__":
    main()
