# SPDX-License-Identifier: Apache-2.0
"""Drawn paths told in four times as many poses: the same wrenches; each answer was verified by itself."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from cable_ros import Equilibrium, Status, Tracker, load_scene
from cable_ros.bench.cases import case_scene
from cable_ros.bench.drawn import drawn_case, refined
from cable_ros.bench.metamorphic import at_rate, corners, in_states
from cable_ros.branch import tracked_equilibrium
from cable_ros.branch.cold_start import Found
from cable_ros.branch.snap_through import SnapThrough, left_on_refining
from zoo import CASES

Key = tuple[int, int] | tuple[int, int, str]
"""Seed, index and kind of `drawn_case`."""
FINER = 4
SAME = 0.01
"""Of the wrench, or of SMALL times the path's largest: what finite steps with friction may matter."""
SMALL = 0.05


@cache
def told(key: Key, poses: int, parts: int, tolerance: float = 1e-4) -> list[Equilibrium]:
    """Answers at the first poses of a drawn case's path, which is told in `parts` as many."""
    case = drawn_case(*key[:2], tolerance, *key[2:])
    tracker, found = Tracker(case_scene(case)), []
    for joints in refined(case.path[:poses], parts):
        found.extend(tracker.arrive(joints).values())
    return found


def apart(some: list[Equilibrium], others: list[Equilibrium]) -> float:
    """Largest relative difference of two paths' end forces."""
    here, there = (np.array([one.end_wrench[:3] for one in path]) for path in (some, others))
    size = np.linalg.norm(there, axis=1)
    return float((np.linalg.norm(here - there, axis=1) / np.maximum(size, SMALL * size.max())).max())


@pytest.mark.parametrize(
    ("key", "poses"),
    [
        # without friction: what a margin that had not been renewed hid, and a descent took for the branch
        ((145, 14, "wall"), 170),
        ((145, 88, "beams"), 5),
        ((158, 133), 33),
        # falls onto edges within elements; and where a patch ends the cable touched and did not, in turn
        ((130, 55), 21),
        ((170, 325), 6),
        # a ball touches an arch, which forks as a finer mesh tells: rounding took the side, in silence
        ((175, 1179), 23),
        # what turns freely was followed on along a ridge, whose margin had been 0 twice
        ((159, 42), 5),
        ((158, 287), 3),
        # slip turns back as the force falls: it went on the way its friction pushed
        ((145, 37, "slot"), 11),
        ((146, 45, "beams"), 34),
        # a point that slipped sticks where the ball turns back, and is pulled along
        ((145, 81, "ball"), 11),
        # points that stick and roll: a cable turns over on a table, and one leaves the middle of a drum
        ((152, 15, "table"), 9),
        ((149, 17), 5),
        # slip that turns otherwise than before, or has a corner where something lands
        ((134, 13), 11),
        ((136, 24), 41),
        ((137, 1), 11),
        # points come to rest amid a step: they stick at its end, or still slip a little
        ((155, 17, "drum"), 17),
        ((155, 9, "rollers"), 9),
        # the end of a patch that does not press went to and fro, and a grid took over
        ((156, 7, "table"), 4),
        # a point becomes a short patch that slides, whose ends stuck
        ((158, 297), 54),
        # on another mesh a taut cable that lies stuck elsewhere, and one that slipped lost friction
        ((159, 740), 66),
        ((159, 74), 58),
        # a grid takes over where friction along a patch turns back
        ((156, 0, "table"), 5),
        # a symmetric branch forks: steps crossed the fork or took a side, and a fall swung to the other one
        ((167, 708), 9),
        # steps that were not judged led past a fork, and a fall from there to the other side of it
        ((173, 1570), 5),
        ((166, 524), 3),
        ((168, 143), 17),
        # against more drag a fall failed for the motion of the clamps alone
        ((159, 795), 17),
        # from a cold start, without friction, five solves take steps of 1e-7 lengths
        ((165, 163), 2),
        # a point becomes a patch that slides, which seemed to turn all of its friction
        ((175, 261), 136),
        # what comes down beside what slides began to stick
        ((175, 866), 9),
        ((175, 1335), 16),
        # where friction turns back steps took eighty iterations in vain, and a grid took over
        ((173, 866), 17),
        ((177, 194), 11),
        # slip that turns along a patch lagged behind, a heavy lift was 2.1 % off; led on too far, cables that
        # turn over were 5 %
        ((177, 786), 61),
        ((164, 1871), 12),
        # in one step, which no change of the end force told to be too long, a cable turned over
        ((177, 184), 117),
        # an end of a patch that bears nothing swung, and the lift was taken to fall
        ((177, 345), 26),
        # off the top of a beam a point became a patch across the one beside it
        ((178, 131), 6),
        # there a point at an edge went across the patch beside it
        ((179, 702), 3),
        # what stuck in the middle was unstable until it slipped, and was not judged meanwhile
        ((169, 1146), 36),
        # an end of a patch where force and couple vanish
        ((179, 635), 170),
        # where a fall leads nowhere shorter steps lead on
        ((167, 570), 2),
        # a thin patch peeled off between two edges: a grid took over
        ((188, 400), 5),
    ],
)
def test_the_same_told_in_more_poses(key: Key, poses: int) -> None:
    once, finer = told(key, poses, 1), told(key, poses, FINER)
    assert all(one.status.trusted for one in once + finer)
    assert apart(once, finer[::FINER]) < SAME


