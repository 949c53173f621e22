"""The record by which rosbag2 knows a lone MCAP file: its own `metadata.yaml`, stored inside the file."""

from __future__ import annotations

import os
from dataclasses import dataclass, field

import yaml

RECORD = "rosbag2"
KEY = "serialized_metadata"

_VERSION = 9  # from this version on QoS policies are named, not numbered; Jazzy writes it


@dataclass
class TopicCount:
    """A topic with what was written on it."""

    name: str
    type_name: str
    offered_qos: str
    type_hash: str
    count: int = 0


@dataclass
class BagSummary:
    """Counts and times of one file, kept while it is written."""

    topics: dict[str, TopicCount] = field(default_factory=dict)
    start: int | None = None
    end: int = 0

    def count(self, topic: str, log_time: int) -> None:
        """One more message on `topic` (which is in `topics`)."""
        self.topics[topic].count += 1
        self.start = log_time if self.start is None or log_time < self.start else self.start
        self.end = max(self.end, log_time)

    @property
    def message_count(self) -> int:
        """Messages on all topics."""
        return sum(topic.count for topic in self.topics.values())

    def serialized(self, file_name: str) -> str:
        """YAML of rosbag2's bag metadata for a bag that is this one file."""
        start = self.start or 0
        span = {
            "duration": {"nanoseconds": max(self.end - start, 0)},
            "starting_time": {"nanoseconds_since_epoch": start},
            "message_count": self.message_count,
        }
        topics = [
            {
                "topic_metadata": {
                    "name": topic.name,
                    "type": topic.type_name,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": yaml.safe_load(topic.offered_qos) if topic.offered_qos else [],
                    "type_description_hash": topic.type_hash,
                },
                "message_count": topic.count,
            }
            for topic in self.topics.values()
        ]
        information = {
            "version": _VERSION,
            "storage_identifier": "mcap",
            **span,
            "topics_with_message_count": topics,
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [file_name],
            "files": [{"path": file_name, **span}],
            "custom_data": {},
            "ros_distro": os.environ.get("ROS_DISTRO", "jazzy"),
        }
        return str(yaml.safe_dump(information, sort_keys=False))
