# SPDX-License-Identifier: Apache-2.0
"""What the node says about itself: one diagnostics entry for the joint states and one for the log."""

from __future__ import annotations

import time

from diagnostic_msgs.msg import DiagnosticStatus

from cable_ros.interpretation import SENTENCE, is_under_way
from cable_ros.ros.joint_states import JointStates
from cable_ros.ros.messages import diagnostic
from cable_ros.ros.recorder import Recorder

_SILENCE = 1.0
"""s without a joint state after which the diagnostics say so."""


class Health:
    """Collects what went wrong between two reports, so that a single bad message is reported, too.

    Args:
        node: its full name, that no other node has: entries are named after it, and it is their hardware_id.
        scene: the scene's file.
    """

    def __init__(self, node: str, scene: str) -> None:
        self.name = node.removeprefix("/")
        self.hardware_id = node
        self._scene = scene
        self._fault = ""
        self._last_message = time.monotonic()

    def note(self, sentence: str) -> None:
        """Something was wrong; the next report says so."""
        self._fault = sentence

    def heard(self) -> None:
        """A joint state came."""
        self._last_message = time.monotonic()

    def joint_states(
        self, states: JointStates | None, waiting: str, refused: bool, publishers: int
    ) -> DiagnosticStatus:
        """The entry of the joint states; what was noted is reported and then forgotten.

        Args:
            states: None while the scene waits for its robot or the compiler.
            waiting: what it waits for, or why the robot cannot be used.
            refused: whether the robot cannot be used.
            publishers: how many there are on the topic.
        """
        name = f"{self.name}: joint states"
        if states is None:
            level = DiagnosticStatus.ERROR if refused else DiagnosticStatus.WARN
            return diagnostic(name, level, waiting, {}, self.hardware_id)
        silence = time.monotonic() - self._last_message
        fault, self._fault = self._fault, ""
        level, message = DiagnosticStatus.OK, f"Joint states arrive on '{states.topic}'."
        if missing := states.missing():
            names = " and ".join(f"'{joint}'" for joint in missing)
            level = DiagnosticStatus.ERROR
            message = (
                f"No position of the joint {names} was seen on '{states.topic}' ({publishers} publishers); "
                "the cables are not solved before."
            )
            message += f" {fault}" if fault else ""
        elif fault:
            level, message = DiagnosticStatus.WARN, fault
        elif is_under_way():
            level, message = DiagnosticStatus.WARN, f"{SENTENCE.capitalize()}."
        elif silence > _SILENCE and states.needed:
            level = DiagnosticStatus.WARN
            message = f"No joint state on '{states.topic}' for {silence:.1f} s ({publishers} publishers)."
        counters = states.counters
        values: dict[str, object] = {
            "received": counters.received,
            "solved": counters.solved,
            "skipped": counters.skipped,
            "lost": counters.lost,
            "rejected": counters.rejected,
            "without a needed joint": counters.other,
            "publishers": publishers,
            "scene": self._scene,
        }
        for joint, value in states.joints().items():
            values[f"position of {joint}"] = value
        return diagnostic(name, level, message, values, self.hardware_id)

    def log(self, recorder: Recorder) -> DiagnosticStatus:
        """The entry of the log."""
        name = f"{self.name}: log"
        writer = recorder.writer
        if problem := recorder.problem:
            dropped = {"dropped": writer.dropped} if writer else {}
            return diagnostic(name, DiagnosticStatus.ERROR, problem, dropped, self.hardware_id)
        if writer is None:
            return diagnostic(name, DiagnosticStatus.OK, "The log is off.", {}, self.hardware_id)
        values = {
            "file": writer.path,
            "written": writer.written,
            "dropped": writer.dropped,
            "waiting [bytes]": writer.queued_bytes,
        }
        level, message = DiagnosticStatus.OK, f"Writing {writer.path}."
        if writer.dropped:
            level = DiagnosticStatus.WARN
            message = (
                f"The disk is slower than the topics: {writer.dropped} messages are not in {writer.path}."
            )
        return diagnostic(name, level, message, values, self.hardware_id)
