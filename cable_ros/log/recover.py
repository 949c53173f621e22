# SPDX-License-Identifier: Apache-2.0
"""Saves what is whole of a log whose writer was killed, or whose disk was full, into a new, indexed file."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from mcap import records
from mcap.reader import SeekingReader
from mcap.summary import Summary

from cable_ros.log import bag
from cable_ros.log.chunks import MOST_RECORD_BYTES
from cable_ros.log.errors import LogError, describe
from cable_ros.log.files import LogFile
from cable_ros.log.mcap_writer import McapWriter
from cable_ros.log.records import Damage, whole_records
from cable_ros.log.unfinished import SUFFIX, UnfinishedFile

_CHUNK_BYTES = 1 << 20
_SUFFIX = ".recovery"  # of the new file until it is whole; the log itself may be called .part


@dataclass
class Recovery:
    """What was saved, what was lost."""

    path: Path
    """The new file."""
    messages: dict[str, int] = field(default_factory=dict)
    """Topic -> number of messages saved."""
    attachments: int = 0
    start: int | None = None
    end: int = 0
    """Log times of the first and the last message saved, ns; `start` is None where there is none."""
    damages: list[Damage] = field(default_factory=list)
    """Places that could not be read."""
    orphans: int = 0
    """Messages whose topic was announced in a damaged place."""
    was_whole: bool = False
    """Whether the file had its index, so that nothing needed to be saved."""

    @property
    def lost_bytes(self) -> int:
        """Bytes of the damaged places."""
        return sum(damage.size for damage in self.damages)


def default_output(path: Path) -> Path:
    """Where the recovered log of `path` goes: its own name without '.part', or '<stem>_recovered.mcap'."""
    if path.name.endswith(".mcap" + SUFFIX):
        return path.with_name(path.name.removesuffix(SUFFIX))
    return path.with_name(f"{path.stem}_recovered.mcap")


def recover(path: Path, out: Path | None = None) -> Recovery:
    """Stream every whole chunk, attachment and metadata record of `path` into a new file.

    `path` is left as it is. Messages keep their bytes, times and order.

    Raises: LogError where `path` is not an MCAP file or cannot be read, or `out` cannot be written.
    """
    out = default_output(path) if out is None else out
    if out.resolve() == path.resolve():
        raise LogError(f"Cannot write {out}: it is the log to recover; choose another name with --out.")
    with LogFile(path) as stream:
        copy = _Copy(out)
        copy.announce(_summary(stream))
        try:
            for record in whole_records(stream):
                copy.take(record)
            copy.finish()
        except OSError as error:
            copy.file.discard()
            raise LogError(describe(error, out, "write")) from None
        except BaseException:
            copy.file.discard()
            raise
    return copy.result


def _summary(stream: IO[bytes]) -> Summary | None:
    try:
        stream.seek(0)
        return SeekingReader(stream, record_size_limit=MOST_RECORD_BYTES).get_summary()
    except Exception:  # without an index; mcap has several errors for that
        return None


class _Copy:
    """The new file."""

    def __init__(self, path: Path) -> None:
        # One that a killed recovery left is written anew: the log it was made from is still there.
        self.file = UnfinishedFile(path, _CHUNK_BYTES, _SUFFIX, takes_over=True)
        self.result = Recovery(path, was_whole=True)
        self._writer = McapWriter(self.file.stream, _CHUNK_BYTES)
        self._topics: dict[int, bag.BagTopic] = {}
        self._started = False
        self._ros2 = False
        self._schemas: dict[int, records.Schema] = {}
        self._schema_ids: dict[int, int] = {0: 0}
        self._channels: dict[int, records.Channel] = {}
        self._channel_ids: dict[int, int] = {}

    def announce(self, summary: Summary | None) -> None:
        """Schemas and channels from the index, where there is one, for when their own place is damaged."""
        if summary is not None:
            self._schemas.update(summary.schemas)
            self._channels.update(summary.channels)

    def take(self, record: records.McapRecord | Damage) -> None:
        if isinstance(record, Damage):
            self.result.was_whole = False
            self.result.damages.append(record)
        elif isinstance(record, records.Header):
            self._begin(record.profile)
        elif isinstance(record, records.Schema):
            self._schemas[record.id] = record
        elif isinstance(record, records.Channel):
            self._channels[record.id] = record
        elif isinstance(record, records.Message):
            self._message(record)
        elif isinstance(record, records.Attachment):
            self._begin()
            self._writer.add_attachment(
                record.create_time, record.log_time, record.name, record.media_type, record.data
            )
            self.result.attachments += 1
        elif isinstance(record, records.Metadata) and record.name != bag.RECORD:
            self._begin()
            self._writer.add_metadata(record.name, record.metadata)

    def _begin(self, profile: str = "") -> None:
        if not self._started:
            self._started = True
            self._ros2 = profile == "ros2"
            self._writer.start(profile=profile, library="cable_ros log recover")

    def _message(self, message: records.Message) -> None:
        self._begin()
        channel = self._channels.get(message.channel_id)
        if channel is None:  # it was announced in a chunk that is damaged
            self.result.orphans += 1
            return
        new_id = self._channel_ids.get(channel.id)
        if new_id is None:
            new_id = self._channel_ids[channel.id] = self._add_channel(channel)
        self._writer.add_message(
            new_id, message.log_time, message.data, message.publish_time, message.sequence
        )

    def _add_channel(self, channel: records.Channel) -> int:
        schema = self._schemas.get(channel.schema_id)
        if schema is not None and schema.id not in self._schema_ids:
            self._schema_ids[schema.id] = self._writer.register_schema(
                schema.name, schema.encoding, schema.data
            )
        new_id = self._writer.register_channel(
            channel.topic,
            channel.message_encoding,
            self._schema_ids.get(channel.schema_id, 0),
            channel.metadata,
        )
        self._topics[new_id] = bag.BagTopic(
            channel.topic,
            schema.name if schema else "",
            channel.metadata.get("offered_qos_profiles", ""),
            channel.metadata.get("topic_type_hash", ""),
        )
        return new_id

    def finish(self) -> None:
        self._begin()
        self._writer.flush()
        found = self._writer.statistics
        if self._ros2:
            text = bag.metadata_text(self.file.path.name, self._topics, found)
            self._writer.add_metadata(bag.RECORD, {bag.KEY: text})
        self._writer.finish()
        self.file.finish()
        for channel, topic in self._topics.items():
            count = found.channel_message_counts.get(channel, 0)
            self.result.messages[topic.name] = self.result.messages.get(topic.name, 0) + count
        if found.message_count:
            self.result.start, self.result.end = found.message_start_time, found.message_end_time
