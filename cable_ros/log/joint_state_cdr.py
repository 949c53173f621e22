# SPDX-License-Identifier: Apache-2.0
"""The little of CDR that the log has to know itself."""

from __future__ import annotations

import struct

JOINT_STATE = "sensor_msgs/msg/JointState"


def trim_joint_state(cdr: bytes) -> bytes:
    """`cdr` of a JointState without what follows its last field.

    rmw_fastrtps' `serialize_message` returns its estimate of the size, which counts eight bytes of padding
    that an empty velocity and effort do not have; who publishes such bytes sends them along. CDR readers
    skip them, but rosbags refuses a message with more than three. Bytes that are not a JointState come
    back as they are: what was received is what is logged.
    """
    order = "<" if cdr[1:2] == b"\x01" else ">"
    try:
        (position,) = struct.unpack_from(order + "I", cdr, 12)
        position += 16  # encapsulation, stamp, length of frame_id; the frame_id itself
        position, names = _length(order, cdr, position)
        for _ in range(names):
            position, size = _length(order, cdr, position)
            position += size
        for _ in range(3):
            position, count = _length(order, cdr, position)
            if count:
                # The encapsulation's four bytes do not count for alignment.
                position += -(position - 4) % 8 + 8 * count
    except struct.error:
        return cdr
    return cdr[:position] if position < len(cdr) else cdr


def _length(order: str, cdr: bytes, position: int) -> tuple[int, int]:
    position += -position % 4
    return position + 4, int(struct.unpack_from(order + "I", cdr, position)[0])
