# SPDX-License-Identifier: Apache-2.0
"""Compiled: the least distance of a centreline from obstacles, less the cable's radius where it counts."""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import LEAF, njit
from cable_ros.contact.distance import gap
from cable_ros.rod.centreline import position
from cable_ros.rod.resultants import GOLDEN, SECTIONS

OPTIONS = {"cache": True, "error_model": "numpy"}

COARSE, FINE = 32, 16
"""Number of equal intervals of the rod, and of parts of those that may hold the least distance."""
STEEP = 1.1
"""Largest change of the distance per arc length: a cable is stretched to no more than this."""


@njit(**LEAF)
def distance(obstacle, c, h, s0, s, work):
    """`distance.gap` at the arc length s; `work` (5, 3): workspace."""
    position(c, h, s0, s, work[0])
    return gap(obstacle, work[0], work[1], work[2:4], work[4])


@njit(**OPTIONS)
def clearance(c, h, s0, obstacles, most):
    """Least distance from the obstacles (n, WIDTH), the arc length where it is, and which obstacle's it is.

    Only one below `most`, the least that is known elsewhere, is looked for; infinite if there is none.

    What is too far away to hold a smaller distance, by its length, is left out, as is an interval whose ends
    are; the smallest of the samples of all others is refined by golden sections between its neighbours. Two
    minima nearer to each other than 1 / (32 16) of the length may be taken for one. Units of the cable;
    negative: inside.
    """
    best, at, which = np.inf, 0.0, 0
    work, ends, spots = np.empty((5, 3)), np.empty(COARSE + 1), np.empty((COARSE + 1, 3))
    wide, step, known = 1.0 / COARSE, 1.0 / (COARSE * FINE), most
    for i in range(COARSE + 1):
        position(c, h, s0, i * wide, spots[i])
    for o in range(obstacles.shape[0]):
        for i in range(0, COARSE + 1, COARSE // 4):
            most = min(most, gap(obstacles[o], spots[i], work[1], work[2:4], work[4]))
    for o in range(obstacles.shape[0]):
        near, at_s = np.inf, 0.0
        i = 0
        while i <= COARSE:
            value = gap(obstacles[o], spots[i], work[1], work[2:4], work[4])
            ends[i] = value
            if value < near:
                near, at_s = value, i * wide
            i += 1
            # bounds instead of distances where these exceed what is known by more than a fine step's
            value -= STEEP * wide
            while i <= COARSE and value >= min(best, most) + STEEP * step:
                ends[i] = value
                value -= STEEP * wide
                i += 1
        for i in range(COARSE):
            if 0.5 * (ends[i] + ends[i + 1] - STEEP * wide) < min(near, best, most):
                for k in range(1, FINE):
                    value = distance(obstacles[o], c, h, s0, i * wide + k * step, work)
                    if value < near:
                        near, at_s = value, i * wide + k * step
        if near - STEEP * step >= min(best, most):
            continue
        a, b = max(at_s - step, 0.0), min(at_s + step, 1.0)
        u, v = b - GOLDEN * (b - a), a + GOLDEN * (b - a)
        left, right = distance(obstacles[o], c, h, s0, u, work), distance(obstacles[o], c, h, s0, v, work)
        for _ in range(SECTIONS):
            if left <= right:
                b, v, right = v, u, left
                u = b - GOLDEN * (b - a)
                left = distance(obstacles[o], c, h, s0, u, work)
            else:
                a, u, left = u, v, right
                v = a + GOLDEN * (b - a)
                right = distance(obstacles[o], c, h, s0, v, work)
        if left < near:
            near, at_s = left, u
        if near < min(best, known):
            best, at, which = near, at_s, o
    return best, at, which
