# SPDX-License-Identifier: Apache-2.0
"""The node's parameters: what they mean, what they may be, and which can change while it runs."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import ParameterException
from rclpy.parameter import Parameter

from cable_ros.common.printable import one_line
from cable_ros.scene.errors import suggestion
from cable_ros.scene.joint_limits import MODES, WARN
from cable_ros.share import scene_path

if TYPE_CHECKING:
    from rclpy.node import Node


@dataclass(frozen=True)
class Declaration:
    """One parameter; `low` and `high` bound a number, `live` says that it can change while the node runs."""

    name: str
    default: bool | int | float | str
    description: str
    low: float | None = None
    high: float | None = None
    live: bool = False

    def descriptor(self) -> ParameterDescriptor:
        """What `ros2 param describe` shows."""
        descriptor = ParameterDescriptor(description=self.description, read_only=not self.live)
        if self.low is not None and self.high is not None:
            if isinstance(self.default, float):
                descriptor.floating_point_range = [
                    FloatingPointRange(from_value=self.low, to_value=self.high)
                ]
            else:
                descriptor.integer_range = [
                    IntegerRange(from_value=int(self.low), to_value=int(self.high), step=1)
                ]
        return descriptor


DECLARATIONS = (
    Declaration("scene", "", "Scene file (YAML); a bare name is also sought among the installed scenes."),
    Declaration(
        "tolerance", 1e-4, "Relative error of the end wrench that is accepted.", 1e-10, 0.1, live=True
    ),
    Declaration("polyline_points", 101, "Poses in a cable's polyline.", 2, 10001, live=True),
    Declaration(
        "polyline_rate",
        0.0,
        "Most polylines in a second, Hz; 0: one for every joint state.",
        0.0,
        1e4,
        live=True,
    ),
    Declaration(
        "joint_limits",
        WARN,
        "Joint values outside the URDF's limits: warn (solved and reported), refuse (not solved) or ignore.",
        live=True,
    ),
    Declaration(
        "check_motion",
        False,
        "Compare the joints' motion with each cable's lowest natural frequency, and warn in the diagnostics "
        "where a cable would swing by more than 1 % of its length.",
        live=True,
    ),
    Declaration(
        "world_frame",
        "",
        "Frame of scene positions without a link; empty: the robot's root link, or 'world'.",
    ),
    Declaration(
        "frame_prefix",
        "",
        "Text before every frame_id, as robot_state_publisher has it, such as 'left/'.",
    ),
    Declaration("diagnostics_rate", 1.0, "Diagnostics in a second while nothing changes, Hz.", 0.1, 100.0),
    Declaration("marker_rate", 20.0, "Most marker messages in a second, Hz.", 0.1, 1000.0, live=True),
    Declaration("marker_force_scale", 0.5, "Length of a force arrow, m/N.", 1e-6, 1e6, live=True),
    Declaration("log.enabled", False, "Write an MCAP log.", live=True),
    Declaration(
        "log.path",
        "",
        "The log: a file that does not exist yet (.mcap), or a folder that does, in which each log gets a "
        "name with the time; empty: ROS's log folder. Takes effect with the next log.",
        live=True,
    ),
    Declaration(
        "log.max_size", 1024, "Size at which a new file is begun, MB; 0: never.", 0, 1 << 20, live=True
    ),
    Declaration(
        "log.max_duration", 0.0, "Time after which a new file is begun, s; 0: never.", 0.0, 1e7, live=True
    ),
    Declaration(
        "log.queue_size",
        32,
        "Most that may wait for the disk, MB; what is beyond is dropped and counted.",
        1,
        4096,
    ),
)


_OF_TOPICS = "qos_overrides."  # declared with the topics


class ParameterError(ValueError):
    """A parameter that can't be used: one sentence with its name and what would be right."""


def declare(node: Node) -> None:
    """Declare all parameters.

    Raises:
        ParameterError: a value given on the command line or in a file has the wrong type or is out of range.
    """
    for entry in DECLARATIONS:
        try:
            node.declare_parameter(entry.name, entry.default, entry.descriptor())
        except ParameterException as error:
            raise ParameterError(f"Parameter '{entry.name}' must be {_wanted(entry)}.") from error
        reason = refusal(entry, node.get_parameter(entry.name).value)
        if reason:
            raise ParameterError(reason)


def unknown(node: Node) -> Iterator[str]:
    """A sentence for each parameter that is given on the command line or in a file and that there is not."""
    known = [entry.name for entry in DECLARATIONS]
    # rclpy has no public way to them that would not declare them all.
    for name in node._parameter_overrides:
        if not node.has_parameter(name) and not name.startswith(_OF_TOPICS):
            yield f"There is no parameter '{one_line(name)}'{suggestion(name, known)}; it is ignored."


def _wanted(entry: Declaration) -> str:
    kind = {bool: "true or false", int: "an integer", float: "a number with a decimal point", str: "a text"}
    bounds = "" if entry.low is None else f" from {entry.low:g} to {entry.high:g}"
    return kind[type(entry.default)] + bounds


def refusal(entry: Declaration, value: Any) -> str:
    """Why a value of the right type and range still can't be used; empty when it can."""
    if isinstance(value, float) and not math.isfinite(value):
        return f"Parameter '{entry.name}' is {value}; it must be {_wanted(entry)}."
    if entry.name == "joint_limits" and value not in MODES:
        return f"Parameter 'joint_limits' is '{value}'; it must be {', '.join(MODES[:-1])} or {MODES[-1]}."
    if entry.name == "frame_prefix" and value.startswith("/"):
        return f"Parameter 'frame_prefix' is '{value}'; frames of tf2 do not begin with '/': leave it out."
    if entry.name == "log.path" and value.endswith(".mcap") and os.path.exists(os.path.expanduser(value)):
        return f"Parameter 'log.path': {value} exists already and logs never overwrite; choose another name."
    return ""


def scene_file(value: str) -> Path:
    """The scene's file, as `share.scene_path` finds it.

    Raises:
        ParameterError: nothing is named.
    """
    if not value:
        raise ParameterError(
            "Parameter 'scene' is empty; name a scene file, such as -p scene:=space_arm.yaml"
        )
    return scene_path(value)


def validate(parameters: Sequence[Parameter]) -> SetParametersResult:
    """The callback that accepts or refuses a change; it changes nothing itself."""
    entries = {entry.name: entry for entry in DECLARATIONS}
    for parameter in parameters:
        entry = entries.get(parameter.name)
        if entry and (reason := refusal(entry, parameter.value)):
            return SetParametersResult(successful=False, reason=reason)
    return SetParametersResult(successful=True)


def as_text(node: Node) -> str:
    """All parameters of the node in the form of a ROS parameter file, for the log."""
    import yaml

    tree: dict[str, Any] = {}
    for entry in DECLARATIONS:
        *groups, leaf = entry.name.split(".")
        place = tree
        for group in groups:
            place = place.setdefault(group, {})
        place[leaf] = node.get_parameter(entry.name).value
    return yaml.safe_dump({node.get_fully_qualified_name(): {"ros__parameters": tree}}, sort_keys=False)
