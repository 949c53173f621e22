# SPDX-License-Identifier: Apache-2.0
"""Drawn scenes: always the same, possible, and judged by what came before."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cable_ros.bench import drawn_judge
from cable_ros.bench.cases import Case, answered, case_scene
from cable_ros.bench.drawn import divided, drawn_case, refined
from cable_ros.bench.drawn_judge import friction_fault, run_drawn
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

    def fault(turns: bool = False, **said: Any) -> str:
        """Of an answer that is told again after the ground has gone away under it."""
        contacts = tuple(replace(contact, **said) for contact in found.contacts)
        told = replace(found, _touching=lambda: SimpleNamespace(contacts=lambda: contacts))
        assert friction_fault(scene, kinematics, (found, before), (told, before)) is None
        return friction_fault(scene, kinematics, (found, before), (told, far), turns) or ""

    assert "said to stick" in fault(sliding=False)
    assert "said to stick" in fault(turns=True, sliding=False)
    largest = max(contact.normal_force for contact in found.contacts)
    up, ahead = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
    assert "the way its friction pushes" in fault(sliding=True, force=largest * (up - 0.1 * ahead))
    assert fault(turns=True, sliding=True, force=largest * (up - 0.1 * ahead)) == ""
    assert fault(sliding=True, force=largest * (up + 0.1 * ahead)) == ""


@pytest.mark.parametrize("share", [1.0, 0.5, 0.25])
def test_slip_may_turn_back_within_a_step_that_finer_ones_clear(
    share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = drawn("table", friction=False)
    step = max(abs(case.path[1][name] - case.path[0][name]) for name in case.path[0])

    def fault(scene: Any, kinematics: Any, before: Any, after: Any, turns: bool = False) -> str | None:
        """Found in every step at least `share` as long as the path's."""
        far = max(abs(after[1][name] - before[1][name]) for name in before[1])
        return "slides" if far > (share - 0.01) * step and not turns else None

    monkeypatch.setattr(drawn_judge, "friction_fault", fault)
    found = {pose.inconsistent for pose in run_drawn(case, 2).poses[1:]}
    assert found == ({"slides"} if share == 0.25 else {None})


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
