"""A batch of equilibria as a log like the node's: for Foxglove, `ros2 bag play` and `cable plot`."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path as FilePath

import numpy as np
from sensor_msgs.msg import JointState

from cable_ros.batch import Batch
from cable_ros.log.errors import LogError
from cable_ros.log.history import JOINT_STATE, PATH, WRENCH
from cable_ros.log.host import host_facts
from cable_ros.log.reader import SCENE, URDF
from cable_ros.log.writer import LogWriter
from cable_ros.ros.cdr import Template
from cable_ros.ros.frames import world_frame
from cable_ros.ros.messages import PathMessage, WrenchMessage, set_stamp
from cable_ros.scene import Scene

PERIOD = 10_000_000  # ns between the stamps of two poses
MOST_QUEUED = 8 << 20  # bytes that may wait for the disk


class BatchLog:
    """Writes batches of one scene under the topic names of a node called cable_node.

    Raises:
        LogError: the file exists or cannot be written.
    """

    def __init__(self, path: FilePath, scene: Scene) -> None:
        attachments = {SCENE: scene.text} | ({URDF: scene.robot.urdf} if scene.robot else {})
        self._writer = LogWriter(path, attachments=attachments, metadata={"host": host_facts()}, max_bytes=0)
        self._frame = world_frame(scene.robot)
        self._wrenches = {
            (cable.name, end): WrenchMessage(f"{cable.name}_{end}")
            for cable in scene.cables
            for end in ("end", "start")
        }
        self._joints: Template | None = None
        self._path: PathMessage | None = None
        self._stamp = time.time_ns()

    def write(self, variant: Mapping[str, float], batch: Batch) -> None:
        """Append the poses of a batch; what is not trusted has no messages, as with the node."""
        trusted = batch.trusted
        for i in range(len(batch)):
            self._stamp += PERIOD
            self._put("/joint_states", JOINT_STATE, self._joint_state(batch, i))
            for j, cable in enumerate(batch.cables):
                if not trusted[i, j]:
                    continue
                topic = f"/cable_node/{cable}"
                for end, wrench in (("end", batch.end_wrench), ("start", batch.start_wrench)):
                    message = self._wrenches[cable, end].fill(self._stamp, wrench[i, j])
                    self._put(f"{topic}/{end}_wrench", WRENCH, message)
                self._put(
                    f"{topic}/polyline", PATH, self._polyline(batch.points[i, j], batch.orientations[i, j])
                )

    def close(self) -> None:
        """Finish the file.

        Raises:
            LogError: it could not be written whole.
        """
        problem = self._writer.error
        self._writer.close()
        if problem or not self._writer.paths:
            raise LogError(problem or self._writer.error or "the log could not be finished")

    def _put(self, topic: str, type_name: str, data: bytes) -> None:
        # The writer drops what a full queue cannot take, as a live node must; here there is time to wait.
        while self._writer.queued_bytes > MOST_QUEUED and self._writer.error is None:
            time.sleep(0.005)
        self._writer.write(topic, type_name, data, self._stamp)

    def _joint_state(self, batch: Batch, index: int) -> bytes:
        if self._joints is None:
            names = list(batch.joint_names)
            self._joints = Template(JointState(name=names, position=[0.0] * len(names)))
        set_stamp(self._joints, self._stamp)
        if batch.joint_names:
            self._joints.view("position[0]", len(batch.joint_names))[:] = batch.joints[index]
        return self._joints.to_bytes()

    def _polyline(self, points: np.ndarray, orientations: np.ndarray) -> bytes:
        if self._path is None:
            self._path = PathMessage(self._frame, len(points))
        return self._path.fill(self._stamp, points, orientations)
