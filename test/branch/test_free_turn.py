# SPDX-License-Identifier: Apache-2.0
"""Where a round weightless cable turns to, which is free to turn until an end moves."""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros import Equilibrium, Status, Tracker, load_scene
from cable_ros.bench.carriage import on_carriage
from cable_ros.branch.cold_start import Conditions, Found, equilibria
from cable_ros.branch.free_turn import place_to_turn_to
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


def led_aside(first: float, angle: float) -> list[Equilibrium]:
    """A cable that is free to turn, whose end is led aside by `first`, then by 0.05 lengths, at an angle."""
    end = {"position": [0.0, 0.0, 0.6], "orientation": [0.0, 0.0, np.sin(0.6), np.cos(0.6)]}
    plane = {"point": [0.0, 0.0, -9.0], "normal": [0.0, 0.0, 1.0]}
    cable = {
        "name": "cable", "length": 1.0, "stiffness": [1.0, 1.0, 0.75], "linear_density": 0.0,
        "start": {"position": [0.0, 0.0, 0.0], "rpy": [0.0, 0.0, 0.0]}, "end": end,
    }  # fmt: skip
    obstacles = [{"name": "far", "plane": plane, "friction": 0.0}]
    scene, urdf, home = on_carriage({"gravity": [0.0, 0.0, 0.0], "cables": [cable], "obstacles": obstacles})
    tracker = Tracker(load_scene(scene, urdf=urdf))
    tracker.arrive(home)
    return [
        tracker.arrive({**home, "x": part * np.cos(angle), "y": part * np.sin(angle)})["cable"]
        for part in (first, 0.05)
    ]


def test_it_turns_at_once_however_small_the_first_step() -> None:
    """It was lost where the first step was of 4e-6, and took hundreds of iterations where it was larger.

    Where it comes to depends on the direction alone, and turns with that.
    """
    forces = []
    for angle in (0.3, 2.0, 4.5):
        for first in (1e-7, 1e-4, 1e-2):
            found = led_aside(first, angle)
            assert {one.status for one in found} <= {Status.CONVERGED, Status.SNAPPED}, found[0].message
            assert found[0].iterations <= 70
            turned = np.cos(angle) + 1j * np.sin(angle)
            across = complex(*found[1].end_wrench[:2]) / turned
            forces.append([across.real, across.imag, found[1].end_wrench[2]])
    np.testing.assert_allclose(forces, [forces[0]] * len(forces), atol=1e-4 * abs(forces[0][2]))
