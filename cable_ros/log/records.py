# SPDX-License-Identifier: Apache-2.0
"""The records of an MCAP file one after the other, as far as they are whole."""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO

from mcap import records
from mcap.opcode import Opcode
from mcap.stream_reader import MAGIC_SIZE
from mcap.writer import MCAP0_MAGIC

from cable_ros.log import chunks

_HEADER = struct.Struct("<BQ")
_KINDS = {
    Opcode.HEADER: records.Header,
    Opcode.SCHEMA: records.Schema,
    Opcode.CHANNEL: records.Channel,
    Opcode.ATTACHMENT: records.Attachment,
    Opcode.METADATA: records.Metadata,
}
_MOST_DAMAGES = 1000  # of single records; what comes after them is one more


@dataclass(frozen=True)
class Damage:
    """A stretch of the file that could not be read: `size` bytes from `offset` on, and what it was."""

    offset: int
    size: int
    what: str


def has_magic(stream: IO[bytes]) -> bool:
    """Whether the file begins as every MCAP file does."""
    stream.seek(0)
    return stream.read(MAGIC_SIZE) == MCAP0_MAGIC


def whole_records(stream: IO[bytes]) -> Iterator[records.McapRecord | Damage]:
    """Header, schemas, channels, messages, attachments and metadata in the order of the file.

    Chunks are opened, and those that are damaged or hold too much reported as Damage; reading ends where the
    data section ends, or with the Damage of the first record that is not whole, or after too many. Only one
    chunk at a time is in memory.
    """
    size = stream.seek(0, io.SEEK_END)
    allowance = chunks.Allowance(size)
    stream.seek(MAGIC_SIZE)
    damages = 0
    while True:
        offset = stream.tell()
        header = stream.read(_HEADER.size)
        if not header:
            yield Damage(offset, 0, "end of the file, without its index")
            return
        if len(header) < _HEADER.size:
            yield Damage(offset, size - offset, "begin of a record")
            return
        opcode, length = _HEADER.unpack(header)
        if opcode == Opcode.DATA_END:
            return
        if not 0 < opcode <= max(Opcode) and opcode < 0x80:
            yield Damage(offset, size - offset, "what should be a record and is not")
            return
        if offset + _HEADER.size + length > size:
            yield Damage(offset, size - offset, f"unfinished {_name(opcode)}")
            return
        end = offset + _HEADER.size + length
        try:
            if length > chunks.MOST_RECORD_BYTES:
                raise chunks.ChunkError(f"of more than {chunks.MOST_RECORD_BYTES >> 20} MB")
            if opcode in _KINDS or opcode in (Opcode.CHUNK, Opcode.MESSAGE):
                yield from _parse(Opcode(opcode), stream.read(length), allowance)
        except chunks.AllowanceError as error:
            yield Damage(offset, size - offset, f"all from here on: {error}")
            return
        except chunks.ChunkError as error:
            damages += 1
            if damages > _MOST_DAMAGES:
                yield Damage(offset, size - offset, "all from here on: nothing but damaged records")
                return
            yield Damage(offset, end - offset, f"damaged {_name(opcode)}: {error}")
        stream.seek(end)


def _parse(opcode: Opcode, body: bytes, allowance: chunks.Allowance) -> Iterator[records.McapRecord]:
    """What one record holds; a chunk is whole or left out."""
    if opcode == Opcode.MESSAGE:
        yield chunks.message(body)
    elif opcode == Opcode.CHUNK:
        yield from chunks.open_chunk(chunks.read_chunk(body), allowance)
    else:
        yield chunks.parsed(_KINDS[opcode], body)


def _name(opcode: int) -> str:
    return Opcode(opcode).name.lower().replace("_", " ") if opcode in list(Opcode) else f"record {opcode}"
