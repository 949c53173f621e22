# SPDX-License-Identifier: Apache-2.0
"""What a log holds besides messages of topics: enough to repeat every solve, bit for bit.

A tracker's result depends on its history (warm start, branch), so the log holds, in the order in which
they happened, every `Tracker.solve` with exactly the joint values that it was given, and every event
that changed the tracker. Joint states as received are not enough: they are partial, merged from several
publishers, and the node skips those that are overtaken by newer ones.

Two topics below the node's name, written to the log only:

- `~/solved_joints`, `sensor_msgs/msg/JointState`: names and positions given to one `Tracker.solve`, before
  its wrenches. Wrenches that follow, up to the next one, are its results; a cable without one had no
  trusted result.
- `~/events`, `std_msgs/msg/String`: one JSON object each, with the event under the key `event`.

A log holds one scene: another scene begins another log.
"""

from __future__ import annotations

import json
import struct
from typing import Any

SOLVED_JOINTS = "solved_joints"
EVENTS = "events"
STRING = "std_msgs/msg/String"

START = "start"
"""A log begins: `tolerance`, `polyline_points`, `joint_limits`,
`fresh` (whether the tracker has not solved anything yet),
`environment` as in ENVIRONMENT where it is not the scene's, and
`lost` as in `Tracker.lost` if it is not empty."""
RESET = "reset"
"""`Tracker.reset()` was called."""
SET = "set"
"""A setting of the tracker changed: `tolerance`, `polyline_points` or `joint_limits` with the new value."""
ENVIRONMENT = "environment"
"""`Tracker.set_environment` was called: `environment` is what it was given."""


def encode_event(event: str, **values: Any) -> bytes:
    """CDR of the `std_msgs/msg/String` for `~/events`; `values` as JSON writes them (floats exactly)."""
    text = json.dumps({"event": event, **values}).encode() + b"\0"
    return b"\x00\x01\x00\x00" + struct.pack("<I", len(text)) + text


def encode_solved_joints(names: tuple[str, ...], positions: Any, stamp_ns: int) -> bytes:
    """CDR of the `sensor_msgs/msg/JointState` for `~/solved_joints`; `positions` (n,) float64, as solved."""
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    parts = [b"\x00\x01\x00\x00", struct.pack("<iIIx", seconds, nanoseconds, 1), b"\0\0\0"]
    parts.append(struct.pack("<I", len(names)))
    for name in names:
        text = name.encode() + b"\0"
        parts += [struct.pack("<I", len(text)), text, bytes(-len(text) % 4)]
    parts.append(struct.pack("<I", len(names)))
    parts.append(bytes(-(sum(map(len, parts)) - 4) % 8) if names else b"")
    parts.append(struct.pack(f"<{len(names)}d", *positions))
    parts.append(struct.pack("<II", 0, 0))
    return b"".join(parts)


def decode_event(text: str) -> dict[str, Any]:
    """The object of one event; an empty one where `text` is not ours."""
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):  # not JSON, or brackets within brackets without end
        return {}
    return value if isinstance(value, dict) else {}
