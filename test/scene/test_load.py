# SPDX-License-Identifier: Apache-2.0
"""Scenes: what is read, and the sentence for each mistake."""

from __future__ import annotations

import copy
import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cable_ros.scene import Plane, SceneError, Sphere, load_scene
from cable_ros.share import share_file

ARM = share_file("config", "space_arm.yaml")
URDF = share_file("config", "space_arm.urdf").read_text()


def cable(**changes: Any) -> dict[str, Any]:
    """A valid cable in the world; a change to None takes the field away."""
    fields = {
        "name": "hose",
        "length": 1.0,
        "stiffness": [0.02, 0.02, 0.015],
        "linear_density": 0.1,
        "start": {"position": [0, 0, 0], "orientation": [0, 0, 0, 1]},
        "end": {"position": [0.5, 0, 0], "orientation": [0, 0, 0, 1]},
        **changes,
    }
    return {name: value for name, value in fields.items() if value is not None}


def scene(*cables: dict[str, Any], **changes: Any) -> dict[str, Any]:
    return {"gravity": [0, 0, -9.81], "cables": list(cables) or [cable()], **changes}


def sentence(mapping: Any, **keywords: Any) -> str:
    with pytest.raises(SceneError) as caught:
        load_scene(mapping, **keywords)
    text = str(caught.value)
    assert text.splitlines() == [text]
    return text


def test_arm_is_the_papers() -> None:
    arm = load_scene(ARM)
    (only,) = arm.cables
    assert (only.name, only.length, only.diameter, only.total_twist) == ("camera_cable", 0.38, 0.00754, -2.7)
    # The paper's table gives EI = 1063.0 and GJ = 723.5 N mm^2 to four digits.
    np.testing.assert_allclose(only.stiffness, [1063.0e-6, 1063.0e-6, 723.5e-6], rtol=1e-4)
    assert only.linear_density * -arm.gravity[2] == pytest.approx(1.0, rel=1e-6)  # 1e-3 N/mm
    assert only.start.link is None
    assert only.end.link == "turret"
    assert arm.text == ARM.read_text()
    assert arm.path == ARM
    assert arm.robot is not None
    assert arm.robot.path == ARM.with_name("space_arm.urdf")


def test_other_shipped_scenes_say_what_they_differ_in() -> None:
    arm = load_scene(ARM)
    sphere = load_scene(share_file("config", "space_arm_sphere.yaml"))
    (ball,) = sphere.obstacles
    assert isinstance(ball.shape, Sphere)
    assert (*ball.shape.center, ball.shape.radius, ball.friction) == (0.092, 0.010, -0.095, 0.045, 0.35)
    assert not ball.cable_radius_counts
    cold = load_scene(share_file("config", "space_arm_cold.yaml"))
    for other in (sphere, cold):
        assert repr(other.cables[0].start) == repr(arm.cables[0].start)
        np.testing.assert_array_equal(other.cables[0].stiffness, arm.cables[0].stiffness)
    temperature, dose = cold.cables[0].temperature, cold.cables[0].dose
    assert temperature is not None
    assert dose is not None
    # Between -100 and -50 degC: three fifths of the way from 1.8 to 3.2; a fifth of the way from 1.0 to 1.25.
    np.testing.assert_allclose(temperature.factors(-80.0), [2.64, 2.64, 2.36])
    np.testing.assert_allclose(dose.factors(2.0e5), [1.05, 1.05, 1.04])
    draped = load_scene(share_file("config", "draped.yaml"))
    assert isinstance(draped.obstacles[0].shape, Plane)
    # What touches the ground lies on it at the start clamp.
    assert draped.cables[0].start.position[2] == draped.cables[0].radius


def test_scene_is_frozen_down_to_its_arrays() -> None:
    loaded = load_scene(scene())
    with pytest.raises(dataclasses.FrozenInstanceError):
        loaded.cables[0].length = 2.0  # type: ignore[misc]
    arrays = [loaded.gravity, loaded.cables[0].stiffness]
    arrays += [a for m in loaded.cables[0].mounts for a in (m.position, m.orientation)]
    for array in arrays:
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_mapping_with_numpy_and_text_that_loads_again(tmp_path: Path) -> None:
    mapping = scene(
        cable(stiffness=np.array([1e-6, 2.5e-6, 1e-7]), length=np.float64(0.1), total_twist=-1 / 3),
        gravity=(0, 0.1 + 0.2, -128.43),
    )
    mapping["cables"][0]["end"]["position"] = np.array([0.05, 0, 1e-17])
    first = load_scene(mapping)
    file = tmp_path / "again.yaml"
    file.write_text(first.text)
    second = load_scene(file)
    # Exactly: a log's scene must reproduce a run bit for bit.
    np.testing.assert_array_equal(first.gravity, second.gravity)
    np.testing.assert_array_equal(first.cables[0].stiffness, second.cables[0].stiffness)
    np.testing.assert_array_equal(first.cables[0].end.position, second.cables[0].end.position)
    assert second.cables[0].total_twist == -1 / 3


