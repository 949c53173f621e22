# SPDX-License-Identifier: Apache-2.0
"""A robot that may misbehave, keeps what it hears and reads the node's diagnostics."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from robot import NODE, TIMEOUT, Robot
from sensor_msgs.msg import JointState

from cable_ros.ros.replay_node import message_class
from cable_ros.scene.text import parse_yaml
from cable_ros.share import share_file

JOINTS_ENTRY = f"{NODE[1:]}: joint states"
LOG_ENTRY = f"{NODE[1:]}: log"
OK, WARN, ERROR, STALE = (bytes([level]) for level in range(4))


class Observer(Robot):
    """Arguments as `Robot` has them: the node's parameters."""

    def __init__(self, **parameters: object) -> None:
        super().__init__(**parameters)
        self.messages: dict[str, list[Any]] = {}
        self._reports: list[DiagnosticArray] = []
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._reports.append, 100)

    def listen(self, topic: str, kind: str, qos: QoSProfile | None = None) -> list[Any]:
        """Keep every message of a topic, read from its bytes; returns the growing list."""
        messages = self.messages.setdefault(topic, [])
        message_type = message_class(kind)

        def take(data: bytes) -> None:
            messages.append(deserialize_message(data, message_type))

        self.node.create_subscription(message_type, topic, take, qos or QoSProfile(depth=1000), raw=True)
        return messages

    def send(
        self, names: Sequence[str], position: Sequence[float], stamp: int | None = None, **fields: Any
    ) -> JointState:
        """Publish one joint state; `stamp` is in ns, now unless given."""
        message = JointState(name=list(names), position=[float(value) for value in position], **fields)
        stamp = time.time_ns() if stamp is None else stamp
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
        self.publisher.publish(message)
        return message

    def rest(self, seconds: float = 0.3) -> None:
        """Hear what is still on its way."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            self.executor.spin_once(timeout_sec=0.02)

    def _first(self, name: str, wanted: Callable[[DiagnosticStatus], bool]) -> DiagnosticStatus:
        found: list[DiagnosticStatus] = []

        def done() -> bool:
            entries = (status for report in self._reports for status in report.status)
            found.extend(status for status in entries if status.name == name and wanted(status))
            self._reports.clear()
            return bool(found)

        self.wait(done)
        return found[0]

    def entry(
        self, name: str = JOINTS_ENTRY, wanted: Callable[[DiagnosticStatus], bool] = lambda _: True
    ) -> DiagnosticStatus:
        """The first entry of that name in the diagnostics from now on that is as wanted."""
        self._reports.clear()
        return self._first(name, wanted)

    def told(self, sentence: str, name: str = JOINTS_ENTRY) -> DiagnosticStatus:
        """The entry that says `sentence`, in a report that was not looked at yet."""
        return self._first(name, lambda status: sentence in status.message)

    def counters(self) -> dict[str, int]:
        """What became of the joint states, from the second next report: the next may be on its way."""
        self.entry()
        return {
            pair.key: int(pair.value)
            for pair in self.entry().values
            if pair.value.isdigit() and not pair.key.startswith("position of")
        }

    def try_parameter(self, name: str, value: object) -> tuple[bool, str]:
        """Whether the node takes a parameter, and what it says."""
        request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
        (result,) = self.call(SetParameters, f"{NODE}/set_parameters", request).results
        return result.successful, result.reason

    def end(self, with_signal: signal.Signals) -> str:
        """Stop the node at once, whatever is under way; returns what it printed."""
        self.process.send_signal(with_signal)
        output, _ = self.process.communicate(timeout=TIMEOUT)
        assert self.process.returncode == 0, output
        assert "Traceback" not in output, output
        return output


def arm_scene(folder: Path, **changes: object) -> Path:
    """The arm's scene with other top-level fields, as a file in `folder`."""
    source = share_file("config", "space_arm.yaml")
    scene = parse_yaml(source.read_text(), str(source))
    scene["robot"] = {"urdf": str(source.with_suffix(".urdf"))}
    scene = {key: value for key, value in (scene | changes).items() if value is not None}
    path = folder / "scene.yaml"
    path.write_text(yaml.safe_dump(scene))
    return path
