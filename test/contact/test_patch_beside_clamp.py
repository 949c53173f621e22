# SPDX-License-Identifier: Apache-2.0
"""A twisted cable led aside on the ground, whose contact comes near the clamp: a patch, not a point."""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros import Tracker
from cable_ros.bench.cases import case_scene
from cable_ros.bench.drawn import drawn_case, refined


@pytest.mark.parametrize("parts", [1, 4])
def test_the_clamp_beside_a_patch_has_the_force_of_balance(parts: int) -> None:
    """Flat on a plane M' + t x F = 0 asks for the force M_t M_n / EI across it: the moments tell it."""
    case = drawn_case(116, 106, 1e-4)
    scene = case_scene(case)
    (cable,) = scene.cables
    tracker = Tracker(scene, tolerance=1e-4)
    looked = 0
    for i, joints in enumerate(refined(case.path, parts)[: 32 * parts + 1]):
        found = tracker.solve(joints)["cable"]
        if i < 17 * parts:
            continue
        force, moment = found.end_wrench[:3], found.end_wrench[3:]
        assert found.status.trusted
        across = -moment[0] * moment[2] / cable.stiffness[0]
        assert abs(force[0] - across) < 1e-4 * np.linalg.norm(force)
        looked += 1
    assert looked == 15 * parts + 1


def test_a_rough_patch_ends_in_the_clamp_that_it_runs_into() -> None:
    """A lift led aside comes off the ground: its patch shrinks towards the clamp, and is gone there."""
    case, ends = drawn_case(101, 2, 1e-4), []
    for parts in (1, 2):
        tracker = Tracker(case_scene(case), tolerance=1e-4)
        found = [tracker.arrive(joints)["cable"] for joints in refined(case.path[:19], parts)]
        assert all(one.status.trusted for one in found)
        assert found[-2 * parts].contacts
        assert not found[-1].contacts
        ends.append(found[-1].end_wrench)
    assert np.linalg.norm(ends[1] - ends[0]) < 1e-3 * np.linalg.norm(ends[0])
