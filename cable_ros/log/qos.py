# SPDX-License-Identifier: Apache-2.0
"""Quality of service of a logged topic, in the YAML of rosbag2 since Jazzy (metadata version 9)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import yaml

from cable_ros.scene.errors import SceneError
from cable_ros.scene.text import parse_yaml

if TYPE_CHECKING:
    from rclpy.qos import QoSProfile

MOST_DEPTH = 10_000
_MOST_CHARACTERS = 20_000
_NANOSECONDS = 1_000_000_000
_DURATIONS = ("deadline", "lifespan", "liveliness_lease_duration")
# RMW_DURATION_INFINITE; rclpy's profiles hold 0 or this where nothing was asked for.
_INFINITE = {"sec": 9223372036, "nsec": 854775807}


def qos_to_yaml(profile: QoSProfile) -> str:
    """`profile` of a publisher as the `offered_qos_profiles` of a channel."""
    entry: dict[str, Any] = {
        "history": profile.history.name.lower(),
        "depth": profile.depth,
        "reliability": profile.reliability.name.lower(),
        "durability": profile.durability.name.lower(),
        "liveliness": profile.liveliness.name.lower(),
        "avoid_ros_namespace_conventions": bool(profile.avoid_ros_namespace_conventions),
    }
    for name in _DURATIONS:
        total = getattr(profile, name).nanoseconds
        entry[name] = (
            {"sec": total // _NANOSECONDS, "nsec": total % _NANOSECONDS} if total > 0 else dict(_INFINITE)
        )
    return yaml.safe_dump([entry], sort_keys=False)


def offered_profiles(text: str) -> list[dict[str, Any]]:
    """The profiles that a channel's `offered_qos_profiles` holds; none where the text is damaged."""
    if len(text) > _MOST_CHARACTERS:
        return []
    try:
        values = parse_yaml(text, "offered_qos_profiles")
    except SceneError:
        return []
    return [value for value in values if isinstance(value, dict)] if isinstance(values, list) else []


def qos_from_yaml(text: str) -> QoSProfile:
    """Profile to publish a logged topic with: reliability, durability and depth as they were offered.

    Deadline, lifespan and liveliness are left out: they were promises of the process that was logged.
    Empty, unknown or damaged text gives rclpy's default (reliable, volatile, keep last 10).
    """
    from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

    entry = next(iter(offered_profiles(text)), {})

    def policy(kind: Any, name: str, default: Any) -> Any:
        value = entry.get(name)
        if isinstance(value, str) and value.upper() in kind.__members__ and value != "unknown":
            return kind[value.upper()]
        # Up to metadata version 8 rosbag2 wrote the numbers of the enums.
        return kind(value) if value in [int(member) for member in kind] and value else default

    history = policy(HistoryPolicy, "history", HistoryPolicy.KEEP_LAST)
    depth = entry.get("depth", 0)
    return QoSProfile(
        history=history,
        depth=min(depth, MOST_DEPTH) if isinstance(depth, int) and depth > 0 else 10,
        reliability=policy(ReliabilityPolicy, "reliability", ReliabilityPolicy.RELIABLE),
        durability=policy(DurabilityPolicy, "durability", DurabilityPolicy.VOLATILE),
    )
