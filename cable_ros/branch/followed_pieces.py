# SPDX-License-Identifier: Apache-2.0
"""The branch of pieces that share supports, from pose to pose: steps, and where it ends."""

from __future__ import annotations

import numpy as np

from cable_ros.branch.coupled_state import Shared
from cable_ros.branch.followed_equilibrium import largest_difference
from cable_ros.branch.prediction import predicted
from cable_ros.branch.released import Released
from cable_ros.branch.snap_through import JUMP, has_jumped
from cable_ros.equilibrium import Status
from cable_ros.rod import quaternion
from cable_ros.scene import Kinematics

LONGEST = 0.2
"""Maximum step in joint values, rad or m, that is taken at once."""
SHORTEST = 1e-4
"""Minimum step, rad or m; if even that fails, the cable snaps."""
STEEP = 1e-6
"""The same while a cable stands on its end all but straight: the end goes aside as the root of the step."""
MOST_STEPS, MOST_WORK = 60, 300_000
"""Maximum number of steps of one solve; with friction of obstacles also maximum work, iterations times
unknowns, after which no further one begins: about 0.6 s."""
BEYOND = (1.0, 10.0, 100.0)
"""Steps of `SHORTEST` along the path at which a snap-through is tried."""


class FollowedPieces(Released):
    """A run that goes on from its last equilibrium."""

    def reset(self) -> None:
        super().reset()
        self._stride = LONGEST  # step in joint values that it goes on with, rad or m

    def _follow(self, kinematics: Kinematics, joints: np.ndarray, steps: int) -> tuple[int, str | None]:
        """Continue the branch straight to `joints`, as far as the steps last.

        Returns the number of steps, and a sentence if it snapped on the way; None: it was lost.
        """
        told = ""
        origin = self._joints
        distance = largest_difference(joints, origin)
        longest = LONGEST / max(distance, LONGEST)
        at, step = 0.0, min(longest, self._stride / distance) if distance else 1.0
        while at < 1.0:
            if steps >= MOST_STEPS or (self.rubs and self._worked > MOST_WORK):
                if distance:
                    self._stride = step * distance
                return steps, told
            target = min(1.0, at + step)
            there = joints if target == 1.0 else origin + target * (joints - origin)
            mounts = kinematics.poses(there)[self.which]
            steps += 1
            assert self.state is not None
            found = self._balanced(kinematics, there, mounts)
            distance_here = (target - at) * distance
            hasty = found is not None and (any(piece.hasty for piece in self.pieces) or self._stops(found))
            if hasty and 0.5 * distance_here >= SHORTEST:
                found = None
            if found is not None and not self._stable(kinematics, there, mounts, found):
                found = None
            if found is not None:
                for piece in self.pieces:
                    piece.arrive()
                self._accept(there, found)
                at, step = target, min(2.0 * step, longest)
                continue
            self._return()
            self._faces = [tip.touch for tip in self.state.tips]
            step = 0.5 * (target - at)
            if step * distance < (STEEP if self._stands else SHORTEST):
                rubbed = self.rubbing
                before, last = self._energy(kinematics.poses(self._joints)[self.which]), self.state
                shapes = [piece.shape for piece in self.pieces]
                left = self._left_branch(kinematics, origin, joints, at, step)
                if left is None:
                    return steps, None
                target, remembers = left
                at, step = target, longest
                if rubbed and not remembers:
                    self.pieces[0].distrust("it snapped, and the friction of its contacts was forgotten")
                turned = np.abs(last.step_to(self.state)[~self._lengths]).max()
                if turned < JUMP and not any(map(has_jumped, shapes, (piece.shape for piece in self.pieces))):
                    continue  # it goes on, steeply
                after = self._energy(kinematics.poses(self._joints)[self.which])
                told = (
                    f"{Status.SNAPPED.sentence[:-1]} (energy {before:.4g} -> {after:.4g} J at"
                    f" {100.0 * target:.4g} % of the step)."
                )
        self._stride = LONGEST
        if not distance:
            self._joints = joints
        return steps, told

    def _left_branch(
        self, kinematics: Kinematics, origin: np.ndarray, joints: np.ndarray, at: float, step: float
    ) -> tuple[float, bool] | None:
        """Leave the last equilibrium, `at` a fraction of the way from `origin` to `joints`, for another one.

        What is rough holds a cable as it falls, if that leads anywhere; else friction is forgotten. Returns
        the fraction at which it arrived, and whether it knows its friction; None: there is none.
        """
        assert self.state is not None
        last = self.state
        ways = [(self._snap, False)]
        if self.rubbing and not self.loose:
            ways.insert(0, (self._fall_with_friction, True))
        for way, remembers in ways:
            for reach in BEYOND:  # next to a fold nothing is exact
                target = min(1.0, at + reach * step)
                there = origin + target * (joints - origin)
                if way(kinematics, there, kinematics.poses(there)[self.which]):
                    return target, remembers
                self.state = last
                self._return()
        return None

    def _balanced(self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray) -> Shared | None:
        """The equilibrium at the end of a step, from several guesses in turn; None: it is found from none."""
        assert self.state is not None
        clear = not self.rubbing
        self._set_clear(clear)
        guess = self._extrapolated(joints)
        found = self._newton(kinematics, joints, mounts, guess)
        if clear and self.may_rub and (found is None or self.rubbing):
            # what has come to rub does so since the last pose
            self._set_clear(False)
            self._return()
            found = self._newton(kinematics, joints, mounts, guess)
        if found is None and self.loose:
            self._return()
            guess = self._carried(kinematics.poses(self._joints)[self.which], mounts)
            found = self._newton(kinematics, joints, mounts, guess)
        if found is None and guess is not self.state:
            self._return()
            found = self._newton(kinematics, joints, mounts, self.state)
        return found

    @property
    def _worked(self) -> float:
        """Iterations times unknowns since the solve began."""
        return sum(piece.worked for piece in self.pieces)

    def _extrapolated(self, joints: np.ndarray) -> Shared:
        """The state there if it goes on as in the last steps."""
        assert self.state is not None
        change = predicted(self._steps, joints - self._joints)
        if change is None:
            return self.state
        change = change + self._missed
        change[~self._solved] = 0.0
        return self.state.moved(change)

    def _carried(self, before: np.ndarray, mounts: np.ndarray) -> Shared:
        """The state to first order after the mounts' motions from `before`, both (n + 1, 2, 7).

        A loose end is to follow them, for a cable that is all but straight has no slack.
        """
        state = self.state
        assert state is not None
        if not self._renew(before, state):
            return state
        assert self._inverse is not None
        motions = np.empty((len(mounts), 2, 6))
        for old, new, motion in zip(
            before.reshape(-1, 7), mounts.reshape(-1, 7), motions.reshape(-1, 6), strict=True
        ):
            back = quaternion.conjugate(quaternion.from_ros(old[3:]))
            motion[:3] = quaternion.rotate(back, new[:3] - old[:3])
            motion[3:] = quaternion.rotation_vector(quaternion.multiply(back, quaternion.from_ros(new[3:])))
        step, free = np.zeros(len(self.free)), self._solved
        step[free] = -self._inverse @ self.tangent(before, state).by_mounts(motions.reshape(-1, 12))[free]
        return state.moved(step)
