# SPDX-License-Identifier: Apache-2.0
"""A file that has its own name only once it is whole."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import io
import os
from pathlib import Path

from cable_ros.log.errors import LogError, describe

SUFFIX = ".part"
"""Of a log that is being written, or whose writer was killed: a name without it is whole."""


class UnfinishedFile:
    """A new file, called `path` + `suffix` until `finish`.

    `stream` buffers up to `buffer_bytes`. `takes_over`: one that a killed process left under the unfinished
    name is overwritten, if nobody writes it any more.

    Raises: LogError where `path` exists or the file cannot be made.
    """

    def __init__(
        self, path: Path, buffer_bytes: int, suffix: str = SUFFIX, *, takes_over: bool = False
    ) -> None:
        self.path = path
        self.part_path = path.with_name(path.name + suffix)
        try:
            for existing in (path,) if takes_over else (path, self.part_path):
                if existing.exists():
                    raise LogError(describe(FileExistsError(errno.EEXIST, ""), existing, "write"))
            if path.parent.exists() and not path.parent.is_dir():
                raise NotADirectoryError(errno.ENOTDIR, "")
            path.parent.mkdir(parents=True, exist_ok=True)
            raw = _take_over(self.part_path) if takes_over else io.FileIO(self.part_path, "xb")
            self.stream = io.BufferedWriter(raw, buffer_bytes)
        except BlockingIOError:
            raise LogError(
                f"Cannot write {path}: another process is writing {self.part_path}; wait for it to end."
            ) from None
        except OSError as error:
            raise LogError(describe(error, path, "write")) from None

    def sync(self) -> None:
        """Everything so far to the disk: a power cut loses nothing of it. Raises OSError."""
        self.stream.flush()
        os.fdatasync(self.stream.fileno())

    def finish(self) -> None:
        """Give the file its own name, never over an existing file. Raises OSError."""
        self.sync()
        self.stream.close()
        # The empty placeholder reserves the name on any file system; replacing it is atomic.
        os.close(os.open(self.path, os.O_CREAT | os.O_EXCL | os.O_WRONLY))
        os.replace(self.part_path, self.path)
        folder = os.open(self.path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)

    def abandon(self) -> None:
        """Close as it is, as after a failed write; the '.part' file stays for recovery."""
        try:
            self.stream.close()
        except OSError:
            with contextlib.suppress(OSError):
                self.stream.raw.close()

    def discard(self) -> None:
        """Close and remove it."""
        self.abandon()
        with contextlib.suppress(OSError):
            self.part_path.unlink()


def _take_over(path: Path) -> io.FileIO:
    """The file, empty, and locked while it is open. Raises BlockingIOError where another has it locked."""
    file = io.FileIO(os.open(path, os.O_CREAT | os.O_WRONLY | os.O_CLOEXEC | os.O_NOFOLLOW, 0o666), "w")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        file.truncate(0)
    except BaseException:
        file.close()
        raise
    return file