def test_a_fall_as_its_mesh_is_refined_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside a fold, where the error grows, the refined mesh is past it."""
    refining = []

    def recorded(*found: Found) -> tuple[Found, SnapThrough] | None:
        refining.append(left_on_refining(*found))
        return refining[-1]

    monkeypatch.setattr(tracked_equilibrium, "left_on_refining", recorded)
    case = next(one for one in CASES if one.name == "fold: snaps through and back")
    tracker = Tracker(case_scene(case), tolerance=0.1)
    for joints in case.path[:27]:
        (found,) = tracker.arrive(joints).values()
        assert found.status is Status.CONVERGED
    for joints in refined(case.path[26:28], 1000):
        (found,) = tracker.arrive(joints).values()
        if any(refining):
            break
    assert found.status is Status.SNAPPED


def test_a_branch_of_more_energy_falls_as_well_told_in_more_poses() -> None:
    """Its refined mesh was past a fold that the coarse one was before."""
    case = drawn_case(145, 50, 1e-4, "tray")
    (cable,) = case.scene["cables"]
    scene = load_scene({**case.scene, "cables": [{**cable, "total_twist": -4.804}]}, urdf=case.urdf)
    once, finer = (
        [tracker.arrive(joints)["cable"] for joints in refined(case.path[:2], parts)]
        for tracker, parts in ((Tracker(scene), 1), (Tracker(scene), FINER))
    )
    assert once[0].energy == pytest.approx(2.26756, rel=1e-5)
    assert [Status.SNAPPED in [one.status for one in path] for path in (once, finer)] == [True, True]
    assert apart(once, finer[::FINER]) < SAME


def test_a_hose_led_back_at_250_hz_falls_and_keeps_its_friction() -> None:
    """Its small steps took a call's budget before one was short enough to try whether it falls."""
    case = drawn_case(159, 25, 1e-4)
    tracker = Tracker(case_scene(case))
    path = at_rate(corners(case), 250, 0.5)[:310]
    found = [tracker.arrive(joints)["cable"].status for joints in path]
    assert set(found) == {Status.CONVERGED, Status.SNAPPED}


@pytest.mark.parametrize(
    ("key", "rate", "poses"),
    [
        # laid flat, with a sample 8e-5 L from the clamp: it passed for unstable
        pytest.param((20, 4), 250, 251, id="a lift laid flat"),
        # a patch whose end swung beside a sample, by 0.62 of its last motion and more
        pytest.param((20, 12), 1000, 1001, id="a lift at 1 kHz"),
        # what is free to turn was lost where the first step was of 4e-6
        pytest.param((25, 9), 250, 20, id="what turns freely"),
        # a mesh that had followed contacts for 618 poses was too coarse where they came to
        pytest.param((28, 135), 1000, 640, id="another mesh"),
    ],
)
def test_smooth_scenes_at_any_rate(key: tuple[int, int], rate: float, poses: int) -> None:
    """Without friction nothing hangs on how a path is told; these were lost, near the ends of their paths."""
    case = drawn_case(*key, 1e-4)
    tracker = Tracker(case_scene(case))
    path = at_rate(corners(case), rate, 0.5)[:poses]
    found = [tracker.arrive(joints)["cable"] for joints in path][-50:]
    assert {one.status for one in found} <= {Status.CONVERGED, Status.SNAPPED}


