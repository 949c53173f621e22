# SPDX-License-Identifier: Apache-2.0
"""A cable that a moving obstacle pulls taut: its branch ends there, and it is the same on the way back."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from cable_ros import Equilibrium, Status, Tracker, load_scene
from cable_ros.branch.continuation import _taut_at

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


def test_the_end_is_extrapolated() -> None:
    """The force to the power -1/2 is linear in what is left of the slack."""
    forces = [(at, 4e2 / (0.8 - at) ** 2) for at in (0.2, 0.5)]
    assert _taut_at(forces) == pytest.approx(0.8)
    assert _taut_at(forces[::-1]) == np.inf
    assert _taut_at(forces[:1]) == np.inf
