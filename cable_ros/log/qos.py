"""Quality of service of a logged topic, in the YAML of rosbag2 since Jazzy (metadata version 9)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import yaml

if TYPE_CHECKING:
    from rclpy.qos import QoSProfile

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


def qos_from_yaml(text: str) -> QoSProfile:
    """Profile to publish a logged topic with: reliability, durability and depth as they were offered.

    Deadline, lifespan and liveliness are left out: they were promises of the process that was logged.
    Empty or unknown text gives rclpy's default (reliable, volatile, keep last 10).
    """
    from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

    entries = yaml.safe_load(text) if text else None
    entry = entries[0] if isinstance(entries, list) and entries and isinstance(entries[0], dict) else {}

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
        depth=depth if isinstance(depth, int) and depth > 0 else 10,
        reliability=policy(ReliabilityPolicy, "reliability", ReliabilityPolicy.RELIABLE),
        durability=policy(DurabilityPolicy, "durability", DurabilityPolicy.VOLATILE),
    )
