# SPDX-License-Identifier: Apache-2.0
"""Edge rounding: edges are rounded for a descent, and sharp again once the cable lies on them.

Across an edge the direction of contact turns within the cable's radius, often a thousandth of its length:
Newton's method cannot cross it from farther off, and inside the obstacle the distance has a kink. A body
that is smaller all around by `rho`, with `rho` more about it, has the same faces and rounded edges.
"""

from __future__ import annotations

import numpy as np

from cable_ros.contact.active_set_rod import ActiveSetRod
from cable_ros.contact.distance import BOX, CYLINDER, DIMENSIONS, OFFSET, SHAPE
from cable_ros.rod import warm_step

ROUNDING = 0.02
"""Radius of rounded edges, L."""
CORE = 0.8
"""Maximum radius, fraction of the body's smallest half width."""
FINEST = 0.01
"""Fraction of ROUNDING below which edges are made sharp."""
CLOSEST = 0.97
"""Maximum ratio of the radii before and after such a step."""
MOST_STEPS = 60
"""Maximum number of steps from rounded to sharp edges."""


def rounded(obstacles: np.ndarray, fraction: float = 1.0) -> np.ndarray:
    """The obstacles (n, WIDTH) with edges rounded by a fraction of ROUNDING; themselves if none has edges."""
    edged = (obstacles[:, SHAPE] == BOX) | (obstacles[:, SHAPE] == CYLINDER)
    if not edged.any() or fraction == 0.0:
        return obstacles
    out = obstacles.copy()
    for i in np.flatnonzero(edged):
        widths = slice(DIMENSIONS, OFFSET if out[i, SHAPE] == BOX else OFFSET - 1)
        rho = fraction * min(ROUNDING, CORE * float(out[i, widths].min()))
        out[i, widths] -= rho
        out[i, OFFSET] += rho
    return out


def remove_rounding(
    rod: ActiveSetRod, q: np.ndarray, F: np.ndarray, obstacles: np.ndarray, tolerance: float
) -> tuple[np.ndarray, np.ndarray, int] | None:
    """From the equilibrium (q, F) among `rounded` obstacles to that among `obstacles`: q, F, iterations.

    None if that fails, or takes more work than the rod has left.
    """
    edged, rod.obstacles = rod.obstacles, obstacles
    if not rod.count and rod.clear(q):  # where it is free to turn, no step would end at rest
        return q, F, 0
    rod.obstacles = edged
    at, ratio, total = 1.0, 0.0, 0  # `ratio`: of the next rounding to the present one
    for _ in range(MOST_STEPS):
        if rod.work <= 0.0:
            break
        target = ratio * at if ratio * at > FINEST else 0.0
        code, iterations, q_new, F_new = rod.step_in_contact(
            q, F, rod.qe, rod.re, rod.f, tolerance, 0.6, rounded(obstacles, target)
        )
        total += iterations
        if code == warm_step.ADVANCED:
            q, F, at = q_new, F_new, target
            if at == 0.0:
                return q, F, total
            ratio *= ratio
            continue
        ratio = np.sqrt(max(ratio, 0.06))
        while target == 0.0 and ratio * at <= FINEST and ratio <= CLOSEST:  # the same step again
            ratio = np.sqrt(ratio)
        if ratio > CLOSEST:
            return None
    return None
