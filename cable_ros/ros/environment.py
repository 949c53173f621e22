# SPDX-License-Identifier: Apache-2.0
"""Temperatures and radiation doses from their topics, for cables whose stiffness depends on them."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Temperature
from std_msgs.msg import Float64

from cable_ros.scene.influences import Influence
from cable_ros.scene.model import Cable, Scene
from cable_ros.tracker import Tracker

if TYPE_CHECKING:
    from rclpy.node import Node

_QOS = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
_SPACING = 0.1
"""s between two changes: what warms or ages a cable is slow, a noisy sensor may be fast."""

_MESSAGES: dict[str, tuple[type, Callable[[Any], float]]] = {
    "temperature": (Temperature, lambda message: message.temperature),
    "dose": (Float64, lambda message: message.data),
}


def _influences(cable: Cable) -> list[Influence]:
    return [influence for influence in (cable.temperature, cable.dose) if influence is not None]


class Environment:
    """Hands what the topics say to the tracker, between two solves.

    Args:
        node: subscribes.
        scene: names the topics.
        tracker: of that scene.
        note: called with a sentence where a value can't be used; the one before holds then.
    """

    def __init__(self, node: Node, scene: Scene, tracker: Tracker, note: Callable[[str], None]) -> None:
        self._cables = {cable.name: cable for cable in scene.cables}
        self._tracker = tracker
        self._note = note
        self.values: dict[str, dict[str, float]] = {}
        """By cable and name: what holds in place of the scene's own value."""
        self._heard: dict[tuple[str, str], float] = {}
        self._next = 0.0
        self._subscriptions = [
            self._subscribe(node, cable.name, influence.name, influence.topic)
            for cable in scene.cables
            for influence in _influences(cable)
            if influence.topic is not None
        ]

    def _subscribe(self, node: Node, cable: str, name: str, topic: str) -> Any:
        kind, read = _MESSAGES[name]

        def take(message: Any) -> None:
            self._heard[cable, name] = read(message)

        return node.create_subscription(kind, topic, take, _QOS)

    def apply(self) -> dict[str, dict[str, float]]:
        """Give the tracker what has changed; returns that, as `Tracker.set_environment` takes it."""
        if not self._heard or time.monotonic() < self._next:
            return {}
        self._next = time.monotonic() + _SPACING
        changed: dict[str, dict[str, float]] = {}
        for (cable, name), value in self._heard.items():
            if self.values.get(cable, {}).get(name) == value:
                continue
            try:
                self._tracker.set_environment({cable: {name: value}})
            except ValueError as error:
                self._note(f"Not used: {error}.")
                continue
            changed.setdefault(cable, {})[name] = value
            self.values.setdefault(cable, {})[name] = value
        self._heard.clear()
        return changed

    def of(self, cable: str) -> dict[str, float]:
        """What holds for a cable, for the diagnostics: value by name and unit."""
        values = self.values.get(cable, {})
        return {
            f"{influence.name} [{influence.unit}]": values.get(influence.name, influence.value)
            for influence in _influences(self._cables[cable])
        }

    def destroy(self, node: Node) -> None:
        """End the subscriptions."""
        for subscription in self._subscriptions:
            node.destroy_subscription(subscription)
