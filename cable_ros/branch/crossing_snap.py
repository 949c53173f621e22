# SPDX-License-Identifier: Apache-2.0
"""A cable that snaps: its energy is descended while springs keep its strands apart."""

from __future__ import annotations

import numpy as np

from cable_ros.branch.crossing_newton import CrossingNewton, overlapping
from cable_ros.branch.shared_piece import Place
from cable_ros.branch.strand_springs import Strands
from cable_ros.rod import quaternion
from cable_ros.scene import Kinematics


class CrossingSnap(CrossingNewton):
    """The cables of a group; see `CrossingNewton`."""

    onto_itself = False
    """Whether a cable's last snap ended where it touches itself."""

    def _snap(self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray) -> float | None:
        """How far a cable moves, L, that snaps at a pose nearby, to where nothing touches; it is accepted.

        None: it does not, or might meet another cable on the way; all is as it was then.
        """
        self.onto_itself = False
        if self._may_meet(poses):
            return None
        before = [cable.outline(own[0]) for cable, own in zip(self.cables, poses, strict=True)]
        for i, (cable, own) in enumerate(zip(self.cables, poses, strict=True)):
            turn = quaternion.matrix_from_ros(own[0, 3:])
            known = [
                Strands(
                    np.array(pair.closest.arcs) / cable.length, pair.closest.normal @ turn,
                    pair.closest.distance / cable.length,
                )
                for pair in self._pairs
                if pair.cables == (i, i)
            ]  # fmt: skip
            diameter = 2.0 * self._radii[i] / cable.length
            arrived, self.onto_itself = cable.descend(
                kinematics, joints, Place(own, cable.length), diameter, known
            )
            if not arrived:
                self._restore(self._kept)
                return None
        # from the springs' accuracy to that of all others
        if self._newton(kinematics, joints, poses, []) is None or overlapping(pairs := self.pairs(poses), []):
            self._restore(self._kept)
            return None
        self._accept(joints, pairs, [])
        self._before = self._judged = None
        after = [cable.outline(own[0]) for cable, own in zip(self.cables, poses, strict=True)]
        moves = zip(after, before, self.cables, strict=True)
        return max(float(np.abs(a - b).max()) / cable.length for a, b, cable in moves)

    def _may_meet(self, poses: np.ndarray) -> bool:
        """Whether two cables can come near each other in any shape; `poses` (n, 2, 7): of the clamps."""
        middles = poses[:, :, :3].mean(axis=1)
        for i, a in enumerate(self.cables):
            for k, b in enumerate(self.cables[:i]):
                reach = 0.5 * (a.length + b.length) + self._radii[i] + self._radii[k]
                thick = self._radii[i] and self._radii[k]
                if thick and float(np.linalg.norm(middles[i] - middles[k])) < reach:
                    return True
        return False
