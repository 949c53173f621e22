# SPDX-License-Identifier: Apache-2.0
"""How a program with a node ends: by SIGINT or SIGTERM at any moment, cleanly and once.

rclpy answers a signal from a thread of its own, which ends the context whenever it gets to it: also between
another thread's look at the context and its use. So that thread is gone before anything is taken down, and
what fails after a signal has failed because of it.

Fast DDS can wait for ever in taking down a participant while another one leaves, as when a whole launch is
stopped. So that has a limit.
"""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Callable
from types import TracebackType

import rclpy
from rcl_interfaces.msg import Log
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException
from rclpy.logging import LoggingSeverity
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from cable_ros.interpretation import Interpretation

_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_ROSOUT = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)  # as rcl has it
_FATAL = int(LoggingSeverity.FATAL)
_MATCHED = 6.5
"""Time, s, in which those who listen have heard of a new publisher, as a rule some ms: participants call out
every 3 s, and one of 60 is found by the second call only. Where nobody listens, the process ends so much
later.
"""
_ACKNOWLEDGED = 3.0  # s
_LEAVING = 10.0
"""s that leaving the middleware may take, as a rule some ms; the process ends by SIGALRM then."""


def tell_last(node: Node, sentence: str) -> None:
    """Tell why the node ends before it has begun: on stderr, and on /rosout once those who listen are found.

    The node's own logger would publish at once: to nobody, as the middleware takes its time to match a new
    publisher with those who listen.
    """
    print(f"{node.get_name()}: {sentence}", file=sys.stderr, flush=True)
    publisher = node.create_publisher(Log, "/rosout", _ROSOUT)
    deadline = time.monotonic() + _MATCHED
    while not publisher.get_subscription_count() and time.monotonic() < deadline:
        time.sleep(0.02)
    stamp = node.get_clock().now().to_msg()
    publisher.publish(Log(stamp=stamp, level=_FATAL, name=node.get_logger().name, msg=sentence))
    publisher.wait_for_all_acked(Duration(seconds=_ACKNOWLEDGED))


class Lifetime:
    """Context manager for all that a program does with rclpy, from `rclpy.init` on.

    Until `started`, a signal raises KeyboardInterrupt. Later it ends the context, and with it `rclpy.spin`,
    while the callback that is under way goes on: an exception in its midst could part what is published from
    what is logged. A solve in the interpreter, which takes seconds, ends by one. Either way the block is left
    without an exception; other errors pass where no signal came.
    From the end of the block on signals are ignored: a second one must not cut off what is being closed.
    """

    def __init__(self) -> None:
        self._signalled = False
        self._raising = True
        self._node: Node | None = None
        self._close: Callable[[], object] = lambda: None

    def __enter__(self) -> Lifetime:
        # Before rclpy's: its handlers call the ones that they find, and uninstalling them puts these back.
        for number in _SIGNALS:
            signal.signal(number, self._on_signal)
        sys.unraisablehook = self._on_lost_error
        return self

    def started(self, node: Node, close: Callable[[], object]) -> None:
        """From here on a signal ends the context and raises nothing.

        At the end `close` is called, which may take its time, and then `node` is destroyed.
        """
        self._node, self._close = node, close
        self._raising = False

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        self._raising = False
        rclpy.uninstall_signal_handlers()  # waits for rclpy's thread
        for number in _SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        self._close()
        # Not for Python to handle: what hangs does not let go of the interpreter.
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_REAL, _LEAVING)
        if self._node is not None:
            self._node.destroy_node()
        rclpy.try_shutdown()
        signal.setitimer(signal.ITIMER_REAL, 0)
        return self._signalled or isinstance(error, ExternalShutdownException)

    def _on_signal(self, *_: object) -> None:
        self._signalled = True
        Interpretation.stopped = True
        raising, self._raising = self._raising, False
        if raising:
            raise KeyboardInterrupt

    def _on_lost_error(self, lost: sys.UnraisableHookArgs) -> None:
        # In a callback of the compiler our KeyboardInterrupt is lost; the context has ended all the same.
        if not self._signalled:
            sys.__unraisablehook__(lost)
