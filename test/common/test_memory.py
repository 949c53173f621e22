# SPDX-License-Identifier: Apache-2.0
"""Free memory goes back to the system."""

from __future__ import annotations

import ctypes
import sys
from pathlib import Path

import pytest

from cable_ros.common import memory
from cable_ros.common.memory import give_back

STATUS = Path("/proc/self/status")


def resident() -> float:
    """Memory of this process, MB."""
    (line,) = (line for line in STATUS.read_text().splitlines() if line.startswith("VmRSS"))
    return int(line.split()[1]) / 1024


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "malloc_trim"), reason="glibc only")
def test_memory_between_what_is_in_use_is_given_back():
    """40,000 pieces of 2 kB; every 500th stays, so that the C library keeps what is free before it."""
    pieces = [bytearray(2048) for _ in range(40_000)]
    left = pieces[::500]
    del pieces
    before = resident()
    give_back()
    assert resident() < before - 60.0  # of 82 MB; pages with a piece that stays are 0.3
    assert len(left) == 80


@pytest.mark.skipif(not Path("/proc/self/maps").exists(), reason="Linux only")
def test_code_that_rests_is_given_back_and_read_again(monkeypatch):
    """The interpreter's own, of which a part is back at once."""
    library = "libpython" if memory.code_of("libpython") else Path(sys.executable).resolve().name
    monkeypatch.setattr(memory, "STARTER", library)
    pieces = memory.code_of(library)
    assert sum(length for _, length in pieces) > 1e6
    before = resident()
    give_back()
    assert resident() < before
    assert sorted([3, 1, 2]) == [1, 2, 3]
