# SPDX-License-Identifier: Apache-2.0
"""Where a round weightless cable turns to, which is free to turn until an end moves."""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros import Equilibrium, Status, Tracker, load_scene
from cable_ros.bench.carriage import on_carriage
from cable_ros.bench.cases import case_scene
from cable_ros.bench.drawn import drawn_case
from cable_ros.bench.metamorphic import corners, in_states
from cable_ros.branch.cold_start import Conditions, Found, equilibria
from cable_ros.branch.free_turn import place_to_turn_to, places_beside
from cable_ros.branch.snap_through import DESCENT
from cable_ros.rod import quaternion

SLACK = np.array([0.0, 0.0, 0.6])
"""Of the end, L, from the start: in line with both clamps."""
SMALL = 1e-4
"""Motion of the end, L or rad: what is of second order in it is 1e-4 of what is of first order."""
ANGLES = np.linspace(0.0, 2.0 * np.pi, 721)


def about_line(angle: float) -> np.ndarray:
    return np.array([np.cos(0.5 * angle), 0.0, 0.0, np.sin(0.5 * angle)])


def arch(spin: float) -> Found:
    """An equilibrium that is free to turn about the line of its clamps, the end turned by `spin`, rad."""
    found = equilibria(
        np.array([1.0, 1.0, 0.75]), None, Conditions(about_line(spin), SLACK, np.zeros(3)), spin, 1e-8
    )
    one = found[0]
    one.rod.linearize(one.q, one.F)
    return one


@pytest.mark.parametrize(
    ("spin", "shift", "tilt"),
    [
        (0.0, (0.2, 0.1), (0.5, -1.0)),
        (1.2, (1.0, 0.0), (0.0, 0.0)),
        (1.2, (-0.3, 0.8), (0.0, 0.0)),
        (1.2, (0.2, 0.1), (0.5, -1.0)),
    ],
)
def test_it_is_the_equilibrium_of_least_energy(
    spin: float, shift: tuple[float, float], tilt: tuple[float, float]
) -> None:
    """A descent from there goes nowhere, and has the least energy that the end wrench can leave."""
    one = arch(spin)
    rod, energy, moment = one.rod, one.energy, one.rod.reactions().copy()
    motion, rotation = SMALL * np.array([*shift, 0.0]), SMALL * np.array([*tilt, 0.0])
    small = np.array([1.0, *(0.5 * rotation)])
    end = quaternion.multiply(rod.qe, small / np.linalg.norm(small))
    conditions = Conditions(end, SLACK + motion, np.zeros(3))
    place = place_to_turn_to(rod, one.q, one.F, conditions)
    assert place is not None
    works = [
        quaternion.rotate(about_line(angle), one.F) @ motion
        + quaternion.rotate(about_line(angle), moment) @ rotation
        for angle in ANGLES
    ]
    rod.set_conditions(end, SLACK + motion, np.zeros(3))
    found = rod.minimum(rod.on_end(place[0]), place[1], DESCENT)
    assert found is not None
    assert found[2] <= 6
    # as far as the end has moved, by the leverage of a soft shape
    assert quaternion.largest_rotation(place[0], found[0]) < 100.0 * SMALL
    assert rod.linearize(*found[:2])[0] - energy == pytest.approx(min(works), rel=0.01)


def test_what_does_not_turn_freely() -> None:
    """With another stiffness about one axis no place is known; nor where the end moves along the line, nor
    where it moves across and a cable without twist pulls along the line alone.
    """
    plain, one = arch(0.0), arch(1.2)
    aside = SLACK + np.array([SMALL, 0.0, 0.0])
    assert (
        place_to_turn_to(plain.rod, plain.q, plain.F, Conditions(about_line(0.0), aside, np.zeros(3))) is None
    )
    conditions = Conditions(about_line(1.2), aside, np.zeros(3))
    assert place_to_turn_to(one.rod, one.q, one.F, conditions) is not None
    along = Conditions(about_line(1.2), SLACK + np.array([0.0, 0.0, SMALL]), np.zeros(3))
    assert place_to_turn_to(one.rod, one.q, one.F, along) is None
    one.rod.K = np.array([1.0, 1.1, 0.75])
    assert place_to_turn_to(one.rod, one.q, one.F, conditions) is None


