"""Compiled: how far a cable is led from one pose to another."""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import LEAF, njit

TURN = 0.3
"""A clamp or an obstacle that turns by 1 rad moves the cable beside it by about so many lengths."""
FRICTION_STEP, CONTACT_STEP = 0.02, 0.1
"""Longest step, lengths, of a cable among obstacles, with friction and without: friction depends on the path
between two poses, which is taken to be straight."""


@njit(**LEAF)
def travel(
    qe: np.ndarray, re: np.ndarray, obstacles: np.ndarray, qe2: np.ndarray, re2: np.ndarray,
    obstacles2: np.ndarray,
) -> float:  # fmt: skip
    """Largest motion of the end clamp and the obstacles (o, WIDTH) in the start clamp's frame, lengths."""
    straight, back, out = 0.0, 0.0, 0.0
    for i in range(4):
        straight = max(straight, abs(qe[i] - qe2[i]))
        back = max(back, abs(qe[i] + qe2[i]))
    out = 2.0 * TURN * min(straight, back)
    for i in range(3):
        out = max(out, abs(re[i] - re2[i]))
    for o in range(obstacles.shape[0]):
        for i in range(1, 4):
            out = max(out, abs(obstacles[o, i] - obstacles2[o, i]))
        for i in range(4, 13):
            out = max(out, TURN * abs(obstacles[o, i] - obstacles2[o, i]))
    return out