@pytest.mark.parametrize(
    ("written", "meant"),
    [("6.70e6", 6.7e6), ("1e5", 1e5), ("+.5E+6", 5e5), ("67e+5", 6.7e6), ("0100000", 1e5), ("1.e6", 1e6)],
)
def test_numbers_as_engineers_write_them(tmp_path: Path, written: str, meant: float) -> None:
    file = tmp_path / "scene.yaml"
    text = (
        ARM.read_text()
        .replace("6.70e6 ", written + " ")
        .replace("space_arm.urdf", str(ARM.parent / "space_arm.urdf"))
    )
    file.write_text(text)
    stiffness = load_scene(file).cables[0].stiffness
    assert stiffness[0] == pytest.approx(meant * math.pi / 64 * 0.00754**4, rel=1e-14)  # a few roundings


def test_rpy_turns_as_a_urdf_does() -> None:
    """Rotation by roll, pitch, yaw about fixed axes; what SciPy calls 'xyz', extrinsic."""
    angles = [0.3, -1.1, 2.4]
    mounts = [mount(orientation=[0, 0, 0, 1]) | {"rpy": angles} for _ in range(2)]
    for one in mounts:
        del one["orientation"]
    box = {"name": "b", "box": {"center": [0, 0, 9], "size": [1, 1, 1], "rpy": angles}}
    loaded = load_scene(scene(cable(start=mounts[0]), obstacles=[box]))
    wanted = Rotation.from_euler("xyz", angles).as_matrix()
    for found in (loaded.cables[0].start.orientation, loaded.obstacles[0].shape.orientation):
        np.testing.assert_allclose(Rotation.from_quat(found).as_matrix(), wanted, atol=1e-15)


def test_a_urdf_of_a_package(tmp_path, monkeypatch) -> None:
    index = tmp_path / "share" / "ament_index" / "resource_index" / "packages"
    index.mkdir(parents=True)
    (index / "arm_description").touch()
    file = tmp_path / "share" / "arm_description" / "urdf" / "arm.urdf"
    file.parent.mkdir(parents=True)
    file.write_text(URDF)
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"/nowhere:{tmp_path}")
    mapping = scene(
        cable(end=mount(link="turret")), robot={"urdf": "package://arm_description/urdf/arm.urdf"}
    )
    assert load_scene(mapping).robot.path == file
    mapping["robot"] = {"urdf": "package://cable_ros/config/space_arm.urdf"}
    assert load_scene(mapping).robot.urdf == URDF
    mapping["robot"] = {"urdf": "package://no_arm/urdf/arm.urdf"}
    text = sentence(mapping)
    assert (
        "robot.urdf: package://no_arm/urdf/arm.urdf: there is no package 'no_arm' in the ament index" in text
    )
    mapping["robot"] = {"urdf": "package://arm_description/urdf/leg.urdf"}
    assert f"{file.with_name('leg.urdf')}: there is no such file" in sentence(mapping)


def test_urdf_given_later_takes_the_place_of_the_file() -> None:
    mapping = yaml.safe_load(ARM.read_text().replace("6.70e6", "6.70e+6").replace("2.28e6", "2.28e+6"))
    mapping["robot"] = {"urdf": ARM.with_name("space_arm.urdf")}
    assert load_scene(mapping).robot is not None
    mapping["robot"] = {"urdf": "/nowhere/robot.urdf"}
    loaded = load_scene(mapping, urdf=URDF)
    assert loaded.robot is not None
    assert loaded.robot.urdf == URDF
    assert loaded.robot.path is None
    del mapping["robot"]
    assert load_scene(mapping, urdf=URDF).robot is not None
    text = sentence(mapping)
    assert "cables[0].end.link" in text
    assert "robot_description" in text


