# SPDX-License-Identifier: Apache-2.0
"""The record by which rosbag2 knows a lone MCAP file: its own `metadata.yaml`, stored inside the file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass

import yaml
from mcap.records import Statistics

from cable_ros.log.qos import offered_profiles

RECORD = "rosbag2"
KEY = "serialized_metadata"

_VERSION = 9  # from this version on QoS policies are named, not numbered; Jazzy writes it


@dataclass(frozen=True)
class BagTopic:
    """A topic as rosbag2 describes it."""

    name: str
    type_name: str
    offered_qos: str
    type_hash: str


def metadata_text(file_name: str, topics: Mapping[int, BagTopic], statistics: Statistics) -> str:
    """YAML of rosbag2's bag metadata for a bag that is this one file; `topics` by number of the channel."""
    start, end = statistics.message_start_time, statistics.message_end_time
    span = {
        "duration": {"nanoseconds": end - start},
        "starting_time": {"nanoseconds_since_epoch": start},
        "message_count": statistics.message_count,
    }
    counted = [
        {
            "topic_metadata": {
                "name": topic.name,
                "type": topic.type_name,
                "serialization_format": "cdr",
                "offered_qos_profiles": offered_profiles(topic.offered_qos),
                "type_description_hash": topic.type_hash,
            },
            "message_count": statistics.channel_message_counts.get(channel, 0),
        }
        for channel, topic in topics.items()
    ]
    information = {
        "version": _VERSION,
        "storage_identifier": "mcap",
        **span,
        "topics_with_message_count": counted,
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file_name],
        "files": [{"path": file_name, **span}],
        "custom_data": {},
        "ros_distro": os.environ.get("ROS_DISTRO", "jazzy"),
    }
    return str(yaml.safe_dump(information, sort_keys=False))
