# SPDX-License-Identifier: Apache-2.0
"""Compiled: where a step leads a cable among obstacles, and how far, in one call from Python."""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import njit
from cable_ros.contact.distance import gap, place_obstacles
from cable_ros.contact.travel import travel
from cable_ros.rod.units import relative_conditions

OPTIONS = {"cache": True, "error_model": "numpy"}


@njit(**OPTIONS)
def destination(poses, last, weight, unit, obstacles, out):  # type: ignore[no-untyped-def]
    """Conditions and obstacles in the start clamp's frame, units of the cable.

    Args:
        poses: (2, 7) of the clamps, world, x y z, quaternion x y z w.
        last: end frame (4,), end position (3,) and obstacles (o, WIDTH) before the step.
        weight: (3,) load per length in the world, N/m.
        unit: length, m, and force, N, of the cable.
        obstacles: (o, WIDTH) in the frames of their links, SI, and (o, 7) these links in the world.
        out: end frame (4,), end position (3,), load (3,) and obstacles, a copy of those in their links'
            frames; overwritten.

    Returns:
        `travel` of the step, and the least gap at the clamps, L.
    """
    qe, re, f, there = out
    local, links = obstacles
    length, force = unit
    relative_conditions(poses, last[0], weight, length, force, qe, re, f)
    place_obstacles(local, links, poses[0], length, there)
    r, n, directions, bends = np.zeros(3), np.empty(3), np.empty((2, 3)), np.empty(2)
    least = np.inf
    for o in range(there.shape[0]):
        least = min(least, gap(there[o], r, n, directions, bends), gap(there[o], re, n, directions, bends))
    return travel(last[0], last[1], last[2], qe, re, there), least
