# SPDX-License-Identifier: Apache-2.0
"""CDR, the wire format of ROS 2 messages: serialise once, then overwrite the numbers in place.

Plain CDR as DDS and MCAP carry it: a header of four bytes, then every primitive aligned to its own size,
counted from the end of that header (OMG formal/2023-01-02 "DDS-RTPS" 10.5, "DDS-XTypes" 7.4.1). Nothing here
imports ROS: a message is any object with `get_fields_and_field_types()`.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np

HEADER = b"\x00\x01\x00\x00"
"""Encapsulation header: plain CDR, little endian."""

_CODES = {
    "boolean": "?",
    "octet": "B",
    "uint8": "B",
    "int8": "b",
    "int16": "h",
    "uint16": "H",
    "int32": "i",
    "uint32": "I",
    "int64": "q",
    "uint64": "Q",
    "float": "f",
    "double": "d",
}
_SEQUENCE = re.compile(r"sequence<([^,>]+)(?:, *\d+)?>$")
_ARRAY = re.compile(r"(.+)\[(\d+)\]$")
_TIME = "builtin_interfaces/Time"


class _Encoder:
    """Writes one message and notes where each number, and each text, went."""

    def __init__(self) -> None:
        self.body = bytearray()
        self.offsets: dict[str, int] = {}
        self.stamps: list[int] = []

    def _align(self, size: int) -> None:
        self.body.extend(bytes(-len(self.body) % size))

    def _number(self, path: str, code: str, value: Any) -> None:
        self._align(struct.calcsize(code))
        self.offsets[path] = len(self.body)
        self.body += struct.pack("<" + code, value[0] if isinstance(value, bytes) else value)

    def field(self, path: str, kind: str, value: Any) -> None:
        if code := _CODES.get(kind):
            self._number(path, code, value)
        elif kind.startswith("string"):
            text = value.encode()
            self._number(path + ".length", "I", len(text) + 1)
            self.offsets[path] = len(self.body)
            self.body += text + b"\0"
        elif match := _SEQUENCE.match(kind):
            self._number(path + ".length", "I", len(value))
            self._elements(path, match[1], value)
        elif match := _ARRAY.match(kind):
            self._elements(path, match[1], value)
        elif hasattr(value, "get_fields_and_field_types"):
            if kind == _TIME:
                self._align(4)
                self.stamps.append(len(self.body))
            for name, inner in value.get_fields_and_field_types().items():
                self.field(f"{path}.{name}" if path else name, inner, getattr(value, name))
        else:
            raise TypeError(f"Field '{path}' has the type '{kind}', which this serialiser does not know.")

    def _elements(self, path: str, kind: str, values: Any) -> None:
        for index, value in enumerate(values):
            self.field(f"{path}[{index}]", kind, value)


def serialise(message: Any) -> bytes:
    """The CDR bytes of a ROS message; padding is zero, so equal messages give equal bytes."""
    encoder = _Encoder()
    encoder.field("", "", message)
    return HEADER + bytes(encoder.body)


class Template:
    """One message of fixed layout: strings and lengths stay, numbers are overwritten through NumPy views.

    Args:
        message: the message whose strings and sequence lengths are kept.
    """

    def __init__(self, message: Any) -> None:
        encoder = _Encoder()
        encoder.field("", "", message)
        self._offsets = encoder.offsets
        size = len(HEADER) + len(encoder.body)
        # The header is put at offset 4, so that the body, and with it every number, is aligned in memory.
        self._storage = np.zeros(8 + size, dtype=np.uint8)
        self._message = self._storage[4 : 4 + size]
        self._message[:] = np.frombuffer(HEADER + bytes(encoder.body), dtype=np.uint8)
        self._words = self._storage[: len(self._storage) // 4 * 4].view(np.uint32).data
        self._stamps = [2 + offset // 4 for offset in encoder.stamps]

    def view(self, path: str, columns: int, rows: int | None = None, dtype: Any = np.float64) -> np.ndarray:
        """Writable view of `columns` neighbouring numbers, or of such a row in each element of a sequence.

        Args:
            path: the first number, e.g. "wrench.force.x"; with `rows`, braces stand for the element's index,
                e.g. "poses[{}].pose.position.x".
            columns: how many numbers of `dtype` follow one another; of a text, its bytes as `np.uint8`.
            rows: number of elements, or None for a single row.

        Returns:
            (columns,) or (rows, columns) array.

        Raises:
            KeyError: there is no such number.
            ValueError: the elements don't lie at equal distances.
        """
        starts = np.array([self._offsets[path.format(row)] for row in range(1 if rows is None else rows)])
        steps = np.diff(starts)
        if steps.size and np.any(steps != steps[0]):
            raise ValueError(f"The elements of '{path}' do not lie at equal distances.")
        item = np.dtype(dtype).itemsize
        strides = (int(steps[0]) if steps.size else item, item)
        full: np.ndarray = np.ndarray(
            (len(starts), columns),
            dtype,
            buffer=self._storage.data,
            offset=8 + int(starts[0]),
            strides=strides,
        )
        return full[0] if rows is None else full

    def stamp(self, seconds: int, nanoseconds: int) -> None:
        """Set every `builtin_interfaces/Time` of the message (not durations)."""
        # Seconds are signed on the wire; the mask keeps a negative one's two's complement.
        seconds &= 0xFFFFFFFF
        for at in self._stamps:  # mostly one: a tenth of the time of an array's
            self._words[at], self._words[at + 1] = seconds, nanoseconds

    def to_bytes(self) -> bytes:
        """The message as it is now: what to publish and what to log."""
        return self._message.tobytes()


class Reader:
    """Reads primitives from CDR bytes, in either byte order.

    Raises:
        ValueError: the bytes are not plain CDR.
    """

    def __init__(self, data: bytes) -> None:
        if len(data) < 4 or data[0] != 0 or data[1] not in (0, 1):
            raise ValueError(f"is not plain CDR (it starts with {data[:4].hex(' ') or 'nothing'})")
        self.order = "<" if data[1] else ">"
        self.data = data
        self.offset = 4

    def number(self, code: str) -> Any:
        """One number of the `struct` format `code`."""
        size = struct.calcsize(code)
        start = self.offset + (4 - self.offset) % size
        try:
            (value,) = struct.unpack_from(self.order + code, self.data, start)
        except struct.error:
            raise ValueError(f"ends after {len(self.data)} bytes, in the middle of a field") from None
        self.offset = start + size
        return value

    def string(self) -> str:
        """One string."""
        size = self.number("I")
        end = self.offset + size
        if end > len(self.data):
            raise ValueError(f"has a string of {size} bytes, longer than the message")
        text = self.data[self.offset : end].rstrip(b"\0").decode(errors="replace")
        self.offset = end
        return text

    def strings(self) -> Iterator[str]:
        """A sequence of strings."""
        for _ in range(self.number("I")):
            yield self.string()

    def doubles(self) -> tuple[int, int]:
        """A sequence of doubles, skipped: its offset in the bytes and its length."""
        count = self.number("I")
        start = self.offset + ((4 - self.offset) % 8 if count else 0)
        if start + 8 * count > len(self.data):
            raise ValueError(f"has a sequence of {count} numbers, longer than the message")
        self.offset = start + 8 * count
        return start, count
