# SPDX-License-Identifier: Apache-2.0
"""Replays a log: the logged bytes, with the logged timing and quality of service.

`ros2 run cable_ros cable_replay LOG [--rate R] [--loop] [--topics ...] [--start S] [--duration D] [--clock]`
"""

from __future__ import annotations

import argparse
import importlib
import math
import struct
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import rclpy
from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.utilities import remove_ros_args
from rclpy.validate_topic_name import validate_topic_name
from tqdm import tqdm

from cable_ros.common.arguments import from_zero
from cable_ros.common.printable import one_line
from cable_ros.log.definitions import TYPE_NAME
from cable_ros.log.errors import LogError
from cable_ros.log.qos import qos_from_yaml
from cable_ros.log.reader import LoggedMessage, LoggedTopic, LogReader
from cable_ros.ros.lifetime import Lifetime

_CLOCK = "/clock"
_CLOCK_PERIOD = 0.01  # s of wall time between two clock messages
_LOOK_AROUND = 0.1  # s; how often a long pause looks whether it should stop
_SETTLE = 0.3  # s
_QUIET = 1.0  # s without another topic's first subscriber
_NANO = 1_000_000_000
_MOST_TOPICS = 1000  # each is a publisher
_LAST_CLOCK = (1 << 31) * _NANO  # ns; builtin_interfaces/Time has four bytes for the seconds

EXAMPLE = """example:
  ros2 run cable_ros cable_replay run.mcap --topics /joint_states --rate 2

into a running cable_node: only what it subscribes to. Files of a split log are given in any order."""


@dataclass(frozen=True)
class Window:
    """What is replayed: `topics` (None: all) with start <= log time < end, ns."""

    topics: frozenset[str] | None
    start: int
    end: int


