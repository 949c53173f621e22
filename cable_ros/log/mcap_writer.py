# SPDX-License-Identifier: Apache-2.0
"""Writes MCAP with little work per message: the thread that logs shares its interpreter with one in a hurry.

A message is packed at once; what concerns a chunk as a whole is done when it is written, mostly by calls that
let go of the interpreter. The `mcap` package's own writer takes three times as long. Format: https://mcap.dev/spec
"""

from __future__ import annotations

import struct
import sys
import zlib
from array import array
from collections.abc import Mapping
from typing import IO

import zstandard
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

_LEVEL = -1  # of zstd: a third of the time of the usual 3, and 4 % more bytes
_COMPRESSION = b"zstd"
_MESSAGE = struct.Struct("<BQHIQQ")
MESSAGE_HEAD = _MESSAGE.size
"""Bytes that a message takes in a chunk beside its own."""
_MESSAGE_FIELDS = MESSAGE_HEAD - 9  # opcode and length do not count
_MESSAGE_INDEX = struct.Struct("<BQHI")
_CHUNK = struct.Struct(f"<BQQQQII{len(_COMPRESSION)}sQ")
_FOOTER = struct.Struct("<BQQQ")


def _bytes(record: records.McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())


class Chunk:
    """Messages as a chunk holds them. May be filled by one thread and then written by another."""

    __slots__ = ("count", "index", "records", "size")

    def __init__(self) -> None:
        self.records: list[bytes] = []
        self.size = 0
        """Bytes, before compression."""
        self.count = 0
        """Messages."""
        self.index: dict[int, array[int]] = {}
        """Channel -> log time, place in the chunk, log time, place, ..."""

    def add(self, channel_id: int, log_time: int, data: bytes, publish_time: int, sequence: int) -> None:
        """One message; times in ns. `data` is kept until the chunk is written.

        Raises: struct.error where a number does not fit; nothing has changed then.
        """
        size = len(data)
        head = _MESSAGE.pack(
            Opcode.MESSAGE, _MESSAGE_FIELDS + size, channel_id, sequence, log_time, publish_time
        )
        index = self.index.get(channel_id)
        if index is None:
            index = self.index[channel_id] = array("Q")
        index.extend((log_time, self.size))
        self.records += (head, data)
        self.size += _MESSAGE.size + size
        self.count += 1


