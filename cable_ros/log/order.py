# SPDX-License-Identifier: Apache-2.0
"""The messages of an MCAP file in order of time or as they were written, from chunks that are not trusted."""

from __future__ import annotations

import heapq
import struct
from collections.abc import Collection, Iterator
from typing import IO

from mcap import records
from mcap.opcode import Opcode
from mcap.summary import Summary

from cable_ros.log.chunks import MOST_RECORD_BYTES, RECORD_COST, Allowance, ChunkError, open_chunk, read_chunk
from cable_ros.log.records import Damage, whole_records

MOST_HELD = 512 << 20
"""Bytes of messages that wait for their turn; the chunks of a log hardly overlap in time."""

Item = tuple[records.Schema | None, records.Channel, records.Message]
_HEADER = struct.Struct("<BQ")


class Source:
    """A file with its summary, as the messages are read from it.

    Its methods raise ChunkError, or what the file itself raises.
    """

    def __init__(self, stream: IO[bytes], size: int, summary: Summary) -> None:
        self._stream, self._size = stream, size
        self._schemas, self._channels = dict(summary.schemas), dict(summary.channels)
        self._chunks = sorted(summary.chunk_indexes, key=lambda chunk: chunk.chunk_start_offset)

    def messages(
        self, topics: Collection[str] | None, start: int | None, end: int | None, as_written: bool
    ) -> Iterator[Item]:
        """Messages of `topics` (None: all) with start <= log time < end, ns."""
        wanted = None if topics is None else frozenset(topics)
        chunks = [chunk for chunk in self._chunks if self._may_hold(chunk, wanted, start, end)]
        allowance = Allowance(self._size)
        for item in self._as_written(chunks, allowance) if as_written else self._in_order(chunks, allowance):
            _, channel, message = item
            if wanted is not None and channel.topic not in wanted:
                continue
            if (start is None or message.log_time >= start) and (end is None or message.log_time < end):
                yield item

    def _may_hold(
        self, chunk: records.ChunkIndex, topics: frozenset[str] | None, start: int | None, end: int | None
    ) -> bool:
        if start is not None and chunk.message_end_time < start:
            return False
        if end is not None and chunk.message_start_time >= end:
            return False
        numbers = chunk.message_index_offsets
        if topics is None or not numbers:
            return True
        known = (self._channels.get(number) for number in numbers)
        return any(channel is None or channel.topic in topics for channel in known)

    def _as_written(self, chunks: list[records.ChunkIndex], allowance: Allowance) -> Iterator[Item]:
        if not self._chunks:
            yield from self._unchunked()
        for chunk in chunks:
            yield from self._items(chunk, allowance)

    def _in_order(self, chunks: list[records.ChunkIndex], allowance: Allowance) -> Iterator[Item]:
        """By log time, then by place; a chunk is opened when its first message may be next."""
        if not self._chunks:
            yield from _by_time(self._unchunked())
            return
        waiting = sorted(chunks, key=lambda chunk: (chunk.message_start_time, chunk.chunk_start_offset))
        heap: list[tuple[int, int, int, Item]] = []
        held = opened = 0
        while True:
            while opened < len(waiting) and (not heap or waiting[opened].message_start_time <= heap[0][0]):
                chunk = waiting[opened]
                opened += 1
                # The number of opening makes two of the same place different.
                for index, item in enumerate(self._items(chunk, allowance)):
                    held += _held(item)
                    if held > MOST_HELD:
                        raise ChunkError("too many of its chunks are of the same time")
                    heapq.heappush(
                        heap, (item[2].log_time, chunk.chunk_start_offset, index + (opened << 32), item)
                    )
            if not heap:
                return
            item = heapq.heappop(heap)[3]
            held -= _held(item)
            yield item

    def _items(self, chunk: records.ChunkIndex, allowance: Allowance) -> Iterator[Item]:
        self._stream.seek(chunk.chunk_start_offset)
        header = self._stream.read(_HEADER.size)
        opcode, length = _HEADER.unpack(header) if len(header) == _HEADER.size else (0, 0)
        left = self._size - chunk.chunk_start_offset - _HEADER.size
        if opcode != Opcode.CHUNK or length > min(left, MOST_RECORD_BYTES):
            raise ChunkError("its index names a chunk where there is none")
        for record in open_chunk(read_chunk(self._stream.read(length)), allowance):
            if isinstance(record, records.Message):
                yield self._item(record)

    def _unchunked(self) -> Iterator[Item]:
        """All messages of a file whose index names no chunk."""
        for record in whole_records(self._stream):
            if isinstance(record, Damage):
                raise ChunkError(record.what)
            if isinstance(record, records.Schema):
                self._schemas.setdefault(record.id, record)
            elif isinstance(record, records.Channel):
                self._channels.setdefault(record.id, record)
            elif isinstance(record, records.Message):
                yield self._item(record)

    def _item(self, message: records.Message) -> Item:
        channel = self._channels.get(message.channel_id)
        if channel is None:
            raise ChunkError(f"a message is of channel {message.channel_id}, which its index does not name")
        schema = self._schemas.get(channel.schema_id)
        if schema is None and channel.schema_id:
            raise ChunkError(f"channel {channel.id} is of schema {channel.schema_id}, which there is not")
        return schema, channel, message


def _held(item: Item) -> int:
    return len(item[2].data) + RECORD_COST


def _by_time(items: Iterator[Item]) -> list[Item]:
    out, held = [], 0
    for item in items:
        out.append(item)
        held += _held(item)
        if held > MOST_HELD:
            raise ChunkError("it has no chunks, and too many messages to be put in order")
    out.sort(key=lambda item: item[2].log_time)
    return out
