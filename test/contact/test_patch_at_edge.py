# SPDX-License-Identifier: Apache-2.0
"""A patch that comes to an edge of its obstacle: the cable bends over it, and comes back."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from one_joint import RADIUS, lying, moved

from cable_ros import Equilibrium, Status, Tracker, load_scene

EDGE = 0.0
URDF = moved("z", "prismatic", (0, 0, 1))
SCENE: dict[str, Any] = {
    "gravity": [0, 0, -9.81],
    "obstacles": [{"name": "table", "box": {"center": [-1, 0, -0.5], "size": [2, 1, 1]}}],
    "cables": [lying({"position": [-0.5, 0, RADIUS]}, {"link": "body", "position": [0.47, 0, 0]})],
}
HIGH, LOW = 0.12, -0.05


def lowered(steps: int) -> list[Equilibrium]:
    """Down and up again, in so many steps each."""
    tracker = Tracker(load_scene(SCENE, urdf=URDF), tolerance=1e-6)
    down = np.linspace(HIGH, LOW, steps + 1)
    return [tracker.solve({"z": float(z)})["cable"] for z in (*down, *down[-2::-1])]


@pytest.mark.parametrize("steps", [1, 2, 8, 32])
def test_there_and_back(steps: int) -> None:
    path, few = lowered(steps), lowered(1)
    assert all(one.status is Status.CONVERGED for one in path)
    for one, other in ((path[0], path[-1]), (path[0], few[0]), (path[steps], few[1])):
        # both within the tolerance
        size = float(np.linalg.norm(other.end_wrench))
        assert float(np.abs(one.end_wrench - other.end_wrench).max()) < 2e-6 * size


def test_a_set_that_has_just_changed_is_not_given_up() -> None:
    """The first iteration after a change may be longer than the one before it: 209 iterations became 18."""
    assert max(one.iterations for one in lowered(32)[1:]) < 60


def test_the_contact_changes_at_the_edge() -> None:
    """Held high the cable lifts off before the edge; low it bends over it, and lies up to short of it."""
    path = lowered(16)
    ends = [sorted(c.position[0] for c in one.contacts if c.length == 0.0) for one in (path[0], path[16])]
    assert len(ends[0]) == 1
    assert ends[0][0] < EDGE
    assert len(ends[1]) == 2
    assert ends[1][0] < EDGE <= ends[1][1] < EDGE + RADIUS


def test_beside_an_edge_it_stands_off_as_a_beam_does() -> None:
    """Its deflection is that of a beam under its weight: a quarter of that is at the end of the patch."""
    (cable,) = SCENE["cables"]
    weight, bent = 9.81 * cable["linear_density"], 0
    for one in lowered(64)[:65]:
        ends = [c for c in one.contacts if c.length == 0.0]
        if len(ends) == 2:
            inner, outer = sorted(ends, key=lambda c: c.arc_length)
            off = outer.arc_length - inner.arc_length
            # its tension straightens it, by a thirtieth of F off^2 / EI at the most
            pulled = float(np.linalg.norm(one.end_wrench[:3])) * off**2 / cable["stiffness"][0]
            assert -1e-4 < inner.normal_force / (0.25 * weight * off) - 1.0 < pulled / 30.0 + 1e-4
            bent += 1
    assert bent > 10


def test_what_stands_off_is_not_missed_as_long_as_the_edge_holds_the_patch() -> None:
    """From the first contact with the edge on, at 1e-4 until the slope of what stands off counts."""
    heights = np.linspace(0.06, 0.055, 41)
    rough, exact = (
        [tracker.solve({"z": float(z)})["cable"] for z in heights]
        for tracker in (Tracker(load_scene(SCENE, urdf=URDF), tolerance=t) for t in (1e-4, 1e-8))
    )
    points = [[sum(c.length == 0.0 for c in one.contacts) for one in path] for path in (rough, exact)]
    assert points[0][0] == points[1][0] == 1
    assert points[0][-1] == points[1][-1] == 2
    for one, other in zip(rough, exact, strict=True):
        assert one.status is other.status is Status.CONVERGED
        # what is left out must be well below the tolerance, as its estimated error does not tell of it
        off = float(np.abs(one.end_wrench - other.end_wrench).max())
        assert off < 1e-6 * float(np.linalg.norm(other.end_wrench))
