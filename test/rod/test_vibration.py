# SPDX-License-Identifier: Apache-2.0
"""Natural frequencies against closed forms: beam, taut string, bar; and how fast they converge."""

from __future__ import annotations

import numpy as np
import pytest
from references.rods import STILL, equal, reference, uniform
from scipy.optimize import brentq

from cable_ros.branch.cold_start import Found
from cable_ros.branch.modes import modes
from cable_ros.rod.extensible import StretchingRod
from cable_ros.rod.kirchhoff import Rod
from cable_ros.rod.units import Units
from cable_ros.rod.vibration import follow, kernel, lowest
from cable_ros.rod.warm_step import ADVANCED

BEAM = (4.730040744862704, 7.853204624095838, 10.995607838001671)
"""Roots of cos x cosh x = 1 (Rao, Mechanical Vibrations, table 8.15)."""


def omega(rod: Rod, q: np.ndarray, F: np.ndarray, count: int) -> np.ndarray:
    """(count,) angular frequencies in units of the cable."""
    return 2.0 * np.pi * modes(rod, q, F, STILL, Units(1.0, 1.0), 1.0, count, 2).frequencies


def straight(rod: Rod) -> np.ndarray:
    """The frames of the straight rod, and its conditions set to that."""
    rod.set_conditions(np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]), np.zeros(3))
    q = np.zeros((len(rod.mesh.nodes), 4))
    q[:, 0] = 1.0
    return q


def under_tension(tension: float, count: int) -> np.ndarray:
    """(count,) of a clamped-clamped beam, EI = rho = L = 1, from its characteristic equation."""

    def miss(w: float) -> float:
        root = np.sqrt(0.25 * tension**2 + w * w)
        a, b = np.sqrt(root + 0.5 * tension), np.sqrt(root - 0.5 * tension)
        return float(2 * a * b * (1 / np.cosh(a) - np.cos(b)) + (a * a - b * b) * np.tanh(a) * np.sin(b))

    grid = np.linspace(1.0, 3.0 * np.pi * count * np.sqrt(tension + np.pi**2 * count**2), 4000 * count)
    values = [miss(w) for w in grid]
    at = np.flatnonzero(np.sign(values[1:]) != np.sign(values[:-1]))[:count]
    return np.array([brentq(miss, grid[i], grid[i + 1], xtol=1e-13) for i in at])


@pytest.mark.parametrize(("order", "counts"), [(2, (8, 16)), (3, (4, 8))])
def test_a_clamped_beam_and_twice_the_order(order, counts):
    K = np.array([1.0, 1.7, 0.8])
    exact = np.sort(np.outer(np.square(BEAM), np.sqrt(K[:2])).ravel())[:4]
    errors = []
    for count in counts:
        rod = Rod(equal(order, count), K)
        errors.append(np.abs(omega(rod, straight(rod), np.zeros(3), 4) / exact - 1.0))
    rates = np.log(errors[0] / errors[1]) / np.log(counts[1] / counts[0])
    np.testing.assert_allclose(rates, 2 * order, atol=0.6)


@pytest.mark.parametrize("tension", [5.0, 400.0])
def test_a_beam_under_tension(tension):
    rod = Rod(equal(6, 6), np.array([1.0, 1.0, 0.8]))
    found = omega(rod, straight(rod), np.array([0.0, 0.0, tension]), 6)
    # Round: each twice. The discretisation's error is below 1e-7 there.
    np.testing.assert_allclose(found, np.repeat(under_tension(tension, 3), 2), rtol=1e-6)


def test_a_taut_string():
    """Clamps shorten a string by (EI / T)^1/2 at each end (Fletcher, J. Acoust. Soc. Am. 36, 1964)."""
    tension = 1e6
    rod = Rod(equal(6, 24), np.array([1.0, 1.0, 0.8]))
    found = omega(rod, straight(rod), np.array([0.0, 0.0, tension]), 4)[::2]
    string = np.pi * np.arange(1, 3) * np.sqrt(tension)
    # Second order: (4 + n^2 pi^2 / 2) EI / (T L^2), some 1e-5.
    np.testing.assert_allclose(found, string * (1.0 + 2.0 / np.sqrt(tension)), rtol=5e-5)


def test_a_rod_that_stretches_has_longitudinal_waves():
    """Of a bar between walls: n pi (EA / rho)^1/2 / L; bending waves of a stiff rod are far above."""
    soft = 1e-2
    rod = StretchingRod(equal(6, 4), np.array([1e4, 1e4, 1e4]), None, np.array([0.0, 0.0, soft]))
    found = omega(rod, straight(rod), np.zeros(3), 3)
    np.testing.assert_allclose(found, np.pi * np.arange(1, 4) / np.sqrt(soft), rtol=1e-6)


def test_a_rod_that_shears_and_stretches_hardly_is_one_that_does_not():
    near = reference("space_arm_+0.0deg")
    plain = omega(near.rod, near.q, near.F, 4)
    differences = []
    for soft in (1e-6, 1e-7):
        rod = StretchingRod(near.rod.mesh, near.rod.K, None, soft * np.array([2.0, 2.0, 1.0]))
        rod.set_conditions(near.rod.qe, near.rod.re, near.rod.f)
        assert rod.refactor(near.q, near.F)
        code, _, q, F = rod.advance(near.q, near.F, near.rod.qe, near.rod.re, near.rod.f, 1e-10)
        assert code == ADVANCED
        differences.append(np.abs(omega(rod, q, F, 4) / plain - 1.0))
    # The difference is of first order in the compliance.
    np.testing.assert_allclose(differences[0] / differences[1], 10.0, rtol=0.05)


@pytest.mark.parametrize(("order", "counts"), [(3, (16, 32)), (4, (12, 16))])
def test_of_a_bent_cable_they_converge_with_twice_the_order(order, counts):
    name = "space_arm_+90.0deg"
    exact = _omega(reference(name))
    coarse, fine = (np.abs(_omega(uniform(name, order, n)) / exact - 1.0) for n in counts)
    rates = np.log(coarse / fine) / np.log(counts[1] / counts[0])
    np.testing.assert_allclose(rates, 2 * order, atol=0.5)


def _omega(found: Found) -> np.ndarray:
    return omega(found.rod, found.q, found.F, 3)


def test_what_is_held_twice_is_held_once():
    """Two masses on springs, one of them held by two equal rows."""
    H, rows = np.diag([4.0, 9.0]), np.array([[0.0, 1.0], [0.0, 3.0]])
    Z = kernel(rows)
    np.testing.assert_allclose(np.abs(Z[:, 0]), [1.0, 0.0], atol=1e-15)
    found, _ = lowest(Z.T @ H @ Z, np.eye(1), 5)
    np.testing.assert_allclose(found, [2.0])
    np.testing.assert_allclose(follow(H, rows, np.array([[1.0], [3.0]]), Z), [[0.0], [1.0]], atol=1e-15)
    with pytest.raises(np.linalg.LinAlgError):
        follow(H, rows, np.array([[1.0], [1.0]]), Z)


def test_what_is_not_stable_does_not_vibrate():
    with pytest.raises(np.linalg.LinAlgError):
        lowest(np.diag([4.0, -1.0]), np.eye(2), 1)
