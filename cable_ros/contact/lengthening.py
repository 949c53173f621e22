# SPDX-License-Identifier: Apache-2.0
"""A rod whose length changes, as the cable slides through what holds its ends, and its material."""

from __future__ import annotations

import numpy as np

from cable_ros.contact.active_set_rod import ActiveSetRod
from cable_ros.contact.distance import AXES, CENTRE, DIMENSIONS, FRICTION_COEFFICIENT
from cable_ros.contact.patches import resample
from cable_ros.contact.points import (
    ARC_LENGTH,
    BEFORE,
    FORCE,
    FRICTION,
    INTERFACE,
    KIND,
    OBSTACLE,
    SAMPLE,
    SLIP_BEFORE,
    STEP_BEFORE,
)


def lengthen(rod: ActiveSetRod, F: np.ndarray, ratio: float, shift: float) -> np.ndarray:
    """Tell the last equilibrium in units of another length, by the arc lengths that its material has now.

    Friction acts against the motion of material: the next step must be told `ratio` and `shift`, see
    `contact_state.Last`. Material that was not between its ends then is taken to have been at the end.

    Args:
        rod: at that equilibrium; its conditions and contact points change.
        F: (3,) its end force, EI / L^2.
        ratio: its length then over that now.
        shift: arc length now, L, of what was its start.

    Returns:
        (3,) the end force in the new units.
    """
    rod.settled = None  # the gradient there is one in other units
    points = rod.points[: rod.count]
    points[:, FORCE : BEFORE + 3] /= ratio**2
    points[:, SLIP_BEFORE : STEP_BEFORE + 1] *= ratio
    points[:, ARC_LENGTH] = np.clip(ratio * points[:, ARC_LENGTH] + shift, 0.0, 1.0)
    if rod.has_patch:
        _onto_mesh(rod)
    assert rod.obstacles is not None
    obstacles = rod.obstacles.copy()
    obstacles[:, CENTRE:AXES] *= ratio
    obstacles[:, DIMENSIONS:FRICTION_COEFFICIENT] *= ratio
    rod.set_conditions(rod.qe, ratio * rod.re, rod.f / ratio**3, obstacles)
    return F / ratio**2


def _onto_mesh(rod: ActiveSetRod) -> None:
    """Move the samples of patches back to their places in the elements, with the friction of the material."""
    old = rod.points[: rod.count].copy()
    rod.points[: rod.count, INTERFACE] = -1.0
    rod.count = resample(rod.points, rod.count, rod.h, rod.s0, True)
    points = rod.points[: rod.count]
    for o in np.unique(points[:, OBSTACLE]):
        here = (points[:, OBSTACLE] == o) & (points[:, KIND] == SAMPLE)
        there = old[(old[:, OBSTACLE] == o) & (old[:, KIND] == SAMPLE)]
        there = there[np.argsort(there[:, ARC_LENGTH])]
        for column in range(FRICTION, BEFORE):
            points[here, column] = np.interp(points[here, ARC_LENGTH], there[:, ARC_LENGTH], there[:, column])
