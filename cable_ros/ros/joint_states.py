# SPDX-License-Identifier: Apache-2.0
"""Joint states in: several publishers, partial messages, any order, and what can be wrong with them."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field

import numpy as np

from cable_ros.common.printable import one_line
from cable_ros.ros.cdr_template import Reader
from cable_ros.ros.joint_motion import JointMotion

_NANO = 1_000_000_000
_STAMP_START = 4
_NAMES_START = 12  # header of four bytes, stamp of eight
_MAX_LAYOUTS = 64


@dataclass
class _Layout:
    """What the name list of one publisher means, worked out once."""

    places: list[tuple[int, int]]
    """Index in the message and among the needed joints, of every needed joint that it has."""
    error: str
    warning: str
    key: bytes = b""
    prefix: bytes = b""
    size: int = 0
    format: str = ""
    start: int = 0
    stamp_format: str = ""
    last_stamp: int = 0


class LostMessages:
    """Counts what was published and never received, from the publishers' sequence numbers.

    The middleware does not say which publisher a number is from. Every number is taken as the successor of
    the largest smaller one seen; with several publishers that can swap two, which leaves the sum as it is.
    """

    _FAR = 1000  # a larger step than any pause of ours: another publisher
    _MAX_PUBLISHERS = 16

    def __init__(self) -> None:
        self._last: list[int] = []

    def before(self, sequence: int) -> int:
        """How many messages were lost right before the one with this number."""
        nearest = max((last for last in self._last if 0 < sequence - last <= self._FAR), default=None)
        if nearest is None:
            self._last = [*self._last[-self._MAX_PUBLISHERS + 1 :], sequence]
            return 0
        self._last[self._last.index(nearest)] = sequence
        return sequence - nearest - 1


@dataclass
class Counters:
    """What became of the joint states."""

    received: int = 0
    solved: int = 0
    skipped: int = 0
    """Taken in but not solved, because a newer one had come already."""
    lost: int = 0
    """Published between two that were received: fell out of the queue while the node was busy, or lost on the
    way. From the publishers' sequence numbers, so it needs a middleware that gives them (Fast DDS does)."""
    rejected: int = 0
    """Malformed, see the sentence in the diagnostics."""
    other: int = 0
    """Without any joint that a cable needs."""


@dataclass
class JointStates:
    """The last known position of every needed joint, merged from partial messages.

    Args:
        needed: names of the joints that the scene needs.
        topic: name of the topic, for the sentences.
        motion: tells jumps of the needed joints; None: nobody does.
    """

    needed: tuple[str, ...]
    topic: str
    motion: JointMotion | None = None
    counters: Counters = field(default_factory=Counters)

    def __post_init__(self) -> None:
        self.positions = np.full(len(self.needed), np.nan)
        """(len(needed),) rad or m; NaN = never seen."""
        self.stamp = 0
        """Stamp of the last usable message, ns; 0 = it had none."""
        self.fault = ""
        """Sentence about the last message, empty when nothing was wrong with it."""
        self._layouts: dict[tuple[tuple[str, ...], int, int, int], _Layout] = {}
        self._lost = LostMessages()
        self._complete = False

    def carry_on(self, before: JointStates) -> None:
        """Go on counting where another scene's stopped."""
        self.counters, self._lost = before.counters, before._lost

    def missing(self) -> list[str]:
        """Needed joints that were never seen."""
        if self._complete:
            return []
        unseen = [name for name, value in zip(self.needed, self.positions, strict=True) if np.isnan(value)]
        self._complete = not unseen
        return unseen

    def joints(self) -> dict[str, float]:
        """Position by name of the joints seen so far."""
        values = zip(self.needed, self.positions.tolist(), strict=True)
        return {name: value for name, value in values if self._complete or value == value}

    def take(self, data: bytes, sequence: int | None = None) -> bool:
        """Take in one serialised `sensor_msgs/JointState`.

        Args:
            data: its CDR bytes.
            sequence: the publisher's sequence number, where the middleware gives one.

        Returns:
            Whether there is something to solve: the message was well-formed and had a needed joint. `fault`
            says what was wrong, also where the message could be used all the same.
        """
        self.counters.received += 1
        self.fault = ""
        if sequence:
            self.counters.lost += self._lost.before(sequence)
        try:
            layout = self._layout(data)
            self.fault = layout.warning
            if layout.error:
                raise ValueError(layout.error)
            positions = struct.unpack_from(layout.format, data, layout.start)
            for source, target in layout.places:
                if not math.isfinite(positions[source]):
                    name = self.needed[target]
                    raise ValueError(
                        f"has the position {positions[source]} for '{name}'; a finite number is needed"
                    )
        except ValueError as error:
            self.counters.rejected += 1
            self.fault = f"A joint state on '{self.topic}' {error}; the message is ignored."
            return False
        if not layout.places and self.needed:
            self.counters.other += 1
            return False
        seconds, nanoseconds = struct.unpack_from(layout.stamp_format, data, _STAMP_START)
        self.stamp = seconds * _NANO + nanoseconds
        if 0 < self.stamp < layout.last_stamp:
            behind = (layout.last_stamp - self.stamp) * 1e-9
            self.fault = (
                f"The stamps on '{self.topic}' went back by {behind:.6g} s; solved all the same, on from the "
                "last equilibrium. Call ~/reset if this is the start of a new run."
            )
        layout.last_stamp = self.stamp
        for source, target in layout.places:
            self.positions[target] = positions[source]
        if self.motion is not None and self.stamp > 0:
            moved = ((target, positions[source]) for source, target in layout.places)
            self.fault = self.motion.take(moved, self.stamp) or self.fault
        return True

    def _layout(self, data: bytes) -> _Layout:
        """The layout of this message, from the cache where an earlier one had the same names and lengths."""
        size, prefix = len(data), data[:4]
        for layout in self._layouts.values():
            if layout.size == size and layout.prefix == prefix and data.startswith(layout.key, _NAMES_START):
                return layout
        # Another name list, or the same with other rubbish in its padding bytes.
        reader = Reader(data)
        reader.offset = _NAMES_START
        reader.string()
        names = tuple(reader.strings())
        start, count = reader.doubles()
        key = data[_NAMES_START:start]
        velocities, efforts = reader.doubles()[1], reader.doubles()[1]
        kind = (names, count, velocities, efforts)
        found = self._layouts.get(kind)
        if found is None:
            found = self._new_layout(names, count, {"velocities": velocities, "efforts": efforts})
            if len(self._layouts) >= _MAX_LAYOUTS:
                self._layouts.pop(next(iter(self._layouts)))
            self._layouts[kind] = found
        found.key, found.prefix, found.size = key, prefix, size
        found.format, found.start = f"{reader.order}{count}d", start
        found.stamp_format = reader.order + "iI"
        return found

    def _new_layout(self, names: tuple[str, ...], count: int, others: dict[str, int]) -> _Layout:
        order = {name: index for index, name in enumerate(names)}
        places = [(order[name], index) for index, name in enumerate(self.needed) if name in order]
        error = warning = ""
        if count != len(names):
            error = f"has {count} positions for {len(names)} names; there must be one for each"
        elif len(order) != len(names):
            double = next(name for index, name in enumerate(names) if order[name] != index)
            error = f"names '{one_line(double)}' twice; each joint may be there once"
        for what, length in others.items():
            if length not in (0, len(names)):
                warning = (
                    f"Joint states on '{self.topic}' have {length} {what} for {len(names)} names; "
                    "the positions are used all the same."
                )
        return _Layout(places, error, warning)
