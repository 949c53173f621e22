# SPDX-License-Identifier: Apache-2.0
"""A logged run solved under another scene, as a log like the node's."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cable_ros.equilibrium import Equilibrium
from cable_ros.joint import joint_torque
from cable_ros.log.reader import PARAMETERS, LogReader
from cable_ros.log.run import Solve
from cable_ros.ros.solve_log import SolveLog
from cable_ros.scene import Scene
from cable_ros.tracker import Tracker


class WhatIfLog:
    """Writes the new results under the times of the old ones.

    Args:
        path: the new file.
        scene: under which was solved.
        source: the log that was solved again.

    Raises:
        LogError: the file exists or cannot be written.
    """

    def __init__(self, path: Path, scene: Scene, source: LogReader) -> None:
        texts = {name: text for name, text in source.attachments.items() if name == PARAMETERS}
        origin = {"source": str(source.path), "scene": str(scene.path or "")}
        self._tracker = Tracker(scene)  # for its kinematics alone
        self._log = SolveLog(path, scene, texts, {"what_if": origin})

    def write(self, solve: Solve, equilibria: Mapping[str, Equilibrium]) -> None:
        """One pose; what is not trusted has no messages, and polylines come as often as they were logged."""
        times = solve.stamp, solve.log_time
        self._log.joint_state(tuple(solve.joints), list(solve.joints.values()), *times)
        for name, found in equilibria.items():
            if found.status.trusted:
                self._log.wrenches(name, found.end_wrench, found.start_wrench, *times)
                self._log.limits(name, found.extremes, *times)
        names = self._tracker.joint_names
        if names and all(found.status.trusted for found in equilibria.values()):
            torques = joint_torque(self._tracker, equilibria, solve.joints)
            self._log.joint_load(names, [solve.joints[name] for name in names], torques, *times)
        if solve.polylines:
            for name, found in equilibria.items():
                if found.status.trusted:
                    self._log.polyline(name, found.points, found.orientations, *times)

    def __enter__(self) -> WhatIfLog:
        return self

    def __exit__(self, *exc: Any) -> None:
        self._log.__exit__(*exc)
