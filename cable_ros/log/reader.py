# SPDX-License-Identifier: Apache-2.0
"""Reads a log: messages as bytes or decoded, and the scene, URDF and parameters that came with them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from mcap import records
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.summary import Summary

from cable_ros.log.chunks import MOST_RECORD_BYTES, ChunkError, parsed
from cable_ros.log.decoders import decoder_for
from cable_ros.log.errors import RECOVER, LogError
from cable_ros.log.files import LogFile
from cable_ros.log.order import Source

SCENE = "scene.yaml"
URDF = "robot.urdf"
PARAMETERS = "parameters.yaml"
"""Names of the attachments that a log of the node has."""

MOST_ATTACHED = 64 << 20
MOST_ATTACHMENTS = 1000
"""Bytes of all attachments together, and how many of them, and of records of metadata, are read."""
MOST_SCHEMA_BYTES = 1 << 18

Record = TypeVar("Record", bound=records.McapRecord)


@dataclass(frozen=True)
class LoggedTopic:
    """A topic of a log. `offered_qos` is YAML (`qos_from_yaml`), empty where unknown."""

    name: str
    type_name: str
    encoding: str
    offered_qos: str
    count: int


@dataclass(frozen=True)
class LoggedMessage:
    """One message: `cdr` as it was serialised; times in ns, `log_time` being the clock of replay."""

    topic: str
    type_name: str
    cdr: bytes
    log_time: int
    publish_time: int
    sequence: int


class LogReader:
    """A finished MCAP file.

    `topics`: name -> LoggedTopic. `start`, `end`: first and last log time, ns (0 without messages).
    `attachments`: name -> text. `metadata`: record name -> entries.

    Raises: LogError (here and while reading) with the file, the offset and the remedy.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._stream = LogFile(self.path)
        try:
            self._open()
        except BaseException:
            self._stream.close()
            raise

    def _open(self) -> None:
        summary = self._summary()
        statistics = summary.statistics
        assert statistics is not None
        self.start = statistics.message_start_time
        self.end = statistics.message_end_time
        self.topics: dict[str, LoggedTopic] = {}
        for channel in summary.channels.values():
            schema = summary.schemas.get(channel.schema_id)
            known = self.topics.get(channel.topic)
            self.topics[channel.topic] = LoggedTopic(
                channel.topic,
                schema.name if schema else "",
                channel.message_encoding,
                channel.metadata.get("offered_qos_profiles", ""),
                statistics.channel_message_counts.get(channel.id, 0) + (known.count if known else 0),
            )
        self._source = Source(self._stream, self._stream.size, summary)
        try:
            self.attachments = self._attachments(summary)
            self.metadata = self._metadata(summary)
            self.header = self._reader.get_header()
        except Exception as error:
            raise self._damaged(error) from None

    def _attachments(self, summary: Summary) -> dict[str, str]:
        found = self._indexed(summary.attachment_indexes, records.Attachment, "attachments")
        return {one.name: one.data.decode(errors="replace") for one in found}

    def _metadata(self, summary: Summary) -> dict[str, dict[str, str]]:
        found = self._indexed(summary.metadata_indexes, records.Metadata, "records of metadata")
        return {one.name: dict(one.metadata) for one in found}

    def _indexed(self, indexes: Sequence[Any], kind: type[Record], called: str) -> Iterator[Record]:
        """The records of one kind that the summary's `indexes` name."""
        if len(indexes) > MOST_ATTACHMENTS:
            raise ChunkError(f"it has more than {MOST_ATTACHMENTS} {called}")
        left = MOST_ATTACHED
        for index in indexes:
            body = self._body(index.offset, left)
            left -= len(body)
            record = parsed(kind, body)
            assert isinstance(record, kind)
            yield record

    def _body(self, offset: int, most: int) -> bytes:
        """What is in the record at `offset`."""
        self._stream.seek(offset + 1)
        length = int.from_bytes(self._stream.read(8), "little")
        if length > most:
            raise ChunkError(f"its attachments or its metadata have more than {MOST_ATTACHED >> 20} MB")
        return self._stream.read(length)

    def _summary(self) -> Summary:
        try:
            self._reader = SeekingReader(self._stream, record_size_limit=MOST_RECORD_BYTES)
            summary = self._reader.get_summary()
        except Exception:
            summary = None
        if summary is None or summary.statistics is None:
            raise LogError(
                f"Cannot read {self.path}: it ends at byte {self._stream.size} without an index, so its"
                f" writer was interrupted or is still at work; {RECOVER.format(path=self.path)}."
            )
        return summary

    @property
    def scene_text(self) -> str:
        """The scene as it was logged. Raises LogError where the log has none."""
        if SCENE not in self.attachments:
            raise LogError(f"{self.path} has no attachment '{SCENE}'; name a scene with --with.")
        return self.attachments[SCENE]

    @property
    def urdf_text(self) -> str | None:
        """The robot description that was in use, or None."""
        return self.attachments.get(URDF)

    def messages(
        self,
        topics: Collection[str] | None = None,
        start: int | None = None,
        end: int | None = None,
        *,
        as_written: bool = False,
    ) -> Iterator[LoggedMessage]:
        """Messages of `topics` (all) with start <= log time < end, ns, in order of log time.

        `as_written` gives them in the order in which they were written, which differs where the clock
        jumped backwards.
        """
        for schema, channel, message in self._guarded(topics, start, end, as_written):
            yield self._logged(schema, channel, message)

    def decoded(
        self,
        topics: Collection[str] | None = None,
        start: int | None = None,
        end: int | None = None,
        *,
        as_written: bool = False,
        raw: Collection[str] = (),
    ) -> Iterator[tuple[LoggedMessage, Any]]:
        """The same with each message decoded; see `decoders`.

        A decoded message has the fields of the ROS message as attributes; those of the topics `raw` are not
        decoded, None stands for them.
        """
        decoders: dict[int, Any] = {}
        for schema, channel, message in self._guarded(topics, start, end, as_written):
            if channel.topic in raw:
                yield self._logged(schema, channel, message), None
                continue
            decode = decoders.get(channel.id)
            if decode is None:
                try:
                    if schema is not None and len(schema.data) > MOST_SCHEMA_BYTES:
                        raise ValueError(f"more than {MOST_SCHEMA_BYTES} bytes")
                    decode = decoders[channel.id] = decoder_for(channel.message_encoding, schema)
                except LogError:
                    raise
                except Exception as error:  # its parser has many for texts that are no schema
                    raise LogError(
                        f"{self.path}: the schema of topic {channel.topic} is damaged ({_reason(error)});"
                        " leave the topic out."
                    ) from None
                if decode is None:
                    raise LogError(
                        f"{self.path}: topic {channel.topic} is encoded as '{channel.message_encoding}';"
                        " only ROS 2 messages ('cdr' with a 'ros2msg' schema) can be decoded."
                    )
            try:
                value = decode(message.data)
            except Exception as error:  # whatever a schema makes of bytes that are not its own
                raise LogError(
                    f"{self.path}: message {message.sequence} of {channel.topic} is not a {schema.name}"
                    f" ({_reason(error)}); leave the topic out."
                ) from None
            yield self._logged(schema, channel, message), value

    @staticmethod
    def _logged(schema: Any, channel: Any, message: Any) -> LoggedMessage:
        return LoggedMessage(
            channel.topic,
            schema.name if schema else "",
            message.data,
            message.log_time,
            message.publish_time,
            message.sequence,
        )

    def _guarded(
        self, topics: Collection[str] | None, start: int | None, end: int | None, as_written: bool
    ) -> Iterator[Any]:
        wanted = None if topics is None else list(topics)
        if wanted == []:
            return
        iterator = self._source.messages(wanted, start, end, as_written)
        while True:
            try:
                item = next(iterator)
            except StopIteration:
                return
            except Exception as error:
                raise self._damaged(error) from None
            yield item

    def _damaged(self, error: Exception) -> LogError:
        reason = str(error) if isinstance(error, McapError | ChunkError) else type(error).__name__
        return LogError(
            f"Cannot read {self.path}: it is damaged before byte {self._stream.tell()} ({reason});"
            f" {RECOVER.format(path=self.path)}."
        )

    def close(self) -> None:
        """Close the file."""
        self._stream.close()

    def __enter__(self) -> LogReader:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def _reason(error: Exception) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
