# SPDX-License-Identifier: Apache-2.0
"""Solves as a log like the node's: for Foxglove, `ros2 bag play`, `cable plot` and `cable replay`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from cable_ros.limits import Extreme
from cable_ros.log.errors import LogError
from cable_ros.log.events import encode_solved_joints
from cable_ros.log.host import host_facts
from cable_ros.log.joint_state_cdr import JOINT_STATE
from cable_ros.log.reader import SCENE, URDF
from cable_ros.log.run import CLAMPS, DIAGNOSTICS, PATH, WRENCH
from cable_ros.log.writer import LogWriter
from cable_ros.ros.frame_names import root_frame
from cable_ros.ros.limits_message import LimitsMessage
from cable_ros.ros.messages import JointLoadMessage, PathMessage, WrenchMessage
from cable_ros.scene import Scene

NODE = "/cable_node"


class SolveLog:
    """Writes joint states and the answers to them under the topic names of a node called cable_node.

    Args:
        path: the new file.
        scene: under which was solved; goes into the log with its URDF.
        attachments: file name -> text, beside those.
        metadata: record name -> entries, beside what is said about this machine.

    Raises:
        LogError: the file exists or cannot be written.
    """

    def __init__(
        self,
        path: FilePath,
        scene: Scene,
        attachments: Mapping[str, str] | None = None,
        metadata: Mapping[str, Mapping[str, str]] | None = None,
    ) -> None:
        texts = {SCENE: scene.text} | ({URDF: scene.robot.urdf} if scene.robot else {})
        self._writer = LogWriter(
            path,
            attachments=texts | dict(attachments or {}),
            metadata={"host": host_facts()} | dict(metadata or {}),
            max_bytes=0,
            background=False,
        )
        for topic in ("/joint_states", f"{NODE}/joint_load"):
            self._writer.add_topic(topic, JOINT_STATE, exact=True)
        self._frame = root_frame(scene.robot)
        self._wrenches = {
            (cable.name, clamp): WrenchMessage(f"{cable.name}_{clamp}")
            for cable in scene.cables
            for clamp in (*CLAMPS, *(support.name for support in cable.supports))
        }
        self._limits: dict[str, LimitsMessage] = {}
        self._path: PathMessage | None = None
        self._load: JointLoadMessage | None = None

    def joint_state(self, names: Sequence[str], positions: Any, stamp: int, log_time: int) -> None:
        """One pose; times in ns. What answers it comes next and has the same times."""
        message = encode_solved_joints(tuple(names), positions, stamp)
        self._writer.put("/joint_states", JOINT_STATE, message, log_time)

    def wrenches(self, cable: str, end: np.ndarray, start: np.ndarray, stamp: int, log_time: int) -> None:
        """A cable's end and start wrench (6,)."""
        for clamp, wrench in (("end", end), ("start", start)):
            self.wrench(cable, clamp, wrench, stamp, log_time)

    def wrench(self, cable: str, where: str, wrench: np.ndarray, stamp: int, log_time: int) -> None:
        """A cable's wrench (6,) at `end`, `start` or a support of that name."""
        message = self._wrenches[cable, where].fill(stamp, wrench)
        self._writer.put(f"{NODE}/{cable}/{where}_wrench", WRENCH, message, log_time)

    def limits(self, cable: str, extremes: Sequence[Extreme], stamp: int, log_time: int) -> None:
        """How a cable that has limits stands to them; nothing of one that has none."""
        if extremes:
            message = self._limits.setdefault(cable, LimitsMessage(cable, NODE)).fill(stamp, extremes)
            self._writer.put(f"{NODE}/{cable}/limits", DIAGNOSTICS, message, log_time)

    def joint_load(
        self, names: Sequence[str], positions: Any, torques: np.ndarray, stamp: int, log_time: int
    ) -> None:
        """Torques (n,) of all cables on the joints, at their positions (n,)."""
        if self._load is None:
            self._load = JointLoadMessage(names)
        message = self._load.fill(stamp, np.asarray(positions), torques)
        self._writer.put(f"{NODE}/joint_load", JOINT_STATE, message, log_time)

    def polyline(
        self, cable: str, points: np.ndarray, orientations: np.ndarray, stamp: int, log_time: int
    ) -> None:
        """A cable's points (n, 3) and section frames (n, 4), x y z w."""
        if self._path is None or self._path.count != len(points):
            self._path = PathMessage(self._frame, len(points))
        message = self._path.fill(stamp, points, orientations)
        self._writer.put(f"{NODE}/{cable}/polyline", PATH, message, log_time)

    def close(self) -> None:
        """Finish the file.

        Raises:
            LogError: it could not be written whole.
        """
        self._writer.close()
        if self._writer.error:
            raise LogError(self._writer.error)

    def discard(self) -> None:
        """Leave no file: what was to be written was interrupted."""
        self._writer.discard()

    def __enter__(self) -> SolveLog:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None:
            self.close()
        else:
            self.discard()
