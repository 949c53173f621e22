# SPDX-License-Identifier: Apache-2.0
"""From the bytes of a logged message to its fields, with whatever library is there."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from cable_ros.log.errors import LogError

Decoder = Callable[[bytes], Any]
"""Gives an object with the fields of the message as attributes; ValueError where the bytes are not one."""


def decoder_for(encoding: str, schema: Any) -> Decoder | None:
    """The decoder of a channel, None where it holds no messages of ROS 2.

    mcap-ros2-support takes the definition that the log carries, so it can decode every type. Without it, as
    where only ROS is installed, rclpy decodes the types that it knows.

    Args:
        encoding: of the messages.
        schema: MCAP's record of the message type.

    Raises:
        LogError: there is neither of them, or rclpy does not know the type.
    """
    try:
        from mcap_ros2.decoder import DecoderFactory
    except ImportError:
        return _by_rclpy(encoding, schema)
    found: Decoder | None = DecoderFactory().decoder_for(encoding, schema)
    return found


def _by_rclpy(encoding: str, schema: Any) -> Decoder | None:
    if encoding != "cdr" or schema is None or schema.encoding != "ros2msg":
        return None
    try:
        from rclpy.serialization import deserialize_message
    except ImportError:
        raise LogError(
            "Decoding a log needs mcap-ros2-support, or a sourced ROS; install it with 'pip install "
            "mcap-ros2-support'."
        ) from None
    package, _, name = schema.name.partition("/msg/")
    try:
        kind = getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        raise LogError(
            f"The message type {schema.name} is not installed here; install the ROS package '{package}', or "
            "mcap-ros2-support, which needs no package of messages."
        ) from None

    def decode(data: bytes) -> Any:
        try:
            return deserialize_message(data, kind)
        except Exception as error:  # rclpy's own kind, and others for what is no CDR
            raise ValueError(str(error)) from None

    return decode
