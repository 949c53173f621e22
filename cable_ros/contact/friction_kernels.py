# SPDX-License-Identifier: Apache-2.0
"""Compiled: Coulomb friction of a contact point.

An elastic-plastic law for the increment since the last equilibrium: stick is a stiff spring, slip a force of
the cone's size against the increment. What sticks has its force as an unknown: by that, not by an increment
times the spring's stiffness, is seen whether it stays in the cone. Units of the cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import njit
from cable_ros.contact.points import FORCE, FRICTION, SLIPS

OPTIONS = {"cache": True, "error_model": "numpy"}

ROUNDING = 1e-10
"""Of the cone, so that what is on its edge does not change sides for ever."""
FRICTIONLESS, COULOMB, SLIDING = 0, 1, 2
STICK = 1e8
"""Stiffness of stick, EI / L^3: what sticks gives way by 1e-8 of the length per unit of force."""


@njit(**OPTIONS)
def rub(points, i, n, t, mu, model, step, turned, sense, anew, limit):
    """Friction on contact point i after the increment `step` (3,) over the obstacle; writes it to `points`.

    `turned` (3,): the friction before, turned with the obstacle; `sense` (3,): which way the end goes, its
    length the part of the friction that is mobilised; `anew`: begin with the friction before, sticking or
    slipping as then. `limit` (7,) receives the tangent: direction of the slip force (3; zero: stick),
    direction across it (3), stiffness across. Returns whether stick has become slip or the reverse.
    """
    for a in range(7):
        limit[a] = 0.0
    cone = mu * max(points[i, FORCE], 0.0)
    if model == SLIDING:
        side = t[1] * n[2] - t[2] * n[1], t[2] * n[0] - t[0] * n[2], t[0] * n[1] - t[1] * n[0]
        size = np.sqrt(side[0] ** 2 + side[1] ** 2 + side[2] ** 2)
        way = side[0] * sense[0] + side[1] * sense[1] + side[2] * sense[2]
        share = np.sqrt(sense[0] ** 2 + sense[1] ** 2 + sense[2] ** 2) * (-1.0 if way > 0.0 else 1.0)
        for a in range(3):
            limit[a] = 0.0 if size == 0.0 else share * side[a] / size
            points[i, FRICTION + a] = cone * limit[a]
        return False
    if cone == 0.0:
        # about to lift off: it slips, without a force, and which way is seen when it presses again
        points[i, SLIPS] = 1.0
        for a in range(3):
            points[i, FRICTION + a] = 0.0
        return False
    force, trial = np.empty(3), np.empty(3)
    off, normal = 0.0, 0.0
    for a in range(3):
        force[a] = turned[a] if anew else points[i, FRICTION + a]
        trial[a] = turned[a] - STICK * step[a]
        off += force[a] * n[a]
        normal += trial[a] * n[a]
    held, size, along = 0.0, 0.0, 0.0
    for a in range(3):
        force[a] -= off * n[a]
        trial[a] -= normal * n[a]
        held += force[a] * force[a]
        size += trial[a] * trial[a]
        along += force[a] * trial[a]
    held, size = np.sqrt(held), np.sqrt(size)
    slips = points[i, SLIPS] == 1.0
    if not slips and held > (1.0 + ROUNDING) * cone and held > 0.0 and not anew:
        points[i, SLIPS] = 1.0
        trial = force
        size = held
    elif slips and not anew and (size < (1.0 - ROUNDING) * cone or along < 0.0):
        points[i, SLIPS] = 0.0
    elif slips and anew:
        trial = force
        size = held
    if points[i, SLIPS] == 0.0 or size == 0.0:
        points[i, SLIPS] = 0.0
        limit[6] = STICK
        for a in range(3):
            points[i, FRICTION + a] = force[a]
        return slips
    for a in range(3):
        limit[a] = trial[a] / size
        points[i, FRICTION + a] = cone * limit[a]
    limit[3] = n[1] * limit[2] - n[2] * limit[1]
    limit[4] = n[2] * limit[0] - n[0] * limit[2]
    limit[5] = n[0] * limit[1] - n[1] * limit[0]
    limit[6] = STICK * cone / size
    return not slips


@njit(**OPTIONS)
def carry(old, new, r, v):
    """Move the place r (3,) and turn the vector v (3,) with an obstacle from where it was to where it is."""
    y, w = np.zeros(3), np.zeros(3)
    for i in range(3):
        for j in range(3):
            y[i] += old[4 + 3 * j + i] * (r[j] - old[1 + j])
            w[i] += old[4 + 3 * j + i] * v[j]
    for i in range(3):
        r[i] = new[1 + i]
        v[i] = 0.0
        for j in range(3):
            r[i] += new[4 + 3 * i + j] * y[j]
            v[i] += new[4 + 3 * i + j] * w[j]