@pytest.mark.parametrize("angle", [0.0, 0.4, 0.5 * np.pi, 2.0])
def test_an_arch_without_twist_turns_across_the_motion(angle: float) -> None:
    """Its end moves at an angle to its plane. Descents from both places go nowhere, and are mirror images."""
    one, small = arch(0.0), 3e-3
    rod, off = one.rod, Conditions(one.rod.qe, SLACK.copy(), np.zeros(3))
    plane = quaternion.rotate(about_line(angle), np.cross(one.rod.reactions(), [0.0, 0.0, 1.0]))
    off.re[:] += small * plane / np.linalg.norm(plane)
    places = places_beside(rod, one.q, one.F, off)
    assert len(places) == 2
    energies, turned = [], []
    for q, F in places:
        rod.set_conditions(off.qe, off.re, off.f)
        found = rod.minimum(rod.on_end(q), F, DESCENT)
        assert found is not None
        assert found[2] <= 8
        assert quaternion.largest_rotation(q, found[0]) < 10.0 * small
        energies.append(rod.linearize(*found[:2])[0])
        # the arch stands across the motion: the clamp's moment is along that
        turned.append(abs(rod.reactions() @ (off.re - SLACK)) / small / np.linalg.norm(rod.reactions()))
    assert energies[0] == pytest.approx(energies[1], rel=1e-12)
    np.testing.assert_allclose(turned, 1.0, atol=1e-3)
    # the nearer one first; of two that are as far the one that a rule chooses
    ways = [quaternion.largest_rotation(one.q, q) for q, _ in places]
    assert ways[0] < ways[1] + 1e-3


def test_an_arch_that_moves_across_goes_to_one_side_whatever_the_last_digit() -> None:
    """Nudged in the twelfth digit it was another arch at home, and turned to the other side."""
    for free in (False, True):
        told = [led_aside(0.02, 0.5 * np.pi, nudge, 0.0, free)[:2] for nudge in (0.0, 1e-12, -1e-12, 3e-12)]
        for home, aside in told:
            np.testing.assert_allclose(home.points, told[0][0].points, atol=1e-5)
            assert aside.iterations <= 70
            np.testing.assert_allclose(aside.points, told[0][1].points, atol=1e-5)


@pytest.mark.parametrize("states", [2, 8, 32])
def test_it_turns_no_farther_than_to_what_is_in_its_way(states: int) -> None:
    """Between rollers, where it is free to turn, it touches one, or by the last digit does not: then it leapt
    over that. There and back it comes back as it went.
    """
    case = drawn_case(27, 75, 1e-4)
    home, below = corners(case)[-1], corners(case)[-2]
    tracker = Tracker(case_scene(case))
    there, back = (
        [tracker.arrive(joints)["cable"] for joints in in_states([a, b], states)]
        for a, b in ((home, below), (below, home))
    )
    assert all(one.status.trusted for one in there + back)
    size = np.linalg.norm(there[0].end_wrench[:3])
    # its friction has turned back
    np.testing.assert_allclose(back[-1].end_wrench[:3], there[0].end_wrench[:3], atol=0.01 * size)


def led_aside(
    first: float, angle: float, nudge: float = 0.0, spin: float = 1.2, free: bool = False
) -> list[Equilibrium]:
    """A cable that is free to turn, its end at home, aside by `first`, and by 0.05 lengths, at an angle.

    `nudge`: of the joint `pitch`, rad; `spin`: of the end, rad; `free`: without an obstacle.
    """
    end = {"position": [0.0, 0.0, 0.6], "orientation": about_line(spin)[[1, 2, 3, 0]].tolist()}
    # it has edges, which are rounded for a descent
    box = {"box": {"center": [0.0, 0.0, -9.0], "size": [1.0, 1.0, 1.0]}}
    cable = {
        "name": "cable", "length": 1.0, "stiffness": [1.0, 1.0, 0.75], "linear_density": 0.0,
        "start": {"position": [0.0, 0.0, 0.0], "rpy": [0.0, 0.0, 0.0]}, "end": end,
    }  # fmt: skip
    plain = {"gravity": [0.0, 0.0, 0.0], "cables": [cable]}
    obstacles = {} if free else {"obstacles": [{"name": "far", **box, "friction": 0.0}]}
    scene, urdf, home = on_carriage({**plain, **obstacles})
    tracker = Tracker(load_scene(scene, urdf=urdf))
    home["pitch"] += nudge
    return [
        tracker.arrive({**home, "x": part * np.cos(angle), "y": part * np.sin(angle)})["cable"]
        for part in (0.0, first, 0.05)
    ]


def test_it_turns_at_once_however_small_the_first_step() -> None:
    """It was lost where the first step was of 4e-6, and took hundreds of iterations where it was larger.

    Where it comes to depends on the direction alone, and turns with that.
    """
    forces = []
    for angle in (0.3, 2.0, 4.5):
        for first in (1e-7, 1e-4, 1e-2):
            found = led_aside(first, angle)
            assert {one.status for one in found} <= {Status.CONVERGED, Status.SNAPPED}, found[1].message
            assert found[1].iterations <= 70
            turned = np.cos(angle) + 1j * np.sin(angle)
            across = complex(*found[2].end_wrench[:2]) / turned
            forces.append([across.real, across.imag, found[2].end_wrench[2]])
    np.testing.assert_allclose(forces, [forces[0]] * len(forces), atol=1e-4 * abs(forces[0][2]))
