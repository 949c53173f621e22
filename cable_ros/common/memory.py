# SPDX-License-Identifier: Apache-2.0
"""Memory that is free, given back to the system."""

import contextlib
import ctypes
import gc


def give_back() -> None:
    """Give back what nothing refers to, and what the C library has kept for later; it is glibc that does."""
    gc.collect()
    with contextlib.suppress(AttributeError, OSError, TypeError):  # another C library
        ctypes.CDLL(None).malloc_trim(0)
