# SPDX-License-Identifier: Apache-2.0
"""Contact, manufactured: a touching stretch of known curvature with a free span on either side.

Everything lies in the XY plane, weight along -Y, units of the cable inside. Along the touching stretch (angle
theta, tangent t, outward normal n, curvature c of the obstacle's surface) the moment EI c is constant, so
there is no shear and F = T t, with pressure p = w cos(theta) - T c and T' = w sin(theta) + mu p for a cable
that slides along its tangent. Where it lifts off the curvature is continuous and a point force N acts,
F(+) = F(-) - N n + mu N t. From there the free spans are integrated to wherever they end: there the clamps
are put, so nothing has to be solved for and the answer is as exact as the integration (1e-12).
What has to be checked is that it is admissible: N, p >= 0 and no free point inside the obstacle.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, root
from scipy.special import ellipe, ellipeinc, ellipj, ellipk

from references.planar import STIFF
from references.reference import Reference, planar_frame, planar_wrench, pose


@dataclass(frozen=True)
class Touching:
    """A manufactured contact case; `reference.facts` holds
    touchdown_start, touchdown_end [m], point_force_start, point_force_end, contact_force_x, contact_force_y
    (the whole on the cable) [N].
    """

    reference: Reference
    points: np.ndarray
    """(n, 2) centreline, for the check of admissibility."""
    least_pressure: float
    """Smallest pressure along the touching stretch, N/m (0 where it is a point)."""


def _rates(_: float, u: np.ndarray, w: float) -> list[float]:
    """x, y, theta, kappa, F_x, F_y along arc length."""
    c, s = np.cos(u[2]), np.sin(u[2])
    return [c, s, u[3], u[4] * s - u[5] * c, 0.0, w]


def span(state: np.ndarray, length: float, w: float) -> np.ndarray:
    """(6, 200) free span from a lift-off; a negative length goes against the arc length."""
    if length == 0:
        return np.tile(state[:, None], (1, 2))
    return solve_ivp(
        _rates,
        (0.0, length),
        state,
        "DOP853",
        np.linspace(0.0, length, 200),
        args=(w,),
        rtol=1e-12,
        atol=1e-13,
    ).y


def manufacture(
    spans: tuple[float, float],
    contact: float,
    curvature: float,
    tension: float,
    point_forces: tuple[float, float],
    weight: float,
    *,
    angle: float = 0.0,
    friction: float = 0.0,
    contact_curvature: float | None = None,
    length: float = 1.0,
    bending: float = 1.0,
) -> Touching:
    """Contact case from lengths relative to the total and forces in EI / L^2.

    `angle` and `tension` are those where the touching stretch starts, at the origin; `contact_curvature`
    is the rod's own where the stretch is a point. `friction` > 0: sliding along the tangent.
    """
    assert abs(sum(spans) + contact - 1) < 1e-12, "The stretches must add up to the cable."
    kappa = curvature if contact_curvature is None else contact_curvature
    t = np.array([np.cos(angle), np.sin(angle)])
    n = np.array([-t[1], t[0]])

    def inside(_: float, u: np.ndarray) -> list[float]:
        pressure = weight * np.cos(u[2]) - u[3] * curvature
        return [np.cos(u[2]), np.sin(u[2]), curvature, weight * np.sin(u[2]) + friction * pressure]

    grid = np.linspace(0.0, max(contact, 1e-300), 200)
    middle = solve_ivp(
        inside, (0.0, grid[-1]), [0, 0, angle, tension], "DOP853", grid, rtol=1e-12, atol=1e-14
    ).y
    if contact == 0:
        middle = np.tile([[0.0], [0.0], [angle], [tension]], (1, 2))
    x, y, theta, pull = middle[:, -1]
    t2 = np.array([np.cos(theta), np.sin(theta)])
    n2 = np.array([-t2[1], t2[0]])
    before = tension * t + point_forces[0] * (n - friction * t)
    after = pull * t2 - point_forces[1] * (n2 - friction * t2)
    left = span(np.array([0, 0, angle, kappa, *before]), -spans[0], weight)
    right = span(np.array([x, y, theta, kappa, *after]), spans[1], weight)

    unit = bending / length**2
    a, b = left[:, -1], right[:, -1]
    pressure = weight * np.cos(middle[2]) - middle[3] * curvature if contact else np.zeros(1)
    total = (a[4:] - b[4:]) * unit + np.array([0.0, weight * unit])
    reference = Reference(
        length,
        bending * np.array([STIFF, 1.0, STIFF]),
        pose(np.array([*(a[:2] * length), 0.0]), planar_frame(a[2])),
        pose(np.array([*(b[:2] * length), 0.0]), planar_frame(b[2])),
        planar_wrench(a[2], *(a[4:] * unit), a[3] * unit * length),
        planar_wrench(b[2], *(-b[4:] * unit), -b[3] * unit * length),
        weight=np.array([0.0, -weight * unit / length, 0.0]),
        facts={
            "touchdown_start": spans[0] * length,
            "touchdown_end": (spans[0] + contact) * length,
            "point_force_start": point_forces[0] * unit,
            "point_force_end": point_forces[1] * unit,
            "contact_force_x": float(total[0]),
            "contact_force_y": float(total[1]),
        },
    )
    points = np.hstack([left[:2, ::-1], middle[:2], right[:2]]).T * length
    return Touching(reference, points, float(pressure.min() * unit / length))


GROUND = {"name": "ground", "plane": {"point": [0.0, 0.0, 0.0], "normal": [0.0, 1.0, 0.0]}, "friction": 0.0}


def with_obstacle(case: Touching, obstacle: dict) -> Reference:
    """The case's reference with its obstacle in the scene's format."""
    return replace(case.reference, obstacles=(obstacle,))


def lifted(weight: float = 60.0, pull: float = 10.0, lying: float = 0.45, shear: float = 19.0) -> Touching:
    """Heavy cable lying on the ground y = 0 from its start clamp (on the ground) and lifted at its end."""
    return manufacture((0.0, 1.0 - lying), lying, 0.0, pull, (0.0, shear), weight)


def sagging(weight: float = 120.0, pull: float = 12.0) -> Touching:
    """Heavy cable between two raised clamps, its middle on the ground."""
    return manufacture((0.3, 0.35), 0.35, 0.0, pull, (38.0, 37.0), weight)


def draped(
    weight: float = 20.0,
    radius: float = 0.15,
    wrap: float = 1.4,
    friction: float = 0.0,
    tension: float = 12.0,
) -> Touching:
    """Rod over a cylinder of `radius` (axis along Z through (0, -radius) turned back by the wrap's start).

    The stretch starts at angle wrap / 2 and turns to about -wrap / 2; with friction the rod slides
    towards its end, so the tension grows along it as over a capstan.
    """
    contact = radius * wrap
    spans = (0.45 * (1 - contact), 0.55 * (1 - contact))
    return manufacture(
        spans,
        contact,
        -1.0 / radius,
        tension,
        (28.0, 32.0),
        weight,
        angle=wrap / 2,
        friction=friction,
    )


def capstan(pull: float, friction: float, radius: float = 0.15, wrap: float = 1.4) -> Touching:
    """Weightless taut rod over a drum, as `draped`, sliding: `pull` is the force in the first span.

    A straight span under the force F ends in a layer of the angle d between F and the tangent at lift-off:
    kappa^2 / 2 + F . t is constant along it, so EI / (2 R^2) = F (1 - cos d). What of the wrap the layers
    take the point forces' own friction makes up for, to first order in d: with theta the angle between the
    forces of both spans log(F2 / F1) = mu theta + (1 + mu^2) / 2 (d2^2 - d1^2) + O(d^3).
    """

    def layer(force: float) -> float:
        return float(np.arccos(1 - 1 / (2 * radius**2 * force)))

    def inside(force: float, sense: float) -> float:
        d = layer(force)
        return force * (np.cos(d) + sense * friction * np.sin(d))

    tension = inside(pull, 1.0)
    last = brentq(lambda f: inside(f, -1.0) - tension * np.exp(friction * wrap), 0.1 * pull, 10 * pull)
    each = 0.5 * (1 - radius * wrap)
    return manufacture(
        (each, each),
        radius * wrap,
        -1.0 / radius,
        tension,
        (pull * np.sin(layer(pull)), last * np.sin(layer(last))),
        0.0,
        angle=wrap / 2,
        friction=friction,
    )


def cylinder_centre(radius: float, wrap: float) -> np.ndarray:
    """(2,) centre of the cylinder of `draped`: the stretch starts at the origin with outward normal n."""
    return -radius * np.array([-np.sin(wrap / 2), np.cos(wrap / 2)])


def pressed_flat(k: float, span: float, length: float = 1.0, bending: float = 1.0) -> Reference:
    """Weightless rod between clamps parallel to a plane, pressed onto it over a flat stretch; closed form.

    With theta = 0 at the clamp and at lift-off the pendulum energy is the same at both, and lift-off has no
    moment: so the clamp has none either, and the span holds one full period of the inflectional elastica,
    P = EI (4 K / l)^2, thrust at the angle a to the plane with sin(a / 2) = k; height of the clamps
    l (2 E / K - 1) sin(a). `span` = l / L < 1/2; each lift-off carries the point force P sin(a).
    """
    m = k * k
    g = 2 * ellipe(m) / ellipk(m) - 1
    tilt = 2 * np.arcsin(k)
    thrust = bending * (4 * ellipk(m) / (span * length)) ** 2
    height, run = span * length * g * np.sin(tilt), span * length * g * np.cos(tilt)
    flat = (1 - 2 * span) * length
    push = thrust * np.sin(tilt)
    return Reference(
        length,
        bending * np.array([STIFF, 1.0, STIFF]),
        pose(np.array([-run - flat / 2, height, 0.0]), planar_frame(0.0)),
        pose(np.array([run + flat / 2, height, 0.0]), planar_frame(0.0)),
        planar_wrench(0.0, -thrust * np.cos(tilt), push, 0.0),
        planar_wrench(0.0, thrust * np.cos(tilt), push, 0.0),
        obstacles=(GROUND,),
        facts={
            "touchdown_start": span * length,
            "touchdown_end": (1 - span) * length,
            "point_force_start": push,
            "point_force_end": push,
            "contact_force_x": 0.0,
            "contact_force_y": 2 * push,
        },
    )


def pressed_at_a_point(k: float, phase: float, length: float = 1.0, bending: float = 1.0) -> Reference:
    """The same before it flattens: the arch touches the plane at its middle only; closed form.

    The half rod's phase runs from K - phase to K + phase (end curvatures opposite and equal, as theta = 0
    at both): phase = K is the free buckled rod, 2 K the onset of flattening. Thrust P = EI (4 phase / L)^2.
    """
    m = k * k
    big = ellipk(m)
    half = length / 2
    rate = 2 * phase / half
    thrust = bending * rate**2
    u = np.array([big - phase, big + phase])
    sn, cn, dn, am = ellipj(u, m)
    psi = 2 * np.arctan2(k * sn[0], dn[0])
    along = (2 * np.diff(ellipeinc(am, m))[0] - 2 * phase) / rate
    across = -2 * k * np.diff(cn)[0] / rate
    c, s = np.cos(psi), -np.sin(psi)
    # Arch upwards in the formulas; the plane lies below, so y and the moments change sign.
    run, drop = c * along - s * across, s * along + c * across
    force = -thrust * np.array([c, -s])
    moment = -2 * bending * k * rate * cn[0]
    return Reference(
        length,
        bending * np.array([STIFF, 1.0, STIFF]),
        pose(np.array([-run, drop, 0.0]), planar_frame(0.0)),
        pose(np.array([run, drop, 0.0]), planar_frame(0.0)),
        planar_wrench(0.0, *force, moment),
        planar_wrench(0.0, -force[0], force[1], -moment),
        obstacles=(GROUND,),
        facts={
            "touchdown_start": half,
            "touchdown_end": half,
            "contact_force_x": 0.0,
            "contact_force_y": 2 * force[1],
        },
    )


def pressed(height: float, chord: float) -> Reference:
    """Rod of length 1 and EI = 1 between clamps `height` above the plane and `chord` apart: point or flat.

    Raises ValueError where it does not touch the plane or no solution is found.
    """

    def point_miss(x: np.ndarray) -> np.ndarray:
        end = pressed_at_a_point(x[0], x[1] * float(ellipk(x[0] ** 2))).end
        return np.array([end[0] - chord / 2, end[1] - height])

    def flat_miss(x: np.ndarray) -> np.ndarray:
        end = pressed_flat(x[0], x[1]).end
        return np.array([end[0] - chord / 2, end[1] - height])

    for miss, guesses, low, high in (
        (point_miss, (1.2, 1.5, 1.8), 1.0, 2.0),
        (flat_miss, (0.45, 0.4, 0.3), 0.0, 0.5),
    ):
        for guess in guesses:
            found = root(miss, [0.5, guess], tol=1e-13)
            k, x = found.x
            if np.linalg.norm(found.fun) < 1e-11 and 0 < k < 1 and low <= x <= high:
                if miss is point_miss:
                    return pressed_at_a_point(k, x * float(ellipk(k * k)))
                return pressed_flat(k, x)
    raise ValueError("No rod pressed against the plane at this height and chord.")


def dragged_sideways(
    weight: float = 40.0, friction: float = 0.35, tension: float = 2.0, curvature: float = 2.0
) -> Reference:
    """Rod lying on the ground (normal Z, weight along -Z), both clamps dragged along +Y for ever.

    Every element slides along +Y, so friction is the uniform load -mu w along Y: in the ground's plane the
    rod hangs in it as in a weight, and the ground carries the true weight. Symmetric; `tension` and
    `curvature` are those at the middle, units of the cable.
    """
    lateral = friction * weight
    hanging = manufacture(
        (0.5, 0.5), 0.0, 0.0, tension, (0.0, 0.0), lateral, contact_curvature=curvature
    ).reference
    ground = {
        "name": "ground",
        "plane": {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]},
        "friction": friction,
    }
    return replace(
        hanging,
        weight=np.array([0.0, 0.0, -weight]),
        obstacles=(ground,),
        facts={"friction_force": lateral, "contact_force_z": weight},
    )