def test_nearly_unit_quaternion_is_normalised() -> None:
    half = math.sqrt(0.5)
    rounded = cable(start={"position": [0, 0, 0], "orientation": [0.7071, 0, 0, 0.7071]})
    loaded = load_scene(scene(rounded)).cables[0].start.orientation
    np.testing.assert_allclose(loaded, [half, 0, 0, half], rtol=1e-15)  # one rounding


def mount(**changes: Any) -> dict[str, Any]:
    return {"position": [0, 0, 0], "orientation": [0, 0, 0, 1], **changes}


ROUND = {"stiffness": None, "diameter": 0.01, "youngs_modulus": 1e7, "shear_modulus": 3e6}

MISTAKES = {
    "unknown field": (scene(cable(lenght=1.0)), "cables[0].lenght", "did you mean 'length'"),
    "unknown field, nothing near": (
        scene(cable(colour=1)),
        "cables[0].colour",
        "fields here are name, length",
    ),
    "unknown top field": (scene(gravitation=[0, 0, 0]), "gravitation", "did you mean 'gravity'"),
    "missing": (scene(cable(length=None)), "cables[0].length", "missing; give metres"),
    "empty number": (scene({**cable(), "length": None}), "cables[0].length", "empty; give metres"),
    "empty link": (
        scene(cable(end=mount(link=None))),
        "cables[0].end.link",
        "empty; give a link of the robot",
    ),
    "empty robot": (scene(robot=None), "robot", "must be a mapping with the fields urdf, not empty"),
    "missing mount": (scene(cable(end=None)), "cables[0].end", "missing; give {position"),
    "missing position": (
        scene(cable(end={"orientation": [0, 0, 0, 1]})),
        "cables[0].end.position",
        "missing",
    ),
    "missing gravity": ({"cables": [cable()]}, "gravity", "[0, 0, -9.80665]"),
    "no cables": ({"gravity": [0, 0, 0], "cables": []}, "cables", "at least one"),
    "cables is a mapping": ({"gravity": [0, 0, 0], "cables": cable()}, "cables", "not a mapping"),
    "text for a number": (scene(cable(length="38 cm")), "cables[0].length", "not the text '38 cm'"),
    "truth value for a number": (scene(cable(length=True)), "cables[0].length", "truth value"),
    "number for a mount": (scene(cable(end=3)), "cables[0].end", "must be a mapping"),
    "short vector": (scene(gravity=[0, 9.81]), "gravity", "list of 3 numbers, not a list of 2"),
    "text in a vector": (scene(gravity=[0, 0, "down"]), "gravity[2]", "must be a number"),
    "nan": (scene(cable(length=math.nan)), "cables[0].length", "must be finite"),
    "infinite": (scene(gravity=[0, 0, -math.inf]), "gravity[2]", "must be finite"),
    "negative": (scene(cable(linear_density=-0.1)), "cables[0].linear_density", "must not be negative"),
    "length in mm": (scene(cable(length=380)), "cables[0].length", "millimetres; give metres"),
    "length 0": (scene(cable(length=0)), "cables[0].length", "outside 0.01 to 100 m"),
    "diameter in mm": (scene(cable(**{**ROUND, "diameter": 7.54})), "cables[0].diameter", "millimetres"),
    "diameter above length": (
        scene(cable(**{**ROUND, "diameter": 0.9, "length": 0.5})),
        "cables[0].diameter",
        "below the length",
    ),
    "modulus in MPa": (scene(cable(**{**ROUND, "youngs_modulus": 6.7})), "cables[0].youngs_modulus", "MPa"),
    "modulus in GPa": (scene(cable(**{**ROUND, "shear_modulus": 80})), "cables[0].shear_modulus", "GPa"),
    "stiffness in N mm^2": (scene(cable(stiffness=[1063.0, 1063.0, 723.5])), "cables[0].stiffness", "N mm^2"),
    "stiffness 0": (scene(cable(stiffness=[0.1, 0.1, 0])), "cables[0].stiffness[2]", "outside"),
    "density in g/m": (scene(cable(linear_density=1020)), "cables[0].linear_density", "grams per metre"),
    "density in g/m, round": (
        scene(cable(**ROUND, linear_density=101.97)),
        "cables[0].linear_density",
        "heavier than any solid",
    ),
    "position in mm": (
        scene(cable(end=mount(position=[80, 145, 75]))),
        "cables[0].end.position",
        "millimetres",
    ),
    "both orientations": (
        scene(cable(end=mount(rpy=[0, 0, 0]))),
        "cables[0].end",
        "both orientation and rpy are given; give one of the two",
    ),
    "degrees": (
        scene(cable(end={"position": [0, 0, 0], "rpy": [0, 90, 0]})),
        "cables[0].end.rpy[1]",
        "it looks like degrees",
    ),
    "quaternion": (scene(cable(end=mount(orientation=[1, 0, 0, 1]))), "cables[0].end.orientation", "1.41421"),
    "quaternion 0": (
        scene(cable(end=mount(orientation=[0, 0, 0, 0]))),
        "cables[0].end.orientation",
        "norm is 0",
    ),
    "matrix": (
        scene(cable(end=mount(orientation=np.eye(3)))),
        "cables[0].end.orientation",
        "list of 4 numbers",
    ),
    "both": (scene(cable(diameter=0.01)), "cables[0]", "both stiffness and diameter are given"),
    "both, moduli": (scene(cable(youngs_modulus=1e7)), "cables[0]", "both stiffness and youngs_modulus"),
    "both, tube": (scene(cable(inner_diameter=0.005)), "cables[0]", "both stiffness and inner_diameter"),
    "no wall": (
        scene(cable(**ROUND, inner_diameter=0.01)),
        "cables[0].inner_diameter",
        "0.01 m leaves no wall within the diameter of 0.01 m; give less than 0.0099 m",
    ),
    "inner diameter in mm": (
        scene(cable(**ROUND, inner_diameter=6)),
        "cables[0].inner_diameter",
        "millimetres",
    ),
    "neither": (scene(cable(stiffness=None)), "cables[0]", "neither stiffness nor diameter"),
    "half of a section": (
        scene(cable(**{**ROUND, "shear_modulus": None})),
        "cables[0].shear_modulus",
        "missing; give pascals",
    ),
    "no robot": (scene(cable(end=mount(link="hand"))), "cables[0].end.link", "robot_description"),
    "two of a name": (scene(cable(), cable()), "cables[1].name", "already the name of cables[0]"),
    "name with a space": (scene(cable(name="my hose")), "cables[0].name", "ROS topic name"),
    "name with a digit first": (scene(cable(name="2nd")), "cables[0].name", "a letter first"),
    "name with two underscores": (scene(cable(name="a__b")), "cables[0].name", "single underscores"),
    "endless name": (scene(cable(name="a" * 81)), "cables[0].name", "up to 80 letters"),
    "empty name": (scene(cable(name=" ")), "cables[0].name", "must be a text"),
    "number for a name": (scene(cable(name=7)), "cables[0].name", "must be a text, not 7"),
    "robot is a path": (scene(robot="arm.urdf"), "robot", "must be a mapping with the fields urdf"),
    "robot without urdf": (scene(robot={"file": "a.urdf"}), "robot.file", "fields here are urdf"),
    "no such urdf": (scene(robot={"urdf": "/nowhere/a.urdf"}), "robot.urdf: /nowhere/a.urdf", "no such file"),
}


