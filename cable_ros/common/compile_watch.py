# SPDX-License-Identifier: Apache-2.0
"""What compiling costs: its time, which is no part of a solve, and a word about it while it lasts.

`kernel_compiler` calls `listen`; until then this file does without Numba.
"""

from __future__ import annotations

import contextlib
import gc
import threading
import time
from collections.abc import Callable, Iterator
from functools import cache

NOTICE = 1.0
"""Duration of compiling, s, after which `Watch.tell` is called."""


class Watch:
    """Time between starts and ends that may be nested, of each thread by itself."""

    def __init__(self) -> None:
        self._mine = _Span()
        self.tell: Callable[[], None] | None = None
        """Called once, at the first event after more than `NOTICE`."""

    @property
    def seconds(self) -> float:
        """Time that the calling thread has spent, without a span that has not ended."""
        return self._mine.past

    def on_start(self) -> None:
        """Take a start."""
        mine = self._mine
        if mine.depth == 0:
            mine.begin = time.perf_counter()
        mine.depth += 1
        self._notice(mine)

    def on_end(self) -> None:
        """Take an end."""
        mine = self._mine
        mine.depth -= 1
        if mine.depth == 0:
            mine.past += time.perf_counter() - mine.begin
        self._notice(mine)

    @contextlib.contextmanager
    def span(self) -> Iterator[None]:
        """From a start to its end."""
        self.on_start()
        try:
            yield
        finally:
            self.on_end()

    def _notice(self, mine: _Span) -> None:
        if self.tell is None:
            return
        if mine.past + (time.perf_counter() - mine.begin if mine.depth else 0.0) > NOTICE:
            tell, self.tell = self.tell, None
            tell()


class _Span(threading.local):
    """State of a watch in one thread."""

    depth = 0
    begin = 0.0
    past = 0.0


COMPILING = Watch()
"""Compilation of code that was not kept from an earlier time."""
GETTING = Watch()
"""The same, and loading of code that was kept."""


@cache
def listen() -> None:
    """Let the watches hear of Numba's work; once in a process."""
    from numba.core import event

    class Pause(event.Listener):
        """No search for garbage amid the compiler's millions of objects: about a fifth of its time."""

        nested = 0  # one thread at a time compiles
        resume = False

        def on_start(self, _: object) -> None:
            if self.nested == 0:
                self.resume = gc.isenabled()
                gc.disable()
            self.nested += 1

        def on_end(self, _: object) -> None:
            self.nested -= 1
            if self.nested == 0 and self.resume:
                gc.enable()

    class Listener(event.Listener):
        def __init__(self, watch: Watch) -> None:
            self._watch = watch

        def on_start(self, _: object) -> None:
            self._watch.on_start()

        def on_end(self, _: object) -> None:
            self._watch.on_end()

    event.register("numba:compile", Listener(COMPILING))
    event.register("numba:compile", Pause())
    event.register("numba:compiler_lock", Listener(GETTING))
