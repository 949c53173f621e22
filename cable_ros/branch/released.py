# SPDX-License-Identifier: Apache-2.0
"""Cold start and snap-through of a cable with pins, rings and tubes: clips in their place are released."""

from __future__ import annotations

import numpy as np

from cable_ros.branch.balance import HELD, LEAST, Balance
from cable_ros.branch.coupled_state import Shared, first_guess, reachable
from cable_ros.branch.release import Release, descend
from cable_ros.equilibrium import Status
from cable_ros.scene import Kinematics

SLIDE, MOST_SLIDES = 0.05, 200
"""Step of a cable that friction does not hold, as a fraction of the shortest piece, and their number."""


class Released(Balance):
    """A run with the searches for another equilibrium."""

    def _start(
        self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray
    ) -> tuple[Status, str, int] | None:
        """Find an equilibrium: clips in the place of all supports, then released.

        None, or status and message of the piece that failed, and its number here.
        """
        Balance.reset(self)
        length = self.run.length
        arcs = np.array([support.arc_length for support in self.run.supports])
        guess = first_guess(mounts, reachable(mounts, arcs, length, self._guides), length, self._tubes)
        for i, (piece, place) in enumerate(zip(self.pieces, guess.places(mounts, length), strict=True)):
            found = piece.find(kinematics, joints, place)
            if not found.converged:
                return found.status, found.message, i
        self._joints, self.state = joints, guess
        if self._snap(kinematics, joints, mounts):
            return None
        self.state = None
        return Status.NOT_CONVERGED, "No stable equilibrium was found as its supports were released.", 0

    def _snap(self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray) -> bool:
        """Descend the energy from the last equilibrium to a stable one; whether one was found.

        Friction of obstacles is left out on the way, and begins at nothing.
        """
        assert self.state is not None
        for piece in self.pieces:
            piece.rub(False)
        found = self._descended(kinematics, joints, mounts)
        for piece in self.pieces:
            piece.rub(True)
        if found is not None:
            self._accept(joints, found)
            self._before = None
        return found is not None

    def _descended(self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray) -> Shared | None:
        """The stable equilibrium that a descent from the last one ends at; None: none was found."""
        assert self.state is not None
        state, kept = self.state, self._kept
        self._inverse = self._judged_at = self._before = None
        if self._kept and not self._move(kinematics, joints, mounts, state, True):
            return None

        def energy() -> float:
            return self._energy(mounts, state)

        def move(to: Shared, fall: bool) -> bool:
            nonlocal state
            self._keep()
            if not self._move(kinematics, joints, mounts, to, fall):
                self._return()
                return False
            state = to
            return True

        def back(to: Shared) -> None:
            nonlocal state
            self._return()
            state = to

        self._slides[:] = 0
        sticks = ~self.free
        release = Release(move, back, energy, lambda at: self.tangent(mounts, at), self.scale(), ~sticks)
        found = descend(release, state)
        if found is not None:
            self.state = found
            found = self._let_slide(kinematics, joints, mounts)
        if found is None or not self._stable(joints, mounts, found):
            self._kept = kept
            return None
        return found

    def _let_slide(self, kinematics: Kinematics, joints: np.ndarray, mounts: np.ndarray) -> Shared | None:
        """Let the cable slide in rings that do not hold it, until friction does; None: it slides too far.

        The pieces are at a state without sliding. What exceeds friction moves on in short steps, as a cable
        that creeps, until Newton's method finds where friction is just enough.
        """
        assert self.state is not None
        step = longest = SLIDE * min(piece.length for piece in self.pieces)
        for _ in range(MOST_SLIDES):
            self._slides[:], self._inverse = 0, None
            stuck = self._corrected(kinematics, joints, mounts, self.state)
            if stuck is None:
                return None
            excess, signs = self._excess()
            over = self._guides & (self._friction > 0.0) & (excess > (1.0 + HELD) * self._friction)
            if not over.any():
                return stuck
            self.state = stuck
            self._keep()
            self._slides[over], self._inverse = signs[over], None
            slid = self._corrected(kinematics, joints, mounts, stuck)
            if slid is not None and not (over & (signs * (slid.arcs - stuck.arcs) > 0.0)).any():
                return slid
            self._return()
            self._slides[:] = 0
            while step > LEAST * self.run.length:
                on = Shared(stuck.turns, stuck.arcs - step * signs * over)
                crept = self._corrected(kinematics, joints, mounts, on)
                if crept is not None:
                    now, towards = self._excess()
                    if (over & (now > self._friction) & (towards == signs)).any():
                        self.state, step = crept, min(2.0 * step, longest)
                        break
                self._return()
                step *= 0.5
            else:
                return None
        return None

    def _energy(self, mounts: np.ndarray, state: Shared | None = None) -> float:
        """Of all pieces, J."""
        state = self.state if state is None else state
        assert state is not None
        places = state.places(mounts, self.run.length)
        return sum(piece.energy(place.poses) for piece, place in zip(self.pieces, places, strict=True))
