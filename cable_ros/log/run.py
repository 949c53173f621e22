# SPDX-License-Identifier: Apache-2.0
"""What a log says a tracker did: every solve with its wrenches, and what changed the tracker between."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cable_ros.log.errors import LogError
from cable_ros.log.events import EVENTS, SOLVED_JOINTS, STRING, decode_event
from cable_ros.log.joint_state_cdr import JOINT_STATE
from cable_ros.log.reader import LoggedMessage, LoggedTopic, LogReader

WRENCH = "geometry_msgs/msg/WrenchStamped"
PATH = "nav_msgs/msg/Path"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
CLAMPS = ("end", "start")
_TOPIC = re.compile(r"(?:\w*/)+\w+", re.ASCII)


@dataclass
class Solve:
    """One `Tracker.solve` of the node."""

    log_time: int
    """ns."""
    stamp: int
    """Of the joint state, ns."""
    joints: dict[str, float]
    """What was solved, rad or m."""
    wrenches: dict[tuple[str, str], np.ndarray] = field(default_factory=dict)
    """By cable and clamp ('end', 'start'), those that were published: (6,) N and N m."""
    polylines: list[str] = field(default_factory=list)
    """Cables whose polyline was logged."""


@dataclass(frozen=True)
class Event:
    """Something that changed the tracker, as `cable_ros.log.events` names it."""

    log_time: int
    kind: str
    values: dict[str, Any]


@dataclass(frozen=True)
class Gap:
    """So many solves were dropped from the log here."""

    log_time: int
    count: int


class LoggedRun:
    """The files of one run, in order of time.

    `exact`: the log holds what was solved (topic `~/solved_joints`); otherwise the joint states as they were
    received stand for it, merged by name, one solve for each.

    Raises: LogError where the log holds no wrench or no joints.
    """

    def __init__(self, logs: Sequence[LogReader]) -> None:
        self.logs = sorted(logs, key=lambda log: log.start)
        topics: dict[str, LoggedTopic] = {}
        for log in self.logs:
            topics.update(log.topics)
        self.name = str(self.logs[0].path)
        self._wrenches = {
            topic: (topic.split("/")[-2], clamp)
            for topic in _named(topics, WRENCH, "end_wrench", "start_wrench")
            for clamp in CLAMPS
            if topic.endswith(f"/{clamp}_wrench")
        }
        if not self._wrenches:
            raise LogError(f"{self.name} holds no wrench of a cable; give a log in which the node answered.")
        self._polylines = {topic: topic.split("/")[-2] for topic in _named(topics, PATH, "polyline")}
        self._events = set(_named(topics, STRING, EVENTS))
        solved = _named(topics, JOINT_STATE, SOLVED_JOINTS)
        self.exact = bool(solved)
        self._joints = set(solved) or {
            topic.name
            for topic in topics.values()
            if topic.type_name == JOINT_STATE and not topic.name.endswith("/joint_load")
        }
        if not self._joints:
            raise LogError(f"{self.name} holds no joint states; record them with the wrenches.")

    @property
    def count(self) -> int:
        """Joint states: at least as many as solves."""
        return sum(log.topics[name].count for log in self.logs for name in self._joints if name in log.topics)

    def __iter__(self) -> Iterator[Solve | Event | Gap]:
        """In the order in which they happened; a Solve comes when its wrenches are complete."""
        current: Solve | None = None
        known: dict[str, float] = {}
        wanted = [*self._joints, *self._events, *self._wrenches]
        next_number = 0
        for log in self.logs:
            topics = [name for name in [*wanted, *self._polylines] if name in log.topics]
            for logged, message in log.decoded(topics, as_written=True, raw=tuple(self._polylines)):
                if logged.topic in self._wrenches:
                    if current is not None:
                        current.wrenches[self._wrenches[logged.topic]] = _read(_wrench, logged, message)
                elif logged.topic in self._polylines:
                    if current is not None:
                        current.polylines.append(self._polylines[logged.topic])
                elif logged.topic in self._events:
                    if current is not None:
                        yield current
                        current = None
                    values = decode_event(str(getattr(message, "data", "")))
                    yield Event(logged.log_time, str(values.pop("event", "")), values)
                else:
                    if current is not None:
                        yield current
                    if self.exact and logged.sequence > next_number > 0:
                        yield Gap(logged.log_time, logged.sequence - next_number)
                    next_number = logged.sequence + 1
                    joints, stamp = _read(_joint_state, logged, message)
                    known.update(joints)
                    current = Solve(logged.log_time, stamp, dict(known))
        if current is not None:
            yield current


def _wrench(message: Any) -> np.ndarray:
    force, torque = message.wrench.force, message.wrench.torque
    return np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z], dtype=float)


def _joint_state(message: Any) -> tuple[dict[str, float], int]:
    # Names and positions of a malformed joint state may differ in number.
    joints = dict(zip(map(str, message.name), map(float, message.position), strict=False))
    return joints, int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)


def _read(how: Callable[[Any], Any], logged: LoggedMessage, message: Any) -> Any:
    """What `how` takes out of a message. Raises LogError where the log's schema has given it other fields."""
    try:
        return how(message)
    except (AttributeError, TypeError, ValueError, OverflowError) as error:
        raise LogError(
            f"A message of {logged.topic} has not the fields of a {logged.type_name} ({error}); leave it out."
        ) from None


def _named(topics: dict[str, LoggedTopic], type_name: str, *last: str) -> list[str]:
    """Topics of this type with messages whose names end so; those that ROS cannot have are nobody's."""
    return [
        topic.name
        for topic in topics.values()
        if topic.type_name == type_name
        and topic.count
        and topic.name.rpartition("/")[2] in last
        and _TOPIC.fullmatch(topic.name)
    ]
