# SPDX-License-Identifier: Apache-2.0
"""The node's log: on or off, and never in the way of publishing."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rclpy.event_handler import PublisherEventCallbacks

from cable_ros.log.errors import LogError
from cable_ros.log.qos import qos_to_yaml
from cable_ros.log.writer import LogWriter

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.publisher import Publisher
    from rclpy.qos import QoSProfile

_MEGABYTE = 1_000_000


def type_name(message_type: type) -> str:
    """The name of a message class, such as 'geometry_msgs/msg/WrenchStamped'."""
    return f"{message_type.__module__.partition('.')[0]}/msg/{message_type.__name__}"


@dataclass(frozen=True)
class Outlet:
    """A topic that the node publishes serialised messages on.

    `publisher` is None for a topic that is only logged. `exact`: nothing follows its messages' last field.
    """

    topic: str
    type_name: str
    qos: QoSProfile
    publisher: Publisher | None
    exact: bool = True

    @classmethod
    def create(cls, node: Node, message_type: Any, topic: str, qos: QoSProfile) -> Outlet:
        """Advertise `topic` of `node`."""
        # rclpy's default callbacks (a warning where a subscriber's QoS does not match) cost the executor two
        # more things to wait for per publisher, at every joint state.
        quiet = PublisherEventCallbacks(use_default_callbacks=False)
        publisher = node.create_publisher(message_type, topic, qos, event_callbacks=quiet)
        return cls(publisher.topic_name, type_name(message_type), qos, publisher)

    def publish(self, data: bytes) -> None:
        """Send CDR bytes as they are."""
        if self.publisher is not None:
            self.publisher.publish(data)

    def wanted(self) -> bool:
        """Whether somebody listens."""
        return self.publisher is not None and self.publisher.get_subscription_count() > 0


class Recorder:
    """Writes what it is given to the log while that is on."""

    def __init__(self) -> None:
        self.writer: LogWriter | None = None
        self.error = ""
        """Why the last start failed; empty when it did not."""

    @property
    def on(self) -> bool:
        """Whether messages go to a file at this moment."""
        return self.writer is not None and self.writer.error is None

    @property
    def problem(self) -> str:
        """Why nothing is written though a log was asked for; empty when all is well."""
        return self.error or (self.writer.error or "" if self.writer else "")

    def start(
        self,
        path: Path,
        settings: Mapping[str, float],
        attachments: Mapping[str, str],
        metadata: Mapping[str, Mapping[str, str]],
        outlets: Iterable[Outlet],
    ) -> None:
        """Begin a log; `error` says why where that fails.

        Args:
            path: the file.
            settings: `max_size` MB, `max_duration` s and `queue_size` MB as the parameters have them.
            attachments: file name -> text.
            metadata: record name -> entries.
            outlets: the topics that will be written, for their quality of service.
        """
        self.stop()
        try:
            if not path.parent.exists():  # a slip in its name would make a folder
                raise LogError(
                    f"Cannot write {path}: there is no folder {path.parent}; make it, or name another."
                )
            self.writer = LogWriter(
                path,
                attachments=attachments,
                metadata=metadata,
                max_bytes=int(settings["max_size"] * _MEGABYTE),
                max_seconds=settings["max_duration"],
                queue_bytes=int(settings["queue_size"] * _MEGABYTE),
            )
            for outlet in outlets:
                self.writer.add_topic(outlet.topic, outlet.type_name, qos_to_yaml(outlet.qos), outlet.exact)
        except LogError as error:
            self.error = str(error)

    def write(self, outlet: Outlet, data: bytes, log_time: int, publish_time: int | None = None) -> None:
        """Queue one message; times in ns."""
        if self.writer is not None:
            self.writer.write(outlet.topic, outlet.type_name, data, log_time, publish_time)

    def stop(self) -> str:
        """Finish the log. Returns the problem that it had, or an empty text."""
        writer, self.writer, self.error = self.writer, None, ""
        if writer is None:
            return ""
        writer.close()
        return writer.error or ""


def log_path(wanted: str, node: str, default_folder: str) -> Path:
    """The file of the next log: `wanted` itself, or one named after node and time in that folder.

    Numbered where there is such a file: a second log under the same parameters. Only the default folder is
    made where it is missing. `node` is its full name, as two nodes may begin their logs in the same folder
    and second.
    """
    path = Path(os.path.expanduser(wanted or default_folder))
    if not wanted:
        with contextlib.suppress(OSError):  # reported when the log is begun
            path.mkdir(parents=True, exist_ok=True)
    if path.suffix != ".mcap":
        path /= f"{node.replace('/', '_')}_{time.strftime('%Y%m%d-%H%M%S')}.mcap"
    candidate, number = path, 1
    while os.path.exists(candidate) or os.path.exists(f"{candidate}.part"):
        number += 1
        candidate = path.with_name(f"{path.stem}-{number}.mcap")
    return candidate
