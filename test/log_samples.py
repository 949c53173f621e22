# SPDX-License-Identifier: Apache-2.0
"""Messages for logs, serialised by a library that is not ours."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="rosbags is not on this machine")

from rosbags.typesys import Stores, get_typestore

from cable_ros.log.writer import LogWriter

JOINTS = "/joint_states"
WRENCH = "/cable_node/camera_cable/end_wrench"
JOINT_STATE = "sensor_msgs/msg/JointState"
WRENCH_STAMPED = "geometry_msgs/msg/WrenchStamped"
START = 1_700_000_000_000_000_000  # ns
PERIOD = 1_000_000  # ns: joint states at 1 kHz

SENSOR_QOS = """\
- history: keep_last
  depth: 5
  reliability: best_effort
  durability: volatile
  deadline: {sec: 9223372036, nsec: 854775807}
  lifespan: {sec: 9223372036, nsec: 854775807}
  liveliness: automatic
  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}
  avoid_ros_namespace_conventions: false
"""

_store = get_typestore(Stores.ROS2_JAZZY)


def joint_state(angle: float, stamp: int = 0, *, rates: bool = False) -> bytes:
    """CDR of a JointState of two joints; with empty velocity and effort unless `rates`."""
    types = _store.types
    more = np.full(2, 0.5) if rates else np.zeros(0)
    message = types[JOINT_STATE](
        types["std_msgs/msg/Header"](
            types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9), "base"
        ),
        ["orientation", "pitch"],
        np.array([angle, 0.0]),
        more,
        more,
    )
    return bytes(_store.serialize_cdr(message, JOINT_STATE))


def wrench(values: list[float], stamp: int = 0) -> bytes:
    """CDR of a WrenchStamped of six numbers."""
    types = _store.types
    vector = types["geometry_msgs/msg/Vector3"]
    message = types[WRENCH_STAMPED](
        types["std_msgs/msg/Header"](
            types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9), "camera_cable_end"
        ),
        types["geometry_msgs/msg/Wrench"](vector(*values[:3]), vector(*values[3:])),
    )
    return bytes(_store.serialize_cdr(message, WRENCH_STAMPED))


def fill(log: LogWriter, count: int, first: int = 0) -> None:
    """`count` joint states, each with a wrench, 1 ms apart in log time."""
    for i in range(first, first + count):
        time = START + i * PERIOD
        assert log.write(JOINTS, JOINT_STATE, joint_state(1e-3 * i, time), time, time - 1000)
        assert log.write(WRENCH, WRENCH_STAMPED, wrench([i, 0.1, -i, 1.0, 2.0, 0.5 * i], time), time)
