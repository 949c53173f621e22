# SPDX-License-Identifier: Apache-2.0
"""What the chunks of an MCAP file hold, opened without trusting what they say about their size."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator

from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode

MOST_RECORD_BYTES = 256 << 20
"""Of one record as it stands in the file; recorders write chunks of 1 to 4 MB, and a 4K image has 25 MB."""
MOST_CHUNK_BYTES = 128 << 20
"""Of a chunk's content."""
MOST_CHUNK_RECORDS = 1_000_000
MOST_EXPANSION = 1000
LEAST_ALLOWANCE = 256 << 20
"""All chunks together may hold this many times the size of their file, or this many bytes."""
RECORD_COST = 200
"""Bytes that a record counts for besides its own: those of the objects that stand for it."""

_HEADER = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
PRIVATE = 0x80
"""Least opcode of a record that is no part of the MCAP specification, and is left out."""
_LAST_TIME = (1 << 63) - 1  # ns; times that fit into a signed number, as ROS has them


class ChunkError(ValueError):
    """A chunk that is damaged or holds too much."""


class AllowanceError(ChunkError):
    """A file whose chunks together hold too much."""


class Allowance:
    """How much the chunks of a file may still hold together, by its size in bytes."""

    def __init__(self, file_size: int) -> None:
        self._left = max(LEAST_ALLOWANCE, MOST_EXPANSION * file_size)

    def spend(self, amount: int) -> None:
        """Take `amount` bytes off. Raises AllowanceError where there are not so many left."""
        self._left -= amount
        if self._left < 0:
            raise AllowanceError(
                f"the chunks hold more than {LEAST_ALLOWANCE >> 20} MB and {MOST_EXPANSION} times the file"
            )


def read_chunk(body: bytes) -> records.Chunk:
    """A chunk out of the body of its record, still compressed. Raises ChunkError."""
    chunk = parsed(records.Chunk, body)
    assert isinstance(chunk, records.Chunk)
    return chunk


def parsed(kind: type[records.McapRecord], body: bytes) -> records.McapRecord:
    """The record of a kind out of its body. Raises ChunkError where it is damaged."""
    try:
        return kind.read(ReadDataStream(io.BytesIO(body)))
    except Exception as error:  # mcap and struct each have errors of their own for wrong bytes
        raise ChunkError(f"damaged {kind.__name__.lower()} ({type(error).__name__})") from None


def open_chunk(chunk: records.Chunk, allowance: Allowance) -> Iterator[records.McapRecord]:
    """Schemas, channels and messages of a chunk, in order.

    All is checked before the first is given: sizes, checksum, and that record follows record to the end.

    Raises: ChunkError, AllowanceError.
    """
    if chunk.uncompressed_size > MOST_CHUNK_BYTES:
        raise ChunkError(f"a chunk says that it holds more than {MOST_CHUNK_BYTES >> 20} MB")
    allowance.spend(chunk.uncompressed_size)
    data = _decompressed(chunk)
    if len(data) != chunk.uncompressed_size:
        raise ChunkError("a chunk holds more or less than it says")
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ChunkError("the checksum of a chunk is wrong")
    allowance.spend(RECORD_COST * _check_records(data))
    return _records(data)


def message(body: bytes) -> records.Message:
    """A message out of the body of its record. Raises ChunkError."""
    channel, sequence, log_time, publish_time = _check_message(body, 0, len(body))
    return records.Message(
        channel_id=channel,
        data=body[_MESSAGE.size :],
        log_time=log_time,
        publish_time=publish_time,
        sequence=sequence,
    )


def _decompressed(chunk: records.Chunk) -> bytes:
    """At most a byte more than the chunk says that it holds; nothing is allocated for what it has beyond."""
    most = chunk.uncompressed_size + 1
    if chunk.compression == "":
        return chunk.data
    try:
        if chunk.compression == "zstd":
            import zstandard

            reader = zstandard.ZstdDecompressor(max_window_size=MOST_CHUNK_BYTES).stream_reader(chunk.data)
            return bytes(reader.read(most))
        if chunk.compression == "lz4":
            import lz4.frame

            decompressor = lz4.frame.LZ4FrameDecompressor()
            data = bytes(decompressor.decompress(chunk.data, max_length=most))
            if not decompressor.eof and len(data) < most:
                raise ChunkError("a chunk ends within its compressed data")
            return data
    except (RuntimeError, ValueError, EOFError, MemoryError, _zstd_error()) as error:
        if isinstance(error, ChunkError):
            raise
        raise ChunkError(f"a chunk cannot be decompressed ({type(error).__name__})") from None
    raise ChunkError(f"a chunk is compressed by '{chunk.compression}', which is neither zstd nor lz4")


def _zstd_error() -> type[Exception]:
    import zstandard

    return zstandard.ZstdError


def _check_records(data: bytes) -> int:
    """How many records there are. Raises ChunkError unless each is whole and may stand in a chunk."""
    count = position = 0
    end = len(data)
    while position < end:
        if end - position < _HEADER.size:
            raise ChunkError("a chunk ends within a record")
        opcode, length = _HEADER.unpack_from(data, position)
        position += _HEADER.size
        if length > end - position:
            raise ChunkError("a record reaches beyond its chunk")
        if opcode == Opcode.MESSAGE:
            _check_message(data, position, length)
        elif opcode == Opcode.SCHEMA:
            parsed(records.Schema, data[position : position + length])
        elif opcode == Opcode.CHANNEL:
            parsed(records.Channel, data[position : position + length])
        elif opcode < 0x80:  # from there on they are anybody's own
            raise ChunkError(f"a chunk holds a record of kind {opcode}, which has no place there")
        position += length
        count += 1
        if count > MOST_CHUNK_RECORDS:
            raise ChunkError(f"a chunk holds more than {MOST_CHUNK_RECORDS} records")
    return count


def _check_message(data: bytes, position: int, length: int) -> tuple[int, int, int, int]:
    if length < _MESSAGE.size:
        raise ChunkError("a message is shorter than its head")
    channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(data, position)
    if log_time > _LAST_TIME or publish_time > _LAST_TIME:
        raise ChunkError("a message has a time after the year 2262")
    return channel, sequence, log_time, publish_time


def _records(data: bytes) -> Iterator[records.McapRecord]:
    """The records of an uncompressed chunk, without private ones."""
    position = 0
    while position < len(data):
        opcode, length = _HEADER.unpack_from(data, position)
        position += _HEADER.size
        if opcode < PRIVATE:
            body = data[position : position + length]
            if opcode == Opcode.MESSAGE:
                yield message(body)
            else:
                yield parsed(records.Schema if opcode == Opcode.SCHEMA else records.Channel, body)
        position += length
