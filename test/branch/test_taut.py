# SPDX-License-Identifier: Apache-2.0
"""A cable that a moving obstacle pulls taut: its branch ends there, and it is the same on the way back."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from cable_ros import Equilibrium, Status, Tracker, load_scene
from cable_ros.bench.cases import case_scene, joint_values
from cable_ros.bench.drawn import drawn_case
from cable_ros.branch.failed_step import taut_at
from cable_ros.contact.distance import AXES, CAPSULE, CENTRE, DIMENSIONS, SHAPE, SPHERE, WIDTH
from cable_ros.contact.shortest_path import gets_taut
from cable_ros.scene.kinematics import Kinematics

LENGTH, SPAN, HEIGHT, RADIUS = 1.0, 0.35, 0.1, 0.205
"""Of the cable; half the distance of its clamps and their height; of the drum, the cable's own counted: m."""
STEP = 0.004
"""Of the drum, m."""

URDF = """<robot name="r"><link name="ground"/><link name="lift"/>
<joint name="up" type="prismatic"><parent link="ground"/><child link="lift"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


def drum(friction: float) -> Tracker:
    """A weightless cable over a drum that `up` lifts, m."""
    obstacle = {
        "name": "drum",
        "link": "lift",
        "capsule": {"start": [0.0, -0.5, 0.0], "end": [0.0, 0.5, 0.0], "radius": 0.2},
        "friction": friction,
    }
    cable = {
        "name": "cable",
        "length": LENGTH,
        "stiffness": [0.1, 0.1, 0.075],
        "outer_diameter": 0.01,
        "linear_density": 0.0,
        "start": {"position": [-SPAN, 0.0, HEIGHT], "orientation": [0.0, 0.0, 0.0, 1.0]},
        "end": {"link": "ground", "position": [SPAN, 0.0, HEIGHT], "orientation": [0.0, 0.0, 0.0, 1.0]},
    }
    scene = {"gravity": [0.0, 0.0, -9.80665], "obstacles": [obstacle], "cables": [cable]}
    return Tracker(load_scene(scene, urdf=URDF), tolerance=1e-4)


def shortest(up: float) -> float:
    """Length, m, of the shortest path over the drum: two tangents and an arc."""
    distance = np.hypot(SPAN, up - HEIGHT)
    arc = np.arccos((HEIGHT - up) / distance) - np.arccos(RADIUS / distance)
    return float(2.0 * (np.sqrt(distance**2 - RADIUS**2) + RADIUS * arc))


def lifted(tracker: Tracker, heights: np.ndarray) -> list[Equilibrium]:
    return [tracker.arrive({"up": float(up)})["cable"] for up in heights]


@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_drum_pulls_it_taut(friction: float) -> None:
    """It ends where the shortest path over the drum, an independent bound, is as long as the cable."""
    taut = float(brentq(lambda up: shortest(up) - LENGTH, 0.0, 0.4))
    tracker = drum(friction)
    heights = taut + STEP * np.arange(-50, 5)
    found = lifted(tracker, heights)
    # a step before, its force is 4e4 EI / L^2, and friction on a grid of contacts is known to a fifth only
    assert all(one.status.trusted for one in found[: 47 if friction else 49])
    for one in found[51:]:
        assert one.status is Status.NOT_CONVERGED
        assert "taut around obstacle 'drum'" in one.message
        assert np.isnan(one.end_wrench).all()
    back = lifted(tracker, heights[30:][::-1])[-1:9:-1]
    assert not tracker._tracked_cables[0].lost
    if not friction:
        assert all(one.status is Status.CONVERGED for one in back)
        assert max(map(force_error, back, found[30:45])) < 1e-4  # the tolerance


def force_error(one: Equilibrium, other: Equilibrium) -> float:
    """Relative difference of their end forces."""
    difference = np.linalg.norm(one.end_wrench[:3] - other.end_wrench[:3])
    return float(difference / np.linalg.norm(other.end_wrench[:3]))


def test_what_friction_holds_off_its_shortest_path_is_not_said_to_be_taut() -> None:
    """Two rough beams (drawn 116:36) pull on a cable beside the plane in which the shortest path lies.

    Friction alone bounds how far they can be raised: the shortest path, two tangents, two arcs about the
    outer edges and the straight line between, is shorter than the cable.
    """
    case = drawn_case(116, 36, 1e-4)
    scene = case_scene(case)
    (cable,) = scene.cables
    tracker = Tracker(scene, tolerance=case.tolerance)
    kinematics = Kinematics(scene)
    found = [tracker.arrive(joints)["cable"] for joints in case.path[:3]]
    start = kinematics.poses(joint_values(kinematics, case.path[2]))[0, 0]
    lift = kinematics.obstacle_poses(joint_values(kinematics, case.path[2]))[0, 2]
    centre, size = scene.obstacles[0].shape.center, scene.obstacles[0].shape.size
    edge = np.array([centre[0] - 0.5 * size[0], centre[2] + 0.5 * size[2] + lift])
    to = edge - start[[0, 2]]
    apart, rise = np.hypot(*to), np.arctan2(to[1], to[0])
    angle = rise + np.arcsin(cable.radius / apart)  # of the tangent, from the flat line between the edges
    path = 2.0 * (np.sqrt(apart**2 - cable.radius**2) + cable.radius * angle - edge[0])
    assert found[1].status.trusted
    assert 5e-4 < cable.length - path < 2e-3
    assert found[2].status is Status.NOT_CONVERGED
    assert "is taut" not in found[2].message
    assert np.isnan(found[2].end_wrench).all()


def test_it_is_led_back_where_newtons_method_goes_astray() -> None:
    """A drum is pushed up under a weightless cable, and down again: a pose on the way back failed."""
    case = drawn_case(172, 232, 1e-4)
    tracker = Tracker(case_scene(case))
    found = [tracker.arrive(joints)["cable"] for joints in case.path]
    assert "taut" in found[2].message
    assert {one.status for one in found[:2] + found[9:]} == {Status.CONVERGED}
    assert force_error(found[10], found[0]) < 1e-4  # the tolerance


def test_it_is_taut_where_a_coarse_mesh_has_slack() -> None:
    """Under a roller (drawn 153:10) the cable is drawn taut within a pose, its force up 800 times."""
    case = drawn_case(153, 10, 1e-4, "rollers")
    tracker = Tracker(case_scene(case), tolerance=case.tolerance)
    out = [tracker.arrive(joints)["cable"] for joints in case.path[:10]]
    back = [tracker.arrive(joints)["cable"] for joints in case.path[8::-1]][::-1]
    for there, here in zip(out[:8], back[:8], strict=True):
        assert there.status is here.status is Status.CONVERGED
        size = float(np.linalg.norm(there.end_wrench))
        # each is within the tolerance
        assert float(np.abs(there.end_wrench - here.end_wrench).max()) < 2e-4 * size
    assert np.linalg.norm(out[7].end_wrench) > 100.0 * np.linalg.norm(out[6].end_wrench)
    for found in (out[8], out[9], back[8]):
        assert "is taut" in found.message


def over(shape: float, axes: np.ndarray, up: float) -> bool:
    """Whether a string over a drum or a ball gets taut as it rises to `up`, m, past where a planar one is."""
    taut = float(brentq(lambda up: shortest(up) - LENGTH, 0.0, 0.4))
    x = np.linspace(0.0, 1.0, 101)
    string = np.column_stack([2.0 * SPAN * x, np.zeros(101), 0.48 * np.sin(np.pi * x)])
    obstacle = np.zeros(WIDTH)
    obstacle[SHAPE], obstacle[AXES:DIMENSIONS] = shape, axes
    obstacle[DIMENSIONS : DIMENSIONS + 2] = RADIUS, 1.0

    def there(t: float) -> tuple[np.ndarray, np.ndarray]:
        moved = obstacle.copy()
        moved[CENTRE : CENTRE + 3] = SPAN, 0.0, taut + up - 0.02 * (1.0 - t) - HEIGHT
        return np.array([2.0 * SPAN, 0.0, 0.0]), moved[None]

    assert abs(shortest(taut + up) - LENGTH) > 5e-4
    assert (shortest(taut + up) > LENGTH) == (up > 0.0)
    return bool(gets_taut(string, there, 0.02, LENGTH))


@pytest.mark.parametrize("up", [-0.02, -0.001, 0.001, 0.01])
def test_a_string_over_a_drum_gets_longer_than_the_cable(up: float) -> None:
    """It does as soon as the shortest path over the drum, an independent bound, does."""
    across = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0])
    assert over(CAPSULE, across, up) == (up > 0.0)


def test_a_string_over_the_top_of_a_ball_is_not_taut() -> None:
    """In the plane of symmetry it is longer than the cable, but any string slides off sideways."""
    assert not over(SPHERE, np.eye(3).ravel(), 0.01)


def test_the_end_is_extrapolated() -> None:
    """The force to the power -1/2 is linear in what is left of the slack."""
    forces = [(at, 4e2 / (0.8 - at) ** 2) for at in (0.2, 0.5)]
    assert taut_at(forces) == pytest.approx(0.8)
    assert taut_at(forces[::-1]) == np.inf
    assert taut_at(forces[:1]) == np.inf
