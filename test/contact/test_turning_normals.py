# SPDX-License-Identifier: Apache-2.0
"""Forces at edges: an iteration that hardly moves the cable turns them, and the start wrench with them."""

from __future__ import annotations

import numpy as np

from cable_ros import Tracker
from cable_ros.bench.cases import case_scene
from cable_ros.bench.drawn import drawn_case

POSES = 55
"""Of a heavy cable over the two edges of a smooth beam, which are moved up."""


def test_both_end_wrenches_of_a_cable_over_edges_meet_the_tolerance() -> None:
    """In one pose of these the start force was 1e-3 off, ten tolerances, after one iteration."""
    case = drawn_case(175, 939, 1e-4)
    usual, fine = (Tracker(case_scene(case), tolerance=tolerance) for tolerance in (1e-4, 1e-7))
    for joints in case.path[:POSES]:
        one, other = (tracker.arrive(joints)["cable"] for tracker in (usual, fine))
        for here, there in ((one.start_wrench, other.start_wrench), (one.end_wrench, other.end_wrench)):
            assert np.linalg.norm(here[:3] - there[:3]) < case.tolerance * np.linalg.norm(there[:3])
