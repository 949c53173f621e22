"""Compiled: Coulomb friction of a contact point.

An elastic-plastic law for the increment since the last equilibrium: stick is a stiff spring, slip a force of
the cone's size against the increment (return mapping). Units of the cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import njit
from cable_ros.statics.touch_points import FORCE, FRICTION

OPTIONS = {"cache": True, "error_model": "numpy"}

FRICTIONLESS, COULOMB, SLIDING = 0, 1, 2
STICK = 1e6
"""Stiffness of stick, EI / L^3: what sticks creeps by 1e-6 of the length per unit of force."""


@njit(**OPTIONS)
def rub(points, i, n, t, mu, model, step, turned, sense, limit):
    """Friction on contact point i after the increment `step` (3,) over the obstacle; writes it to `points`.

    `turned` (3,): the friction before, turned with the obstacle; `sense` (3,): which way the end goes, its
    length the part of the friction that is mobilised. `limit` (7,) receives the tangent: direction of the
    slip force (3; zero: stick), direction across it (3), stiffness across.
    """
    for a in range(7):
        limit[a] = 0.0
    cone = mu * max(points[i, FORCE], 0.0)
    if model == SLIDING:
        side = np.cross(t, n)
        size = np.sqrt(side[0] ** 2 + side[1] ** 2 + side[2] ** 2)
        way = side[0] * sense[0] + side[1] * sense[1] + side[2] * sense[2]
        share = np.sqrt(sense[0] ** 2 + sense[1] ** 2 + sense[2] ** 2) * (-1.0 if way > 0.0 else 1.0)
        for a in range(3):
            limit[a] = 0.0 if size == 0.0 else share * side[a] / size
            points[i, FRICTION + a] = cone * limit[a]
        return
    trial = np.empty(3)
    normal = 0.0
    for a in range(3):
        trial[a] = turned[a] - STICK * step[a]
        normal += trial[a] * n[a]
    size = 0.0
    for a in range(3):
        trial[a] -= normal * n[a]
        size += trial[a] * trial[a]
    size = np.sqrt(size)
    if size <= cone:
        limit[6] = STICK
        for a in range(3):
            points[i, FRICTION + a] = trial[a]
        return
    for a in range(3):
        limit[a] = trial[a] / size
        points[i, FRICTION + a] = cone * limit[a]
    limit[3] = n[1] * limit[2] - n[2] * limit[1]
    limit[4] = n[2] * limit[0] - n[0] * limit[2]
    limit[5] = n[0] * limit[1] - n[1] * limit[0]
    limit[6] = STICK * cone / size


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
