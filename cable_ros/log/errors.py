# SPDX-License-Identifier: Apache-2.0
"""What goes wrong with a log, as sentences that say what to do about it."""

from __future__ import annotations

import errno
from pathlib import Path

from cable_ros.common.printable import one_line

RECOVER = "what it already holds can be saved with 'cable log recover {path}'"

_REMEDIES = {
    errno.ENOSPC: "the disk is full; free some space, or write the log to another disk",
    errno.EDQUOT: "the disk quota is used up; free some space, or write the log to another disk",
    errno.EFBIG: "the file has reached the largest size allowed; split the log into smaller files",
    errno.EROFS: "the disk is mounted read-only; write the log to another folder",
    errno.EACCES: "this user may not write there; write the log to another folder",
    errno.EPERM: "this user may not write there; write the log to another folder",
    errno.ENOTDIR: "a part of its path is a file, not a folder; write the log to another folder",
    errno.EEXIST: "it exists already and logs never overwrite; choose another name",
    errno.ENOENT: "there is no such file or folder; check the path",
    errno.EISDIR: "it is a folder; name a file",
    errno.EIO: "the disk reports an input/output error; check its health",
}


class LogError(ValueError):
    """A log that cannot be written or read: one sentence with the file and a remedy."""

    def __init__(self, sentence: str) -> None:
        super().__init__(one_line(sentence))  # names from a file may hold anything


def describe(error: OSError, path: Path, doing: str) -> str:
    """One sentence: which file, what failed, what to do. `doing` is a verb: 'write', 'read'."""
    remedy = _REMEDIES.get(error.errno or 0, error.strerror or str(error))
    return f"Cannot {doing} {path}: {remedy}."
