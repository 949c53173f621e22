# SPDX-License-Identifier: Apache-2.0
"""Patches that press at their ends alone, as a cable does on a beam whose two edges it bends over.

Where such a cable begins to arch between them, all of the patch peels off within 1e-5 of a pose, and where
stick and slip change as well Newton's method does not find how. Two points hold it as the patch did.
"""

from __future__ import annotations

import numpy as np

from cable_ros.contact.points import ARC_LENGTH, AT_EDGE, FIRST, FORCE, KIND, LAST, OBSTACLE, POINT, SAMPLE

THIN = 0.02
"""Largest part of its force that such a patch bears between its ends: on drawn beams below 0.004."""


def with_ends_alone(points: np.ndarray) -> np.ndarray | None:
    """The contact points (k, COLUMNS) with two points in place of each thin patch; None if there is none."""
    points, kept, found = points.copy(), np.ones(len(points), bool), False
    s, kind, force = points[:, ARC_LENGTH], points[:, KIND].copy(), points[:, FORCE]
    for first in np.flatnonzero(kind == FIRST):
        beyond = (points[:, OBSTACLE] == points[first, OBSTACLE]) & (s >= s[first])
        ends = np.flatnonzero(beyond & (kind == LAST))
        if not len(ends):
            continue
        last = ends[np.argmin(s[ends])]
        inner = beyond & (kind == SAMPLE) & (s <= s[last])
        if force[inner].sum() < THIN * (force[first] + force[last]):
            points[[first, last], KIND], points[[first, last], AT_EDGE] = POINT, 0.0
            kept[inner], found = False, True
    return points[kept] if found else None