def test_a_tube_has_the_second_moments_of_its_wall() -> None:
    """Rings of the section added up; and of a thin wall t at radius r, pi r^3 t in bending."""
    tube = load_scene(scene(cable(**ROUND, inner_diameter=0.006))).cables[0]
    assert (tube.diameter, tube.radius) == (0.01, 0.005)
    r = np.linspace(0.003, 0.005, 20_001)
    ring = 2 * np.pi * r**3
    polar = float((0.5 * (ring[1:] + ring[:-1]) * np.diff(r)).sum())
    # The trapezoidal rule in so many steps is good to 1e-8.
    assert tube.stiffness == pytest.approx([1e7 * polar / 2, 1e7 * polar / 2, 3e6 * polar], rel=1e-7)
    thin = load_scene(scene(cable(**ROUND, inner_diameter=0.0099))).cables[0]
    # The wall of 0.05 mm at 4.975 mm, to the square of their ratio.
    assert thin.stiffness[0] == pytest.approx(1e7 * np.pi * 0.004975**3 * 0.05e-3, rel=1e-4)
    solid = load_scene(scene(cable(**ROUND))).cables[0]
    assert tube.stiffness / tube.stiffness[0] == pytest.approx(solid.stiffness / solid.stiffness[0])


@pytest.mark.parametrize("name", MISTAKES)
def test_mistake_gives_place_and_remedy(name: str) -> None:
    mapping, place, remedy = MISTAKES[name]
    text = sentence(mapping)
    assert text.startswith(f"scene: {place}: ")
    assert remedy in text.removeprefix(f"scene: {place}: ")


