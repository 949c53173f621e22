# SPDX-License-Identifier: Apache-2.0
"""Planar elastica in closed form (Love, Treatise on Elasticity, ch. XIX), as clamped-clamped cases.

In the XY plane with EI theta'' = F_x sin(theta) - F_y cos(theta) and F = -P (cos a, sin a), the angle
psi = theta - a swings like a pendulum, EI psi'' = -P sin(psi). With lambda = sqrt(P / EI):
inflectional: sin(psi/2) = k sn(u), u = lambda s + u0;
non-inflectional: sin(psi/2) = sn(u), u = lambda s/k + u0.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipj, ellipk, ellipkinc

from references.reference import Reference, planar_frame, planar_wrench, pose

# Out-of-plane and torsional stiffness relative to EI: stiff, so that the planar shape is a minimum.
STIFF = 4.0


def _inflectional(u: np.ndarray, k: float, rate: float) -> tuple[np.ndarray, ...]:
    """psi, psi', xi, eta along and across the thrust, at pendulum phases u; xi up to a constant."""
    sn, cn, dn, am = ellipj(u, k * k)
    psi = 2.0 * np.arctan2(k * sn, dn)
    return psi, 2 * k * rate * cn, (2.0 * ellipeinc(am, k * k) - u) / rate, -2 * k * cn / rate


def _orbital(u: np.ndarray, k: float, rate: float) -> tuple[np.ndarray, ...]:
    """The same for a pendulum that goes round (no inflection); `rate` is lambda."""
    _, _, dn, am = ellipj(u, k * k)
    s = u * k / rate
    xi = (1 - 2 / k**2) * s + 2 / (k * rate) * ellipeinc(am, k * k)
    return 2.0 * am, 2 * rate / k * dn, xi, -2 * dn / (k * rate)


def elastica(
    length: float,
    bending: float,
    thrust: float,
    k: float,
    start_phase: float,
    start_angle: float = 0.0,
    orbital: bool = False,
) -> Reference:
    """Elastica of modulus k under the end thrust P [N], clamped where its ends happen to lie.

    `start_phase` is u0; the start tangent is turned to `start_angle` from X [rad].
    """
    rate = np.sqrt(thrust / bending)
    solution = _orbital if orbital else _inflectional
    u = np.array([start_phase, start_phase + rate * length / (k if orbital else 1.0)])
    psi, curvature, xi, eta = solution(u, k, rate)
    direction = start_angle - psi[0]
    c, s = np.cos(direction), np.sin(direction)
    along, across = xi[1] - xi[0], eta[1] - eta[0]
    end_angle = direction + psi[1]
    force = -thrust * np.array([c, s])
    moment = bending * curvature
    end = np.array([c * along - s * across, s * along + c * across, 0.0])
    return Reference(
        length,
        bending * np.array([STIFF, 1.0, STIFF]),
        pose(np.zeros(3), planar_frame(start_angle)),
        pose(end, planar_frame(end_angle)),
        planar_wrench(start_angle, *force, moment[0]),
        planar_wrench(end_angle, *-force, -moment[1]),
    )


def cantilever(length: float, bending: float, tip_force: float) -> Reference:
    """Cantilever along X, tip force [N] along +Y; clamped at the pose where its free tip rests."""
    # F = (0, tip_force) = -P (cos a, sin a) with a = -pi/2: at the clamp theta = 0, so psi = pi/2 and
    # k sn(u0) = sin(pi/4); at the tip there is no moment, so cn = 0 and u = K.
    rate = np.sqrt(tip_force / bending)

    def miss(k: float) -> float:
        return float(ellipk(k * k) - _phase(np.sqrt(0.5) / k, k) - rate * length)

    k = brentq(miss, np.sqrt(0.5) * (1 + 1e-14), 1 - 1e-14, xtol=1e-15)
    return elastica(length, bending, tip_force, k, _phase(np.sqrt(0.5) / k, k))


def _phase(sn: float, k: float) -> float:
    """u in [0, K] with sn(u) given: the incomplete integral of the first kind."""
    return float(ellipkinc(np.arcsin(min(1.0, sn)), k * k))


def buckled(length: float, bending: float, chord: float) -> Reference:
    """Rod clamped along X at both ends, buckled in the XY plane; `chord` is relative to the length.

    chord = 2 E / K - 1 and P = EI (4 K / L)^2, which tends to Euler's 4 pi^2 EI / L^2.
    """
    m = brentq(lambda m: 2 * ellipe(m) / ellipk(m) - 1 - chord, 0.0, 0.82, xtol=1e-15)
    thrust = bending * (4 * ellipk(m) / length) ** 2
    return elastica(length, bending, thrust, np.sqrt(m), 0.0)


def arc(length: float, bending: float, angle: float) -> Reference:
    """Circular arc that turns by `angle` [rad]: a pure moment EI angle / L, no force."""
    radius = length / angle
    moment = bending / radius
    end = radius * np.array([np.sin(angle), 1 - np.cos(angle), 0.0])
    return Reference(
        length,
        bending * np.array([STIFF, 1.0, STIFF]),
        pose(np.zeros(3), planar_frame(0.0)),
        pose(end, planar_frame(angle)),
        planar_wrench(0.0, 0.0, 0.0, moment),
        planar_wrench(angle, 0.0, 0.0, -moment),
    )
