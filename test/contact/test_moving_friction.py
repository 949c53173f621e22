# SPDX-License-Identifier: Apache-2.0
"""Friction where contact moves along the cable: its tangent is complete if Newton's method converges fast.

The end of a patch presses at a point that the iteration moves. Its friction goes with it, and how far the
cable has slipped there depends on where that is if the cable has turned in the step. Where the surface is
curved friction turns with the normal as well. Without, the iteration converged linearly, by a factor of 0.66,
or not at all.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from cable_ros import Tracker
from cable_ros.bench.cases import Case, Pose, case_scene
from cable_ros.bench.drawn import drawn_case, refined
from cable_ros.branch.cable_tracker import CableTracker
from cable_ros.contact.active_set_rod import ActiveSetRod
from cable_ros.contact.distance import CENTRE
from cable_ros.contact.points import FIRST, FORCE, FRICTION, KIND, POINT, SLIPS
from cable_ros.rod import warm_step

LOOSE, TIGHT = 1e-4, 1e-10
"""Last rotation of the iteration, rad, or change of a force over the end force."""
MORE = 3
"""Iterations from one to the other at a quadratic rate, 1e-4, 1e-8, 1e-16, and one that only looks."""


@pytest.mark.parametrize("poses", [12, 14])
@pytest.mark.parametrize("distance", [1e-4, 3e-4])
def test_the_ends_of_a_patch_slip_and_converge_quadratically(poses: int, distance: float) -> None:
    case = drawn_case(173, 318, 1e-4)
    cable = _led_along(case, refined(case.path, 4)[:poses])
    ends = cable.rod.points[: cable.rod.count]
    ends = ends[ends[:, KIND] >= FIRST]
    assert len(ends) == 2
    assert (ends[:, SLIPS] == 1.0).all()
    assert ends[:, FORCE].min() > 40.0
    assert _more_iterations(cable, np.array([0.0, distance, 0.0])) <= MORE


@pytest.mark.parametrize("slips", [False, True])
@pytest.mark.parametrize("distance", [3e-5, 1e-4])
def test_a_point_on_a_small_ball_converges_quadratically(slips: bool, distance: float) -> None:
    """Where it moves over the ball its friction turns, to stay across the normal: it took 13 iterations."""
    case = drawn_case(189, 671, 1e-4)
    cable = _led_along(case, refined(case.path, 40)[: 85 if slips else 84])
    (point,) = cable.rod.points[: cable.rod.count]
    assert point[KIND] == POINT
    assert point[SLIPS] == slips
    assert np.linalg.norm(point[FRICTION : FRICTION + 3]) > 13.0
    assert _more_iterations(cable, np.array([-distance, 0.0, 0.0])) <= MORE


def _led_along(case: Case, path: Sequence[Pose]) -> CableTracker:
    tracker = Tracker(case_scene(case))
    for joints in path:
        tracker.arrive(joints)
    (cable,) = tracker._tracked_cables
    assert isinstance(cable.rod, ActiveSetRod)
    assert cable.rod.obstacles is not None
    return cable


def _more_iterations(cable: CableTracker, motion: np.ndarray) -> int:
    """Iterations from LOOSE to TIGHT if its obstacle moves so far, in a step of its own."""
    rod, iterations = cable.rod, []
    rod.work, obstacles = np.inf, rod.obstacles.copy()
    obstacles[0, CENTRE : CENTRE + 3] += motion
    for tolerance in (LOOSE, TIGHT):
        put_back = rod.kept()
        rod.refactor_at = 0.0  # Newton's method, not with the factors of an earlier shape
        code, count, _, _ = rod.step_in_contact(
            cable.q, cable.end_force, rod.qe, rod.re, rod.f, tolerance, 0.6, obstacles, remesh=False
        )
        assert code == warm_step.ADVANCED
        iterations.append(count)
        put_back()
        rod.refactor(cable.q, cable.end_force)
    return iterations[1] - iterations[0]
