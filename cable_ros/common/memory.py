# SPDX-License-Identifier: Apache-2.0
"""Memory that is free, given back to the system."""

import contextlib
import ctypes
import gc
from pathlib import Path

STARTER = "libllvmlite"
"""Library that links kept code at the start and rests afterwards."""
_DONTNEED = 4
"""Advice to Linux: forget these pages of a file; it reads them again if they are needed."""


def give_back() -> None:
    """Give back what nothing refers to, what the C library has kept for later, and the linker's code.

    It is glibc and Linux that do; elsewhere nothing is given back.
    """
    gc.collect()
    with contextlib.suppress(AttributeError, OSError, TypeError):  # another C library or system
        library = ctypes.CDLL(None)
        library.malloc_trim(0)
        for start, length in code_of(STARTER):
            library.madvise(ctypes.c_void_p(start), ctypes.c_size_t(length), _DONTNEED)


def code_of(library: str) -> list[tuple[int, int]]:
    """Address and length of each piece of a loaded library's code, which nobody writes to."""
    out = []
    for line in Path("/proc/self/maps").read_text(encoding="utf-8").splitlines():
        place, allowed, *_, file = line.split()
        if allowed == "r-xp" and Path(file).name.startswith(library):
            start, end = (int(one, 16) for one in place.split("-"))
            out.append((start, end - start))
    return out
