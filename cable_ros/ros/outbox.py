# SPDX-License-Identifier: Apache-2.0
"""Everything that leaves the node: published at once, and the same bytes logged when all is out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import rclpy.logging

from cable_ros.log import events
from cable_ros.log.host import host_facts
from cable_ros.ros.cable_outputs import STREAM
from cable_ros.ros.recorder import Outlet, Recorder

if TYPE_CHECKING:
    from rclpy.node import Node


class Outbox:
    """Publishes for a node, and logs while the log is on."""

    def __init__(self, node: Node) -> None:
        self.recorder = Recorder()
        self._node = node
        self._events = Outlet(node.resolve_topic_name(f"~/{events.EVENTS}"), events.STRING, STREAM, None)
        self._sent: list[tuple[Outlet, bytes]] = []
        self._reported = ""
        self._latched: dict[str, tuple[Outlet, bytes]] = {}

    def _now(self) -> int:
        return self._node.get_clock().now().nanoseconds

    def send(self, outlet: Outlet, data: bytes) -> None:
        """Publish at once; what has only been logged so far has no publisher."""
        outlet.publish(data)
        self._sent.append((outlet, data))

    def latch(self, outlet: Outlet, data: bytes) -> None:
        """Publish what late joiners, and every log, get as well."""
        self._latched[outlet.topic] = (outlet, data)
        self.send(outlet, data)

    def flush(self, log_time: int | None = None, publish_time: int | None = None) -> None:
        """Hand to the log what was sent since the last time; times in ns, now unless given."""
        if self._sent:
            log_time = self._now() if log_time is None else log_time
            for outlet, data in self._sent:
                self.recorder.write(outlet, data, log_time, publish_time)
            self._sent.clear()
        if self.recorder.problem != self._reported:  # the disk is full, or gone: once into the node's own log
            self._reported = self.recorder.problem
            if self._reported:
                self._node.get_logger().error(self._reported)

    def event(self, event: str, **values: Any) -> None:
        """Log what is needed, besides the joints, to solve the run again bit for bit."""
        self.recorder.write(self._events, events.encode_event(event, **values), self._now())

    def start_log(
        self,
        path: Path,
        settings: Mapping[str, float],
        attachments: Mapping[str, str],
        outlets: Iterable[Outlet],
    ) -> bool:
        """Begin a log that holds the latched messages first; False where it can't be written.

        Args:
            path: the file.
            settings: as in `Recorder.start`.
            attachments: file name -> text.
            outlets: the topics that will be written, for their quality of service.
        """
        latched = list(self._latched.values())
        everything = [self._events, *(outlet for outlet, _ in latched), *outlets]
        self.recorder.start(path, settings, attachments, {"host": host_facts()}, everything)
        if problem := self.recorder.problem:
            self._reported = problem
            self._node.get_logger().error(problem)
            return False
        self._node.get_logger().info(f"Writing the log {path}.")
        now = self._now()
        for outlet, data in latched:
            self.recorder.write(outlet, data, now, now)
        return True

    def stop_log(self) -> None:
        """Complete the log."""
        self.flush()
        writer = self.recorder.writer
        problem = self.recorder.stop()
        # A logger of its own: the node's also publishes, which it no longer can after a signal.
        logger = rclpy.logging.get_logger(f"{self._node.get_logger().name}.log")
        if problem:
            logger.error(problem)
        elif writer is not None:
            logger.info(f"The log {writer.path} is complete: {writer.written} messages.")
