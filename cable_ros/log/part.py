# SPDX-License-Identifier: Apache-2.0
"""One MCAP file of a log, laid out as rosbag2 lays it out."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from cable_ros.log import bag
from cable_ros.log.definitions import message_definition, type_hash
from cable_ros.log.errors import LogError, describe
from cable_ros.log.mcap_writer import Chunk, McapWriter
from cable_ros.log.unfinished import UnfinishedFile

END_RECORD = "cable_ros_log_end"
"""Name of the metadata record with which a log says that it was closed, and how many messages it lacks."""


@dataclass
class Topic:
    """A logged topic; `sequence` counts what was offered, so that gaps in the file show what was dropped."""

    name: str
    type_name: str
    offered_qos: str = ""
    number: int = 0
    """Of its channel, the same in all files of a log."""
    trim: bool = False
    """Whether what may follow the last field has to be cut off."""
    sequence: int = 0


@dataclass(frozen=True)
class Contents:
    """What every file of a log carries besides messages.

    `attachments`: file name -> text (scene, URDF, parameters). `metadata`: record name -> entries.
    """

    attachments: Mapping[str, str]
    metadata: Mapping[str, Mapping[str, str]]


class Part:
    """An MCAP file that is being written.

    Raises: LogError where the file cannot be made or exists; later calls raise the disk's OSError.
    """

    def __init__(self, path: Path, contents: Contents, chunk_bytes: int) -> None:
        self.file = UnfinishedFile(path, chunk_bytes)
        self._writer = McapWriter(self.file.stream, chunk_bytes)
        self._topics: dict[int, bag.BagTopic] = {}
        self._schemas: dict[str, int] = {}
        try:
            self._start(contents)
        except OSError as error:
            self.file.abandon()
            raise LogError(describe(error, path, "write")) from None

    def _start(self, contents: Contents) -> None:
        self._writer.start(profile="ros2", library="cable_ros")
        now = time.time_ns()
        for name, text in contents.attachments.items():
            media_type = "application/xml" if name.endswith((".urdf", ".xml")) else "application/yaml"
            self._writer.add_attachment(now, now, name, media_type, text.encode())
        for name, entries in contents.metadata.items():
            self._writer.add_metadata(name, dict(entries))
        self.file.stream.flush()

    @property
    def size(self) -> int:
        """Bytes written so far."""
        return self.file.stream.tell()

    def write(self, chunk: Chunk, topics: Sequence[Topic]) -> None:
        """One chunk, whose channels are numbered as `topics`, from 1."""
        for number in chunk.index:
            if number not in self._topics:
                self._add_channel(topics[number - 1])
        self._writer.write_chunk(chunk)

    def _add_channel(self, topic: Topic) -> None:
        schema = self._schemas.get(topic.type_name)
        if schema is None:
            text = message_definition(topic.type_name).encode()
            schema = self._writer.register_schema(topic.type_name, "ros2msg", text)
            self._schemas[topic.type_name] = schema
        hash_ = type_hash(topic.type_name)
        metadata = {"offered_qos_profiles": topic.offered_qos, "topic_type_hash": hash_}
        self._writer.register_channel(topic.name, "cdr", schema, metadata, topic.number)
        self._topics[topic.number] = bag.BagTopic(topic.name, topic.type_name, topic.offered_qos, hash_)

    def flush(self) -> None:
        """Everything so far to the operating system: a killed process loses nothing of it."""
        self._writer.flush()

    def finish(self, dropped: int) -> None:
        """Index, footer, then its own name; `dropped` is how many messages the log lacks so far."""
        self._writer.add_metadata(END_RECORD, {"dropped": str(dropped)})
        text = bag.metadata_text(self.file.path.name, self._topics, self._writer.statistics)
        self._writer.add_metadata(bag.RECORD, {bag.KEY: text})
        self._writer.finish()
        self.file.finish()
