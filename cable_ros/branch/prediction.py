# SPDX-License-Identifier: Apache-2.0
"""Where unknowns are at the next pose if they go on along the path of the last ones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cable_ros.compilation import LEAF_ENTRY, njit

BENT = 0.5
"""Change of velocity in a step, relative to itself, beyond which the path has a kink: a ring slides."""


class Step(NamedTuple):
    """From one equilibrium to the next."""

    joints: np.ndarray
    """(n,) motion of the joints, rad or m."""
    change: np.ndarray
    """(N,) of the unknowns."""


NO_STEP = Step(np.zeros(0), np.zeros(0))


@njit(**LEAF_ENTRY)
def onward(first, step):  # type: ignore[no-untyped-def]
    """A step in the joints over the one before it if it goes on the same way, at most twice as far; else 0.

    Args:
        first, step: (n,) motions of the joints.
    """
    size, along = 0.0, 0.0
    for i in range(first.shape[0]):
        size += first[i] * first[i]
        along += first[i] * step[i]
    ratio = along / size if size > 0.0 else 0.0
    if not 0.0 < ratio <= 2.0:
        return 0.0
    aside, most = 0.0, 0.0
    for i in range(first.shape[0]):
        aside, most = max(aside, abs(step[i] - ratio * first[i])), max(most, abs(step[i]))
    return 0.0 if aside > 0.1 * most else ratio


@njit(**LEAF_ENTRY)
def _lead(motion, joints, change, earlier, before, out):  # type: ignore[no-untyped-def]
    """`predicted` into `out` (N,); whether it goes on.

    Args:
        motion: (n,) of the joints.
        joints, change: of the last `Step`.
        earlier, before: of the one before it, empty if there is none.
        out: (N,) overwritten.
    """
    ratio = onward(joints, motion)
    if ratio == 0.0:
        return False
    longer = onward(earlier, joints)
    most, bent = 0.0, 0.0
    for k in range(out.shape[0]):
        # per length of the last step; in its middle
        out[k] = change[k]
        most = max(most, abs(change[k]))
        if longer > 0.0:
            bent = max(bent, abs(change[k] - longer * before[k]))
    bends = longer > 0.0 and bent <= BENT * most
    for k in range(out.shape[0]):
        if bends:
            out[k] += (1.0 + ratio) / (1.0 + 1.0 / longer) * (change[k] - longer * before[k])
        out[k] *= ratio
    return True


def predicted(steps: Sequence[Step], motion: np.ndarray) -> np.ndarray | None:
    """(N,) change of the unknowns in a motion of the joints (n,); None if it does not go on as before.

    `steps`: the last ones, the latest first. Of two, the velocity goes on changing as it does: an error of
    third order, where one leaves one of second.
    """
    if not steps:
        return None
    last, before = steps[0], steps[1] if len(steps) > 1 else NO_STEP
    out = np.empty(len(last.change))
    return out if _lead(motion, *last, *before, out) else None
