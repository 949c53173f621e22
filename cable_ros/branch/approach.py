# SPDX-License-Identifier: Apache-2.0
"""Obstacles away from where they are: from there they come back to a cable that hangs."""

from __future__ import annotations

import numpy as np

from cable_ros.scene import Kinematics

FAR = 2.0
"""How far they go, lengths of the cable."""


class Away(Kinematics):
    """A robot's kinematics with one joint more, by whose value all obstacles are off.

    Args:
        of: the robot's.
        way: (3,) by which they are off where that value is 1, m, world.
    """

    def __init__(self, of: Kinematics, way: np.ndarray) -> None:
        self._of, self._way = of, way
        self.joint_names = (*of.joint_names, "away")

    def poses(self, q: np.ndarray) -> np.ndarray:
        return self._of.poses(q[: len(self._of.joint_names)])

    def obstacle_poses(self, q: np.ndarray) -> np.ndarray:
        out = self._of.obstacle_poses(q[: len(self._of.joint_names)]).copy()
        out[:, :3] += q[-1] * self._way
        return out
