# SPDX-License-Identifier: Apache-2.0
"""Drawn scenes: always the same, possible, and judged by what came before."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cable_ros import Equilibrium, Status
from cable_ros.bench import drawn_judge
from cable_ros.bench.cases import Case, answered, case_scene
from cable_ros.bench.drawn import divided, drawn_case, refined
from cable_ros.bench.drawn_judge import friction_faults, run_drawn
from cable_ros.bench.drawn_scenes import KINDS
from cable_ros.bench.drawn_table import ALL, HEAD, count, kind, lines
from cable_ros.bench.metamorphic import (
    Rounded,
    Stepped,
    at_rate,
    corners,
    follow,
    in_states,
    nudged,
    step_all,
    tellings,
)
from cable_ros.cli.main import main
from cable_ros.scene.kinematics import Kinematics
from cable_ros.tracker import Tracker


def drawn(begins: str, friction: bool, most: int = 11, seed: int = 1) -> Case:
    """The first drawn case of a kind with few poses."""
    return next(
        case
        for case in (drawn_case(seed, i, 1e-4, begins) for i in range(1000))
        if len(case.path) <= most and ("friction 0:" not in case.expected) == friction
    )


def test_a_drawn_case_is_always_the_same() -> None:
    for index in range(20):
        one, again = drawn_case(5, index, 1e-4), drawn_case(5, index, 1e-4)
        assert (one.scene, one.path, one.urdf) == (again.scene, again.path, again.urdf)
    assert drawn_case(5, 2, 1e-4).scene != drawn_case(6, 2, 1e-4).scene


def test_paths_come_back() -> None:
    for index in range(40):
        path = drawn_case(5, index, 1e-4).path
        assert 3 <= len(path) <= 210
        assert path[0] == path[-1]


def test_most_drawn_cables_touch_something() -> None:
    """Not all: a cable that would be inside an obstacle if it were alone may have a way round it."""
    touching = 0
    for kind_of in KINDS:
        case = drawn(kind_of, friction=False, most=16)
        tracker = Tracker(case_scene(case), tolerance=1e-2)
        touching += any(tracker.solve(pose)["cable"].contacts for pose in case.path)
    assert touching >= 10


def test_a_finer_path_goes_through_the_same_poses() -> None:
    case = drawn("hose", friction=True, most=40)
    assert refined(case.path, 4)[::4] == tuple(case.path)
    again = divided(corners(case), len(case.path))
    assert [list(pose) for pose in again] == [list(pose) for pose in case.path]
    values = [[list(pose.values()) for pose in path] for path in (again, case.path)]
    assert values[0] == pytest.approx(np.array(values[1]), abs=1e-12)
    for path in (in_states(corners(case), 8), at_rate(corners(case), 50.0, 0.2)):
        assert path[0] == case.path[0]
        assert path[-1] == case.path[-1]
        assert all(corner in path for corner in corners(case))


def test_a_frictionless_table_is_verified_and_the_same_when_told_more_finely() -> None:
    one = run_drawn(drawn("table", friction=False))
    assert one.raised is None
    assert [kind(pose) for pose in one.poses] == ["verified"] * len(one.poses)
    assert lines(one) == []
    counts = count([one])
    assert counts[ALL].good
    assert len(counts[ALL].row(ALL)) == len(HEAD)


def test_friction_that_cannot_have_come_of_the_step_is_found() -> None:
    case = drawn("hose", friction=True)
    scene = case_scene(case)
    tracker, kinematics = Tracker(scene, polyline_points=401), Kinematics(scene)
    before = case.path[0]
    found = answered(tracker, before)[0]["cable"]
    assert found.contacts
    length = scene.cables[0].length
    far = {**before, "across": before["across"] + 0.01 * length}

    def fault(**said: Any) -> str:
        """Of an answer that is told again after the ground has gone away under it."""
        contacts = tuple(replace(contact, **said) for contact in found.contacts)
        told = replace(found, _touching=lambda: SimpleNamespace(contacts=lambda: contacts))
        assert not friction_faults(scene, kinematics, (found, before), (told, before))
        faults = friction_faults(scene, kinematics, (found, before), (told, far))
        return faults[0][1] if faults else ""

    assert "said to stick" in fault(sliding=False)
    largest = max(contact.normal_force for contact in found.contacts)
    up, ahead = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
    assert "the way its friction pushes" in fault(sliding=True, force=largest * (up - 0.1 * ahead))
    assert fault(sliding=True, force=largest * (up + 0.1 * ahead)) == ""


@pytest.mark.parametrize("sticks", [False, True])
@pytest.mark.parametrize("amiss", ["", "parts", "corner", "stick", "wrench", "lost"])
def test_a_step_is_cleared_by_its_parts_if_they_end_in_the_same(
    amiss: str, sticks: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of two steps at fault there is something `amiss` with the second's parts."""
    case = drawn("hose", friction=True)
    scene = case_scene(case)
    tracker, kinematics = Tracker(scene, polyline_points=401), Kinematics(scene)
    found = answered(tracker, case.path[0])[0]["cable"]

    def answer(sliding: bool, **said: Any) -> Equilibrium:
        contacts = tuple(replace(contact, sliding=sliding) for contact in found.contacts)
        return replace(found, _touching=lambda: SimpleNamespace(contacts=lambda: contacts), **said)

    told = answer(not sticks)

    def faults(scene: Any, kinematics: Any, before: Any, after: Any, still: float = 1.0) -> list[Any]:
        """In both steps of the path, and perhaps in the second's last part; only a little at a corner."""
        last = bool(way) and after[1] is way[-1]
        there = (amiss == "parts" or (amiss == "corner" and still < 1.0)) if last else not way
        return [(told.contacts[0], "amiss")] if there else []

    def solve(case: Any, scene: Any, path: Any) -> tuple[list[Equilibrium], list[float]]:
        way[:] = path
        solved = [told] * len(path)
        if amiss == "stick":
            solved[-1] = answer(sticks)
        elif amiss == "wrench":
            solved[-1] = answer(not sticks, end_wrench=1.02 * found.end_wrench)
        elif amiss == "lost":
            solved[-2] = answer(not sticks, status=Status.BRANCH_LOST)
        return solved, []

    way: list[Any] = []
    monkeypatch.setattr(drawn_judge, "friction_faults", faults)
    monkeypatch.setattr(drawn_judge, "_solve", solve)
    steps = drawn_judge._step_faults(case, scene, kinematics, [told] * 3, case.path[:3])
    cleared = amiss in ("", "corner") or (amiss == "stick" and not sticks)
    assert steps == [None, None if cleared else "amiss"]


