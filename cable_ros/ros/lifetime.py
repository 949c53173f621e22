"""How a program with a node ends: by SIGINT or SIGTERM at any moment, cleanly and once.

rclpy answers a signal from a thread of its own, which ends the context whenever it gets to it: also between
another thread's look at the context and its use. So that thread is gone before anything is taken down, and
what fails after a signal has failed because of it.
"""

from __future__ import annotations

import contextlib
import signal
import sys
from collections.abc import Callable
from types import TracebackType

import rclpy
from rclpy.executors import ExternalShutdownException

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Lifetime:
    """Context manager for all that a program does with rclpy, from `rclpy.init` on.

    Until `started`, a signal raises KeyboardInterrupt. Later it ends the context, and with it `rclpy.spin`,
    while the callback that is under way goes on: an exception in its midst could part what is published from
    what is logged. Either way the block is left without an exception; other errors pass where no signal came.
    From the end of the block on signals are ignored: a second one must not cut off what is being closed.
    """

    def __init__(self) -> None:
        self._signalled = False
        self._raising = True
        self._at_end = contextlib.ExitStack()

    def __enter__(self) -> Lifetime:
        # Before rclpy's: its handlers call the ones that they find, and uninstalling them puts these back.
        for number in _SIGNALS:
            signal.signal(number, self._on_signal)
        sys.unraisablehook = _tell_unless_interrupted
        return self

    def started(self, close: Callable[[], object]) -> None:
        """From here on `close` is called at the end, and a signal ends the context and raises nothing."""
        self._at_end.callback(close)
        self._raising = False

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        self._raising = False
        rclpy.uninstall_signal_handlers()  # waits for rclpy's thread
        for number in _SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        self._at_end.close()
        rclpy.try_shutdown()
        return self._signalled or isinstance(error, ExternalShutdownException)

    def _on_signal(self, *_: object) -> None:
        self._signalled = True
        raising, self._raising = self._raising, False
        if raising:
            raise KeyboardInterrupt


def _tell_unless_interrupted(lost: sys.UnraisableHookArgs) -> None:
    # An interruption that hits a callback of the compiler is lost there. The context has ended all the same.
    if not isinstance(lost.exc_value, KeyboardInterrupt):
        sys.__unraisablehook__(lost)
