# SPDX-License-Identifier: Apache-2.0
"""A cable that snaps: its energy is descended while springs keep its strands apart."""

from __future__ import annotations

import numpy as np

from cable_ros.branch.crossing_cable import SLOTS
from cable_ros.branch.crossing_newton import CrossingNewton, overlapping
from cable_ros.branch.shared_piece import Place
from cable_ros.branch.strand_springs import Strands
from cable_ros.contact.crossing import Spacer, closest
from cable_ros.rod import quaternion
from cable_ros.scene import Kinematics

LEAST_PART = 1.0 / 16.0
"""Least part of what springs gave way that is taken back in one step."""


class CrossingSnap(CrossingNewton):
    """The cables of a group; see `CrossingNewton`."""

    onto_itself = False
    """Whether a cable's last snap ended where it touches itself."""

    def _snap(self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray) -> float | None:
        """How far a cable moves, L, that snaps at a pose nearby, maybe onto itself; it is accepted.

        None: it does not, or might meet another cable on the way; all is as it was then.
        """
        self.onto_itself = False
        if self._may_meet(poses):
            return None
        before = [cable.outline(own[0]) for cable, own in zip(self.cables, poses, strict=True)]
        found = self._descended(kinematics, joints, poses)
        pairs = self.pairs(poses) if found is not None else []
        if found is None or overlapping(pairs, found) or not self._stable(poses, found):
            self._restore(self._kept)
            return None
        self._accept(joints, pairs, found)
        self._before = None
        after = [cable.outline(own[0]) for cable, own in zip(self.cables, poses, strict=True)]
        moves = zip(after, before, self.cables, strict=True)
        return max(float(np.abs(a - b).max()) / cable.length for a, b, cable in moves)

    def _descended(
        self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray
    ) -> list[Spacer] | None:
        """The equilibrium where a descent of each cable's energy ends; None: it ends nowhere."""
        spacers: list[Spacer] = []
        loads: list[dict[int, tuple[float, float]]] = []
        for i, (cable, own) in enumerate(zip(self.cables, poses, strict=True)):
            diameter = 2.0 * self._radii[i]
            place, known = Place(own, cable.length), self._strands(i, own[0])
            arrived, pressed = cable.descend(kinematics, joints, place, diameter / cable.length, known)
            self.onto_itself = self.onto_itself or bool(pressed)
            if not arrived or 2 * len(pressed) > SLOTS:
                return None
            curve = cable.curve(own[0])
            load: dict[int, tuple[float, float]] = {}
            for j, (strands, force) in enumerate(pressed):
                near = closest(curve, curve, (float(strands.arcs[0]), float(strands.arcs[1])))
                slots = 2 * j, 2 * j + 1
                spacers.append(Spacer.between((i, i), slots, near.points, near.tangents, near.distance))
                load |= {slot: (s / cable.length, force) for slot, s in zip(slots, near.arcs, strict=True)}
            loads.append(load)
        if not spacers:  # from the springs' accuracy to that of all others
            return self._newton(kinematics, joints, poses, [])
        self._show(kinematics, joints, poses, spacers)
        if not all(cable.press(load) for cable, load in zip(self.cables, loads, strict=True)):
            return None
        return self._hardened(kinematics, joints, poses, spacers)

    def _strands(self, i: int, start: np.ndarray) -> list[Strands]:
        """Of cable i, which starts at `start` (7,), where its strands were near each other."""
        turn, length = quaternion.matrix_from_ros(start[3:]), self.cables[i].length
        return [
            Strands(np.array(near.arcs) / length, near.normal @ turn, near.distance / length)
            for near in (pair.closest for pair in self._pairs if pair.cables == (i, i))
        ]

    def _hardened(
        self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray, spacers: list[Spacer]
    ) -> list[Spacer] | None:
        """The equilibrium with full distances, from spacers as wide as the springs have left them."""
        widths = [one.apart for one in spacers]
        state, part, step = spacers, 0.0, 1.0
        self._checkpoint()
        while part < 1.0:
            to = min(part + step, 1.0)
            guess = [
                one.with_apart((1.0 - to) * width + to * 2.0 * self._radii[one.cables[0]])
                for one, width in zip(state, widths, strict=True)
            ]
            found = self._newton(kinematics, joints, poses, guess)
            if found is not None:
                state, part = found, to
                self._checkpoint()
                continue
            self._restore(self._spare)
            step *= 0.5
            if step < LEAST_PART:
                return None
        return state

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
