# SPDX-License-Identifier: Apache-2.0
"""A log as a file to read: regular, with the magic of MCAP, and never read beyond its end."""

from __future__ import annotations

import io
from pathlib import Path

from cable_ros.common.regular_file import open_regular
from cable_ros.log.errors import LogError, describe
from cable_ros.log.records import has_magic


class LogFile(io.BufferedReader):
    """The bytes of a log. A read that asks for more than there is allocates no more than there is.

    Raises: LogError where it cannot be read, or is no MCAP file.
    """

    def __init__(self, path: Path) -> None:
        try:
            super().__init__(open_regular(path))
        except OSError as error:
            raise LogError(describe(error, path, "read")) from None
        self.size = self.seek(0, io.SEEK_END)
        """Bytes."""
        if not has_magic(self):
            self.close()
            raise LogError(f"Cannot read {path}: it does not begin as an MCAP file does; name a log (.mcap).")
        self.seek(0)

    def read(self, size: int | None = -1, /) -> bytes:
        """Up to `size` bytes (None or negative: all)."""
        left = max(self.size - self.tell(), 0)
        return super().read(left if size is None or size < 0 else min(size, left))
