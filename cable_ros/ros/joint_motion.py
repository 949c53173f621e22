# SPDX-License-Identifier: Apache-2.0
"""Tells jumps of joints: between two stamps they went farther than their velocity limits allow."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from cable_ros.scene.joint_limits import JointLimit


class JointMotion:
    """Where each joint was last, and when.

    Args:
        limits: of the joints that the scene needs, in their order.
    """

    def __init__(self, limits: Sequence[JointLimit]) -> None:
        self._limits = limits
        self._velocities = [limit.velocity for limit in limits]
        self._last = [(math.nan, 0)] * len(limits)

    def take(self, positions: Iterable[tuple[int, float]], stamp: int) -> str:
        """A sentence about the joint that jumped, or an empty text.

        Args:
            positions: index among the joints, and position, rad or m, of those that a message has.
            stamp: of the message, ns. After a time that goes back, the next message is the first.
        """
        warning = ""
        for index, position in positions:
            before, since = self._last[index]
            self._last[index] = position, stamp
            # a cheap test first: at 1 kHz hardly any joint jumps
            if (
                0 < since < stamp
                and abs(position - before) > self._velocities[index] * (stamp - since) * 1e-9
            ):
                warning = self._limits[index].too_fast(position - before, (stamp - since) * 1e-9) or warning
        return warning
