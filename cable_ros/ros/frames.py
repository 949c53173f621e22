# SPDX-License-Identifier: Apache-2.0
"""The constant transforms of the clamps on /tf_static."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from geometry_msgs.msg import TransformStamped

from cable_ros.ros.cable_outputs import LATCHED
from cable_ros.ros.cdr_template import serialise
from cable_ros.ros.recorder import Outlet

if TYPE_CHECKING:
    from rclpy.node import Node

TOPIC = "/tf_static"
TYPE = "tf2_msgs/msg/TFMessage"


@dataclass
class _TFMessage:
    """Stands in for `tf2_msgs/msg/TFMessage`, which the ROS wheels lack; its CDR is the same."""

    transforms: Sequence[TransformStamped]

    def get_fields_and_field_types(self) -> dict[str, str]:
        return {"transforms": "sequence<geometry_msgs/TransformStamped>"}


def tf_static(transforms: Sequence[TransformStamped]) -> bytes:
    """The CDR bytes of a message for /tf_static."""
    return serialise(_TFMessage(transforms))


def tf_static_outlet(node: Node) -> Outlet:
    """/tf_static; without a publisher, so only for the log, where tf2_msgs is not installed."""
    try:
        from tf2_msgs.msg import TFMessage
    except ImportError:
        return Outlet(TOPIC, TYPE, LATCHED, None)
    return Outlet.create(node, TFMessage, TOPIC, LATCHED)
