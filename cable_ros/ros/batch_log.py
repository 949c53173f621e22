# SPDX-License-Identifier: Apache-2.0
"""A batch of equilibria as a log like the node's."""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cable_ros.batch import Batch
from cable_ros.limits import QUANTITIES, Extreme
from cable_ros.ros.solve_log import SolveLog
from cable_ros.scene import Scene

NOWHERE = np.full(3, np.nan)
PERIOD = 10_000_000  # ns between the stamps of two poses


class BatchLog:
    """Writes batches of one scene, pose after pose, from now on.

    Raises:
        LogError: the file exists or cannot be written.
    """

    def __init__(self, path: Path, scene: Scene) -> None:
        self._log = SolveLog(path, scene)
        self._cables = scene.cables
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
                    if batch.support_wrench is not None:
                        for k, (owner, name) in enumerate(batch.supports):
                            if owner == cable:
                                self._log.wrench(cable, name, batch.support_wrench[i, k], *times)
                    self._log.limits(cable, self._extremes(batch, i, j), *times)
            if batch.joint_names and trusted[i].all():
                self._log.joint_load(batch.joint_names, batch.joints[i], batch.joint_load[i], *times)
            for j, cable in enumerate(batch.cables):
                if trusted[i, j]:
                    self._log.polyline(cable, batch.points[i, j], batch.orientations[i, j], *times)

    def _extremes(self, batch: Batch, pose: int, cable: int) -> list[Extreme]:
        """Of one cable at one pose; a batch does not hold where in the world, nor to which obstacle."""
        limits = self._cables[cable].limits
        if batch.extremes is None or limits is None:
            return []
        return [
            Extreme(quantity, value, place, NOWHERE, getattr(limits, quantity.name))
            for quantity, (value, place) in zip(QUANTITIES, batch.extremes[pose, cable].tolist(), strict=True)
        ]

    def __enter__(self) -> BatchLog:
        return self

    def __exit__(self, *exc: Any) -> None:
        """Finish the file, or leave none after an exception; raises LogError where it cannot."""
        self._log.__exit__(*exc)