class McapWriter:
    """Writes MCAP to `stream`; a chunk is closed when it exceeds `chunk_bytes` (uncompressed), or by `flush`.

    Methods and their errors are those of `mcap.writer.Writer`, but for `write_chunk`.
    """

    def __init__(self, stream: IO[bytes], chunk_bytes: int) -> None:
        self._stream = stream
        self._chunk_bytes = chunk_bytes
        self._compressor = zstandard.ZstdCompressor(level=_LEVEL)
        self._chunk = Chunk()
        self._announced: list[bytes] = []  # go into the next chunk
        self._summary: dict[Opcode, list[bytes]] = {
            Opcode.SCHEMA: [],
            Opcode.CHANNEL: [],
            Opcode.STATISTICS: [],
            Opcode.CHUNK_INDEX: [],
            Opcode.ATTACHMENT_INDEX: [],
            Opcode.METADATA_INDEX: [],
        }
        self.statistics = records.Statistics(0, 0, {}, 0, 0, 0, 0, 0, 0)
        """Of the chunks that are closed; also its number of schemas and channels."""

    def start(self, profile: str, library: str) -> None:
        """Magic and header."""
        self._stream.write(MCAP0_MAGIC + _bytes(records.Header(profile, library)))

    def add_attachment(
        self, create_time: int, log_time: int, name: str, media_type: str, data: bytes
    ) -> None:
        """A file inside the file; times in ns."""
        body = _bytes(records.Attachment(create_time, log_time, name, media_type, data))
        index = records.AttachmentIndex(
            self._stream.tell(), len(body), log_time, create_time, len(data), name, media_type
        )
        self._stream.write(body)
        self._summary[Opcode.ATTACHMENT_INDEX].append(_bytes(index))
        self.statistics.attachment_count += 1

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """A named record of texts."""
        body = _bytes(records.Metadata(name, dict(data)))
        index = records.MetadataIndex(self._stream.tell(), len(body), name)
        self._stream.write(body)
        self._summary[Opcode.METADATA_INDEX].append(_bytes(index))
        self.statistics.metadata_count += 1

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Announce a message type; returns its id."""
        self.statistics.schema_count += 1
        number = self.statistics.schema_count
        self._announce(Opcode.SCHEMA, records.Schema(id=number, data=data, encoding=encoding, name=name))
        return number

    def register_channel(
        self,
        topic: str,
        message_encoding: str,
        schema_id: int,
        metadata: Mapping[str, str],
        number: int | None = None,
    ) -> int:
        """Announce a topic; returns its id, which is `number` where given."""
        self.statistics.channel_count += 1
        number = self.statistics.channel_count if number is None else number
        channel = records.Channel(
            id=number,
            topic=topic,
            message_encoding=message_encoding,
            metadata=dict(metadata),
            schema_id=schema_id,
        )
        self._announce(Opcode.CHANNEL, channel)
        return number

    def _announce(self, opcode: Opcode, record: records.McapRecord) -> None:
        body = _bytes(record)
        self._summary[opcode].append(body)
        self._announced.append(body)

    def add_message(
        self, channel_id: int, log_time: int, data: bytes, publish_time: int, sequence: int
    ) -> None:
        """One message; times in ns. `data` is kept until its chunk is closed."""
        self._chunk.add(channel_id, log_time, data, publish_time, sequence)
        if self._chunk.size > self._chunk_bytes:
            self._close_chunk()

    def _close_chunk(self) -> None:
        chunk, self._chunk = self._chunk, Chunk()
        self.write_chunk(chunk)

    def write_chunk(self, chunk: Chunk) -> None:
        """Write a chunk and its index, nothing where it has no message. Its channels must be registered."""
        if not chunk.count:
            return
        if self._announced:
            announced, self._announced = b"".join(self._announced), []
            chunk.records.insert(0, announced)
            for index in chunk.index.values():
                for place in range(1, len(index), 2):
                    index[place] += len(announced)
        body = b"".join(chunk.records)
        compressed = self._compressor.compress(body)
        start = min(min(index[::2]) for index in chunk.index.values())
        end = max(max(index[::2]) for index in chunk.index.values())
        head = _CHUNK.pack(
            Opcode.CHUNK,
            _CHUNK.size - 9 + len(compressed),
            start,
            end,
            len(body),
            zlib.crc32(body),
            len(_COMPRESSION),
            _COMPRESSION,
            len(compressed),
        )
        chunk_start = self._stream.tell()
        chunk_size = len(head) + len(compressed)
        indexes, places = [], {}
        place = chunk_start + chunk_size
        for channel, index in chunk.index.items():
            entries = _little_endian(index)
            places[channel] = place
            indexes += [
                _MESSAGE_INDEX.pack(Opcode.MESSAGE_INDEX, 6 + len(entries), channel, len(entries)),
                entries,
            ]
            place += _MESSAGE_INDEX.size + len(entries)
        self._stream.write(b"".join((head, compressed, *indexes)))
        chunk_index = records.ChunkIndex(
            chunk_length=chunk_size,
            chunk_start_offset=chunk_start,
            compression=_COMPRESSION.decode(),
            compressed_size=len(compressed),
            message_end_time=end,
            message_index_length=place - chunk_start - chunk_size,
            message_index_offsets=places,
            message_start_time=start,
            uncompressed_size=len(body),
        )
        self._summary[Opcode.CHUNK_INDEX].append(_bytes(chunk_index))
        self._count(chunk, start, end)

    def _count(self, chunk: Chunk, start: int, end: int) -> None:
        found = self.statistics
        found.message_start_time = min(found.message_start_time, start) if found.chunk_count else start
        found.message_end_time = max(found.message_end_time, end)
        found.chunk_count += 1
        found.message_count += chunk.count
        for channel, index in chunk.index.items():
            count = len(index) // 2
            found.channel_message_counts[channel] = found.channel_message_counts.get(channel, 0) + count

    def flush(self) -> None:
        """Close the chunk and hand everything to the operating system."""
        self._close_chunk()
        self._stream.flush()

    def finish(self) -> None:
        """Close the chunk, write index and footer. The stream stays open."""
        self._close_chunk()
        self._stream.write(_bytes(records.DataEnd(0)))
        self._summary[Opcode.STATISTICS].append(_bytes(self.statistics))
        start = self._stream.tell()
        groups, offsets = b"", b""
        for opcode, group in self._summary.items():
            body = b"".join(group)
            if body:
                offsets += _bytes(records.SummaryOffset(opcode, start + len(groups), len(body)))
            groups += body
        footer = _FOOTER.pack(Opcode.FOOTER, 20, start, start + len(groups))
        checksum = zlib.crc32(groups + offsets + footer)
        self._stream.write(groups + offsets + footer + struct.pack("<I", checksum) + MCAP0_MAGIC)


def _little_endian(numbers: array[int]) -> bytes:
    if sys.byteorder == "big":
        numbers.byteswap()
    return numbers.tobytes()
