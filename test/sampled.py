# SPDX-License-Identifier: Apache-2.0
"""Tests of many scenes against a slow reference, of which `make test` runs some: it has half an hour.

`make test-all` runs every one. Most of what is left out differs from what is run by numbers alone; two tests,
and the page that adds an obstacle, are left out whole.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import pytest

HALF, THIRD, FIRST, NONE = slice(None, None, 2), slice(None, None, 3), slice(1), slice(0)
SAMPLED = {
    "branch/test_contact_modes.py::test_frequencies_are_those_of_the_energy_differentiated": HALF,
    "branch/test_supported_modes.py::test_frequencies_are_those_of_the_energy_differentiated": HALF,
    "contact/test_nodal_estimate.py::test_the_estimate_covers_the_error_where_it_lies": slice(2),
    "contact/test_nodal_response.py::test_what_sticks": HALF,
    "log/test_hostile.py::test_recovery_leaves_bombs_out": THIRD,
    "references/test_free_boundary.py::test_shooting_and_collocation_agree_with_friction": HALF,
    "ros/test_node_starts_and_stops.py::test_what_it_cannot_start_with_is_one_sentence": HALF,
    "scene/test_meshes.py::test_a_meshed_capsule_is_that_capsule": FIRST,
    "test_batch_scale.py::test_processes_give_the_same_bits": FIRST,
    "test_cable_friction.py::test_the_same_path_in_other_steps": NONE,
    "test_cable_friction.py::test_two_contacts_in_other_steps": HALF,
    "test_compilation.py::test_files_cut_short_are_replaced": HALF,
    "test_compilation.py::test_the_same_interpreted_meanwhile_and_compiled_after": NONE,
    "test_crossing.py::test_agrees_with_shooting": THIRD,
    "test_ends.py::test_wrenches_meet_an_independent_shooting_solution": HALF,
    "test_hanging_ends.py::test_found_cold_on_the_ground_it_is_as_it_is_led_there": THIRD,
    "test_hanging_ends.py::test_lowered_to_the_ground_it_buckles_at_its_critical_load": THIRD,
    "test_rough_free_ends.py::test_it_goes_as_a_discrete_rod_does_along_the_whole_path": slice(1, None, 2),
    "test_rough_free_ends.py::test_its_mirror_image_is_its_image": FIRST,
    "test_rough_free_ends.py::test_the_ground_may_move_instead": FIRST,
    "test_rough_supports.py::test_the_path_may_be_told_in_other_steps": HALF,
    "test_rough_wrist.py::test_the_hose_rubs_on_the_links_however_closely_its_path_is_told": FIRST,
    "test_rough_wrist.py::test_the_hose_slips_off_the_links_with_its_friction": FIRST,
    "test_self_contact.py::test_agrees_with_shooting": HALF,
    "test_stretched_ends.py::test_a_ball_that_pushes_is_that_of_shooting": THIRD,
    "test_stretched_ends.py::test_the_error_estimate_bounds_the_error": HALF,
    "test_stretched_ends.py::test_wrenches_meet_an_independent_shooting_solution": HALF,
    "test_supports.py::test_ends_of_any_kind_go_with_supports": HALF,
    "test_supports.py::test_friction_is_that_of_shooting_where_it_slides_and_where_it_sticks": HALF,
    "test_supports.py::test_wrenches_are_those_of_shooting_over_the_whole_cable": THIRD,
    "test_told_finer.py::test_the_same_told_in_more_poses": HALF,
    "test_touching_ends.py::test_a_cable_read_from_its_other_end_is_the_same": HALF,
    "test_touching_ends.py::test_a_rigid_motion_of_everything_changes_no_wrench": HALF,
    "test_touching_ends.py::test_its_mirror_image_has_mirrored_wrenches": HALF,
    "test_touching_ends.py::test_a_ball_that_pushes_is_that_of_shooting": THIRD,
    "test_touching_ends.py::test_the_error_estimate_bounds_the_error": HALF,
    "test_worked_examples.py::test_what_a_page_adds_works": slice(2),
    "test_zoo_supports.py::test_it_is_that_of_shooting": THIRD,
    "test_zoo_touching_ends.py::test_nothing_of_it_is_inside_of_an_obstacle": HALF,
    "test_zoo_touching_ends.py::test_the_twelfth_digit_of_a_joint_hardly_matters": HALF,
    "test_zoo_touching_ends.py::test_there_and_back_it_is_as_before": HALF,
    "test_zoo_touching_ends.py::test_two_eight_or_sixteen_steps_lead_to_one_answer": HALF,
}
"""Which parameter sets of a test are run."""


def sampled(items: Sequence[pytest.Item]) -> tuple[list[pytest.Item], list[pytest.Item]]:
    """Those that are run, and those that are left out."""
    names = [item.nodeid.split("[")[0].removeprefix("test/") for item in items]
    counts, place = Counter(names), Counter[str]()
    run: list[pytest.Item] = []
    left: list[pytest.Item] = []
    for name, item in zip(names, items, strict=True):
        # one that is asked for alone is run
        every = range(counts[name])[SAMPLED.get(name, slice(None))] if len(items) > 1 else range(1)
        (run if place[name] in every else left).append(item)
        place[name] += 1
    return run, left
