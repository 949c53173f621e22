# SPDX-License-Identifier: Apache-2.0
"""Natural frequencies of tracked cables: the arm, a hanging cable, one that stretches, cables that touch."""

from __future__ import annotations

import math

import numpy as np
import pytest
from nodal_scenes import pressed
from references.rods import STILL
from scipy.optimize import brentq

from cable_ros import Equilibrium, Tracker, load_scene
from cable_ros.branch import handover
from cable_ros.branch.modes import modes
from cable_ros.contact.friction_kernels import FRICTIONLESS
from cable_ros.rod.kirchhoff import Rod
from cable_ros.rod.units import Units
from cable_ros.share import share_file

UPRIGHT = [0, 0, 0, 1]


@pytest.mark.parametrize(("degrees", "lowest"), [(-90, 3.5), (0, 3.3), (90, 1.95)])
def test_the_arm_s_lowest_are_those_of_an_independent_computation(degrees, lowest):
    tracker = Tracker(str(share_file("config", "space_arm.yaml")))
    found = tracker.arrive({"orientation": math.radians(degrees)})["camera_cable"].modes(1)
    # Given with two or three digits.
    assert found.frequencies[0] == pytest.approx(lowest, rel=0.015)


def solved(gravity, length, start, end, **fields) -> Equilibrium:
    cable = {"name": "cable", "length": length, "start": start, "end": end, **fields}
    (found,) = Tracker(load_scene({"gravity": gravity, "cables": [cable]})).arrive({}).values()
    assert found.status.trusted, found.message
    return found


def test_a_hanging_cable():
    """Of a shallow inextensible cable: n pi out of its plane, 2 pi and 2.86 pi in it, (H / m)^1/2 / l.

    Irvine and Caughey, Proc. R. Soc. A 341 (1974): the symmetric ones in the plane are tan x = x.
    """
    span, weight = 1.0, 9.81
    a = brentq(lambda a: 2 * a * math.sinh(0.5 * span / a) - 1.005 * span, 0.5, 50.0)
    slope = math.asinh(math.sinh(0.5 * span / a))
    angle = math.atan(math.sinh(slope))  # of the tangent at the supports, below and above the level
    found = solved(
        [0, 0, -weight], 1.005 * span,
        {"position": [0, 0, 0], "rpy": [0, math.pi / 2 + angle, 0]},
        {"position": [span, 0, 0], "rpy": [0, math.pi / 2 - angle, 0]},
        stiffness=[2e-6, 2e-6, 2e-6], linear_density=1.0,
    )  # fmt: skip
    wave = math.sqrt(a * weight) / (2.0 * span)  # of the horizontal force a m g
    expected = wave * np.array([1.0, 2.0, 2.0, 2.8606, 3.0])
    # The sag is a twenty-third of the span, of which theory neglects the square; bending adds 2e-3.
    np.testing.assert_allclose(np.sort(found.modes(5).frequencies), expected, rtol=0.02)


def test_a_cable_stretched_between_its_clamps():
    """Transverse waves of a string along the unstretched length: (T / (1 + e) / rho)^1/2."""
    strain, stiffness = 0.01, 1e4
    found = solved(
        [0, 0, 0], 1.0, {"position": [0, 0, 0], "orientation": UPRIGHT},
        {"position": [0, 0, 1.0 + strain], "orientation": UPRIGHT},
        stiffness=[1e-3, 1e-3, 1e-3], linear_density=0.2, axial_stiffness=stiffness,
    )  # fmt: skip
    string = 0.5 * math.sqrt(stiffness * strain / (1 + strain) / 0.2)
    # Clamps shorten it by (EI / T)^1/2 = 3e-3 at each end, to first order.
    shortened = string * (1.0 + 2.0 * math.sqrt(1e-3 * (1 + strain) / (stiffness * strain)))
    np.testing.assert_allclose(found.modes(2).frequencies, shortened, rtol=2e-4)


def test_a_cable_without_mass_has_none():
    found = solved(
        [0, 0, -9.81], 1.0, {"position": [0, 0, 0], "orientation": UPRIGHT},
        {"position": [0.3, 0, 0.8], "orientation": UPRIGHT}, stiffness=[1, 1, 1], linear_density=0.0,
    )  # fmt: skip
    assert np.isinf(found.modes(2).frequencies).all()


