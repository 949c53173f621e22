# SPDX-License-Identifier: Apache-2.0
"""A twisted cable flat on the ground that leaves it just before its clamp, where its pressure all but ends.

Flat in its plane it is an elastica of curvature kappa, with the twisting moment T constant; balance about the
binormal asks for the force T kappa across the plane, so that the ground presses with p = w + T kappa'. Beside
the end clamp p is slightly negative: there the cable rises as a beam, y'''' = -p, that is held at the clamp
and has y = y' = y'' = 0 where it leaves the ground; y''' at the clamp is what that adds to its force.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid, solve_ivp
from scipy.optimize import brentq, root

from cable_ros import Status, Tracker
from cable_ros.bench.cases import case_scene
from cable_ros.bench.drawn import drawn_case

WEIGHT, TWIST, TORSION, CHORD = 50.0, np.pi, 0.75, 0.5
"""w L^3 / EI, rad, GJ / EI; chord of the clamps, whose tangents are opposite, L: of the drawn scene."""


def flat() -> tuple[float, np.ndarray, np.ndarray]:
    """Curvature at the end; distances from it (n,), and pressures there (n,) if the cable lies everywhere."""

    def back(force: np.ndarray):  # type: ignore[no-untyped-def]
        def rates(_: float, u: np.ndarray) -> list[float]:
            across = force[1] * np.cos(u[0]) - force[0] * np.sin(u[0])
            return [-u[1], across, -np.cos(u[0]), -np.sin(u[0])]

        return rates

    def shape(x: np.ndarray) -> np.ndarray:
        s = np.linspace(0.0, 1.0, 10001)
        return solve_ivp(
            back(x[1:]), (0.0, 1.0), [0.0, x[0], 0.0, 0.0], "DOP853", s, rtol=1e-11, atol=1e-12
        ).y

    def misses(x: np.ndarray) -> np.ndarray:
        end = shape(x)[:, -1]
        return np.array([end[0] + np.pi, end[2] - CHORD, end[3]])

    found = root(misses, [5.5, -0.7, 21.5], tol=1e-11)
    assert found.success
    angle = shape(found.x)[0]
    across = found.x[2] * np.cos(angle) - found.x[1] * np.sin(angle)
    return float(found.x[0]), np.linspace(0.0, 1.0, 10001), WEIGHT - TORSION * TWIST * across


def rise(length: float, at: np.ndarray, pressure: np.ndarray) -> tuple[float, float]:
    """y'' where the beam of this length leaves the ground, and y''' at the clamp."""
    x = np.linspace(0.0, length, 4001)
    integral, integrals = -np.interp(x, at, pressure), []
    for _ in range(4):
        integral = cumulative_trapezoid(integral, x, initial=0.0)
        integrals.append(integral[-1])
    third, second = np.linalg.solve(
        [[length**2 / 2.0, length], [length**3 / 6.0, length**2 / 2.0]], [-integrals[2], -integrals[3]]
    )
    return integrals[1] + third * length + second, third


@pytest.mark.parametrize("tolerance", [1e-4, 3e-6])
def test_its_clamp_has_the_force_of_a_beam_that_rises(tolerance: float) -> None:
    curvature, at, pressure = flat()
    assert -1.0 < pressure[0] < 0.0
    length = brentq(lambda x: rise(x, at, pressure)[0], 0.01, 0.1)
    force = TORSION * TWIST * curvature - rise(length, at, pressure)[1]
    case = drawn_case(107, 101, tolerance)
    scene = case_scene(case)
    (cable,) = scene.cables
    found = Tracker(scene, tolerance=tolerance).arrive(case.path[0])["cable"]
    assert found.status is Status.CONVERGED
    unit = cable.stiffness[0] / cable.length**2
    size = float(np.linalg.norm(found.end_wrench[:3])) / unit
    assert abs(abs(found.end_wrench[0]) / unit - force) < tolerance * size
    assert min(contact.normal_force for contact in found.contacts) >= 0.0
    # without the rise it would be wrong by more than 1e-4
    assert abs(TORSION * TWIST * curvature - force) > 2e-4 * size
