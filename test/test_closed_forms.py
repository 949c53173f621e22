# SPDX-License-Identifier: Apache-2.0
"""The tracker against closed forms at every accuracy asked for, and against limits with their orders."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from references import planar, spatial
from references.boundary_value import solve_planar
from references.reference import Reference, shoot

from cable_ros import Equilibrium, Status, Tracker, load_scene

EXACT = {
    "cantilever": planar.cantilever(0.7, 0.02, 0.35),
    "cantilever strongly bent": planar.cantilever(1.0, 1.0, 12.0),
    "inflectional elastica": planar.elastica(1.3, 2.0, 9.0, 0.8, -0.6, 0.4),
    "orbital elastica": planar.elastica(1.0, 1.0, 4.0, 0.7, 0.3, -0.2, orbital=True),
    "arc": planar.arc(1.0, 1.0, 2.0),
    "helix": spatial.helix(1.0, 1.0, 0.7, 3.0, 2.0, 2.0),
    "helix with extra twist": spatial.helix(0.4, 0.02, 0.05, 5.0, -4.0, 2.0),
}


def solve(reference: Reference, tolerance: float, **fields: float) -> Equilibrium:
    found = Tracker(load_scene(reference.scene(**fields)), tolerance=tolerance).solve({})["cable"]
    assert found.status is Status.CONVERGED, found.message
    return found


def size(wrench: np.ndarray, reference: Reference) -> float:
    return float(np.linalg.norm(wrench * np.array([1.0] * 3 + [1 / reference.length] * 3)))


def error(found: Equilibrium, reference: Reference) -> float:
    """The larger relative error of both wrenches, moments divided by the length."""
    return max(
        size(a - b, reference) / size(b, reference)
        for a, b in (
            (found.end_wrench, reference.end_wrench),
            (found.start_wrench, reference.start_wrench),
        )
    )


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-7, 1e-9])
@pytest.mark.parametrize("name", EXACT)
def test_wrenches_are_within_the_asked_tolerance(name: str, tolerance: float) -> None:
    reference = EXACT[name]
    found = solve(reference, tolerance)
    true = error(found, reference)
    assert true <= tolerance
    # An estimate may be off by a factor, but not lull anyone; 1e-10 is what closed form and rounding leave.
    assert true <= 3 * found.error_estimate + 1e-10
    assert found.stable
    # The twist is as accurate as the wrench, and it is of the order of 1.
    assert found.total_twist == pytest.approx(reference.total_twist, abs=10 * tolerance)


@pytest.mark.parametrize("name", EXACT)
def test_shape(name: str) -> None:
    reference = EXACT[name]
    points, orientations, _ = shoot(reference)
    found = solve(reference, 1e-7)
    assert np.abs(found.points - points).max() < 1e-6 * reference.length
    # Quaternions name a rotation up to their sign.
    assert np.abs(np.sum(found.orientations * orientations, axis=1)) == pytest.approx(1.0, abs=1e-10)


def test_energy_of_bent_and_twisted_rods() -> None:
    arc = planar.arc(1.0, 2.0, 1.5)
    assert solve(arc, 1e-7).energy == pytest.approx(0.5 * 2.0 * 1.5**2, rel=1e-6)
    helix = spatial.helix(1.0, 1.0, 0.7, 3.0, 2.0, 1.0)
    assert solve(helix, 1e-7).energy == pytest.approx(0.5 * (3.0**2 + 0.7 * 1.0**2), rel=1e-6)


def test_euler_load_is_approached_linearly() -> None:
    excess = []
    for shortening in (4e-2, 2e-2, 1e-2):
        force = np.linalg.norm(solve(planar.buckled(1.0, 1.0, 1 - shortening), 1e-8).end_wrench[:3])
        excess.append(force / (4 * np.pi**2) - 1)
    # P / P_Euler - 1 = shortening / 2 + O(shortening^2)
    assert np.array(excess) == pytest.approx([2e-2, 1e-2, 5e-3], rel=0.05)
    assert np.log2(np.array(excess[:-1]) / excess[1:]) == pytest.approx([1.0, 1.0], abs=0.03)


def test_small_deflection_beam_is_approached_with_second_order() -> None:
    errors = []
    for gamma in (16.0, 8.0, 4.0):
        reference = spatial.beam(1.0, 1.0, gamma)
        found = solve(reference, 1e-9)
        vertical = found.end_wrench[0]
        assert vertical == pytest.approx(-gamma / 2, rel=1e-7)  # by symmetry, not only in the limit
        errors.append(abs(found.end_wrench[4] / (gamma / 12) - 1))
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx([2.0, 2.0], abs=0.15)


def test_catenary_is_approached_with_its_orders() -> None:
    plain, corrected = [], []
    for gamma in (1e4, 4e4, 1.6e5):
        for errors, offset in ((plain, False), (corrected, True)):
            limit = spatial.catenary(1.0, 1.0, gamma, (0.6, 0.2), (0.3, 1.9), offset)
            force = solve(limit, 1e-6).end_wrench[:3]
            errors.append(np.linalg.norm(force - limit.end_wrench[:3]) / np.linalg.norm(force))
    rate = np.log(4.0)
    assert np.log(np.array(plain[:-1]) / plain[1:]) / rate == pytest.approx([0.5, 0.5], abs=0.1)
    assert np.log(np.array(corrected[:-1]) / corrected[1:]) / rate == pytest.approx([1.0, 1.0], abs=0.1)


@pytest.mark.parametrize("gamma", [1e3, 1e5])
def test_heavy_cable_against_collocation(gamma: float) -> None:
    true = solve_planar(spatial.catenary(1.0, 1.0, gamma, (0.6, 0.2), (0.3, 1.9)))
    assert error(solve(true, 1e-6), true) < 1e-6


def test_torque_of_a_twisted_nearly_straight_rod() -> None:
    # Chord 0.9999: the torque is GJ / L times the twist exactly, as the twist is uniform in a round rod.
    reference = spatial.twisted_straight(1.0, 1.0, 0.7, 0.8)
    near = np.array(reference.end)
    near[0] = 0.9999
    found = solve(replace(reference, end=near), 1e-6)
    assert found.end_wrench[5] == pytest.approx(-0.7 * found.total_twist, rel=1e-6)
    # The bend of a chord of 0.9999 takes little of the clamp's turn.
    assert found.total_twist == pytest.approx(0.8, abs=0.02)