def test_slip_that_turns_back_within_a_step_is_no_fault() -> None:
    """The point about which the cable turns on the ground goes along it: 3e-4 L the way friction pushes."""
    case = drawn_case(136, 40, 1e-4)
    path = refined(case.path[:7], 4)
    scene = case_scene(case)
    kinematics = Kinematics(scene)
    answers, _ = drawn_judge._solve(case, scene, path)
    steps = pairwise(zip(answers, path, strict=True))
    assert any(friction_faults(scene, kinematics, *step) for step in steps)
    assert not any(drawn_judge._step_faults(case, scene, kinematics, answers, path))


def test_the_last_bits_and_the_number_of_states_do_not_matter() -> None:
    case = drawn("slot", friction=False)
    rounded = Rounded()
    rounded.add(case, 3)
    assert rounded.lines == []
    assert rounded.share == 1.0
    assert nudged(case, 3).path != case.path
    counts: dict[str, Stepped] = {}
    ways = tellings((2, 8), (50,), seconds=0.2)
    assert step_all(case, corners(case), ways, counts) == []
    assert list(counts) == ["2 states", "8 states", "50 Hz"]
    assert follow(case).lost is None


def test_one_drawn_case_from_the_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    index = drawn("table", friction=False).name.split()[1]
    assert main(["bench", "robustness", "--seed", "1", "--only", f"drawn:{index}"]) == 0
    assert capsys.readouterr().out.rstrip().endswith("verified")
