# SPDX-License-Identifier: Apache-2.0
"""Sentences that come at every joint state, reported now and then: each kind by itself."""

from __future__ import annotations

import re
import time

PERIOD = 5.0
"""Time, s, between two sentences of a kind."""
MOST_KINDS = 100
_NUMBER = re.compile(r"(?<!\w)[-+]?\d[\d.]*(?:e[-+]?\d+)?")


class Throttle:
    """Lets a sentence pass unless one of its kind, the same but for its numbers, has passed just before."""

    def __init__(self) -> None:
        self._reported: dict[str, float] = {}

    def passes(self, sentence: str) -> bool:
        """Whether to tell it now."""
        kind, now = _NUMBER.sub("#", sentence), time.monotonic()
        if now - self._reported.get(kind, -PERIOD) < PERIOD:
            return False
        self._reported.pop(kind, None)  # the newest last
        self._reported[kind] = now
        if len(self._reported) > MOST_KINDS:
            del self._reported[next(iter(self._reported))]
        return True
