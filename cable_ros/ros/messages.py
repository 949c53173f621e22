# SPDX-License-Identifier: Apache-2.0
"""The messages that the node sends at the rate of the joint states, as templates filled in place.

Building such a message field by field and having it serialised takes up to 900 us (a path of 101 poses);
filling a template takes 1 to 3 us, and the same bytes are published and logged. Stamps are nanoseconds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseStamped, TransformStamped, WrenchStamped
from nav_msgs.msg import Path
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from cable_ros.ros.cdr_template import Template
from cable_ros.scene.model import Mount

_NANO = 1_000_000_000


def set_stamp(template: Template, stamp: int) -> None:
    """Set every stamp of a template to `stamp` ns."""
    template.stamp(*divmod(stamp, _NANO))


class WrenchMessage:
    """`geometry_msgs/WrenchStamped` in one frame."""

    def __init__(self, frame_id: str) -> None:
        message = WrenchStamped()
        message.header.frame_id = frame_id
        self._template = Template(message)
        self._wrench = self._template.view("wrench.force.x", 6)

    def fill(self, stamp: int, wrench: np.ndarray) -> bytes:
        """Bytes with `wrench` (6,): force N, moment N m."""
        set_stamp(self._template, stamp)
        self._wrench[:] = wrench
        return self._template.to_bytes()


class PathMessage:
    """`nav_msgs/Path` of `count` poses in one frame."""

    def __init__(self, frame_id: str, count: int) -> None:
        message = Path()
        message.header.frame_id = frame_id
        for _ in range(count):
            pose = PoseStamped()
            pose.header.frame_id = frame_id
            message.poses.append(pose)
        self.count = count
        self._template = Template(message)
        self._poses = self._template.view("poses[{}].pose.position.x", 7, rows=count)

    def fill(self, stamp: int, points: np.ndarray, orientations: np.ndarray) -> bytes:
        """Bytes with `points` (count, 3) m and `orientations` (count, 4) as x y z w."""
        set_stamp(self._template, stamp)
        self._poses[:, :3] = points
        self._poses[:, 3:] = orientations
        return self._template.to_bytes()


class SolvedJointsMessage:
    """`sensor_msgs/JointState` with the joint values of one solve, for the log."""

    def __init__(self, names: Sequence[str]) -> None:
        self._template = Template(JointState(name=list(names), position=[0.0] * len(names)))
        self._positions = self._template.view("position[0]", len(names)) if names else np.empty(0)

    def fill(self, stamp: int, positions: np.ndarray) -> bytes:
        """Bytes with `positions` (n,) rad or m."""
        set_stamp(self._template, stamp)
        self._positions[:] = positions
        return self._template.to_bytes()


class JointLoadMessage:
    """`sensor_msgs/JointState` with the positions that were solved and the cables' torques as effort."""

    def __init__(self, names: Sequence[str]) -> None:
        count = len(names)
        message = JointState(name=list(names), position=[0.0] * count, effort=[0.0] * count)
        self._template = Template(message)
        self._positions = self._template.view("position[0]", count)
        self._efforts = self._template.view("effort[0]", count)

    def fill(self, stamp: int, positions: np.ndarray, efforts: np.ndarray) -> bytes:
        """Bytes with `positions` (n,) rad or m and `efforts` (n,) N m or N."""
        set_stamp(self._template, stamp)
        self._positions[:] = positions
        self._efforts[:] = efforts
        return self._template.to_bytes()


class JointStiffnessMessage:
    """`trajectory_msgs/JointTrajectory`: a point for each joint, how the effort on all changes with that one.

    `points[j].effort[i]`: derivative of the effort on joint i by joint j, in the order of `joint_names`.
    Positions stay empty: for a controller of trajectories this is no command.
    """

    def __init__(self, names: Sequence[str]) -> None:
        count = len(names)
        points = [JointTrajectoryPoint(effort=[0.0] * count) for _ in names]
        self._template = Template(JointTrajectory(joint_names=list(names), points=points))
        self._columns = [self._template.view(f"points[{j}].effort[0]", count) for j in range(count)]

    def fill(self, stamp: int, stiffness: np.ndarray) -> bytes:
        """Bytes with `stiffness` (n, n), effort (row) by joint (column), N m/rad for revolute joints."""
        set_stamp(self._template, stamp)
        for column, values in zip(self._columns, stiffness.T, strict=True):
            column[:] = values
        return self._template.to_bytes()


def diagnostic(
    name: str, level: bytes, message: str, values: Mapping[str, object], hardware_id: str
) -> DiagnosticStatus:
    """One entry of a diagnostics message; numbers are written with six digits."""
    entries = [
        KeyValue(key=key, value=f"{value:.6g}" if isinstance(value, float) else str(value))
        for key, value in values.items()
    ]
    return DiagnosticStatus(name=name, level=level, message=message, hardware_id=hardware_id, values=entries)


def diagnostics(stamp: int, statuses: Sequence[DiagnosticStatus]) -> DiagnosticArray:
    """The diagnostics message."""
    message = DiagnosticArray(status=list(statuses))
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, _NANO)
    return message


def clamp_transform(frame_id: str, parent: str, mount: Mount) -> TransformStamped:
    """Where a clamp's frame lies in that of its link, or of the world: constant."""
    message = TransformStamped(child_frame_id=frame_id)
    message.header.frame_id = parent
    translation, rotation = message.transform.translation, message.transform.rotation
    translation.x, translation.y, translation.z = (float(value) for value in mount.position)
    rotation.x, rotation.y, rotation.z, rotation.w = (float(value) for value in mount.orientation)
    return message
