# SPDX-License-Identifier: Apache-2.0
"""`cable bench robustness`: what it counts, prints and writes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cable_ros.bench.cases import run_case
from cable_ros.bench.contact_checks import surfaces
from cable_ros.bench.contact_fuzz import contact_case
from cable_ros.bench.fuzz import cold_case, tracked_case
from cable_ros.bench.markdown import MarkdownError, write_between
from cable_ros.bench.robustness import Tally
from cable_ros.cli.main import main
from cable_ros.scene import load_scene
from cable_ros.scene.kinematics import Kinematics

ZOO = """
from cable_ros.bench.cases import Case
from cable_ros.bench.fuzz import random_cable
import numpy as np
CASES = (Case("any", "verified", random_cable(np.random.default_rng(3)), baselines=False),)
"""


def test_a_small_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "page.md"
    arguments = ["--cases", "5", "--steps", "100", "--seed", "3", "--baselines", "1", "--markdown", str(page)]
    assert main(["bench", "robustness", *arguments]) == 0
    out = capsys.readouterr().out
    assert "cold starts: 5, seed 3" in out
    assert "tracked steps: 100, seed 3" in out
    rows = [line for line in page.read_text().splitlines() if line.startswith("| ")]
    assert [row.split(" | ")[2] for row in rows[2:]] == ["5", "100", "1", "1", "1"]
    assert "Seed 3" in page.read_text()


def test_one_case_again(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "robustness", "--seed", "3", "--only", "cold:2"]) == 0
    out = capsys.readouterr().out
    expected = run_case(cold_case(3, 2, 1e-4)).steps[0].equilibrium
    assert f"twist {expected.total_twist:+9.4f}" in out
    assert out.rstrip().endswith("verified")


def test_an_unknown_case_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "robustness", "--only", "warm:2"]) == 2
    assert "warm:2" in capsys.readouterr().err


def test_cases_of_a_seed_are_always_the_same() -> None:
    assert cold_case(3, 2, 1e-4).scene == cold_case(3, 2, 1e-4).scene
    assert tracked_case(3, 2, 1e-4).path == tracked_case(3, 2, 1e-4).path
    assert cold_case(3, 2, 1e-4).scene != cold_case(4, 2, 1e-4).scene


def test_a_wrong_answer_is_counted_as_wrong() -> None:
    outcome = run_case(cold_case(3, 2, 1e-4))
    (step,) = outcome.steps
    tally = Tally("cold starts")
    tally.add(outcome)
    assert tally.good
    tally.add(replace(outcome, steps=[replace(step, fault="end wrench off")], fault="end wrench off"))
    assert not tally.good
    assert tally.share == 0.5
    assert tally.wrong[0][1] == "end wrench off"


def test_a_slow_answer_is_counted_as_wrong() -> None:
    outcome = run_case(cold_case(3, 2, 1e-4))
    tally = Tally("cold starts")
    tally.add(replace(outcome, steps=[replace(outcome.steps[0], seconds=1.5)]))
    assert not tally.good


def test_named_cases_of_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    zoo, page = tmp_path / "small_zoo.py", tmp_path / "page.md"
    zoo.write_text(ZOO)
    page.write_text("before\n<!-- zoo begins -->\nold\n<!-- zoo ends -->\nafter\n")
    assert main(["bench", "robustness", "--zoo", str(zoo), "--markdown", str(page)]) == 0
    assert "1 of 1 cases passed." in capsys.readouterr().out
    text = page.read_text()
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "old" not in text
    assert "| any | verified | CONVERGED |" in text


def test_no_zoo_is_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "robustness", "--zoo", str(tmp_path / "none.py")]) == 2
    assert "none.py: no such file" in capsys.readouterr().err


def test_a_page_without_a_place_is_not_touched(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("nothing here\n")
    with pytest.raises(MarkdownError, match="zoo begins"):
        write_between(page, "zoo", "text")
    assert page.read_text() == "nothing here\n"


def test_random_scenes_with_obstacles_keep_the_clamps_clear() -> None:
    for index in range(20):
        case = contact_case(5, index, 1e-4)
        scene = load_scene(case.scene, urdf=case.urdf)
        kinematics = Kinematics(scene)
        (cable,) = scene.cables
        for joints in case.path:
            q = np.array([joints[name] for name in kinematics.joint_names])
            for surface in surfaces(scene, kinematics, q, cable.radius).values():
                for pose in kinematics.poses(q)[0]:
                    assert surface.signed(pose[:3]) > 0.04 * cable.length
