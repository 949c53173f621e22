# SPDX-License-Identifier: Apache-2.0
"""How far off the end force of a cable is that lies with friction, for its path was followed in steps.

Within a step slip has one direction, and who slips and who sticks is told at its end. What that does to the
end force is of second order in the step: along a patch a part of how much its change differs from that of the
step before, at points of what slip turns otherwise than in the step before.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

PART, TURN_PART = 0.03, 0.04
"""Of the difference between two steps' changes of the end force, and of the friction by which slip at
points turned otherwise than foreseen. Of 3,750 poses in 120 rough scenes the error is above what is told,
by more than 0.3 %, at 2; where it is above 0.1 %, twice it is told (median)."""
FALL_PART = 0.01
"""Of the change of the end force in a fall. Told in other steps two drawn lifts ended by 1.0 and 1.4 % of it
away, others by less. The force against the drag of its first step, which once counted, was 20 times that."""
FADES = 5.0
"""1 / L: by how much it fades over the motion, as fast as on a grid of contacts."""
SLID_PART, SLID_FADES = 0.1, 100.0
"""Of friction that was unknown, as what bears it begins to slip, from where it stuck; and how fast that
fades, 1 / L. Drawn taut over a beam, a cable was 9.6 % off after 0.0013 L on the way back, and 6.4, 1.8
and 0.3 % after 0.0055, 0.012 and 0.02 L; that was told as 0.1 to 1 %."""
LARGEST = 2.0
"""Maximum error, as a multiple of the friction that the contacts can bear: all of it may be turned round."""

STILL = 1e-9
"""Length of a step, L, below which nothing has moved: a free end is found again to rounding."""


@dataclass(frozen=True)
class PathError:
    """Along the path so far."""

    error: float = 0.0
    """Of the end force, EI / L^2."""
    rate: np.ndarray | None = None
    """(3,) change of the end force in the last step over its length, EI / L^3."""
    possible: float = 0.0
    """Sum of the friction that the contacts could bear after the last step, EI / L^2."""
    unknown: float = 0.0
    """Friction that may be any, EI / L^2: of what sticks since a part of the path that was not followed."""
    slid: float = 0.0
    """Of the end force, EI / L^2, by what has slipped since then."""

    @property
    def of_force(self) -> float:
        """Error of the end force, EI / L^2, by all of it."""
        return self.error + self.unknown + self.slid

    def in_units(self, scale: float) -> PathError:
        """In units of the force that are `scale` times as large."""
        rate = None if self.rate is None else self.rate / scale
        unknown, slid = self.unknown / scale, self.slid / scale
        return PathError(self.error / scale, rate, self.possible / scale, unknown, slid)

    @staticmethod
    def of_slip(possible: float) -> PathError:
        """Where points slip whose friction was forgotten: it has its size, and where they are across their
        slip depends on the past. So the end force was up to 2.7 % off; SLID_PART of the friction was two to
        ten times that, and FADES slower than it did. `possible` as in `after_step`.
        """
        return PathError(SLID_PART * possible, None, possible)

    def not_followed(self, possible: float) -> PathError:
        """After a part of the path that was not followed; `possible` as in `after_step`."""
        return PathError(self.error, None, possible, possible)

    def known_but_for(self, held: float) -> PathError:
        """Where what sticks can bear the friction `held`, EI / L^2: what slips knows most of its own anew."""
        if self.unknown <= held:
            return self
        return replace(self, unknown=held, slid=self.slid + SLID_PART * (self.unknown - held))

    def _not_known(self, distance: float, eased: float) -> tuple[float, float]:
        """`unknown` and `slid` after a step of `distance`, L, where so much is left of an error."""
        return eased * self.unknown, eased * self.slid * math.exp(-SLID_FADES * distance)

    def _eased(self, possible: float) -> float:
        """Part of the error that is left where the contacts can bear so much friction, EI / L^2."""
        return possible / self.possible if possible < self.possible else 1.0

    def after_slip(self, distance: float, unforeseen: float, possible: float) -> PathError:
        """After a step in which it touched at points alone; see `after_step`.

        Args:
            distance, possible: as there.
            unforeseen: friction by which what slips has turned so, EI / L^2; see `slip_kernels.slip_bend`.
        """
        if distance < STILL:
            return self
        eased = self._eased(possible)
        error = eased * self.error * math.exp(-FADES * distance) + TURN_PART * unforeseen
        return PathError(min(error, LARGEST * possible), None, possible, *self._not_known(distance, eased))

    def after_fall(self, before: np.ndarray, after: np.ndarray, possible: float) -> PathError:
        """After a fall, from the end force `before` to `after`, (3,), EI / L^2; `possible` as there.

        The forces on its way are those of a medium, which foretell nothing. How far it falls depends on the
        friction that is unknown where it begins, too.
        """
        change = float(np.linalg.norm(after - before))
        error = self._eased(possible) * self.of_force + FALL_PART * change
        return PathError(min(error, LARGEST * possible), None, possible)

    def after_step(
        self, distance: float, before: np.ndarray, after: np.ndarray, possible: float, landed: float = 0.0
    ) -> PathError:  # fmt: skip
        """After a step of length `distance`, L.

        Args:
            distance: its length, L.
            before, after: (3,) the end force, EI / L^2.
            possible: sum of the friction that the contacts can bear after it, EI / L^2. Where that falls, the
                error falls with it, for friction remembers no more than it can bear; and what the end force
                loses in proportion is no error.
            landed: friction of what came down in it that the step has left open, EI / L^2; see `Landing`.
        """
        if distance < STILL:
            return self
        change = after - before
        eased = self._eased(possible)
        bend = change if self.rate is None else change - distance * self.rate
        # what turns back differs from the last rate by twice its change, what comes to rest by more
        size = min(float(np.linalg.norm(bend)), 2.0 * float(np.linalg.norm(after - eased * before)))
        error = eased * (self.error * math.exp(-FADES * distance) + PART * size) + landed
        rate, not_known = change / distance, self._not_known(distance, eased)
        return PathError(min(error, LARGEST * possible), rate, possible, *not_known)


NONE = PathError()
"""Nothing has slipped along a patch."""
