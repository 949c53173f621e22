# SPDX-License-Identifier: Apache-2.0
"""The node's own topics: those that belong to no cable."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory
from visualization_msgs.msg import MarkerArray

from cable_ros.log import events
from cable_ros.ros.cable_outputs import LATCHED, STREAM
from cable_ros.ros.frames import tf_static_outlet
from cable_ros.ros.recorder import Outlet, type_name

if TYPE_CHECKING:
    from rclpy.node import Node

# As everywhere in ROS, other names are given by remapping.
JOINT_STATES = "joint_states"
# Best effort: a lost state is not sent again, a newer one is better. The queue is emptied at every turn.
JOINT_STATES_QOS = QoSProfile(depth=16, reliability=ReliabilityPolicy.BEST_EFFORT)
_DIAGNOSTICS = QoSProfile(depth=10)
_MARKERS = QoSProfile(depth=50)


@dataclass(frozen=True)
class NodeOutlets:
    """Outlets of the node; the first two are only logged."""

    joint_states: Outlet
    """As received."""
    solved_joints: Outlet
    """The joint values that were solved."""
    diagnostics: Outlet
    joint_load: Outlet
    joint_stiffness: Outlet
    status: Outlet
    markers: Outlet
    scene: Outlet
    tf_static: Outlet

    @classmethod
    def create(cls, node: Node) -> NodeOutlets:
        """Advertise the topics."""
        received, solved = (
            node.resolve_topic_name(name) for name in (JOINT_STATES, f"~/{events.SOLVED_JOINTS}")
        )
        return cls(
            joint_states=Outlet(received, type_name(JointState), JOINT_STATES_QOS, None, exact=False),
            solved_joints=Outlet(solved, type_name(JointState), STREAM, None),
            diagnostics=Outlet.create(node, DiagnosticArray, "/diagnostics", _DIAGNOSTICS),
            joint_load=Outlet.create(node, JointState, "~/joint_load", STREAM),
            joint_stiffness=Outlet.create(node, JointTrajectory, "~/joint_stiffness", STREAM),
            status=Outlet.create(node, DiagnosticArray, "~/status", STREAM),
            markers=Outlet.create(node, MarkerArray, "~/markers", _MARKERS),
            scene=Outlet.create(node, String, "~/scene", LATCHED),
            tf_static=tf_static_outlet(node),
        )

    @property
    def streams(self) -> tuple[Outlet, ...]:
        """Those whose messages follow the joint states; a log lists the latched ones by itself."""
        return (self.joint_states, self.solved_joints, self.diagnostics, self.joint_load,
                self.joint_stiffness, self.status, self.markers)  # fmt: skip