class ReplayNode(Node):
    """Publishes the messages of `logs`, which are in order of time.

    Args:
        logs: finished logs.
        window: which of their messages.
        rate: factor of speed.
        clock: publish the logged time on /clock.
    """

    def __init__(self, logs: Sequence[LogReader], window: Window, rate: float, clock: bool) -> None:
        super().__init__("cable_replay")
        self._logs, self._window, self._rate = logs, window, rate
        self.published = 0
        self.late = 0.0
        """Largest delay of a message behind its time, s."""
        self._publishers_by_topic: dict[str, Any] = {}
        self._latched: set[str] = set()
        for topic in {name: topic for log in logs for name, topic in log.topics.items()}.values():
            if (window.topics is None or topic.name in window.topics) and not (
                clock and topic.name == _CLOCK
            ):
                self._advertise(topic)
        self._clock_publisher = None
        if clock:
            self._clock_publisher = self.create_publisher(
                message_class("rosgraph_msgs/msg/Clock"), _CLOCK, 10
            )
        self._next_clock = -math.inf

    def _advertise(self, topic: LoggedTopic) -> None:
        name, type_name = one_line(topic.name), one_line(topic.type_name)
        try:
            validate_topic_name(topic.name)
            kind = message_class(topic.type_name)
        except InvalidTopicNameException:
            self.get_logger().warning(f"Topic '{name}' is left out: ROS has no topics of such a name.")
            return
        except (ImportError, AttributeError, ValueError):
            self.get_logger().warning(f"Topic {name} is left out: its type {type_name} is not installed.")
            return
        qos = qos_from_yaml(topic.offered_qos)
        try:
            publisher = self.create_publisher(kind, topic.name, qos)
        except (InvalidTopicNameException, RuntimeError, TypeError, ValueError) as error:  # such as too long
            self.get_logger().warning(f"Topic {name} is left out: {one_line(str(error))}.")
            return
        if qos.durability == DurabilityPolicy.TRANSIENT_LOCAL:
            self._latched.add(topic.name)
        self._publishers_by_topic[topic.name] = publisher

    def wait_for_subscribers(self, seconds: float) -> None:
        """Until no further topic finds a subscriber, at most so long: what is sent earlier would be lost.

        Discovery takes 0.1 s as a rule, and now and then some seconds.
        """
        heard, since = 0, time.monotonic()
        deadline = since + seconds
        publishers = self._publishers_by_topic.values()
        while (now := time.monotonic()) < deadline:
            count = sum(publisher.get_subscription_count() > 0 for publisher in publishers)
            if count != heard:
                heard, since = count, now
            # A subscriber sees a publisher a moment after it is seen by it.
            if heard and now - since > (_SETTLE if heard == len(publishers) else _QUIET):
                return
            self._pause(0.02)
        if not heard and seconds:
            self.get_logger().warning(f"Nobody has subscribed within {seconds:g} s; playing all the same.")

    def play(self, progress: Any) -> None:
        """Replay once; `progress` is a tqdm bar of seconds of log.

        Raises: ExternalShutdownException where the process was asked to end.
        """
        begin = self._window.start
        for message in self._latched_before(begin):
            self._publish(message)
        origin = time.monotonic()
        for message in self._messages(self._publishers_by_topic, begin, self._window.end):
            elapsed = (message.log_time - begin) / _NANO
            self._wait_until(origin, elapsed)
            self._publish(message)
            self.late = max(self.late, time.monotonic() - origin - elapsed / self._rate)
            progress.update(elapsed - progress.n)
        progress.update((self._window.end - begin) / _NANO - progress.n)

    def _messages(self, topics: Any, start: int, end: int) -> Iterator[LoggedMessage]:
        for log in self._logs:
            yield from log.messages(list(topics), start, end)

    def _latched_before(self, begin: int) -> list[LoggedMessage]:
        """The last message before the window of each latched topic, which a late joiner would have got."""
        first = min(log.start for log in self._logs)
        if begin <= first or not self._latched:
            return []
        last = {message.topic: message for message in self._messages(self._latched, first, begin)}
        return list(last.values())

    def _publish(self, message: LoggedMessage) -> None:
        self._publishers_by_topic[message.topic].publish(message.cdr)
        self.published += 1

    def _wait_until(self, origin: float, elapsed: float) -> None:
        """Until `elapsed` s of log after `origin`, with the clock going on meanwhile."""
        due = origin + elapsed / self._rate
        while True:
            now = time.monotonic()
            if self._clock_publisher is not None and now >= self._next_clock:
                logged = min((now - origin) * self._rate, elapsed)
                self._publish_clock(self._window.start + int(logged * _NANO))
                self._next_clock = now + _CLOCK_PERIOD
            if now >= due:
                if not rclpy.ok():
                    raise ExternalShutdownException
                return
            self._pause(min(due - now, _CLOCK_PERIOD if self._clock_publisher else _LOOK_AROUND))

    def _publish_clock(self, nanoseconds: int) -> None:
        assert self._clock_publisher is not None
        self._clock_publisher.publish(b"\x00\x01\x00\x00" + struct.pack("<iI", *divmod(nanoseconds, _NANO)))

    def _pause(self, seconds: float) -> None:
        if not rclpy.ok():
            raise ExternalShutdownException
        time.sleep(seconds)

    def finish(self) -> None:
        """Wait, at most a second, until reliable subscribers have everything."""
        deadline = time.monotonic() + 1.0
        for publisher in self._publishers_by_topic.values():
            left = max(deadline - time.monotonic(), 0.0)
            if publisher.qos_profile.reliability == ReliabilityPolicy.RELIABLE:
                publisher.wait_for_all_acked(Duration(seconds=left))

    def close(self) -> None:
        """Say how much there was."""
        print(f"cable_replay: {self.published} messages published", file=sys.stderr)


def message_class(type_name: str) -> Any:
    """The Python class of 'package/msg/Type'. Raises ImportError, AttributeError or ValueError."""
    match = TYPE_NAME.fullmatch(type_name)
    if match is None:  # a log may say anything, and importing runs code
        raise ValueError(f"'{type_name}' is not a message type")
    kind = getattr(importlib.import_module(f"{match[1]}.msg"), match[2])
    kind.get_fields_and_field_types()
    return kind


