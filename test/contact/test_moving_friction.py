# SPDX-License-Identifier: Apache-2.0
"""Friction where contact moves along the cable: its tangent is complete if Newton's method converges fast.

The end of a patch presses at a point that the iteration moves. Its friction goes with it, and how far the
cable has slipped there depends on where that is if the cable has turned in the step. Without both, the
iteration converged linearly, by a factor of 0.66, or not at all.
"""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros import Tracker
from cable_ros.bench.cases import case_scene
from cable_ros.bench.drawn import drawn_case, refined
from cable_ros.contact.active_set_rod import ActiveSetRod
from cable_ros.contact.distance import CENTRE
from cable_ros.contact.points import FIRST, FORCE, KIND, SLIPS
from cable_ros.rod import warm_step

LOOSE, TIGHT = 1e-4, 1e-10
"""Last rotation of the iteration, rad, or change of a force over the end force."""
MORE = 3
"""Iterations from one to the other at a quadratic rate, 1e-4, 1e-8, 1e-16, and one that only looks."""


@pytest.mark.parametrize("poses", [12, 14])
@pytest.mark.parametrize("distance", [1e-4, 3e-4])
def test_the_ends_of_a_patch_slip_and_converge_quadratically(poses: int, distance: float) -> None:
    case = drawn_case(173, 318, 1e-4)
    tracker = Tracker(case_scene(case))
    for joints in refined(case.path, 4)[:poses]:
        tracker.arrive(joints)
    (cable,) = tracker._tracked_cables
    rod = cable.rod
    assert isinstance(rod, ActiveSetRod)
    assert rod.obstacles is not None
    ends = rod.points[: rod.count][rod.points[: rod.count, KIND] >= FIRST]
    assert len(ends) == 2
    assert (ends[:, SLIPS] == 1.0).all()
    assert ends[:, FORCE].min() > 40.0
    rod.work, obstacles, iterations = np.inf, rod.obstacles.copy(), []
    obstacles[0, CENTRE + 1] += distance
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
    assert iterations[1] - iterations[0] <= MORE