def test_limits_are_legitimate_themselves() -> None:
    for length in (0.01, 100):
        end = mount(position=[length / 2, 0, 0])
        for bending in (1e-6, 1e3):
            extreme = cable(length=length, stiffness=[bending, bending / 50, bending * 100], end=end)
            assert load_scene(scene({**extreme, "linear_density": 0})).cables[0].linear_density == 0
            assert load_scene(scene({**extreme, "linear_density": 1000})).cables[0].linear_density == 1000


FILES = {
    "empty": ("", "the file is empty"),
    "only comments": ("# nothing\n", "the file is empty"),
    "a list": ("- 1\n- 2\n", "must be a mapping"),
    "a word": ("scene\n", "must be a mapping"),
    "not yaml": ("gravity: [0, 0\ncables: 3\n", "line 2, column "),
    "tab": ("gravity:\n\t- 0\n", "line 2, column 1"),
    "twice": (
        "gravity: [0, 0, 0]\ngravity: [0, 0, 1]\n",
        "line 2, column 1: the field 'gravity' stands here twice",
    ),
    "alias without anchor": ("gravity: *down\n", "line 1, column 10"),
    "python object": ("gravity: !!python/object/apply:os.getcwd []\n", "line 1, column 10"),
    "two documents": ("gravity: [0, 0, 0]\n---\ncables: []\n", "line 2"),
    "unhashable key": ("? [1, 2]\n: 3\n", "line 1, column 3"),
}


@pytest.mark.parametrize("name", FILES)
def test_text_that_is_no_scene(tmp_path: Path, name: str) -> None:
    text, remedy = FILES[name]
    file = tmp_path / "bad.yaml"
    file.write_text(text)
    told = sentence(file)
    assert told.startswith(f"{file}: ")
    assert remedy in told


def test_files_that_are_none(tmp_path: Path) -> None:
    assert "there is no such file" in sentence(tmp_path / "nothing.yaml")
    assert "this is a folder" in sentence(str(tmp_path))
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00")
    assert "not UTF-8" in sentence(tmp_path / "binary.yaml")


def test_unknown_link_lists_the_known() -> None:
    mapping = scene(cable(end=mount(link="turet")))
    text = sentence(mapping, urdf=URDF)
    assert text.startswith(
        "scene: cables[0].end.link: the robot has no link 'turet' (did you mean 'turret'?)"
    )
    assert "base, turret, camera" in text
    mapping["cables"][0]["end"] = mount(link="turret", position=[80, 145, 75])
    assert "origin of its link; it looks like millimetres" in sentence(mapping, urdf=URDF)


@pytest.mark.parametrize(
    ("urdf", "remedy"),
    [
        ("", "not the XML of a URDF"),
        ("<robot><link name='base'></robot>", "not the XML of a URDF"),
        ("<sdf/>", "root is <robot>"),
        ("<robot/>", "no links"),
        ("<robot xmlns:xacro='http://ros.org/wiki/xacro'><xacro:arm/></robot>", "expand it first"),
    ],
)
def test_text_that_is_no_urdf(urdf: str, remedy: str) -> None:
    text = sentence(scene(cable(end=mount(link="turret"))), urdf=urdf)
    assert text.startswith("robot description: ")
    assert remedy in text


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths of all values below `value`."""
    pairs = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *(p for key, entry in pairs for p in places(entry, (*path, key)))]


JUNK = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=3),
    st.lists(st.floats(), max_size=5),
    st.dictionaries(st.one_of(st.text(max_size=3), st.integers()), st.integers(), max_size=2),
    st.just(np.zeros((2, 2))),
)
WHOLE = scene(cable(total_twist=1.0), cable(name="second", **ROUND))


@settings(max_examples=300)
@given(st.sampled_from(places(WHOLE)), JUNK)
def test_any_value_anywhere_loads_or_gives_a_sentence(place: tuple[Any, ...], junk: Any) -> None:
    mapping: Any = copy.deepcopy(WHOLE)
    if not place:
        mapping = {"gravity": junk}
    else:
        inner = mapping
        for key in place[:-1]:
            inner = inner[key]
        inner[place[-1]] = junk
    try:
        loaded = load_scene(mapping)
    except SceneError as error:
        told = str(error)
    else:
        told = ""
        assert all(np.isfinite(v).all() for v in (loaded.gravity, *(c.stiffness for c in loaded.cables)))
    assert len(told.splitlines()) <= 1
