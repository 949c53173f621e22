# SPDX-License-Identifier: Apache-2.0
"""Planar rod under a uniform load by collocation (scipy.integrate.solve_bvp), in the XY plane."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.integrate import solve_bvp
from scipy.spatial.transform import Rotation

from references.reference import Reference, planar_frame, planar_wrench, shoot


def plane_angle(pose: np.ndarray) -> float:
    """Angle of the tangent of a planar clamp from X, in (-pi, pi]."""
    tangent = Rotation.from_quat(pose[3:]).as_matrix()[:, 2]
    return float(np.arctan2(tangent[1], tangent[0]))


def solve_planar(guess: Reference, tolerance: float = 1e-9) -> Reference:
    """`guess` with the wrenches of the true equilibrium; see `solve_planar_shape`."""
    return solve_planar_shape(guess, 2, tolerance)[0]


def solve_planar_shape(
    guess: Reference, samples: int, tolerance: float = 1e-9
) -> tuple[Reference, np.ndarray, np.ndarray]:
    """The planar equilibrium between the clamps of `guess`, started from the shape that they and its wrench
    give: integrated where the cable is light, catenary and layers where it is heavy. With it come the points
    (samples, 3) and orientations (samples, 4) at equal arc lengths.

    Unknowns x, y, theta, M(s) and the start force, in units of the cable. Raises ValueError
    where the collocation does not converge.
    """
    length, bending = guess.length, guess.stiffness[1]
    w = -guess.weight[1] * length**3 / bending
    span = (guess.end[:2] - guess.start[:2]) / length
    angles = plane_angle(guess.start), plane_angle(guess.end)
    force = planar_frame(angles[0]) @ guess.start_wrench[:3] * length**2 / bending
    h, v = force[0], force[1]
    s, shape = _integrated(guess) if w < 100 else _layered_catenary(h, v, w, angles)

    def rates(s: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
        c, sn = np.cos(u[2]), np.sin(u[2])
        return np.array([c, sn, u[3], p[0] * sn - (p[1] + w * s) * c])

    def ends(a: np.ndarray, b: np.ndarray, p: np.ndarray) -> np.ndarray:
        return np.array([a[0], a[1], a[2] - angles[0], b[0] - span[0], b[1] - span[1], b[2] - angles[1]])

    solution = solve_bvp(
        rates,
        ends,
        s,
        shape,
        p=np.array([h, v]),
        tol=tolerance,
        max_nodes=200_000,
    )
    if not solution.success:
        raise ValueError(solution.message)
    unit_f, unit_m = bending / length**2, bending / length
    fx, fy = solution.p * unit_f
    solved = dataclasses.replace(
        guess,
        start_wrench=planar_wrench(angles[0], fx, fy, solution.y[3, 0] * unit_m),
        end_wrench=planar_wrench(angles[1], -fx, -fy - w * unit_f, -solution.y[3, -1] * unit_m),
    )
    x, y, theta, _ = solution.sol(np.linspace(0, 1, samples))
    points = guess.start[:3] + length * np.column_stack([x, y, np.zeros(samples)])
    frames = Rotation.from_matrix([planar_frame(angle) for angle in theta])
    return solved, points, frames.as_quat()


def _integrated(guess: Reference) -> tuple[np.ndarray, np.ndarray]:
    """Grid and x, y, theta, curvature of integrating from the start clamp, in units of the cable."""
    points, orientations, _ = shoot(guess, 201)
    tangents = Rotation.from_quat(orientations).as_matrix()[:, :, 2]
    s = np.linspace(0, 1, 201)
    theta = np.unwrap(np.arctan2(tangents[:, 1], tangents[:, 0]))
    theta += plane_angle(guess.start) - theta[0]
    x, y = (points[:, :2] - guess.start[:2]).T / guess.length
    return s, np.array([x, y, theta, np.gradient(theta, s)])


def _layered_catenary(
    h: float, v: float, w: float, angles: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """The same for a catenary with tan(psi / 4) = tan(d / 4) exp(-s / l) in both layers."""
    layer = 1 / np.sqrt(np.hypot(h, v))
    near = np.minimum(12 * layer, 0.5) * np.linspace(0, 1, 121) ** 2
    s = np.unique(np.round(np.concatenate([np.linspace(0, 1, 201), near, 1 - near]), 9))
    phi = np.arctan2(v + w * s, h)
    theta = (
        phi
        + 4 * np.arctan(np.tan((angles[0] - phi[0]) / 4) * np.exp(-s / layer))
        + 4 * np.arctan(np.tan((angles[1] - phi[-1]) / 4) * np.exp(-(1 - s) / layer))
    )
    middle = 0.5 * (theta[1:] + theta[:-1])
    x = np.concatenate([[0], np.cumsum(np.diff(s) * np.cos(middle))])
    y = np.concatenate([[0], np.cumsum(np.diff(s) * np.sin(middle))])
    return s, np.array([x, y, theta, np.gradient(theta, s)])
