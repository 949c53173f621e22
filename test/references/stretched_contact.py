# SPDX-License-Identifier: Apache-2.0
"""Contact of a cable that stretches, manufactured as in `contact`: touching stretches of known curvature.

Along the unloaded cable, with a = 1 + T / EA: x' = a cos(theta), y' = a sin(theta), theta' = kappa, and with
M = EI kappa also M' = -a F.n. On flat ground kappa = 0, so F = T t and the pressure is the weight. Along a
cylinder the tension is constant if there is no weight, so kappa = -a / R is, too, and F = T t again, with the
pressure T a / R. Where the cable lifts off a point force acts along the normal.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.integrate import solve_ivp

from references.contact import GROUND
from references.planar import STIFF
from references.reference import Reference, planar_frame, planar_wrench, pose


def span(state: np.ndarray, length: float, weight: float, soft: float) -> np.ndarray:
    """(6,) x, y, theta, kappa, F_x, F_y after a free span; a negative length goes against the arc length."""

    def rates(_: float, u: np.ndarray) -> list[float]:
        c, s = np.cos(u[2]), np.sin(u[2])
        a = 1.0 + soft * (u[4] * c + u[5] * s)
        return [a * c, a * s, u[3], a * (u[4] * s - u[5] * c), 0.0, weight]

    return solve_ivp(rates, (0.0, length), state, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]


def manufacture(
    spans: tuple[float, float], tension: float, forces: tuple[float, float], weight: float, soft: float, *,
    curvature: float = 0.0, angle: float = 0.0,
) -> Reference:  # fmt: skip
    """A cable of unit length and EI that touches between free spans of the unloaded lengths `spans`.

    Args:
        spans: in front of the touching stretch and behind it.
        tension: where the stretch begins.
        forces: point forces at its ends.
        weight: per length, along -Y; 0 on a cylinder.
        soft: 1 / EA.
        curvature: of the surface, 0 or less.
        angle: of the tangent where the stretch begins.
    """
    assert curvature == 0.0 or weight == 0.0
    along = 1.0 - sum(spans)
    t = np.array([np.cos(angle), np.sin(angle)])
    n = np.array([-t[1], t[0]])
    kappa = (1.0 + soft * tension) * curvature
    if curvature == 0.0:
        point, theta = t * along * (1.0 + soft * tension), angle
    else:
        theta = angle + kappa * along
        chord = np.array([np.sin(theta) - np.sin(angle), np.cos(angle) - np.cos(theta)])
        point = chord / curvature
    t2 = np.array([np.cos(theta), np.sin(theta)])
    n2 = np.array([-t2[1], t2[0]])
    before, after = tension * t + forces[0] * n, tension * t2 - forces[1] * n2
    a = span(np.array([0.0, 0.0, angle, kappa, *before]), -spans[0], weight, soft) if spans[0] else np.array(
        [0.0, 0.0, angle, kappa, *(tension * t)]
    )  # fmt: skip
    b = span(np.array([*point, theta, kappa, *after]), spans[1], weight, soft)
    return Reference(
        1.0, np.array([STIFF, 1.0, STIFF]),
        pose(np.array([*a[:2], 0.0]), planar_frame(a[2])), pose(np.array([*b[:2], 0.0]), planar_frame(b[2])),
        planar_wrench(a[2], a[4], a[5], a[3]), planar_wrench(b[2], -b[4], -b[5], -b[3]),
        weight=np.array([0.0, -weight, 0.0]),
        facts={"touchdown_start": spans[0], "touchdown_end": 1.0 - spans[1]},
    )  # fmt: skip


def lifted(soft: float) -> Reference:
    """A heavy cable that lies on the ground from its start clamp and is lifted at its end."""
    return replace(manufacture((0.0, 0.55), 10.0, (0.0, 19.0), 60.0, soft), obstacles=(GROUND,))


def sagging(soft: float) -> Reference:
    """A heavy cable between two raised clamps, its middle on the ground."""
    return replace(manufacture((0.3, 0.35), 12.0, (38.0, 37.0), 120.0, soft), obstacles=(GROUND,))


def draped(soft: float, radius: float = 0.15, wrap: float = 1.4, tension: float = 12.0) -> Reference:
    """A weightless rod over a cylinder along Z, which it wraps by about the angle `wrap`."""
    along = radius * wrap
    spans = (0.45 * (1 - along), 0.55 * (1 - along))
    made = manufacture(spans, tension, (28.0, 32.0), 0.0, soft, curvature=-1.0 / radius, angle=0.5 * wrap)
    x, y = -radius * np.array([-np.sin(0.5 * wrap), np.cos(0.5 * wrap)])
    drum = {"start": [float(x), float(y), -1.0], "end": [float(x), float(y), 1.0], "radius": radius}
    return replace(made, obstacles=({"name": "drum", "cylinder": drum},))
