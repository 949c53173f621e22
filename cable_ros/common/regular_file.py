# SPDX-License-Identifier: Apache-2.0
"""Opens what a user or a scene names only if it is a regular file."""

from __future__ import annotations

import errno
import io
import os
import stat
from pathlib import Path


class NotRegularFileError(OSError):
    """A device, a pipe or a socket: reading it may never end, or never begin."""


def open_regular(path: Path) -> io.FileIO:
    """The file, open for reading, not buffered.

    Raises:
        NotRegularFileError: it is no regular file.
        OSError: it cannot be opened, or is a folder.
    """
    if "\0" in str(path):
        raise OSError(errno.EINVAL, "its name holds a zero byte; name a file")
    _check(os.stat(path).st_mode, path)  # before opening it: that alone can do something to a device
    # Not blocking, and checked once more: a pipe may have taken the file's place.
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        _check(os.fstat(descriptor).st_mode, path)
        return io.FileIO(descriptor, "r")
    except BaseException:
        os.close(descriptor)
        raise


def _check(mode: int, path: Path) -> None:
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    if not stat.S_ISREG(mode):
        raise NotRegularFileError(
            errno.EINVAL, "it is a device, a pipe or a socket; name a regular file", str(path)
        )
