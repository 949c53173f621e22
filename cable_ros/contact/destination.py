# SPDX-License-Identifier: Apache-2.0
"""Compiled: where a step leads a cable among obstacles, and how far, in one call from Python."""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import njit
from cable_ros.contact.distance import AXES, CENTRE, gap, place_obstacles
from cable_ros.contact.travel import travel
from cable_ros.linalg.vectors import cross
from cable_ros.rod import quaternion
from cable_ros.rod.centreline import tangent
from cable_ros.rod.units import relative_conditions

OPTIONS = {"cache": True, "error_model": "numpy"}
RESTS = 1e-10
"""Maximum distance, L, and angle, rad, of a clamp from a surface that count as none: what rounding and the
twelfth digit of joints make of a clamp that rests on it. A cable that lies there feels them: beside a clamp
higher by h it stands off over a = (72 EI h / p)^(1/4), p the pressure, and the clamp's force changes by
2 p a / 3: at 1e-12 L by 0.3 %."""


@njit(**OPTIONS)
def rest_clamps(obstacles, qe, re):  # type: ignore[no-untyped-def]
    """Bring clamps onto the obstacles on which they all but rest.

    Args:
        obstacles: (o, WIDTH) in the start clamp's frame, L; moved to where that clamp rests on them.
        qe, re: end frame (4,) and end position (3,), L; moved to where that clamp rests.

    Returns:
        The least gap at the clamps, L.
    """
    r, n, directions, bends = np.zeros(3), np.empty(3), np.empty((2, 3)), np.empty(2)
    t = np.array([0.0, 0.0, 1.0])
    least = np.inf
    for o in range(obstacles.shape[0]):
        room = gap(obstacles[o], r, n, directions, bends)
        least = min(least, room)
        if abs(room) < RESTS:
            w = _tilt(t, n, 1.0)
            for first, spacing in ((CENTRE, 1), (AXES, 3), (AXES + 1, 3), (AXES + 2, 3)):
                v = obstacles[o, first : first + 2 * spacing + 1 : spacing]
                turned = cross(w, v)
                for a in range(3):
                    v[a] += turned[a]
            for a in range(3):
                obstacles[o, CENTRE + a] += room * n[a]
    for o in range(obstacles.shape[0]):
        room = gap(obstacles[o], re, n, directions, bends)
        least = min(least, room)
        if abs(room) < RESTS:
            tangent(qe, t)
            w = _tilt(t, n, -1.0)
            turn = quaternion.product((0.0, 0.5 * w[0], 0.5 * w[1], 0.5 * w[2]), qe)
            for a in range(4):
                qe[a] += turn[a]
            for a in range(3):
                re[a] -= room * n[a]
    return least


@njit(**OPTIONS)
def _tilt(t, n, sign):  # type: ignore[no-untyped-def]
    """Rotation vector, a tuple, that makes the normal n, or with sign -1 the tangent t, square to the other.

    It is zero where that takes more than `RESTS`.
    """
    along = t[0] * n[0] + t[1] * n[1] + t[2] * n[2]
    share = sign * along if abs(along) < RESTS else 0.0
    x, y, z = cross(t, n)
    return share * x, share * y, share * z


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
    least = rest_clamps(there, qe, re)
    return travel(last[0], last[1], last[2], qe, re, there), least
