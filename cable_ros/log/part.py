"""One MCAP file while it is being written: laid out as rosbag2 lays it out, whole or marked as not."""

from __future__ import annotations

import io
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import yaml
from mcap.writer import CompressionType, Writer

from cable_ros.log.definitions import message_definition, type_hash
from cable_ros.log.errors import LogError, describe

UNFINISHED = ".part"
"""Suffix of a log that is being written, or whose writer was killed: a name without it is whole."""

_QOS_YAML_VERSION = 9  # rosbag2 metadata version whose QoS profiles name their policies, as Jazzy writes them


@dataclass
class Topic:
    """A logged topic; `sequence` counts what was offered, so that gaps in the file show what was dropped."""

    name: str
    type_name: str
    offered_qos: str = ""
    sequence: int = 0


@dataclass(frozen=True)
class Contents:
    """What every file of a log carries besides messages.

    `attachments`: file name -> text (scene, URDF, parameters). `metadata`: record name -> entries.
    """

    attachments: Mapping[str, str]
    metadata: Mapping[str, Mapping[str, str]]


class Part:
    """An MCAP file under `path` + '.part' that gets its own name when it is finished.

    Raises: LogError where the file cannot be made or exists; later calls raise OSError of the disk.
    """

    def __init__(self, path: Path, contents: Contents, chunk_bytes: int) -> None:
        self.path = path
        self.unfinished = path.with_name(path.name + UNFINISHED)
        if path.exists():
            raise LogError(
                f"Cannot write {path}: it exists already and logs never overwrite; choose another name."
            )
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._stream = io.BufferedWriter(io.FileIO(self.unfinished, "xb"), buffer_size=chunk_bytes)
        except OSError as error:
            raise LogError(describe(error, path, "write")) from None
        self._writer = Writer(self._stream, chunk_size=chunk_bytes, compression=CompressionType.ZSTD)
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._counts: dict[str, int] = {}
        self._types: dict[str, Topic] = {}
        self._start: int | None = None
        self._end = 0
        self._start_file(contents)

    def _start_file(self, contents: Contents) -> None:
        try:
            self._writer.start(profile="ros2", library="cable_ros")
            now = time.time_ns()
            for name, text in contents.attachments.items():
                media_type = "application/xml" if name.endswith((".urdf", ".xml")) else "application/yaml"
                self._writer.add_attachment(now, now, name, media_type, text.encode())
            for name, entries in contents.metadata.items():
                self._writer.add_metadata(name, dict(entries))
            self._stream.flush()
        except OSError as error:
            self.abandon()
            raise LogError(describe(error, self.path, "write")) from None

    @property
    def size(self) -> int:
        """Bytes written so far."""
        return self._stream.tell()

    def add(self, topic: Topic, sequence: int, cdr: bytes, log_time: int, publish_time: int) -> None:
        """One message; its chunk goes to the disk when it is full or at the next `close_chunk`."""
        channel = self._channels.get(topic.name)
        if channel is None:
            channel = self._add_channel(topic)
        self._writer.add_message(channel, log_time, cdr, publish_time, sequence)
        self._counts[topic.name] += 1
        self._start = log_time if self._start is None else min(self._start, log_time)
        self._end = max(self._end, log_time)

    def _add_channel(self, topic: Topic) -> int:
        schema = self._schemas.get(topic.type_name)
        if schema is None:
            text = message_definition(topic.type_name).encode()
            schema = self._writer.register_schema(topic.type_name, "ros2msg", text)
            self._schemas[topic.type_name] = schema
        metadata = {
            "offered_qos_profiles": topic.offered_qos,
            "topic_type_hash": type_hash(topic.type_name),
        }
        channel = self._writer.register_channel(topic.name, "cdr", schema, metadata)
        self._channels[topic.name] = channel
        self._counts[topic.name] = 0
        self._types[topic.name] = topic
        return channel

    def close_chunk(self) -> None:
        """Everything so far to the operating system: a killed process loses nothing of it."""
        self._writer.flush()

    def sync(self) -> None:
        """Everything so far to the disk: a power cut loses nothing of it."""
        self._stream.flush()
        os.fdatasync(self._stream.fileno())

    def finish(self) -> None:
        """Index, footer, then its own name; never over an existing file."""
        self._writer.add_metadata("rosbag2", {"serialized_metadata": self._bag_metadata()})
        self._writer.finish()
        self.sync()
        self._stream.close()
        # The empty placeholder reserves the name on any file system; replacing it is atomic.
        os.close(os.open(self.path, os.O_CREAT | os.O_EXCL | os.O_WRONLY))
        os.replace(self.unfinished, self.path)
        folder = os.open(self.path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)

    def abandon(self) -> None:
        """Close without an index, as after a failed write; the '.part' file stays for recovery."""
        try:
            self._stream.close()
        except OSError:
            self._stream.raw.close()

    def _bag_metadata(self) -> str:
        """What rosbag2 keeps in `metadata.yaml`; it plays a lone file from this record."""
        start = self._start or 0
        span = {
            "duration": {"nanoseconds": self._end - start if self._start is not None else 0},
            "starting_time": {"nanoseconds_since_epoch": start},
            "message_count": sum(self._counts.values()),
        }
        topics = [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type_name,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": yaml.safe_load(topic.offered_qos) if topic.offered_qos else [],
                    "type_description_hash": type_hash(topic.type_name),
                },
                "message_count": self._counts[topic.name],
            }
            for topic in self._types.values()
        ]
        return yaml.safe_dump(
            {
                "version": _QOS_YAML_VERSION,
                "storage_identifier": "mcap",
                **span,
                "topics_with_message_count": topics,
                "compression_format": "",
                "compression_mode": "",
                "relative_file_paths": [self.path.name],
                "files": [{"path": self.path.name, **span}],
                "custom_data": {},
                "ros_distro": os.environ.get("ROS_DISTRO", "jazzy"),
            },
            sort_keys=False,
        )
