# SPDX-License-Identifier: Apache-2.0
"""Cables with a free end that hang straight, or all but, among obstacles.

Held at both ends such a cable has unbounded tension: its mesh once grew until memory was full.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from test_touching_ends import DIAMETER, FREE, GROUND, among
from zoo_supports import CART

from cable_ros import Tracker
from cable_ros.branch.refinement import without_slivers
from cable_ros.equilibrium import Status
from cable_ros.rod.elements import Mesh, reference_element
from cable_ros.scene import load_scene

TOLERANCE = 1e-6


def tracker(weight: float, digits: int, *obstacles: dict, tolerance: float = TOLERANCE) -> Tracker:
    """One of a cable of 1 m that hangs down from 1.1 m, its rpy written with so many digits."""
    start = {"link": "cart", "position": [0.0, 0.0, 1.1], "rpy": [round(np.pi, digits), 0.0, 0.0]}
    return Tracker(load_scene(among(start, FREE, *obstacles, weight=weight), urdf=CART), tolerance=tolerance)


def critical_load(weight: float) -> float:
    """N, under which it buckles, its end free to move aside; EI = 1.

    Its slope v is 0 at the clamp, v'' = T v with the tension T = weight (1 - s) - N, and v' is 0 at the end.
    """

    def moment_at_end(load: float) -> float:
        def slope(s: float, v: np.ndarray) -> list[float]:
            return [v[1], (weight * (1.0 - s) - load) * v[0]]

        return float(solve_ivp(slope, (0.0, 1.0), [0.0, 1.0], rtol=1e-10, atol=1e-12).y[1, -1])

    loads = np.linspace(0.0, 0.25 * np.pi**2 + weight, 200)
    first = next(k for k in range(1, 200) if moment_at_end(loads[k]) < 0.0)
    return float(brentq(moment_at_end, loads[first - 1], loads[first], xtol=1e-10))


@pytest.mark.parametrize("weight", [0.5, 5.0, 50.0])
@pytest.mark.parametrize("digits", [5, 8, 15])
def test_lowered_to_the_ground_it_buckles_at_its_critical_load(weight, digits):
    """And hangs straight again where it is lifted off."""
    hose, slack = tracker(weight, digits, GROUND), 1e-4
    for height in (0.1, 0.05, -slack, -0.05, -slack, 0.05):
        found = hose.arrive({"x": 0.0, "y": 0.0, "z": 0.5 * DIAMETER - 0.1 + height})["c"]
        assert found.status in (Status.CONVERGED, Status.SNAPPED), found.message
        if height > 0.0:
            np.testing.assert_allclose(found.start_wrench, [0, 0, weight, 0, 0, 0], atol=1e-5 * weight)
        elif height == -slack:
            (rests,) = found.contacts
            # the load of a buckled cable changes with its slack to first order
            assert rests.force[2] == pytest.approx(critical_load(weight), rel=20 * slack)
            assert found.start_wrench[2] == pytest.approx(weight - rests.force[2], abs=1e-5 * weight)


@pytest.mark.parametrize("weight", [0.5, 5.0, 50.0])
def test_lowered_until_it_lies_a_cable_that_leans_to_no_side_turns_freely(weight):
    """About the vertical: its least eigenvalue is 0, also where what it lies on takes a moment."""
    hose, margins = tracker(weight, 15, GROUND, tolerance=1e-4), []
    for height in np.concatenate([[0.1, -1e-4], np.linspace(-0.1, -0.7, 13)]):
        found = hose.arrive({"x": 0.0, "y": 0.0, "z": 0.5 * DIAMETER - 0.1 + height})["c"]
        assert found.status in (Status.CONVERGED, Status.SNAPPED), found.message
        margins.append(found.stability_margin)
    assert margins[2:] == [0.0] * 13
    tangent = Rotation.from_quat(found.orientations[-1]).apply([0.0, 0.0, 1.0])
    assert abs(tangent[2]) < 1e-9  # it lies


@pytest.mark.parametrize("weight", [0.5, 5.0, 50.0])
@pytest.mark.parametrize("height", [0.01, 0.1, 0.3])
def test_found_cold_on_the_ground_it_is_as_it_is_led_there(weight, height):
    """Nothing but 2.7e-6 rad tells to which side it goes, so what is the same is its size."""
    joints = {"x": 0.0, "y": 0.0, "z": 0.5 * DIAMETER - 0.1 - height}
    led, cold = (tracker(weight, 5, GROUND, tolerance=1e-4) for _ in range(2))
    for above in (0.1, -1e-4):
        led.arrive(joints | {"z": 0.5 * DIAMETER - 0.1 + above})
    ends = []
    for one in (led.arrive(joints)["c"], cold.arrive(joints)["c"]):
        assert one.status in (Status.CONVERGED, Status.SNAPPED), one.message
        assert one.contacts
        moment, aside = np.linalg.norm(one.start_wrench[3:5]), np.linalg.norm(one.points[-1, :2])
        ends.append([one.start_wrench[2] / weight, moment / weight, aside])
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-3)  # a few times the tolerance


def test_led_over_the_ground_it_is_as_without_it():
    plain, beside = tracker(5.0, 15), tracker(5.0, 15, GROUND)
    for x in np.linspace(0.0, 1.0, 6):
        joints = {"x": x, "y": -0.5 * x, "z": 0.1 * x}
        one, two = plain.arrive(joints)["c"], beside.arrive(joints)["c"]
        assert two.status is Status.CONVERGED, two.message
        assert two.stability_margin > 0.01
        np.testing.assert_allclose(two.start_wrench, one.start_wrench, atol=1e-6)
        np.testing.assert_allclose(two.points, one.points, atol=1e-6)
        np.testing.assert_allclose(two.clamp_stiffness, one.clamp_stiffness, atol=1e-5)


def test_a_weightless_cable_that_a_sliding_end_pulls_straight():
    """It carries the pull alone; led aside and back it is straight again."""
    start = {"link": "cart", "position": [0.0, 0.0, 0.5], "rpy": [0.0, np.pi / 2, 0.0]}
    end = {"kind": "sliding", "position": [0.5, 0.0, 0.5], "rpy": [0.0, np.pi / 2, 0.0], "axial_force": 10.0}
    hose = Tracker(load_scene(among(start, end, GROUND, weight=1e-9), urdf=CART), tolerance=TOLERANCE)
    for z in (0.0, 1e-3, 0.1, 0.0):
        found = hose.arrive({"x": 0.0, "y": 0.0, "z": z})["c"]
        assert found.status is Status.CONVERGED, found.message
        if z == 0.0:
            np.testing.assert_allclose(found.start_wrench, [0.0, 0.0, 10.0, 0.0, 0.0, 0.0], atol=1e-5)
            np.testing.assert_allclose(found.points[-1], [1.0, 0.0, 0.5], atol=1e-6)


def test_a_load_that_hangs_on_a_straight_cable_is_led_against_a_ball():
    """From where it is clear; and its weight adds to the cable's."""
    start = {"link": "cart", "position": [0.0, 0.0, 1.1], "rpy": [np.pi, 0.0, 0.0]}
    ball = {"name": "ball", "sphere": {"center": [0.2, 0.01, 0.4], "radius": 0.1}}
    scene = among(start, FREE | {"force": [0.0, 0.0, -20.0]}, ball, weight=5.0)
    hose = Tracker(load_scene(scene, urdf=CART), tolerance=TOLERANCE)
    for x in (0.0, 0.1, 0.2, 0.1, 0.0):
        found = hose.arrive({"x": x, "y": 0.0, "z": 0.0})["c"]
        assert found.status is Status.CONVERGED, found.message
        push = sum((one.force for one in found.contacts), np.zeros(3))
        exerted = found.start_wrench[:3] * [1.0, -1.0, -1.0]  # along the world's axes
        np.testing.assert_allclose(exerted, push + [0.0, 0.0, -25.0], atol=1e-4)
        assert bool(found.contacts) == (x > 0.05)


def test_slivers_are_joined_to_their_neighbours():
    """Elements that a contact left, from which a finer mesh would grow to a million."""
    lengths = np.array([0.5, 0.25, 9e-9, 0.25 - 1e-8, 1e-9])
    whole = without_slivers(Mesh(reference_element(6), lengths))
    np.testing.assert_allclose(whole.lengths, [0.5, 0.25, 0.25], atol=1e-7)
    assert whole.lengths.sum() == pytest.approx(lengths.sum(), abs=1e-15)
