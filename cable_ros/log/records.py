"""The records of an MCAP file one after the other, as far as they are whole."""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO

from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.stream_reader import MAGIC_SIZE, breakup_chunk
from mcap.writer import MCAP0_MAGIC

_HEADER = struct.Struct("<BQ")
_READERS = {
    Opcode.HEADER: records.Header.read,
    Opcode.SCHEMA: records.Schema.read,
    Opcode.CHANNEL: records.Channel.read,
    Opcode.CHUNK: records.Chunk.read,
    Opcode.ATTACHMENT: records.Attachment.read,
    Opcode.METADATA: records.Metadata.read,
}


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

    Chunks are opened, and those whose checksum is wrong reported as Damage; reading ends where the data
    section ends, or with the Damage of the first record that is not whole. Only one chunk at a time is in
    memory.
    """
    size = stream.seek(0, io.SEEK_END)
    stream.seek(MAGIC_SIZE)
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
        yield from _parse(opcode, stream.read(length), offset)


def _parse(opcode: int, body: bytes, offset: int) -> list[records.McapRecord | Damage]:
    """What one record holds; a chunk is whole or left out."""
    stream = ReadDataStream(io.BytesIO(body))
    try:
        if opcode == Opcode.MESSAGE:
            return [records.Message.read(stream, len(body))]
        if opcode not in _READERS:
            return []
        record = _READERS[Opcode(opcode)](stream)
        if isinstance(record, records.Chunk):
            return list(breakup_chunk(record, validate_crc=True))
        return [record]
    except Exception:  # zstandard, lz4, mcap and struct each have errors of their own for wrong bytes
        return [Damage(offset, _HEADER.size + len(body), f"damaged {_name(opcode)}")]


def _name(opcode: int) -> str:
    return Opcode(opcode).name.lower().replace("_", " ") if opcode in list(Opcode) else f"record {opcode}"
