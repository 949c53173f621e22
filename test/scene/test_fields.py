# SPDX-License-Identifier: Apache-2.0
"""What the tables of fields say of a scene file, against what is read: examples, bounds, defaults."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from cable_ros.scene import Cable, Obstacle, Scene, SceneError, load_scene
from cable_ros.scene.fields import REQUIRED, Field
from cable_ros.scene.load import SCENE
from cable_ros.scene.model import FREE, SUPPORTS
from cable_ros.scene.mounts import BELONGS
from cable_ros.scene.obstacles import OBSTACLE
from cable_ros.share import share_file

URDF = str(share_file("config", "space_arm.urdf"))
CLAMP = {"position": [0, 0, 0], "orientation": [0, 0, 0, 1]}
SMALLEST = {
    "robot": {"urdf": URDF},
    "gravity": [0, 0, -9.81],
    "cables": [
        {
            "name": "hose", "length": 1.0, "stiffness": [0.02, 0.02, 0.015], "linear_density": 0.1,
            "start": CLAMP, "end": {**CLAMP, "position": [0.5, 0, 0]},
        }
    ],
}  # fmt: skip
ROUND = {"diameter": 0.00754, "youngs_modulus": 6.70e6, "shear_modulus": 2.28e6}
SHAPES = [field.name for field in OBSTACLE if field.inner]

Place = tuple[str | int, ...]


def leaves(fields: tuple[Field, ...] = SCENE, place: Place = ()) -> Iterator[tuple[Place, Field]]:
    """Place and description of every field, those within mappings and the first entry of lists included."""
    for field in fields:
        yield (*place, field.name), field
        within: Place = (0,) if field.kind.startswith("list of mappings") else ()
        yield from leaves(field.inner, (*place, field.name, *within))


ALL = list(leaves())
NAMED = [pytest.param(place, field, id=".".join(map(str, place))) for place, field in ALL]
SIZED = [pytest.param(place, field, id=".".join(map(str, place))) for place, field in ALL if field.size]
DEFAULTED = [
    pytest.param(place, field, id=".".join(map(str, place)))
    for place, field in ALL
    if field.default not in (REQUIRED, None, ())
]


def scene_with(place: Place, value: Any) -> dict[str, Any]:
    """A small scene with this value there, and what can't stand beside it taken away."""
    values = copy.deepcopy(SMALLEST)
    described = dict(ALL)
    at, path = values, ()
    for step in place[:-1]:
        path = (*path, step)
        if isinstance(at, dict) and step not in at:
            at[step] = [{"name": "thing"}] if step == "obstacles" else yaml.safe_load(described[path].example)
        at = at[step]
    name = place[-1]
    if place[0] == "cables" and name in {*ROUND, "inner_diameter"}:
        del at["stiffness"]
        at.update(ROUND)
    if name == "rpy":
        at.pop("orientation", None)
    if name in BELONGS and place[-2] in ("start", "end"):
        at["kind"] = BELONGS[name]
        if BELONGS[name] == FREE:
            del at["position"], at["orientation"]
    at[name] = value
    if "supports" in place[:-1] and (kinds := set(SUPPORTS) & set(place)):
        held = values["cables"][0]["supports"][0]
        for other in {*SUPPORTS} - kinds:
            held.pop(other, None)
    if place[0] == "obstacles" and len(place) > 1 and not set(SHAPES) & set(values["obstacles"][0]):
        values["obstacles"][0]["plane"] = {"point": [0, 0, -9], "normal": [0, 0, 1]}
    return values


def load(values: dict[str, Any], folder: Any) -> Scene:
    """Read as a file, where all bounds hold, with a robot whose visual geometry is its collision geometry."""
    text = Path(URDF).read_text(encoding="utf-8").replace("visual>", "collision>")
    (folder / Path(URDF).name).write_text(text)
    if values.get("robot") == {"urdf": URDF}:
        values = {**values, "robot": {"urdf": Path(URDF).name}}
    file = folder / "scene.yaml"
    file.write_text(yaml.safe_dump(values))
    return load_scene(file)


def written(place: Place) -> str:
    """The place as a message has it."""
    text = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in place)
    return text.lstrip(".")


@pytest.mark.parametrize(("place", "field"), NAMED)
def test_each_is_described_and_its_example_is_read(place, field, tmp_path):
    assert field.meaning.endswith(".")
    assert field.remedy
    if field.kind != "list of mappings":  # their entries' fields have examples of their own
        example = yaml.safe_load(field.example)
        load(scene_with(place, example), tmp_path)


@pytest.mark.parametrize(("place", "field"), NAMED)
def test_each_is_required_or_not_as_told(place, field, tmp_path):
    values = scene_with(place, yaml.safe_load(field.example) if field.kind != "list of mappings" else None)
    at = values
    for step in place[:-1]:
        at = at[step]
    del at[place[-1]]
    if (
        field.default is REQUIRED
        or "required" in field.absent
        or (place[-1] in SHAPES and place != ("robot",))
    ):
        with pytest.raises(SceneError):
            load(values, tmp_path)
    elif place != ("robot",):
        load(values, tmp_path)


@pytest.mark.parametrize(("place", "field"), SIZED)
def test_numbers_beyond_the_bounds_are_refused_in_the_unit_told(place, field, tmp_path):
    assert field.size is not None
    example = yaml.safe_load(field.example)
    for beyond in (field.size.low - max(1e-9, abs(field.size.low)), field.size.high * 1.001):
        value = beyond if not isinstance(example, list) else [beyond, *example[1:]]
        with pytest.raises(SceneError) as caught:
            load(scene_with(place, value), tmp_path)
        assert caught.value.field.startswith(written(place))
        assert f"{beyond:g} {field.size.unit}".strip() in caught.value.message
        assert caught.value.message.endswith(f"give {field.remedy}")


@pytest.mark.parametrize(("place", "field"), DEFAULTED)
def test_a_default_is_what_leaving_it_out_means(place, field, tmp_path):
    given = scene_with(place, field.default)
    left_out = copy.deepcopy(given)
    at = left_out
    for step in place[:-1]:
        at = at[step]
    del at[place[-1]]
    first, second = load(given, tmp_path), load(left_out, tmp_path)
    for name in ("friction_model", "effects"):
        assert getattr(first, name) == getattr(second, name)
    for one, other in zip(first.obstacles, second.obstacles, strict=True):
        assert (one.friction, one.cable_radius_counts) == (other.friction, other.cable_radius_counts)


def test_nothing_that_a_scene_holds_is_without_a_field():
    """The dataclasses' fields have the names of the file's, but for what is made of several."""
    names = {path[-1] for path, _ in ALL}
    made = {"text", "path", "source", "shape", "cable_radius_counts", "left_out_by", "cable_friction"}
    held = {one.name for kind in (Scene, Cable, Obstacle) for one in dataclasses.fields(kind)}
    assert held - names == made


def test_a_field_that_is_read_has_to_be_described():
    with pytest.raises(SceneError, match="there is no such field"):
        load_scene({**SMALLEST, "wind": 3})
    np.testing.assert_array_equal(load_scene(SMALLEST).gravity, [0, 0, -9.81])
