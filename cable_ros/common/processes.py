# SPDX-License-Identifier: Apache-2.0
"""Where work is done: in this process, in several of this machine, or wherever an executor does it."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from multiprocessing import connection
from typing import Any

ALONE = 0.5
"""Time, s, that this process works before others start: what is done by then needs none."""
GRACE = 5.0
"""Time, s, in which an executor should have seen that a process has ended."""
RENEWALS = 3
"""Number of times that processes are started again after one has died: more is no accident."""
SINGLE_THREADED = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


class WorkersDiedError(RuntimeError):
    """Processes died, and starting them again did not help; the text is one sentence."""


class Here:
    """Work is done in this process, at once."""

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """The future of `function(*arguments)`."""
        future: Future[Any] = Future()
        future.set_result(function(*arguments))
        return future

    def __enter__(self) -> Here:
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: Any) -> None:
        """End what was started."""


class Elsewhere(Here):
    """Work is done by an executor, which remains the caller's."""

    def __init__(self, executor: Executor) -> None:
        self._executor = executor

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """As `Executor.submit`."""
        return self._executor.submit(function, *arguments)


class Processes(Here):
    """Work is done by processes of this machine, and by this one until they are up.

    A new process takes seconds to import and load the compiled solver, unless it is a fork of this one.
    This one works on meanwhile, so that several are not later than one, and starts them only when there is
    work for more than a moment.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._begin = time.monotonic()
        self._first: tuple[Any, ...] = ()
        self._executor: ProcessPoolExecutor | None = None
        self._children: set[Any] = set()
        self._loaded: list[Future[Any]] = []
        self._renewals = 0

    @property
    def _up(self) -> bool:
        return self._renewals > 0 or any(future.done() for future in self._loaded)

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """The future of `function(*arguments)`, done by this process until others are up.

        After a process has died, which the futures of all tell by a BrokenExecutor, others are started.

        Raises:
            WorkersDiedError: none has ever done anything, or they died again and again.
        """
        if self._executor is not None and self._up:
            try:
                return self._executor.submit(function, *arguments)
            except BrokenExecutor as error:
                return self._renewed(error).submit(function, *arguments)
        out = super().submit(function, *arguments)
        if self._executor is None and time.monotonic() - self._begin > ALONE:
            self._first = function, *arguments
            self._start()
        return out

    def _renewed(self, error: BrokenExecutor) -> ProcessPoolExecutor:
        """Other processes, after one has died."""
        assert self._executor is not None
        self._executor.shutdown()  # settles its futures
        worked = self._renewals > 0 or any(future.exception() is None for future in self._loaded)
        if not worked or self._renewals == RENEWALS:
            raise WorkersDiedError(
                f"the {self._count} processes that solve died {self._renewals + 1} times; the memory may be "
                "too small for so many, or the script that starts them lacks `if __name__ == '__main__':`"
            ) from error
        self._renewals += 1
        return self._start()

    def _start(self) -> ProcessPoolExecutor:
        """Start the processes, which do the first piece of work once more: that loads the code they need."""
        self._executor = ProcessPoolExecutor(
            self._count,
            multiprocessing.get_context(_start_method()),
            initializer=signal.signal,
            initargs=(signal.SIGINT, signal.SIG_IGN),
        )
        before = set(multiprocessing.active_children())
        with _single_threaded():  # the processes are the parallelism
            self._loaded = [self._executor.submit(*self._first) for _ in range(self._count)]
        self._children = set(multiprocessing.active_children()) - before
        threading.Thread(target=_watch, args=(self._executor, self._children), daemon=True).start()
        return self._executor

    def __exit__(self, kind: type[BaseException] | None, *rest: Any) -> None:
        """End the processes; at once if they are not up yet or an exception has come."""
        if self._executor is None:
            return
        if kind is not None or not self._up:
            for child in self._children:
                child.terminate()
        self._executor.shutdown(cancel_futures=True)


def _watch(executor: ProcessPoolExecutor, children: set[Any]) -> None:
    """Let an executor go on that waits for the rest of a message from a process which has died amid it.

    Its own thread then reads for ever, and who waits for that as long: the pipe stays open, as this process
    holds its other end, too. So that end is made one of nothing, and the executor ends as after any death.
    """
    thread = getattr(executor, "_executor_manager_thread", None)
    writer = getattr(getattr(executor, "_result_queue", None), "_writer", None)
    if thread is None or writer is None:  # another Python, whose executor is made otherwise
        return
    connection.wait([child.sentinel for child in children])
    thread.join(GRACE)
    if not thread.is_alive():
        return
    for child in children:
        child.kill()
    for child in children:
        child.join()
    thread.join(GRACE)
    if thread.is_alive():  # it reads; until it has ended nobody closes what it reads from
        with open(os.devnull, "wb") as nothing:
            os.dup2(nothing.fileno(), writer.fileno(), inheritable=False)


def _start_method() -> str:
    """How: a fork has all code loaded, at no cost, but what other threads hold stays locked in it."""
    return "fork" if sys.platform == "linux" and threading.active_count() == 1 else "spawn"


@contextlib.contextmanager
def _single_threaded() -> Iterator[None]:
    """Processes started meanwhile have libraries that use one thread."""
    before = {name: os.environ.get(name) for name in SINGLE_THREADED}
    os.environ.update(dict.fromkeys(SINGLE_THREADED, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
