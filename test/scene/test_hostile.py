# SPDX-License-Identifier: Apache-2.0
"""Scenes and URDFs that mean harm, or are far too much: one sentence each, soon, and little memory."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from cable_ros.common.printable import MOST_CHARACTERS, one_line
from cable_ros.scene import Kinematics, SceneError, load_scene
from cable_ros.scene.caps import LONGEST_CHAIN, MOST_CABLES, MOST_MOVING, MOST_OBSTACLES
from cable_ros.scene.text import parse_yaml

CLAMP = {"position": [0, 0, 0], "orientation": [0, 0, 0, 1]}
BALL = {"sphere": {"center": [9, 9, 9], "radius": 0.1}}
SOON = 100.0  # s; what hangs never ends, and each takes far less


def scene(*, link: str | None = None, cable: Any = (), **changes: Any) -> dict[str, Any]:
    """A scene of one cable, at its end on a link of the robot where one is named."""
    end = {**CLAMP, "position": [0.5, 0, 0], **({"link": link} if link else {})}
    only = {
        "name": "hose", "length": 1.0, "stiffness": [0.02, 0.02, 0.015], "linear_density": 0.1,
        "start": CLAMP, "end": end, **dict(cable),
    }  # fmt: skip
    return {"gravity": [0, 0, -9.81], "cables": [only], **changes}


def chain(count: int, kind: str = "revolute", first: int = 0) -> str:
    """A robot of `count` joints in a row; links below `first` are left out."""
    links = "".join(f'<link name="l{i}"/>' for i in range(first, count + 1))
    joints = (
        f'<joint name="j{i}" type="{kind}"><parent link="l{i}"/><child link="l{i + 1}"/>'
        '<origin xyz="0.001 0 0"/><axis xyz="0 0 1"/></joint>'
        for i in range(count)
    )
    return f'<robot name="r">{links}{"".join(joints)}</robot>'


def told(load: Callable[[], Any]) -> str:
    """The one sentence of a SceneError that comes soon."""
    begin = time.monotonic()
    with pytest.raises(SceneError) as caught:
        load()
    assert time.monotonic() - begin < SOON
    text = str(caught.value)
    assert text.isprintable()
    assert len(text) <= MOST_CHARACTERS
    return text


@pytest.mark.parametrize("what", ["scene", "urdf"])
@pytest.mark.parametrize("kind", ["fifo", "device", "large"])
def test_only_regular_files_of_some_size_are_read(tmp_path: Path, what: str, kind: str) -> None:
    path = tmp_path / "file"
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    else:
        with path.open("wb") as file:
            file.truncate(1 << 40)
    said = told(lambda: load_scene(path if what == "scene" else scene(robot={"urdf": str(path)})))
    assert ("has more than" if kind == "large" else "a device, a pipe or a socket") in said


def _nested(first: str, form: str) -> str:
    """YAML in which each of 30 values uses the one before nine times."""
    lines = [f"a{i}: &a{i} {form.format(f'*a{i - 1}, ' * 9)}" for i in range(1, 30)]
    return "\n".join([f"a0: &a0 {first}", *lines])


def _merged(mappings: int, fields: int) -> str:
    """YAML of a mapping that merges so many others, of so many fields each."""
    lines = []
    for i in range(mappings):
        own = ", ".join(f"k{i}_{j}: 0" for j in range(fields))
        lines.append(f"a{i}: &a{i} {{{own}}}")
    return "\n".join([*lines, f"b: {{<<: [{', '.join(f'*a{i}' for i in range(mappings))}]}}"])


LAUGHS, MERGES = _nested("[x, x]", "[{}]"), _nested("{x: 1}", "{{<<: [{}]}}")


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (LAUGHS, "holds more than"),
        (_merged(6, 200), "fields are in one mapping"),
        ("a: &a [*a]", "is nested more than"),
        ("[" * 100_000, "is nested more than"),
        ("a: 1\n" * 50_000, "has more than"),
        ("a: !!timestamp x", "could not determine a constructor"),
        ("a: !!float [1]", "expected a scalar"),
        ("!!map [1]", "expected a mapping"),
        ("a: !!int x", "invalid literal"),
        ("a: \0", "unacceptable character"),
    ],
)
def test_yaml_that_is_a_bomb_or_damaged(text: str, sentence: str) -> None:
    assert sentence in told(lambda: parse_yaml(text, "scene.yaml"))


def test_a_mapping_that_merges_itself_many_times_over() -> None:
    """PyYAML before 6.0.4 keeps every copy of a field, and it is refused."""
    with contextlib.suppress(SceneError):
        assert parse_yaml(MERGES, "scene.yaml")["a29"] == {"x": 1}


def test_an_integer_of_400_digits(tmp_path: Path) -> None:
    file = tmp_path / "scene.yaml"
    file.write_text(f"gravity: [0, 0, {'9' * 400}]\ncables: []\n")
    assert "gravity[2]: must be finite" in told(lambda: load_scene(file))
    assert "not an integer of 5001 digits" in told(lambda: load_scene(scene(gravity=[0, 0, 10**5000])))
    assert "must be a text, not an integer of" in told(lambda: load_scene(scene(cable={"name": 10**5000})))
    assert "there is no such field" in told(lambda: load_scene({10**5000: 1}))


@pytest.mark.parametrize("bad", ["a\0b", "a\x1b[31mb", "a\u2028b", "a\ud800b", "x" * 5000])
def test_texts_that_cannot_be_names(bad: str) -> None:
    told(lambda: load_scene(scene(robot={"urdf": bad})))
    for mapping in (
        scene(obstacles=[{"name": bad, **BALL}]),
        scene(link=bad),
        scene(cable={"name": bad}),
        scene(friction_model=bad),
        scene(**{bad: 1}),
        scene(effects=[bad]),
    ):
        told(lambda mapping=mapping: load_scene(mapping, urdf=chain(1)))


def test_sentences_show_control_characters_escaped() -> None:
    assert one_line("red \x1b[31m\nand \u202e back") == "red \\x1b[31m and \\u202e back"
    assert len(one_line("x" * 100_000)) < MOST_CHARACTERS


@pytest.mark.parametrize(
    ("gravity", "sentence"),
    [
        ([0, 0, -9806], "gravity[2]: -9806 m/s^2 is outside -500 to 500 m/s^2; it looks like mm/s^2"),
        (
            [980.665, 0, 0],
            "gravity[0]: 980.665 m/s^2 is outside -500 to 500 m/s^2; it looks like mm/s^2 or cm/s^2",
        ),
    ],
)
def test_gravity_of_a_file_that_is_a_slip_of_units(tmp_path: Path, gravity: Any, sentence: str) -> None:
    file = tmp_path / "scene.yaml"
    file.write_text(yaml.safe_dump(scene(gravity=gravity)))
    assert sentence in told(lambda: load_scene(file))


def test_a_cable_of_a_file_that_is_denser_than_metal(tmp_path: Path) -> None:
    file = tmp_path / "scene.yaml"
    file.write_text(yaml.safe_dump(scene(cable={"linear_density": 150, "outer_diameter": 0.012})))
    assert (
        "150 kg/m in an outer diameter of 0.012 m would be denser than any metal; it looks like grams"
    ) in told(lambda: load_scene(file))
    lead = {"linear_density": float(11_340 * np.pi / 4 * 0.012**2), "outer_diameter": 0.012}
    file.write_text(yaml.safe_dump(scene(cable=lead)))
    assert load_scene(file).cables[0].linear_density > 1


def test_numbers_of_cables_and_obstacles_are_bounded() -> None:
    base = scene()
    cables = [{**base["cables"][0], "name": f"c{i}"} for i in range(MOST_CABLES + 1)]
    assert "cables: has 101 entries; give at most 100" in told(lambda: load_scene({**base, "cables": cables}))
    balls = [{"name": f"b{i}", **BALL} for i in range(MOST_OBSTACLES + 1)]
    assert "obstacles: has 1001 entries" in told(lambda: load_scene({**base, "obstacles": balls}))
    assert len(load_scene({**base, "obstacles": balls[1:]}).obstacles) == MOST_OBSTACLES


DOUBLED_LINK = chain(1).replace('<link name="l1"/>', '<link name="l1"/><link name="l1"/>')
DOUBLED_JOINT = chain(2).replace('"j1"', '"j0"')
NAMELESS = chain(1).replace('name="j0"', "")
URDFS = {
    "20,000 links": (chain(20_000), "has 20001 links, more than"),
    "a long chain": (chain(9000), f"more than {LONGEST_CHAIN} joints lead to it"),
    "many joints": (chain(MOST_MOVING + 1), f"{MOST_MOVING + 1} joints move the clamps"),
    "many elements": (f"<robot>{'<a/>' * 400_000}</robot>", "elements"),
    "deep elements": ("<robot>" + "<a>" * 1_000_000, "deep"),
    "entities": ('<!DOCTYPE r [<!ENTITY a "ha">]><robot>&a;</robot>', "<!DOCTYPE>"),
    "undefined parent": (chain(2, first=1), "joint 'j0': its parent link 'l0' is not defined"),
    "undefined child": (chain(1).replace('child link="l1"', 'child link="x"'), "its child link 'x'"),
    "doubled link": (DOUBLED_LINK, "link 'l1': there are two of this name"),
    "doubled joint": (DOUBLED_JOINT, "joint 'j0': there are two of this name"),
    "joint without name": (NAMELESS, "a joint has no name"),
    "two roots": (
        chain(1).replace("</robot>", '<link name="b"/></robot>'),
        "no joints connect the links b, l0",
    ),
    "colours": (chain(1).replace('"j0"', '"j&#x9b;31m"'), "joint 'j\\x9b31m': its name holds a control"),
    "half a character": ('<robot name="\ud800"/>', "this is not the XML of a URDF"),
    "millimetres": (chain(1).replace("0.001 0 0", "123456 0 0"), "its xyz '123456 0 0' is beyond 10000"),
    "endless axis": (chain(1).replace('"0 0 1"', '"1e308 1e308 1e308"'), "its axis is 1.73205e+308 long"),
}


@pytest.mark.parametrize("name", URDFS)
def test_urdfs_that_end_the_process_or_are_no_tree(name: str) -> None:
    urdf, sentence = URDFS[name]
    last = f"l{urdf.count('<joint')}"
    assert sentence in told(lambda: Kinematics(load_scene(scene(link=last), urdf=urdf)))


def test_the_longest_chains_load() -> None:
    moving = Kinematics(load_scene(scene(link=f"l{MOST_MOVING}"), urdf=chain(MOST_MOVING)))
    assert moving.poses(np.zeros(MOST_MOVING))[0, 1, 0] == pytest.approx(0.5 + 0.001 * MOST_MOVING)
    still = Kinematics(load_scene(scene(link=f"l{LONGEST_CHAIN}"), urdf=chain(LONGEST_CHAIN, "fixed")))
    assert still.poses(np.zeros(0))[0, 1, 0] == pytest.approx(0.5 + 0.001 * LONGEST_CHAIN)


def test_a_joint_and_a_link_may_share_a_name() -> None:
    # As many URDFs have it: the clamp is on the link, which the second joint carries.
    urdf = chain(2).replace('"j0"', '"l2"')
    arm = Kinematics(load_scene(scene(link="l2"), urdf=urdf))
    assert arm.joint_names == ("l2", "j1")
    assert arm.poses(np.array([0.0, 0.0]))[0, 1, 0] == pytest.approx(0.502)