def test_what_turns_freely_has_a_frequency_of_nearly_nothing():
    """A round cable without weight, buckled between clamps on one line, turns about that."""
    found = solved(
        [0, 0, 0], 1.0, {"position": [0, 0, 0], "orientation": UPRIGHT},
        {"position": [0, 0, 0.8], "orientation": UPRIGHT}, stiffness=[1, 1, 0.7], linear_density=1.0,
        total_twist=0.0,
    )  # fmt: skip
    assert "turns freely" in found.message
    first, second = found.modes(2).frequencies
    # By the stiffness of 1e-6 of the cable's own that is always added.
    assert 0.0 <= first < 0.01 * second


def test_units_and_world_change_nothing():
    """A cable twice as long and half as heavy per length; the world turned upside down with it."""
    one = solved(
        [0, 0, -8.0], 1.0, {"position": [0, 0, 0], "orientation": UPRIGHT},
        {"position": [0.3, 0.1, 0.8], "orientation": UPRIGHT}, stiffness=[1, 1, 0.7], linear_density=1.0,
        total_twist=0.0,
    )  # fmt: skip
    other = solved(
        [0, 0, 8.0 / 4.0], 2.0, {"position": [1, 1, 1], "orientation": [1, 0, 0, 0]},
        {"position": [1.6, 0.8, -0.6], "orientation": [1, 0, 0, 0]}, stiffness=[1, 1, 0.7],
        linear_density=0.5, total_twist=0.0,
    )  # fmt: skip
    # w L^3 / EI is the same; (EI / (rho L^4))^1/2 is 8^-1/2 of what it was.
    np.testing.assert_allclose(
        other.modes(3).frequencies, one.modes(3).frequencies / math.sqrt(8.0), rtol=1e-6
    )
    turned = one.modes(1).shapes[0] * [1, -1, -1]
    away = other.modes(1).shapes[0]
    np.testing.assert_allclose(away * np.sign((away * turned).sum()), turned, atol=1e-5)


def omega(rod: Rod, q: np.ndarray, F: np.ndarray) -> np.ndarray:
    return modes(rod, q, F, STILL, Units(1.0, 1.0), 1.0, 4, 2).frequencies


@pytest.mark.parametrize("shape", ["sphere", "plane", "capsule", "cylinder", "box"])
def test_both_formulations_of_contact_agree(shape):
    """Exact contact slides and lifts off anywhere; on the grid it is pressed middles of cells."""
    differences = []
    for cells in (64, 128):
        rod = pressed(shape, cells=cells)
        on_grid = omega(rod, rod.shape, rod.end_force)
        exact = handover.exact(rod, 1e-6, FRICTIONLESS)
        assert exact is not None
        differences.append(np.abs(on_grid / omega(exact.rod, exact.q, exact.F) - 1.0))
    # Contacts are half a cell off at most, which is 0.8 % of the length, then 0.4 %.
    assert differences[0].max() < 0.03
    assert differences[1].max() < 0.006


def test_two_places_side_by_side_on_a_grid_are_one_contact():
    rod = pressed("sphere", cells=80)
    assert (rod.state.lam > 0.0).sum() == 2
    exact = handover.exact(rod, 1e-6, FRICTIONLESS)
    assert exact is not None
    found = omega(rod, rod.shape, rod.end_force)
    np.testing.assert_allclose(found, omega(exact.rod, exact.q, exact.F), rtol=5e-3)


def test_friction_that_sticks_holds():
    """Of the arm over its ball: the same equilibrium with and without what keeps it from sliding."""
    tracker = Tracker(load_scene(share_file("config", "space_arm_sphere.yaml")))
    for degrees in (40.0, 50.0, 60.0, 59.9):  # it turns back, so that all sticks
        found = tracker.arrive({"orientation": math.radians(degrees)})["camera_cable"]
    assert found.contacts
    assert not any(contact.sliding for contact in found.contacts)
    (tracked,) = tracker._tracked_cables
    rod, q, F = tracked.rod, tracked.q, tracked._F
    loose = rod.snapshot()()
    loose.model = FRICTIONLESS
    free, stuck = omega(loose, q, F), omega(rod.snapshot()(), q, F)
    # A constraint raises every frequency, or leaves it (Rayleigh).
    assert (stuck >= free * (1.0 - 1e-9)).all()
    assert stuck[0] > 1.01 * free[0]
