# SPDX-License-Identifier: Apache-2.0
"""One process at a time does what has a name; the others wait for it."""

from __future__ import annotations

import contextlib
import hashlib
import os
import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path

try:
    from fcntl import LOCK_EX, LOCK_NB, LOCK_UN, lockf
except ImportError:  # on Windows, where nobody waits
    lockf = None  # type: ignore[assignment]

PAUSE = 0.02
"""Time between two tries, s."""
PATIENCE = 900.0
"""Longest wait, s, above what a slow machine takes: a process that is stopped, not ended, keeps its locks."""


@contextlib.contextmanager
def alone(file: Path, name: str) -> Iterator[None]:
    """While no other process that uses this file does what has this name; at once on disks without locks.

    A name is a byte of the file, far from others'; if a process ends, the system unlocks its bytes. Threads
    of a process do not wait for each other.
    """
    place = int.from_bytes(hashlib.sha256(name.encode()).digest()[:6], "little")
    descriptor = None
    with contextlib.suppress(OSError):
        if lockf is not None:
            descriptor = _opened(str(file), os.getpid())
            _lock(descriptor, place)
    try:
        yield
    finally:
        if descriptor is not None:
            with contextlib.suppress(OSError):
                lockf(descriptor, LOCK_UN, 1, place)


@cache
def _opened(file: str, _: int) -> int:
    """A descriptor of the file, one for each process: to close any would unlock all."""
    return os.open(file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)


def _lock(descriptor: int, place: int) -> None:
    end = time.monotonic() + PATIENCE
    while True:
        try:
            lockf(descriptor, LOCK_EX | LOCK_NB, 1, place)
            return
        except (BlockingIOError, PermissionError):  # which of the two depends on the system
            if time.monotonic() > end:
                return
        time.sleep(PAUSE)
