# SPDX-License-Identifier: Apache-2.0
"""Code for a scene, got beside the executor, which meanwhile answers parameters and services and reports."""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import time
from collections.abc import Callable

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.task import Future

from cable_ros.interpretation import Interpretation, NotKeptError, begin, kept_only
from cable_ros.tracker import Tracker
from cable_ros.warm_up import warm_up

_NAME = "preparation"


class Preparation:
    """Gets the code that a tracker needs in a thread of its own, then hands the tracker over to the executor.

    Args:
        node: whose executor it is.
        tracker: to be left alone until it is handed over.
        done: called by the executor with a tracker of the same scene and settings, and the seconds that it
            took.
        hurry: hand over at once if the code is not kept: the interpreter runs it until it is compiled.
    """

    def __init__(
        self, node: Node, tracker: Tracker, done: Callable[[Tracker, float], None], hurry: bool
    ) -> None:
        self.finished = Future()
        """Done as soon as the tracker is handed over."""
        self._node, self._tracker, self._done = node, tracker, done
        self._error: Exception | None = None
        self._seconds = 0.0
        self._ready = node.create_guard_condition(self._on_ready)
        threading.Thread(target=self._run, args=(hurry,), name=_NAME, daemon=True).start()

    def _run(self, hurry: bool) -> None:
        start = time.perf_counter()
        compiling = None
        try:
            if not (hurry and self._is_kept()):
                compiling = self._interpretation() if hurry else None
                if compiling is None:
                    warm_up(self._tracker)
        except Exception as error:
            self._error = error
        self._seconds = time.perf_counter() - start
        self._hand_over()
        if compiling is not None:
            compiling.wait()
            if Interpretation.stopped:  # the node ends, and has ended the other process
                return
            warm_up(self._copy())
            seconds = time.perf_counter() - start
            self._node.get_logger().info(f"The solver is compiled, after {seconds:.1f} s.")

    def _is_kept(self) -> bool:
        """Load the code; False if some was not kept."""
        try:
            with kept_only():
                warm_up(self._tracker)
            return True
        except NotKeptError:
            self._tracker = self._copy()  # the old one was left amid a solve
            return False

    def _interpretation(self) -> Interpretation | None:
        """Another process that compiles; None if this one is to do that."""
        warn = self._node.get_logger().warning
        Interpretation.tell = lambda sentence: warn(f"{sentence.capitalize()}.")
        return begin(self._tracker.scene)

    def _copy(self) -> Tracker:
        """One that has solved nothing."""
        return Tracker(self._tracker.scene, self._tracker.tolerance, self._tracker.polyline_points)

    def _hand_over(self) -> None:
        with contextlib.suppress(rclpy_implementation.InvalidHandle):  # the node has been taken down
            self._ready.trigger()

    def _on_ready(self) -> None:
        self._node.destroy_guard_condition(self._ready)
        if self._error is not None:
            raise self._error
        self._done(self._tracker, self._seconds)
        self.finished.set_result(None)


def leave(code: int) -> int:
    """Return the exit code; while something compiles, end the process: the interpreter could not cleanly."""
    if Interpretation.current is not None:
        Interpretation.current.leave()
    if any(thread.name == _NAME for thread in threading.enumerate()):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    return code
