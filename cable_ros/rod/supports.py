# SPDX-License-Identifier: Apache-2.0
"""What the mounts of a rod with pinned, free or sliding ends feel at an equilibrium."""

from __future__ import annotations

import numpy as np

from cable_ros.rod import quaternion
from cable_ros.rod.ends import ZERO, Ends
from cable_ros.rod.rod_state import Conditions


class Supports:
    """What the mounts exert on the cable, in its units and in the start mount's frame.

    Args:
        ends: how the ends are held.
        conditions: the present ones.
        end: (3,) end position from the start of the cable, L.
        F: (3,) end force, EI / L^2.
        frames: (2, 4) first and last section.
        moments: (2, 3) moments on the cable at its ends, along the axes of these sections, EI / L.
    """

    def __init__(
        self, ends: Ends, conditions: Conditions, end: np.ndarray, F: np.ndarray, frames: np.ndarray,
        moments: np.ndarray,
    ) -> None:  # fmt: skip
        qe, re, f = conditions
        axis = ends.axis(qe)
        along = ZERO if axis is None else float(axis @ (end - re)) * axis
        self.ends, self.given = ends, ends.given_moments(qe)
        self.offsets = ZERO if ends.start.axis is None else -along, ZERO if ends.end.axis is None else along
        """(3,), (3,): where the cable begins and ends, from the mounts' origins, L."""
        self.forces = -(F + f), F
        """(3,), (3,) at start and end, EI / L^2."""
        self.free = turns = ends.turns
        """(2, 3) which rotations of the end sections are free."""
        self._section_moments = [
            quaternion.rotate(frame, moment * ~free) + given
            for frame, free, moment, given in zip(frames, turns, moments, self.given, strict=True)
        ]

    def moment(self, which: int) -> np.ndarray:
        """(3,) about the origin of the mount 0, start, or 1, end, EI / L; of a free end about itself."""
        moment, offset = self._section_moments[which], self.offsets[which]
        if offset is ZERO:
            return moment
        out: np.ndarray = moment + np.cross(offset, self.forces[which])
        return out

    def on_mounts(self, qe: np.ndarray, force: float, moment: float) -> tuple[np.ndarray, np.ndarray]:
        """(6,), (6,): wrenches of the cable on its end and start mounts, N and N m, in the mounts' axes.

        Args:
            qe: (4,) end frame.
            force, moment: the cable's units, N and N m.
        """
        back, ends = quaternion.conjugate(qe), self.ends
        end = [quaternion.rotate(back, self.forces[1]), quaternion.rotate(back, self.moment(1))]
        start = [self.forces[0], self.moment(0)]
        # given numbers go out as they came in
        if not ends.end.placed:
            end = [ends.end.force, ends.end.moment]
        if not ends.start.placed:
            start = [ends.start.force, ends.start.moment]
        scaled = [np.concatenate([-force * f, -moment * m]) + 0.0 for f, m in (end, start)]
        return scaled[0], scaled[1]
