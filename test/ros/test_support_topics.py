# SPDX-License-Identifier: Apache-2.0
"""The wrenches at a cable's supports in messages, read by rclpy."""

from __future__ import annotations

import copy

import numpy as np
import pytest

pytest.importorskip("rclpy")

import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.serialization import deserialize_message

from cable_ros import Tracker
from cable_ros.ros.cable_outputs import CableOutputs
from cable_ros.ros.frame_names import Frames

SCENE = {
    "gravity": [0.0, 0.0, -9.81],
    "cables": [
        {
            "name": "hose",
            "length": 1.0,
            "stiffness": [0.02, 0.02, 0.015],
            "linear_density": 0.2,
            "start": {"position": [0.0, 0.0, 0.0], "rpy": [0.0, 1.5708, 0.0]},
            "end": {"position": [0.85, 0.1, 0.1], "rpy": [0.0, 1.5708, 0.0]},
            "supports": [
                {
                    "name": "wrist",
                    "clip": {"arc_length": 0.45, "position": [0.4, 0.0, 0.05], "rpy": [0.0, 1.2, 0.0]},
                }
            ],
        }
    ],
}


RING = {"arc_length": 0.45, "position": [0.4, 0.0, 0.05], "friction": 0.1}


@pytest.mark.parametrize("kind", ["clip", "ring"])
def test_each_support_has_a_topic_and_a_frame(kind):
    scene = copy.deepcopy(SCENE)
    if kind == "ring":
        scene["cables"][0]["supports"] = [{"name": "wrist", "ring": RING}]
    tracker = Tracker(scene)
    found = tracker.solve({})["hose"]
    rclpy.init()
    try:
        node = rclpy.create_node("clips")
        outputs = CableOutputs(node, tracker.scene.cables[0], Frames("left_", "world"), 2)
        sent = {outlet.topic: data for outlet, data in outputs.wrenches(1_500_000_000, found)}
        frames = [one.child_frame_id for one in outputs.transforms()]
        node.destroy_node()
    finally:
        rclpy.shutdown()
    (topic,) = [name for name in sent if name.endswith("/hose/wrist_wrench")]
    message = deserialize_message(sent[topic], WrenchStamped)
    assert message.header.frame_id == "left_hose_wrist"
    assert "left_hose_wrist" in frames
    force, torque = message.wrench.force, message.wrench.torque
    values = [force.x, force.y, force.z, torque.x, torque.y, torque.z]
    np.testing.assert_array_equal(values, found.support_wrenches["wrist"])
