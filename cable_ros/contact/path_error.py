# SPDX-License-Identifier: Apache-2.0
"""How far off the end force of a cable is that lies with friction, for its path was followed in steps.

Within a step slip has one direction, and who slips and who sticks is told at its end. What that does to the
end force is of second order in the step: a part of how much its change differs from that of the step before.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

PART = 0.05
"""Of the difference between two steps' changes of the end force. For 51 hoses on rough ground the error is
above what is told, by more than 0.3 %, at 4 of 1,361 poses; where it is large it is half of that (median)."""
FADES = 5.0
"""1 / L: by how much it fades over the motion, as fast as on a grid of contacts."""

STILL = 1e-9
"""Length of a step, L, below which nothing has moved: a free end is found again to rounding."""


@dataclass(frozen=True)
class PathError:
    """Along the path so far."""

    error: float = 0.0
    """Of the end force, EI / L^2."""
    rate: np.ndarray | None = None
    """(3,) change of the end force in the last step over its length, EI / L^3."""

    def in_units(self, scale: float) -> PathError:
        """In units of the force that are `scale` times as large."""
        return PathError(self.error / scale, None if self.rate is None else self.rate / scale)

    def after_step(self, distance: float, change: np.ndarray) -> PathError:
        """After a step of length `distance`, L, in which the end force changed by `change`, (3,)."""
        if distance < STILL:
            return self
        bend = change if self.rate is None else change - distance * self.rate
        faded = self.error * math.exp(-FADES * distance)
        return PathError(faded + PART * float(np.linalg.norm(bend)), change / distance)


NONE = PathError()
"""Nothing has slipped along a patch."""
