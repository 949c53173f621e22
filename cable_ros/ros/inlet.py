# SPDX-License-Identifier: Apache-2.0
"""The joint states' way in, past the executor while they come fast."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.signals import SignalHandlerGuardCondition
from sensor_msgs.msg import JointState

_TURN = 0.02
"""s that one turn lasts at most: how long services, parameters and timers may have to wait."""
_PAUSE = 0.005
"""s without a joint state that end a turn: slower streams go through the executor."""

Message = tuple[bytes, dict[str, Any]]


class Inlet:
    """Subscription that hands over serialised joint states, in batches of all that have come.

    rclpy's executor builds its wait set anew, twice, for every message: 200 us of the 1000 that there are at
    1 kHz. So the callback that it calls stays, and waits for further states on a wait set of its own, as
    `rclpy.wait_for_message` does, until the stream pauses or its turn ends.

    Args:
        node: the node that subscribes.
        topic: of the joint states.
        qos: its depth bounds a batch.
        answer: called with each batch, oldest first.
    """

    def __init__(
        self, node: Node, topic: str, qos: QoSProfile, answer: Callable[[list[Message]], None]
    ) -> None:
        self._answer = answer
        self._depth = qos.depth
        self._subscription = node.create_subscription(
            JointState,
            topic,
            self._on_message,
            qos,
            raw=True,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )
        self._handle: Any = self._subscription.handle
        self._signal = SignalHandlerGuardCondition(context=node.context)
        self._wait_set: Any = rclpy_implementation.WaitSet(1, 1, 0, 0, 0, 0, node.context.handle)

    def _on_message(self, data: bytes, info: dict[str, Any]) -> None:
        end = time.monotonic() + _TURN
        batch = [(data, info)]
        while batch:
            while len(batch) < self._depth and (message := self._take()) is not None:
                batch.append(message)
            self._answer(batch)
            batch = []
            if time.monotonic() < end and self._wait() and (message := self._take()) is not None:
                batch.append(message)

    def _take(self) -> Message | None:
        message: Message | None = self._handle.take_message(JointState, True)
        return message

    def _wait(self) -> bool:
        """Whether a joint state comes before the stream counts as paused."""
        self._wait_set.clear_entities()
        self._wait_set.add_subscription(self._handle)
        self._wait_set.add_guard_condition(self._signal.handle)
        self._wait_set.wait(round(_PAUSE * 1e9))
        return bool(self._wait_set.get_ready_entities("subscription"))
