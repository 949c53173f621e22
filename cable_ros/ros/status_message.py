# SPDX-License-Identifier: Apache-2.0
"""`~/status`: may a controller use what was published for a joint state? Sent for every one that is solved.

A `diagnostic_msgs/DiagnosticArray`, as no other common interface has a stamp and, by name, values of several
kinds: an entry for each cable, always the same keys in the same order.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from cable_ros.equilibrium import Equilibrium, Status
from cable_ros.ros.cable_outputs import level
from cable_ros.ros.cdr_template import Template
from cable_ros.ros.messages import set_stamp

CODES = {
    Status.CONVERGED: 0,
    Status.SNAPPED: 1,
    Status.UNFINISHED: 2,
    Status.BRANCH_LOST: 3,
    Status.OUT_OF_REACH: 4,
    Status.NOT_CONVERGED: 5,
    Status.INVALID_INPUT: 6,
}
"""Number of each status in the message. Controllers keep them: new ones come after, none changes."""

NUMBERS = ("error estimate", "stability margin", "age of the last trusted [s]")
"""Keys whose values change with every message; written with six digits and equal width."""
_WIDTH = 13  # of -1.23457e-105
_MAX_TEMPLATES = 64


class _Filled:
    """The message of one combination of statuses, and the places of its numbers."""

    def __init__(self, hardware_id: str, cables: Sequence[str], found: Sequence[Equilibrium]) -> None:
        message = DiagnosticArray()
        for name, equilibrium in zip(cables, found, strict=True):
            status = equilibrium.status
            fixed = {
                "status": status.name,
                "code": str(CODES[status]),
                "trusted": str(status.trusted).lower(),
                "overlaps": str(equilibrium.overlapping).lower(),
            }
            values = fixed | dict.fromkeys(NUMBERS, " " * _WIDTH)
            message.status.append(
                DiagnosticStatus(
                    name=name,
                    level=level(equilibrium),
                    message=status.sentence,
                    hardware_id=hardware_id,
                    values=[KeyValue(key=key, value=value) for key, value in values.items()],
                )
            )
        self._template = Template(message)
        view = self._template.view
        self._texts = [
            view(f"status[{cable}].values[{index}].value", _WIDTH, dtype=np.uint8).data
            for cable, entry in enumerate(message.status)
            for index, value in enumerate(entry.values)
            if value.key in NUMBERS
        ]

    def fill(self, stamp: int, numbers: Sequence[float]) -> bytes:
        """Bytes with the numbers of each cable, one after the other."""
        set_stamp(self._template, stamp)
        for text, number in zip(self._texts, numbers, strict=True):
            text[:] = b"%13.5e" % number
        return self._template.to_bytes()


class StatusMessage:
    """Status of the cables of one scene, with the time since each could be trusted."""

    def __init__(self, cables: Sequence[str], hardware_id: str) -> None:
        self._cables = tuple(cables)
        self._hardware_id = hardware_id
        self._last_trusted: dict[str, int] = {}
        self._templates: dict[tuple[tuple[Status, bool], ...], _Filled] = {}

    def fill(self, stamp: int, equilibria: Mapping[str, Equilibrium]) -> bytes:
        """Bytes of the message for the joint state of this stamp, ns."""
        found = [equilibria[name] for name in self._cables]
        key = tuple((one.status, one.overlapping) for one in found)
        template = self._templates.get(key)
        if template is None:
            if len(self._templates) >= _MAX_TEMPLATES:
                self._templates.pop(next(iter(self._templates)))
            template = self._templates[key] = _Filled(self._hardware_id, self._cables, found)
        numbers: list[float] = []
        for name, one in zip(self._cables, found, strict=True):
            if one.status.trusted:
                self._last_trusted[name] = stamp
            numbers += [one.error_estimate, one.stability_margin, self._age(name, stamp)]
        return template.fill(stamp, numbers)

    def _age(self, cable: str, stamp: int) -> float:
        """Seconds since the last trusted answer; inf: there was none, or time went back."""
        age = stamp - self._last_trusted.get(cable, stamp + 1)
        return age * 1e-9 if age >= 0 else math.inf
