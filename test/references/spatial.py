# SPDX-License-Identifier: Apache-2.0
"""Helices, twisted straight rods, and the two limits of a cable's weight: beam and catenary."""

from __future__ import annotations

import numpy as np
from scipy.optimize import root

from references.reference import Reference, planar_frame, planar_wrench, pose


def helix(
    length: float, bending: float, torsion_stiffness: float, curvature: float, torsion: float, twist: float
) -> Reference:
    """Helix of constant curvature and torsion [1/m] with the section twisting at `twist` [rad/m].

    For EIx = EIy = A the moment is A kappa b + C omega t in the Frenet frame (n, b, t), and the force that
    keeps it is (C omega - A tau) (0, kappa, tau): a wrench along the helix axis (Love, art. 270).
    """
    turning = np.hypot(curvature, torsion)
    radius, rise = curvature / turning**2, torsion / turning

    def frenet(s: float) -> tuple[np.ndarray, np.ndarray]:
        c, sn = np.cos(turning * s), np.sin(turning * s)
        t = np.array([-radius * turning * sn, radius * turning * c, rise])
        n = np.array([-c, -sn, 0.0])
        return np.array([radius * c, radius * sn, rise * s]), np.column_stack([n, np.cross(t, n), t])

    axial = torsion_stiffness * twist - bending * torsion
    inner = np.concatenate(
        [axial * np.array([0, curvature, torsion]), [0, bending * curvature, torsion_stiffness * twist]]
    )
    poses, wrenches = [], []
    for s in (0.0, length):
        point, frame = frenet(s)
        spin = (twist - torsion) * s
        c, sn = np.cos(spin), np.sin(spin)
        turn = np.array([[c, -sn, 0.0], [sn, c, 0.0], [0.0, 0.0, 1.0]])
        poses.append(pose(point, frame @ turn))
        wrenches.append(np.concatenate([turn.T @ inner[:3], turn.T @ inner[3:]]))
    return Reference(
        length,
        np.array([bending, bending, torsion_stiffness]),
        poses[0],
        poses[1],
        wrenches[0],
        -wrenches[1],
        total_twist=twist * length,
    )


def twisted_straight(length: float, bending: float, torsion_stiffness: float, angle: float) -> Reference:
    """Straight rod of chord L, turned by `angle`: torque C angle / L; its tension is not determined.

    Without tension it writhes where angle exceeds 2 pi 1.430 A / C (Love, art. 272: clamped ends).
    """
    frame = planar_frame(0.0)
    c, s = np.cos(angle), np.sin(angle)
    torque = np.array([0, 0, 0, 0, 0, torsion_stiffness * angle / length])
    return Reference(
        length,
        np.array([bending, bending, torsion_stiffness]),
        pose(np.zeros(3), frame),
        pose(np.array([length, 0.0, 0.0]), frame @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])),
        torque,
        -torque,
        total_twist=angle,
    )


def beam(length: float, bending: float, gravity_number: float) -> Reference:
    """Horizontal clamped-clamped beam under a small weight along -Y: end forces w L / 2 (exact, by
    symmetry), end moments w L^2 / 12, no axial force; true to relative order gravity_number^2.

    The clamps are as far apart as that deflection needs: w^2 L^7 / (60480 EI^2) short of L.
    """
    w = gravity_number * bending / length**3
    chord = length * (1 - gravity_number**2 / 60480)
    force, moment = w * length / 2, w * length**2 / 12
    # F(0) holds the rest up (+Y would lift the part before): the cable pulls both bodies down.
    return Reference(
        length,
        np.array([bending, bending, bending]),
        pose(np.zeros(3), planar_frame(0.0)),
        pose(np.array([chord, 0.0, 0.0]), planar_frame(0.0)),
        planar_wrench(0.0, 0.0, -force, -moment),
        planar_wrench(0.0, 0.0, -force, moment),
        weight=np.array([0.0, -w, 0.0]),
    )


def catenary(
    length: float,
    bending: float,
    gravity_number: float,
    span: tuple[float, float],
    angles: tuple[float, float],
    corrected: bool = True,
) -> Reference:
    """Heavy cable in the XY plane, weight along -Y, from the origin to `span`, clamped at `angles` [rad].

    Outside two boundary layers of thickness l = sqrt(EI / T) it is a catenary; inside,
    EI theta'' = T sin(theta - phi) turns the clamp's angle into the catenary's phi over d = theta - phi, so
    the clamp moment is 2 sqrt(EI T) sin(d/2), and the catenary seems to start off the clamp by
    2 l sin(d/2) across and -2 l (1 - cos(d/2)) along. With that offset the force is true to relative order
    l^2 / L^2 ~ 1 / gravity_number, without it to its root. The moment keeps an error of relative order
    l / L (the tension's change inside the layer).
    """
    w = gravity_number * bending / length**3

    def ends(x: np.ndarray) -> tuple[np.ndarray, list[tuple[float, float, float, np.ndarray]]]:
        """Catenary of horizontal force h and vertical force v0 at the start; its miss, and both layers."""
        h, v0 = x
        v1 = v0 + w * length
        run = h / w * (np.arcsinh(v1 / h) - np.arcsinh(v0 / h))
        rise = (np.hypot(h, v1) - np.hypot(h, v0)) / w
        layers = []
        for v, angle, sense in ((v0, angles[0], 1.0), (v1, angles[1], -1.0)):
            phi, tension = np.arctan2(v, h), np.hypot(h, v)
            layer = np.sqrt(bending / tension)
            d = angle - phi
            t, n = np.array([np.cos(phi), np.sin(phi)]), np.array([-np.sin(phi), np.cos(phi)])
            # Going inward from either clamp, the rod swings towards its own side before it follows phi.
            offset = sense * layer * (2 * np.sin(d / 2) * n - 2 * (1 - np.cos(d / 2)) * t)
            layers.append((phi, tension, d, offset if corrected else np.zeros(2)))
        start = layers[0][3]
        stop = np.array(span) + layers[1][3]
        return np.array([run, rise]) - (stop - start), layers

    guess = np.array([0.3 * w * length, -0.5 * w * length])
    h, v0 = root(lambda x: ends(x)[0] / length, guess, tol=1e-13).x
    if np.linalg.norm(ends(np.array([h, v0]))[0]) > 1e-10 * length:
        raise ValueError("No catenary found between these clamps; start closer to a hanging shape.")
    layers = ends(np.array([h, v0]))[1]
    # theta - phi decays inward: theta' = -+ (2 / l) sin(d / 2) at the start and end clamp.
    moments = [
        -2 * np.sqrt(bending * layers[0][1]) * np.sin(layers[0][2] / 2),
        2 * np.sqrt(bending * layers[1][1]) * np.sin(layers[1][2] / 2),
    ]
    return Reference(
        length,
        np.array([bending, bending, bending]),
        pose(np.zeros(3), planar_frame(angles[0])),
        pose(np.array([*span, 0.0]), planar_frame(angles[1])),
        planar_wrench(angles[0], h, v0, moments[0]),
        planar_wrench(angles[1], -h, -(v0 + w * length), -moments[1]),
        weight=np.array([0.0, -w, 0.0]),
    )
