# SPDX-License-Identifier: Apache-2.0
"""Ask a cable_node that has just been started, and say what it answers and what its start has cost.

python .ci/ask_node.py PID
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import JointState

PATIENCE = 600.0
"""s; a first start that compiles takes minutes."""


def main() -> int:
    process = Path("/proc", sys.argv[1])
    begin = time.perf_counter()
    rclpy.init()
    client = rclpy.create_node("ask_node")
    wrenches: list[Any] = []
    statuses: list[Any] = []
    client.create_subscription(WrenchStamped, "/cable_node/camera_cable/end_wrench", wrenches.append, 10)
    client.create_subscription(DiagnosticArray, "/cable_node/status", statuses.append, 10)
    publisher = client.create_publisher(JointState, "joint_states", 10)
    while not (wrenches and statuses) and time.perf_counter() - begin < PATIENCE and process.exists():
        message = JointState(name=["pitch", "orientation"], position=[0.0, 0.5])
        message.header.stamp = client.get_clock().now().to_msg()
        publisher.publish(message)
        rclpy.spin_once(client, timeout_sec=0.02)
    if not (wrenches and statuses):
        print("the node has not answered")
        return 1
    fields = (process / "stat").read_text().rsplit(")", 1)[1].split()
    cpu = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    force = wrenches[0].wrench.force
    print(f"end wrench in {wrenches[0].header.frame_id}: force {force.x:.4f} {force.y:.4f} {force.z:.4f} N")
    print("status:", ", ".join(f"{one.key} {one.value}" for one in statuses[0].status[0].values))
    wall = time.perf_counter() - begin
    print(f"first wrench after {cpu:.2f} s of the node's CPU time, {wall:.1f} s of wall time")
    client.destroy_node()
    rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