def window_of(logs: Sequence[LogReader], args: argparse.Namespace) -> Window:
    """What `args` asks for. Raises LogError where the logs do not have it."""
    known = sorted({name for log in logs for name in log.topics})
    for topic in args.topics or ():
        if topic not in known:
            raise LogError(f"{logs[0].path} has no topic '{topic}'; it has {', '.join(known) or 'none'}.")
    if len(args.topics or known) > _MOST_TOPICS:
        raise LogError(f"{logs[0].path} has {len(known)} topics; name at most {_MOST_TOPICS} with --topics.")
    start, end = min(log.start for log in logs), max(log.end for log in logs) + 1
    if not any(topic.count for log in logs for topic in log.topics.values()):
        raise LogError(f"{logs[0].path} holds no message; there is nothing to replay.")
    begin = start + round(args.start * _NANO)
    if begin >= end:
        raise LogError(f"{logs[0].path} is {(end - start) / _NANO:.3f} s long; take a smaller --start.")
    if args.clock and end > _LAST_CLOCK:
        raise LogError(f"{logs[0].path} has times that /clock cannot have; leave --clock out.")
    if args.duration is not None:
        end = min(end, begin + round(args.duration * _NANO))
    return Window(frozenset(args.topics) if args.topics else None, begin, end)


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """The command line, without ROS's own arguments."""
    parser = argparse.ArgumentParser(
        prog="cable_replay",
        description="Publish the messages of a log again, with their timing and quality of service.",
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("log", metavar="LOG", type=Path, nargs="+", help="finished log (.mcap)")
    parser.add_argument(
        "--rate", metavar="R", type=_positive, default=1.0, help="factor of speed (default 1)"
    )
    parser.add_argument("--loop", action="store_true", help="begin again at the end, until interrupted")
    parser.add_argument("--topics", metavar="TOPIC", nargs="+", help="only these (default: all)")
    parser.add_argument("--start", metavar="S", type=from_zero, default=0.0, help="skip the first S s")
    parser.add_argument("--duration", metavar="D", type=_positive, help="stop after D s of the log")
    parser.add_argument("--clock", action="store_true", help="publish the logged time on /clock, at 100 Hz")
    parser.add_argument(
        "--wait",
        metavar="S",
        type=from_zero,
        default=5.0,
        help="wait up to S s for subscribers, less where no more of them come (default 5)",
    )
    return parser.parse_args(arguments)


def _positive(text: str) -> float:
    value = from_zero(text)
    if value == 0:
        raise argparse.ArgumentTypeError(f"'{text}' is not a number above 0")
    return value


def main(args: Sequence[str] | None = None) -> int:
    """Replay until the end, SIGINT or SIGTERM.

    Returns:
        0 after the end or a clean stop; 2 where it could not start, with the reason on stderr.
    """
    argv = list(sys.argv if args is None else ["cable_replay", *args])
    options = parse(remove_ros_args(argv)[1:])
    try:
        with Lifetime() as lifetime, ExitStack() as stack:
            logs = [stack.enter_context(LogReader(path)) for path in options.log]
            logs.sort(key=lambda log: log.start)
            window = window_of(logs, options)
            rclpy.init(args=argv)
            node = ReplayNode(logs, window, options.rate, options.clock)
            lifetime.started(node, node.close)
            _run(node, window, options)
    except LogError as error:
        print(f"cable_replay: {error}", file=sys.stderr)
        return 2
    return 0


def _run(node: ReplayNode, window: Window, options: argparse.Namespace) -> None:
    node.wait_for_subscribers(options.wait)
    seconds = (window.end - window.start) / _NANO
    while True:
        # disable=None: no bar where nobody looks, as in a launch file.
        with tqdm(total=round(seconds, 3), unit="s", desc="replay", disable=None) as progress:
            node.play(progress)
        if not options.loop:
            break
    node.finish()
    if node.late > 0.1:
        node.get_logger().warning(
            f"Messages were up to {node.late:.2f} s late; take a lower --rate or fewer --topics."
        )


if __name__ == "__main__":
    sys.exit(main())
