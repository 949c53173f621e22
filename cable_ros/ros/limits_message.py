# SPDX-License-Identifier: Apache-2.0
"""`~/<cable>/limits`: how near a cable comes to what it stands, for every joint state that is solved.

A `diagnostic_msgs/DiagnosticArray`, for the reasons of `~/status`: an entry for each quantity, always the
same keys in the same order.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from cable_ros.limits import BEYOND, NEAR, OK, Extreme
from cable_ros.ros.cdr_template import Template
from cable_ros.ros.messages import set_stamp

LEVELS = {OK: DiagnosticStatus.OK, NEAR: DiagnosticStatus.WARN, BEYOND: DiagnosticStatus.ERROR}
"""Diagnostic level of an extreme."""
SENTENCES = {OK: "Within its limit.", NEAR: "Near its limit.", BEYOND: "Beyond its limit."}
UNWATCHED = "No limit is given."
_WIDTH = 13  # of -1.23457e-105
_MAX_TEMPLATES = 64


class _Filled:
    """The message of one combination of levels and of the nearest obstacle, and the places of its numbers."""

    def __init__(self, cable: str, hardware_id: str, extremes: Sequence[Extreme]) -> None:
        message = DiagnosticArray()
        blank = " " * _WIDTH
        for one in extremes:
            unit = one.quantity.unit
            limit = "none" if one.limit is None else f"{one.limit:.6g}"
            values = {f"value [{unit}]": blank, "at [m]": blank, "use": blank, f"limit [{unit}]": limit}
            values |= {"to": one.obstacle} if one.quantity.name == "clearance" else {}
            message.status.append(
                DiagnosticStatus(
                    name=f"{cable}: {one.quantity.words}",
                    level=LEVELS[one.level],
                    message=UNWATCHED if one.limit is None else SENTENCES[one.level],
                    hardware_id=hardware_id,
                    values=[KeyValue(key=key, value=value) for key, value in values.items()],
                )
            )
        self._template = Template(message)
        self._texts = [
            self._template.view(f"status[{i}].values[{k}].value", _WIDTH, dtype=np.uint8).data
            for i in range(len(extremes))
            for k in range(3)
        ]

    def fill(self, stamp: int, extremes: Sequence[Extreme]) -> bytes:
        """Bytes with their numbers."""
        set_stamp(self._template, stamp)
        numbers = (number for one in extremes for number in (one.value, one.arc_length, one.use))
        for text, number in zip(self._texts, numbers, strict=True):
            text[:] = b"%13.5e" % number
        return self._template.to_bytes()


class LimitsMessage:
    """The extremes of one cable as a message."""

    def __init__(self, cable: str, hardware_id: str) -> None:
        self._cable, self._hardware_id = cable, hardware_id
        self._templates: dict[tuple[tuple[int, str], ...], _Filled] = {}

    def fill(self, stamp: int, extremes: Sequence[Extreme]) -> bytes:
        """Bytes of the message for the joint state of this stamp, ns."""
        key = tuple((one.level, one.obstacle) for one in extremes)
        template = self._templates.get(key)
        if template is None:
            if len(self._templates) >= _MAX_TEMPLATES:
                self._templates.pop(next(iter(self._templates)))
            template = self._templates[key] = _Filled(self._cable, self._hardware_id, extremes)
        return template.fill(stamp, extremes)
