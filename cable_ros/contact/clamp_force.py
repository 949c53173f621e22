# SPDX-License-Identifier: Apache-2.0
"""How well the force of a clamp is known beside which the cable lies on an obstacle."""

from __future__ import annotations

import numpy as np

from cable_ros.contact.distance import gap
from cable_ros.contact.patches import NODES, inside
from cable_ros.contact.points import ARC_LENGTH, FORCE, LENGTH, OBSTACLE
from cable_ros.rod import quaternion
from cable_ros.rod.centreline import position

LEVEL = 1e-6
"""Maximum angle, rad, between a plane and a clamp's tangent that is along it."""
ON_PLANE = 1e-9
"""Largest gap of a clamp on a plane, L, up to which a cable lies. One that comes down leaves the plane for
0.007 of its length before the clamp at 1e-8."""
Z_AXIS = np.array([0.0, 0.0, 1.0])


def clamp_error(
    s: float, clamp: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray], section: tuple[float, float],
    curve: tuple[np.ndarray, np.ndarray, np.ndarray], points: np.ndarray, obstacles: np.ndarray,
) -> float:  # fmt: skip
    """Error of the force of the clamp at s, 0 or 1, EI / L^2; zero where this says nothing.

    On a plane, M' + t x F = 0 across the plane's normal n and the tangent t asks for B F n = (M t) (M n),
    with one bending stiffness B; a cable that stretches has F times 1 + its strain there. Moments are
    accurate, but how a clamp and the sample beside it share the pressure near the clamp depends on the
    element there. A cable that leaves the surface just before the clamp: see `lifts_off`; but one that dips
    there, to a clamp on the plane, lies.

    Args:
        s: arc length.
        clamp: position (3,), frame (4,), force (3,) and moment (3,), this along the section's axes.
        section: bending stiffness, 0 if it is not one, and compliance of stretch.
        curve: coefficients (m, g + 1, 3) of the centreline, lengths and starts (m,) of the elements.
        points: (c, COLUMNS) the contact points.
        obstacles: (o, WIDTH).
    """
    r, q, force, moment = clamp
    bending, compliance = section
    t, M = quaternion.rotate(q, Z_AXIS), quaternion.rotate(q, moment)
    n, directions, bends, middle = np.empty(3), np.empty((2, 3)), np.empty(2), np.empty(3)
    out = 0.0
    for o in np.unique(points[:, OBSTACLE]).astype(int):
        if not inside(points, len(points), o, s):
            continue
        error, last = lifts_off(o, s, curve[1:], points)
        position(*curve, 0.5 * (s + last), middle)
        dips = gap(obstacles[o], middle, n, directions, bends) < 0.0
        on = gap(obstacles[o], r, n, directions, bends) < ON_PLANE
        if (error == 0.0 or (dips and on)) and bending and not bends.any() and abs(t @ n) < LEVEL:
            pressing = (1.0 + compliance * (force @ t)) * (force @ n)
            error = abs(bending * pressing - (M @ t) * (M @ n)) / bending
        out = max(out, error)
    return out


def on_plane(obstacles: np.ndarray, r: np.ndarray) -> bool:
    """Whether a clamp at r (3,) is on the surface of one of the `obstacles` (o, WIDTH)."""
    n, directions, bends = np.empty(3), np.empty((2, 3)), np.empty(2)
    return any(gap(obstacle, r, n, directions, bends) < ON_PLANE for obstacle in obstacles)


def lifts_off(
    o: int, s: float, grid: tuple[np.ndarray, np.ndarray], points: np.ndarray
) -> tuple[float, float]:
    """Error of the force of the clamp at s if the cable leaves obstacle o before it, EI / L^2; else 0.

    And the arc length of the last sample that presses; else s.

    It leaves the surface between the last sample that presses and the next one. That the force of the former
    acts there changes the clamp's by less than the square of their distance over that to the clamp. A cable
    lies at the clamp if the outermost sample presses. Arguments as in `clamp_error`; `grid`: lengths and
    starts (m,) of the elements.
    """
    h, s0 = grid
    mine = (points[:, OBSTACLE] == o) & (points[:, LENGTH] > 0.0) & (points[:, FORCE] > 0.0)
    if not mine.any():
        return 0.0, s
    last = points[mine][np.argmin(np.abs(points[mine, ARC_LENGTH] - s))]
    away = abs(last[ARC_LENGTH] - s)
    left = np.abs((s0[:, None] + h[:, None] * NODES).ravel() - s)
    nearer = left[left < 0.999 * away]
    error = float(last[FORCE] * (1.0 - nearer.max() / away) ** 2) if len(nearer) else 0.0
    return error, float(last[ARC_LENGTH])
