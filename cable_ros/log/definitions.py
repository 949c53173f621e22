# SPDX-License-Identifier: Apache-2.0
"""Texts and hashes of ROS message types, as MCAP schemas of encoding 'ros2msg' want them."""

from __future__ import annotations

import functools
import json
import os
import re
import sys
from pathlib import Path

from cable_ros.log.errors import LogError

_SEPARATOR = "=" * 80
# Every ROS has it, the Python wheels of ROS do not.
_TF_MESSAGE = {"tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n"}
_PRIMITIVES = frozenset(
    ["bool", "byte", "char", "string", "wstring", "float32", "float64"]
    + [f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)]
)
TYPE_NAME = re.compile(r"([a-z][a-z0-9_]*)/msg/([A-Za-z][A-Za-z0-9]*)")
_FIELD = re.compile(r"\s*([A-Za-z][A-Za-z0-9_/]*)[^\s#]*\s+[A-Za-z]")


@functools.cache
def message_definition(type_name: str) -> str:
    """Definition of `type_name` ('package/msg/Type') followed by those of all types it contains.

    Read from the installed packages (`share/<package>/msg` below `AMENT_PREFIX_PATH` on a robot, below
    `sys.prefix` with the wheels), so that a robot's own message types work as well; where there is no
    ROS at all, from rosbags' copy of Jazzy's common interfaces.

    Raises: LogError where the type is unknown or its name has another form.
    """
    text = _own_text(type_name)
    if text is None:
        return _from_rosbags(type_name)
    parts, seen = [text], {type_name}
    pending = _dependencies(type_name, text)
    while pending:
        name = pending.pop(0)
        if name in seen:
            continue
        seen.add(name)
        text = _own_text(name)
        if text is None:
            raise LogError(
                f"Message type {name}, a part of {type_name}, is not installed; install its package."
            )
        package, short = _split(name)
        parts.append(f"{_SEPARATOR}\nMSG: {package}/{short}\n{text}")
        pending += _dependencies(name, text)
    return "\n".join(parts)


@functools.cache
def type_hash(type_name: str) -> str:
    """RIHS01 hash of `type_name`, or '' where the installation has none."""
    package, short = _split(type_name)
    path = _find(package, f"{short}.json")
    if path is None:
        return ""
    hashes = json.loads(path.read_text(encoding="utf-8"))["type_hashes"]
    return next((h["hash_string"] for h in hashes if h["type_name"] == type_name), "")


def _split(type_name: str) -> tuple[str, str]:
    match = TYPE_NAME.fullmatch(type_name)
    if match is None:
        raise LogError(f"'{type_name}' is not a message type; write it as 'geometry_msgs/msg/WrenchStamped'.")
    return match[1], match[2]


def _find(package: str, file_name: str) -> Path | None:
    prefixes = [p for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    for prefix in (*prefixes, sys.prefix):
        path = Path(prefix, "share", package, "msg", file_name)
        if path.is_file():
            return path
    return None


def _own_text(type_name: str) -> str | None:
    package, short = _split(type_name)
    path = _find(package, f"{short}.msg")
    return _TF_MESSAGE.get(type_name) if path is None else path.read_text(encoding="utf-8")


def _dependencies(type_name: str, text: str) -> list[str]:
    """Full names of the message types that the fields of `text` have."""
    own_package = _split(type_name)[0]
    names = []
    for line in text.splitlines():
        match = _FIELD.match(line)
        if match is None or match[1] in _PRIMITIVES:
            continue
        package, _, short = match[1].rpartition("/")
        names.append(f"{package.removesuffix('/msg') or own_package}/msg/{short}")
    return names


def _from_rosbags(type_name: str) -> str:
    package, _ = _split(type_name)
    unknown = LogError(
        f"Message type {type_name} is not installed; install ROS package '{package}', or rosbags for the"
        " common interfaces."
    )
    try:
        from rosbags.typesys import Stores, TypesysError, get_typestore
    except ImportError:
        raise unknown from None
    try:
        return str(get_typestore(Stores.ROS2_JAZZY).generate_msgdef(type_name, ros_version=2)[0])
    except TypesysError:
        raise unknown from None
