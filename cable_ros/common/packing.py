# SPDX-License-Identifier: Apache-2.0
"""Objects as bytes that take little room, also where most of an array is zeros."""

from __future__ import annotations

import io
import pickle
from typing import Any

import numpy as np

LARGE = 10_000
"""Number of elements from which on an array is looked at: below, its zeros take no room worth the look."""
SPARSE = 0.25
"""Fraction of an array that may differ from zero; beyond, index and value take more than half of its room."""


def pack(thing: Any) -> bytes:
    """`thing` pickled, so that `unpack` gives it back to the last bit.

    The work arrays of a rod in contact are as large as the contacts that it may have, tens of MB, while it
    has a few: of an array of doubles that is mostly zeros only the others are kept.
    """
    buffer = io.BytesIO()
    _Packer(buffer, pickle.HIGHEST_PROTOCOL).dump(thing)
    return buffer.getvalue()


def unpack(packed: bytes) -> Any:
    """What was packed: only from a source that is trusted, as all pickles."""
    return pickle.loads(packed)


class _Packer(pickle.Pickler):
    def reducer_override(self, thing: Any) -> Any:
        if type(thing) is not np.ndarray or thing.dtype != np.float64 or thing.size < LARGE:
            return NotImplemented
        if not thing.flags.c_contiguous:
            return NotImplemented
        values = thing.reshape(-1)
        # by their bits: -0.0 is no zero, and must come back
        places = np.flatnonzero(values.view(np.uint64))
        if len(places) > SPARSE * thing.size:
            return NotImplemented
        return _spread, (thing.shape, places, values[places])


def _spread(shape: tuple[int, ...], places: np.ndarray, values: np.ndarray) -> np.ndarray:
    out = np.zeros(shape)
    out.reshape(-1)[places] = values
    return out
