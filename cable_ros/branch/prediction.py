# SPDX-License-Identifier: Apache-2.0
"""Where unknowns are at the next pose if they go on along the path of the last ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

BENT = 0.5
"""Change of velocity in a step, relative to itself, beyond which the path has a kink: a ring slides."""


class Step(NamedTuple):
    """From one equilibrium to the next."""

    joints: np.ndarray
    """(n,) motion of the joints, rad or m."""
    change: np.ndarray
    """(N,) of the unknowns."""


def onward(first: np.ndarray, step: np.ndarray) -> float:
    """A step in the joints over the one before it if it goes on the same way, at most twice as far; else 0.

    Args:
        first, step: (n,) motions of the joints.
    """
    size = float(first @ first)
    ratio = float(first @ step) / size if size > 0.0 else 0.0
    if not 0.0 < ratio <= 2.0 or np.abs(step - ratio * first).max() > 0.1 * np.abs(step).max():
        return 0.0
    return ratio


def predicted(steps: Sequence[Step], motion: np.ndarray) -> np.ndarray | None:
    """(N,) change of the unknowns in a motion of the joints (n,); None if it does not go on as before.

    `steps`: the last ones, the latest first. Of two, the velocity goes on changing as it does: an error of
    third order, where one leaves one of second.
    """
    ratio = onward(steps[0].joints, motion) if steps else 0.0
    if ratio == 0.0:
        return None
    velocity = steps[0].change  # per length of the latest step; in its middle
    before = onward(steps[1].joints, steps[0].joints) if len(steps) > 1 else 0.0
    if before > 0.0:
        bend = velocity - before * steps[1].change
        if np.abs(bend).max() <= BENT * np.abs(velocity).max():
            velocity = velocity + (1.0 + ratio) / (1.0 + 1.0 / before) * bend
    out: np.ndarray = ratio * velocity
    return out
