# SPDX-License-Identifier: Apache-2.0
"""How a run falls where its branch ends among rough obstacles: as in a viscous medium, with their memory."""

from __future__ import annotations

import numpy as np

from cable_ros.branch.balance import Balance
from cable_ros.branch.coupled_state import Shared
from cable_ros.branch.release import lowest, principal
from cable_ros.scene import Kinematics

FIRST, LARGEST, SMALLEST = 0.01, 0.1, 1e-6
"""Step of the supports, rad or in lengths of that stiffness: at first, the largest, and the smallest."""
GROWS, SHRINKS = 1.3, 0.5
"""Its factors after a step that arrived and after one that failed."""
STEPS = 300
"""Maximum number of their steps."""
NEAR, AT_REST = 0.5, 1e-7
"""Part of the radius below which a step may have led to an equilibrium, and the least step of supports that
are not in balance."""


class ViscousFall(Balance):
    """A run that falls without forgetting what sticks."""

    def _fall_with_friction(self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray) -> bool:
        """Come to rest from the last equilibrium, a little further along the path; whether it did.

        The pieces fall between supports that give way step by step, until the whole is in balance.
        """
        assert self.state is not None
        origin, kept, steps = self.state, self._kept, self._steps
        state, to, radius, reach = origin, origin, FIRST, 0.0
        for _ in range(STEPS):
            if self._flowed(kinematics, joints, mounts, to):
                self._keep()
                self.state = state = to
                radius = min(GROWS * radius, LARGEST)
                arrived = True
            elif to is origin or radius < SMALLEST:
                break
            else:
                self._return()
                radius = SHRINKS * min(radius, reach)
                arrived = False
            step = self._given_way(mounts, state, radius)
            if step is None:
                break
            reach = self._reach(step)
            if arrived and (to is origin or reach < NEAR * radius):
                self._inverse = self._judged_at = None
                found = self._newton(kinematics, joints, mounts, state)
                if found is not None and self._stable(kinematics, joints, mounts, found):
                    self._accept(joints, found)
                    self._steps = ()
                    return True
                self._return()
                if reach < AT_REST:
                    break
            to = state.moved(step)
        self.state, self._kept, self._steps = origin, kept, steps
        self._return()
        return False

    def _flowed(self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray, to: Shared) -> bool:
        """Move all pieces to a state nearby, each in one step or by a fall; whether all arrived."""
        places = to.places(mounts, self.run.length)
        if any(place.length < self._least for place in places):
            return False
        return all(
            piece.attempt(kinematics, joints, place) or piece.flow(kinematics, joints, place)
            for piece, place in zip(self.pieces, places, strict=True)
        )

    def _given_way(self, mounts: np.ndarray, state: Shared, radius: float) -> np.ndarray | None:
        """(N,) how the supports give way to what is out of balance, within a radius; None: not known."""
        free, system, scale = self._solved, self._system(mounts, state), self.scale()
        weight = np.sqrt(scale[free] / scale[0])
        found = principal(system.tangent[np.ix_(free, free)], system.residual[free], weight)
        if found is None:
            return None
        values, vectors, g = found
        out = np.zeros(len(free))
        out[free] = vectors @ lowest(values, g, radius) / weight
        return out
