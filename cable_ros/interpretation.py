# SPDX-License-Identifier: Apache-2.0
"""Kernels in the interpreter while another process compiles them: a first answer in seconds, not in a minute.

Kernels give the same numbers compiled and interpreted, but for the last bit of a power or a sine, and take
some fifty times as long. So where the code for a scene is not kept, the process that solves starts one that
compiles it, and takes the code once that has ended. A process that does not live so long ends the other one;
what that has compiled is kept.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import pickle
import subprocess
import sys
import tempfile
import threading
import warnings
from collections.abc import Callable, Iterator
from multiprocessing import parent_process
from typing import Any

import numpy as np

from cable_ros.kept_code import can_keep

ALLOWED = os.environ.get("CABLE_ROS_INTERPRET", "1") != "0"
"""Whether the interpreter may: who measures solves, or must never be slow, waits for the compiler."""
SENTENCE = (
    "the solver is not compiled yet, which another process does now; until then the interpreter solves, as "
    "accurately but some fifty times slower; 'cable compile' compiles ahead"
)
_CHILD = (
    "import pickle, sys; sys.path[:] = pickle.load(sys.stdin.buffer); "
    "from cable_ros.warm_up import warm_up_for; warm_up_for(pickle.load(sys.stdin.buffer))"
)
_LOCK = threading.Lock()


class NotKeptError(Exception):
    """A kernel's code is not kept."""


class _Mine(threading.local):
    """What this thread may do about code that is not kept."""

    scene: object | None = None
    """The one that it solved last."""
    kept_only = False
    compiles = False
    depth = 0
    """Number of interpreted kernels under way."""


_MINE = _Mine()


def solves(scene: object) -> None:
    """Tell for which scene to compile, and that this thread may interpret kernels meanwhile."""
    _MINE.scene = scene


@contextlib.contextmanager
def compiled_here() -> Iterator[None]:
    """What is not kept is compiled by this thread."""
    before, _MINE.compiles = _MINE.compiles, True
    try:
        yield
    finally:
        _MINE.compiles = before


@contextlib.contextmanager
def kept_only() -> Iterator[None]:
    """A kernel whose code is not kept raises NotKeptError."""
    before, _MINE.kept_only = _MINE.kept_only, True
    try:
        yield
    finally:
        _MINE.kept_only = before


def _warn(sentence: str) -> None:
    warnings.warn(sentence, RuntimeWarning, stacklevel=1)


class Interpretation:
    """A process that compiles what a scene needs, and the kernels that are interpreted until it has ended."""

    current: Interpretation | None = None
    """The latest of this process."""
    stopped = False
    """Whether kernels end the program, as by Ctrl-C: an interpreted solve takes seconds."""
    tell: Callable[[str], None] = staticmethod(_warn)
    """Called with `SENTENCE` as one begins."""

    def __init__(self, scene: object) -> None:
        before = Interpretation.current
        self._scenes: list[object] = [*(before._scenes if before else []), scene]
        self._kernels: list[Any] = []
        with tempfile.TemporaryFile() as task:
            pickle.dump(sys.path, task)
            pickle.dump(scene, task)
            task.seek(0)
            self._process = subprocess.Popen(
                [sys.executable, "-c", _CHILD],
                stdin=task,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=os.environ | {"CABLE_ROS_INTERPRET": "0"},
            )
        atexit.register(self.leave)
        Interpretation.current = self
        Interpretation.tell(SENTENCE)

    @property
    def ended(self) -> bool:
        """Whether the process has ended; in a fork of the one that began it, it has."""
        return self._process.poll() is not None

    def has_seen(self, scene: object) -> bool:
        """Whether this process or an earlier one compiled for the scene."""
        return any(one is scene for one in self._scenes)

    def wait(self) -> None:
        """Wait until the process has ended."""
        self._process.wait()

    def leave(self) -> None:
        """End the process, as this one ends."""
        self._process.kill()
        self._process.wait()

    def entry(self, kernel: Any) -> Callable[..., Any]:
        """What runs the `compilation.Kernel` instead of its code."""
        function = kernel.py_func
        if kernel.options.get("no_cpython_wrapper"):  # compiled kernels alone call its code
            return function
        self._kernels.append(kernel)

        def interpreted(*arguments: Any) -> Any:
            if _MINE.depth == 0:
                if Interpretation.stopped:
                    raise KeyboardInterrupt
                if self.ended:
                    self._end()
                    return kernel(*arguments)
            _MINE.depth += 1
            try:
                with np.errstate(all="ignore"):  # as compiled code
                    return function(*arguments)
            finally:
                _MINE.depth -= 1

        return interpreted

    def _end(self) -> None:
        atexit.unregister(self.leave)
        for kernel in self._kernels:
            kernel.forget_entry()


def instead(kernel: Any) -> Callable[..., Any] | None:
    """What runs the `compilation.Kernel`, whose code is not kept; None: this thread is to compile it.

    Raises:
        NotKeptError: within `kept_only`.
    """
    if _MINE.kept_only:
        raise NotKeptError(kernel.__name__)
    if _MINE.scene is None or _MINE.compiles:
        return None
    running = begin(_MINE.scene)
    return None if running is None else running.entry(kernel)


def begin(scene: object) -> Interpretation | None:
    """The process that compiles, one for this scene unless another is under way.

    None where it is of no use: not wanted, there was one for this scene, the code cannot be kept, this is one
    of several processes that solve, or the system starts no other.
    """
    with _LOCK:
        current = Interpretation.current
        if current is not None and not current.ended:
            return current
        if not ALLOWED or parent_process() is not None or not can_keep():
            return None
        if current is not None and current.has_seen(scene):
            return None
        try:
            return Interpretation(scene)
        except OSError:
            return None


def is_under_way() -> bool:
    """Whether kernels are interpreted until another process has compiled them."""
    current = Interpretation.current
    return current is not None and not current.ended