@pytest.mark.parametrize(
    ("key", "rate"), [((28, 13), 1000), ((28, 100), 500), ((28, 198), 1000), ((30, 105), 500)]
)
def test_a_lift_laid_down_at_any_rate_lies_up_to_its_clamp(key: tuple[int, int], rate: float) -> None:
    """Many small steps left it 1e-8 lengths above the ground before the clamp, or below, up to 4 % off; or
    lost it in the last one, of 4e-7 lengths, each part of which took 25 iterations.
    """
    case = drawn_case(*key, 1e-4)
    last = []
    for path in (in_states(corners(case), 8), at_rate(corners(case), rate, 0.5)):
        tracker = Tracker(case_scene(case))
        last.append([tracker.arrive(joints)["cable"] for joints in path][-1:])
    assert {one.status for (one,) in last} == {Status.CONVERGED}
    assert apart(*last) < 1e-3


def test_what_sticks_in_a_corner_rolls_there_and_back_in_few_states() -> None:
    """It rolled by 0.03 lengths a step, whose second order stayed as friction: 1.4 % of the end force."""
    case = drawn_case(30, 73, 1e-4)
    last = []
    for states in (2, 32):
        tracker = Tracker(case_scene(case))
        last.append([tracker.arrive(joints)["cable"] for joints in in_states(corners(case), states)][-1:])
    assert not any(contact.sliding for (one,) in last for contact in one.contacts)
    assert apart(*last) < 2e-3


@pytest.mark.parametrize(
    ("key", "states"),
    [
        # beams: told in 8 states it was followed to where nothing led back
        ((20, 41), 8),
        ((20, 41), 32),
        # rollers: it needed a finer mesh on the way, and was called lost
        ((165, 761), None),
        # a drum: the steps back were too long
        ((164, 1455), None),
        # its margin is small for it is taut, and it was said to have snapped
        ((114, 4), None),
    ],
)
def test_a_taut_cable_is_led_back(key: tuple[int, int], states: int | None) -> None:
    """Smooth obstacles pull it taut, which is said, and come back."""
    case = drawn_case(*key, 1e-4)
    path = case.path if states is None else in_states(corners(case), states)
    tracker = Tracker(case_scene(case))
    found = [tracker.arrive(joints)["cable"] for joints in path]
    assert Status.NOT_CONVERGED in {one.status for one in found}
    assert "around obstacle" in next(one.message for one in found if one.status is Status.NOT_CONVERGED)
    assert found[-1].status is Status.CONVERGED
    assert found[-1].end_wrench == pytest.approx(
        found[0].end_wrench, abs=1e-4 * abs(found[0].end_wrench).max()
    )


def test_a_taut_cable_told_finely_keeps_its_branch() -> None:
    """At 1.5e5 EI / L^2 a grid took over, on which it was not stable; each call took 1 s, and it was lost."""
    found = told((189, 838), 17, FINER)
    assert Status.NOT_CONVERGED in {one.status for one in found}
    assert Status.BRANCH_LOST not in {one.status for one in found}
    assert found[-1].status is Status.CONVERGED


@pytest.mark.parametrize(("index", "rate"), [(49, 125), (66, 100)])
def test_a_taut_cable_is_led_back_at_any_rate(index: int, rate: float) -> None:
    """Its end force doubled from pose to pose, up to 4e7 EI / L^2: from there nothing led back."""
    case = drawn_case(28, index, 1e-4)
    tracker = Tracker(case_scene(case))
    found = [tracker.arrive(joints)["cable"].status for joints in at_rate(corners(case), rate, 0.5)]
    assert Status.NOT_CONVERGED in found
    assert Status.BRANCH_LOST not in found
    assert found[-1] is Status.CONVERGED


def test_a_patch_that_peels_off_between_two_edges_leaves_points_there() -> None:
    """Newton's method did not find how; a grid took over, and told in 250 Hz the path ended 3.5 % off."""
    case = drawn_case(30, 107, 1e-4)
    tracker, other = Tracker(case_scene(case)), Tracker(case_scene(case))
    found = [tracker.arrive(joints)["cable"] for joints in at_rate(corners(case), 250, 0.5)]
    twice = [other.arrive(joints)["cable"] for joints in at_rate(corners(case), 500, 0.5)]
    assert not any("grid" in one.message for one in found)
    assert {one.status for one in found} == {Status.CONVERGED}
    assert apart(found[-1:], twice[-1:]) < SAME


def test_a_patch_that_shrinks_to_the_clamp_leaves_it() -> None:
    """Its end came within 4e-7 of the clamp, with a force without bound, and the path ended there."""
    coarse, fine = (told((145, 30, "lift"), 11, 1, tolerance) for tolerance in (1e-4, 1e-6))
    assert [one.status for one in coarse].count(Status.SNAPPED) == 1
    assert all(one.status.trusted for one in coarse + fine)
    assert apart(coarse, fine) < 1e-4
