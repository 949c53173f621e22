"""What a log of the node says over time: joints and end wrenches as arrays, polylines on demand."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cable_ros.log.errors import LogError
from cable_ros.log.reader import LogReader

JOINT_STATE = "sensor_msgs/msg/JointState"
WRENCH = "geometry_msgs/msg/WrenchStamped"
PATH = "nav_msgs/msg/Path"
MOST_SAMPLES = 20_000
"""Of a topic; a longer log is thinned out evenly, no picture shows more."""


@dataclass(frozen=True)
class Trace:
    """Samples over time: `times` (m,) log times in ns, ascending, and `values` (m, k)."""

    times: np.ndarray
    values: np.ndarray

    def at(self, times: np.ndarray) -> np.ndarray:
        """(n, k) the last values at or before each of the (n,) times; the first ones before that."""
        return self.values[np.maximum(np.searchsorted(self.times, times, side="right") - 1, 0)]


@dataclass(frozen=True)
class History:
    """The run that a log holds."""

    joint_names: tuple[str, ...]
    joints: Trace
    """The last known position of every joint, rad or m; NaN before it is first heard of."""
    end_wrenches: dict[str, Trace]
    """By cable: force [N] and moment [N m] on the body at the end clamp, in its frame."""
    polyline_times: dict[str, np.ndarray]
    """By cable: (m,) log times of its polylines, ns."""


def read_history(path: str | Path) -> History:
    """Read joints and end wrenches of all cables.

    Raises:
        LogError: the log cannot be read, or holds no cable's end wrench.
    """
    with LogReader(path) as reader:
        wrenches = {_cable(name): name for name in _topics(reader, WRENCH, "end_wrench")}
        if not wrenches:
            raise LogError(f"{path} holds no end wrench of a cable; log a run in which the node answers.")
        names, joints = _joints(reader, {name.rsplit("/", 2)[0] for name in wrenches.values()})
        paths = {_cable(name): name for name in _topics(reader, PATH, "polyline")}
        times = {
            cable: np.array([message.log_time for message in reader.messages([topic])])
            for cable, topic in paths.items()
        }
        return History(
            names, joints, {cable: _wrenches(reader, name) for cable, name in wrenches.items()}, times
        )


def read_polyline(path: str | Path, cable: str, time: int) -> np.ndarray:
    """(n, 3) points of the cable's polyline with this log time, ns; world frame, m.

    Raises:
        LogError: the log cannot be read, or has no such polyline.
    """
    with LogReader(path) as reader:
        topics = [name for name in _topics(reader, PATH, "polyline") if _cable(name) == cable]
        for _, message in reader.decoded(topics, time, time + 1):
            positions = (pose.pose.position for pose in message.poses)
            return np.array([[point.x, point.y, point.z] for point in positions])
    raise LogError(f"{path} holds no polyline of {cable} at {time} ns.")


def _topics(reader: LogReader, type_name: str, last: str) -> list[str]:
    return [
        topic.name
        for topic in reader.topics.values()
        if topic.type_name == type_name and topic.name.endswith(f"/{last}") and topic.count
    ]


def _cable(topic: str) -> str:
    return topic.split("/")[-2]


def _joints(reader: LogReader, nodes: set[str]) -> tuple[tuple[str, ...], Trace]:
    topics = [
        topic.name
        for topic in reader.topics.values()
        # The node's own topics of this type, such as the joint load, are answers.
        if topic.type_name == JOINT_STATE and topic.name.rpartition("/")[0] not in nodes
    ]
    known: dict[str, float] = {}
    times, rows = [], []
    stride = _stride(reader, topics)
    for index, (logged, message) in enumerate(reader.decoded(topics)):
        known.update(zip(message.name, message.position, strict=False))
        if index % stride == 0:
            times.append(logged.log_time)
            rows.append(dict(known))
    values = np.array([[row.get(name, np.nan) for name in known] for row in rows]).reshape(
        len(rows), len(known)
    )
    return tuple(known), Trace(np.array(times, dtype=np.int64), values)


def _wrenches(reader: LogReader, topic: str) -> Trace:
    times, rows = [], []
    stride = _stride(reader, [topic])
    for index, (logged, message) in enumerate(reader.decoded([topic])):
        if index % stride == 0:
            force, torque = message.wrench.force, message.wrench.torque
            times.append(logged.log_time)
            rows.append([force.x, force.y, force.z, torque.x, torque.y, torque.z])
    return Trace(np.array(times, dtype=np.int64), np.array(rows).reshape(len(rows), 6))


def _stride(reader: LogReader, topics: list[str]) -> int:
    return 1 + sum(reader.topics[name].count for name in topics) // MOST_SAMPLES
