# SPDX-License-Identifier: Apache-2.0
"""`cable explain`: every effect with its cause, its change and its time, as a table and as JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cable_ros import Tracker, load_scene
from cable_ros.cli.main import main
from cable_ros.contact.overlaps import closest_approach
from cable_ros.contributions import explain
from cable_ros.equilibrium import Status
from cable_ros.scene import EFFECTS
from cable_ros.scene.text import parse_yaml
from cable_ros.share import share_file


def shipped(name: str) -> str:
    return str(share_file("config", name))


def test_every_effect_is_listed_with_its_cause() -> None:
    (one,) = explain(load_scene(shipped("space_arm_cold.yaml")), {"orientation": 0.5}, repeats=0).values()
    by_name = {effect.name: effect for effect in one.effects}
    assert tuple(by_name) == EFFECTS
    assert {name for name, effect in by_name.items() if effect.present} == {"weight", "temperature", "dose"}
    assert by_name["weight"].size == pytest.approx(51.6, rel=1e-3)  # w L^3 / EI of the paper's arm
    assert by_name["temperature"].size == pytest.approx(1.64)
    assert "-80 degC" in by_name["temperature"].why
    for effect in one.effects:
        assert (effect.change is None) == (effect.size is None) == (not effect.present)
        assert effect.time is None


def test_change_is_that_of_scenes_with_and_without() -> None:
    path = shipped("space_arm_cold.yaml")
    values: dict[str, Any] = parse_yaml(Path(path).read_text(), path)
    values["robot"]["urdf"] = shipped("space_arm.urdf")
    joints = {"orientation": 0.5}
    (one,) = explain(load_scene(values), joints, 1e-5, repeats=0).values()
    forces = []
    for taken in ((), ("dose",)):
        fields = {k: v for k, v in values["cables"][0].items() if k not in taken}
        (found,) = Tracker(load_scene({**values, "cables": [fields]}), 1e-7).solve(joints).values()
        forces.append(found.end_wrench)
    change = max(
        np.linalg.norm((forces[1] - forces[0])[part]) / np.linalg.norm(forces[0][part])
        for part in (slice(0, 3), slice(3, 6))
    )
    (dose,) = (effect for effect in one.effects if effect.name == "dose")
    assert dose.change == pytest.approx(change, rel=1e-3)


def test_what_the_scene_keeps_out_is_measured_too(tmp_path: Path) -> None:
    text = Path(shipped("space_arm_cold.yaml")).read_text()
    text = text.replace("urdf: space_arm.urdf", f"urdf: {shipped('space_arm.urdf')}")
    for choice, there in (("[temperature]", {"temperature"}), ("auto", {"weight", "temperature", "dose"})):
        scene = tmp_path / "scene.yaml"
        scene.write_text(text + f"effects: {choice}\n")
        (one,) = explain(load_scene(scene), {"orientation": 0.5}, 1e-3, repeats=0).values()
        assert {effect.name for effect in one.effects if effect.present} == there
        weight = one.effects[0]
        assert weight.change is not None
        assert weight.change > 0.1
        assert ("not in the scene's effects" in weight.why) == (choice != "auto")


def test_left_out_by_auto(tmp_path: Path) -> None:
    text = Path(shipped("space_arm.yaml")).read_text()
    text = text.replace("urdf: space_arm.urdf", f"urdf: {shipped('space_arm.urdf')}")
    scene = tmp_path / "scene.yaml"
    scene.write_text(
        text.replace("    total_twist", "    axial_stiffness: 1.0e+7\n    total_twist") + "effects: auto\n"
    )
    (one,) = explain(load_scene(scene), {"orientation": 0.5}, 1e-3, repeats=4).values()
    (stretch,) = (effect for effect in one.effects if effect.name == "stretch")
    assert not stretch.present
    assert stretch.why.startswith("left out by 'effects: auto'")
    assert stretch.change is not None
    assert 0 < stretch.change < 1e-4
    assert stretch.time is not None
    assert one.time > 0


def test_contact_tells_where_it_touches() -> None:
    scene = load_scene(shipped("space_arm_sphere.yaml"))
    for angle, touches in ((0.0, False), (60.0, True)):
        (one,) = explain(scene, {"orientation": np.radians(angle)}, 1e-3, repeats=0).values()
        by_name = {effect.name: effect for effect in one.effects}
        assert by_name["contact"].present
        assert ("touches ball" in by_name["contact"].why) == touches
        assert by_name["contact"].change is not None
        assert (by_name["contact"].change > 1e-2) == touches
        assert by_name["friction"].change is not None
        assert (by_name["friction"].change > 1e-2) == touches


def test_self_contact_is_told_where_it_would_matter() -> None:
    # A loop of two turns of twist, closed as far as its clamps let it, with a thin and with a thick cable.
    for outer, matters in ((0.004, False), (0.08, True)):
        cable = {
            "name": "cable",
            "length": 1.0,
            "stiffness": [0.02, 0.02, 0.015],
            "outer_diameter": outer,
            "linear_density": 0.0,
            "start": {"position": [0, 0, 0], "orientation": [0, 0, 0, 1]},
            "end": {"position": [0.05, 0, 0.02], "orientation": [0, 0, 0, 1]},
        }
        scene = load_scene({"gravity": [0, 0, 0], "cables": [cable]})
        (one,) = explain(scene, {}, 1e-3, repeats=0).values()
        assert ("matters here" in one.self_contact) == matters
        (found,) = Tracker(scene).solve({}).values()
        assert found.status is Status.CONVERGED
        assert ("matters here" in found.message) == matters


def test_closest_approach_of_a_circle_and_of_a_crossing() -> None:
    s = np.linspace(0, 1, 2001)
    circle = np.stack([np.cos(2 * np.pi * s), np.sin(2 * np.pi * s), 0.01 * s], axis=1)
    length = float(np.hypot(2 * np.pi, 0.01))
    # Its ends meet, one step up; points a quarter of it apart are a chord apart at least.
    assert closest_approach(circle, length, 0.5 * length) == pytest.approx(0.01, rel=1e-5)
    half = circle[:1001]
    expected = 2 * np.sin(np.pi / 4)  # a quarter of the circle
    assert closest_approach(half, length / 2, length / 4) == pytest.approx(expected, rel=1e-4)


def test_command_prints_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["explain", shipped("space_arm.yaml"), "--joint", "orientation=30deg"]) == 0
    out = capsys.readouterr().out
    lines = {line.split()[0]: line for line in out.splitlines() if line.startswith("  ") and line.strip()}
    assert set(EFFECTS) <= set(lines)
    assert " yes " in lines["weight"]
    assert "w L^3 / EI = 51.6" in lines["weight"]
    assert " no " in lines["stretch"]


@pytest.mark.parametrize(
    ("scene", "joint", "there"),
    [
        ("space_arm.yaml", "orientation=-45deg", {"weight"}),
        ("space_arm_cold.yaml", "orientation=45deg", {"weight", "temperature", "dose"}),
        ("space_arm_sphere.yaml", "orientation=75deg", {"weight", "contact", "friction"}),
        ("draped.yaml", "lift=0.2", {"weight", "contact"}),
    ],
)
def test_all_shipped_scenes(
    scene: str, joint: str, there: set[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explain", shipped(scene), "--joint", joint, "--tolerance", "1e-3", "--json"]) == 0
    (cable,) = json.loads(capsys.readouterr().out)["cables"].values()
    assert {effect["name"] for effect in cable["effects"] if effect["present"]} == there
    for effect in cable["effects"]:
        if effect["present"]:
            assert effect["change"] > 1e-3  # all of them matter there
            assert effect["time"] < cable["time"]


def test_command_prints_json(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["explain", shipped("space_arm.yaml"), "--joint", "orientation=0", "--tolerance", "1e-3"]
    assert main([*arguments, "--json"]) == 0
    out = json.loads(capsys.readouterr().out)
    assert (out["effects"], out["tolerance"]) == ("all", 1e-3)
    cable = out["cables"]["camera_cable"]
    assert cable["status"] == "CONVERGED"
    assert [effect["name"] for effect in cable["effects"]] == list(EFFECTS)
    assert set(cable["effects"][0]) == {"name", "present", "why", "formula", "size", "change", "time"}
    assert cable["time"] > 0


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        (["--joint", "elbow=1"], 2, "'elbow'"),
        (["--joint", "orientation=0", "--tolerance", "2"], 2, "not between"),
    ],
)
def test_mistakes_are_one_sentence(
    arguments: list[str], code: int, sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explain", shipped("space_arm.yaml"), *arguments]) == code
    err = capsys.readouterr().err
    assert len(err.splitlines()) == 1
    assert sentence in err


def test_no_equilibrium_no_numbers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = Path(shipped("space_arm.yaml")).read_text().replace("length: 0.380", "length: 0.120")
    scene = tmp_path / "scene.yaml"
    scene.write_text(text.replace("urdf: space_arm.urdf", f"urdf: {shipped('space_arm.urdf')}"))
    assert main(["explain", str(scene), "--joint", "orientation=0"]) == 1
    captured = capsys.readouterr()
    assert "no equilibrium to explain" in captured.out
    assert "farther apart" in captured.err
