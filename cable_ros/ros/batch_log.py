# SPDX-License-Identifier: Apache-2.0
"""A batch of equilibria as a log like the node's."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cable_ros.batch import Batch
from cable_ros.ros.solve_log import SolveLog
from cable_ros.scene import Scene

PERIOD = 10_000_000  # ns between the stamps of two poses


class BatchLog:
    """Writes batches of one scene, pose after pose, from now on.

    Raises:
        LogError: the file exists or cannot be written.
    """

    def __init__(self, path: Path, scene: Scene) -> None:
        self._log = SolveLog(path, scene)
        self._time = time.time_ns()

    def write(self, variant: Mapping[str, float], batch: Batch) -> None:
        """Append the poses of a batch; what is not trusted has no messages, as with the node."""
        trusted = batch.trusted
        for i in range(len(batch)):
            self._time += PERIOD
            times = self._time, self._time
            self._log.joint_state(batch.joint_names, batch.joints[i], *times)
            for j, cable in enumerate(batch.cables):
                if trusted[i, j]:
                    self._log.wrenches(cable, batch.end_wrench[i, j], batch.start_wrench[i, j], *times)
            if batch.joint_names and trusted[i].all():
                self._log.joint_load(batch.joint_names, batch.joints[i], batch.joint_load[i], *times)
            for j, cable in enumerate(batch.cables):
                if trusted[i, j]:
                    self._log.polyline(cable, batch.points[i, j], batch.orientations[i, j], *times)

    def __enter__(self) -> BatchLog:
        return self

    def __exit__(self, *exc: Any) -> None:
        """Finish the file, or leave none after an exception; raises LogError where it cannot."""
        self._log.__exit__(*exc)
