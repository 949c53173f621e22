"""Reads a log: messages as bytes or decoded, and the scene, URDF and parameters that came with them."""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.stream_reader import CRCValidationError
from mcap.summary import Summary

from cable_ros.log.decoders import decoder_for
from cable_ros.log.errors import RECOVER, LogError, describe
from cable_ros.log.records import has_magic

SCENE = "scene.yaml"
URDF = "robot.urdf"
PARAMETERS = "parameters.yaml"
"""Names of the attachments that a log of the node has."""


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
        try:
            self._stream = self.path.open("rb")
        except OSError as error:
            raise LogError(describe(error, self.path, "read")) from None
        try:
            self._open()
        except BaseException:
            self._stream.close()
            raise

    def _open(self) -> None:
        if not has_magic(self._stream):
            raise LogError(
                f"Cannot read {self.path}: it does not begin as an MCAP file does; name a log (.mcap)."
            )
        self._stream.seek(0)
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
        try:
            self.attachments = {
                a.name: a.data.decode(errors="replace") for a in self._reader.iter_attachments()
            }
            self.metadata = {record.name: dict(record.metadata) for record in self._reader.iter_metadata()}
            self.header = self._reader.get_header()
        except Exception as error:
            raise self._damaged(error) from None

    def _summary(self) -> Summary:
        try:
            self._reader = SeekingReader(self._stream, validate_crcs=True)
            summary = self._reader.get_summary()
        except Exception:
            summary = None
        if summary is None or summary.statistics is None:
            size = self.path.stat().st_size
            raise LogError(
                f"Cannot read {self.path}: it ends at byte {size} without an index, so its writer was"
                f" interrupted or is still at work; {RECOVER.format(path=self.path)}."
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
                decode = decoders[channel.id] = decoder_for(channel.message_encoding, schema)
                if decode is None:
                    raise LogError(
                        f"{self.path}: topic {channel.topic} is encoded as '{channel.message_encoding}';"
                        " only ROS 2 messages ('cdr' with a 'ros2msg' schema) can be decoded."
                    )
            try:
                value = decode(message.data)
            except (struct.error, ValueError, IndexError) as error:
                raise LogError(
                    f"{self.path}: message {message.sequence} of {channel.topic} is not a {schema.name}"
                    f" ({error}); leave the topic out."
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
        iterator = self._reader.iter_messages(
            wanted, starting_at=start, ending_before=end, log_time_order=not as_written
        )
        while True:
            try:
                item = next(iterator)
            except StopIteration:
                return
            except Exception as error:
                raise self._damaged(error) from None
            yield item

    def _damaged(self, error: Exception) -> LogError:
        reason = str(error) if isinstance(error, McapError | CRCValidationError) else type(error).__name__
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
