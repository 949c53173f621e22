"""A logged run solved under another scene, as a log like the node's."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from cable_ros.equilibrium import Equilibrium
from cable_ros.log.cdr import JOINT_STATE
from cable_ros.log.errors import LogError
from cable_ros.log.events import encode_solved_joints
from cable_ros.log.host import host_facts
from cable_ros.log.reader import PARAMETERS, SCENE, URDF, LogReader
from cable_ros.log.run import CLAMPS, PATH, WRENCH, Solve
from cable_ros.log.writer import LogWriter
from cable_ros.ros.frames import world_frame
from cable_ros.ros.messages import PathMessage, WrenchMessage
from cable_ros.scene import Scene


class WhatIfLog:
    """Writes the new results under the times and topic names of a node called cable_node.

    Args:
        path: the new file.
        scene: under which was solved.
        source: the log that was solved again.

    Raises:
        LogError: the file exists or cannot be written.
    """

    def __init__(self, path: Path, scene: Scene, source: LogReader) -> None:
        attachments = {SCENE: scene.text} | ({URDF: scene.robot.urdf} if scene.robot else {})
        if PARAMETERS in source.attachments:
            attachments[PARAMETERS] = source.attachments[PARAMETERS]
        metadata = {
            "host": host_facts(),
            "what_if": {"source": str(source.path), "scene": str(scene.path or "")},
        }
        self._writer = LogWriter(path, attachments=attachments, metadata=metadata, max_bytes=0)
        self._frame = world_frame(scene.robot)
        self._wrenches = {
            (cable.name, clamp): WrenchMessage(f"{cable.name}_{clamp}")
            for cable in scene.cables
            for clamp in CLAMPS
        }
        self._path: PathMessage | None = None

    def write(self, solve: Solve, equilibria: Mapping[str, Equilibrium]) -> None:
        """One pose; what is not trusted has no messages, and polylines come as often as they were logged."""
        joints = encode_solved_joints(tuple(solve.joints), list(solve.joints.values()), solve.stamp)
        self._writer.put("/joint_states", JOINT_STATE, joints, solve.log_time)
        for name, found in equilibria.items():
            if not found.status.trusted:
                continue
            topic = f"/cable_node/{name}"
            for clamp, wrench in (("end", found.end_wrench), ("start", found.start_wrench)):
                message = self._wrenches[name, clamp].fill(solve.stamp, wrench)
                self._writer.put(f"{topic}/{clamp}_wrench", WRENCH, message, solve.log_time)
            if solve.polylines:
                if self._path is None or self._path.count != len(found.points):
                    self._path = PathMessage(self._frame, len(found.points))
                message = self._path.fill(solve.stamp, found.points, found.orientations)
                self._writer.put(f"{topic}/polyline", PATH, message, solve.log_time)

    def close(self) -> None:
        """Finish the file. Raises LogError where it could not be written whole."""
        self._writer.close()
        if self._writer.error:
            raise LogError(self._writer.error)

    def __enter__(self) -> WhatIfLog:
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()
