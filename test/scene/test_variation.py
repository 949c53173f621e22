# SPDX-License-Identifier: Apache-2.0
"""The same scene with other numbers."""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros.scene import SceneError, load_scene, vary

CLAMP = {"position": [0, 0, 0], "orientation": [0, 0, 0, 1]}
CABLE = {"length": 0.4, "stiffness": [1e-3, 1e-3, 7e-4], "linear_density": 0.1, "start": CLAMP, "end": CLAMP}


@pytest.fixture
def scene():
    return load_scene(
        {"gravity": [0, 0, -9.8], "cables": [{"name": name, **CABLE} for name in ("left", "right")]}
    )


def test_a_field_of_every_cable(scene):
    assert [cable.length for cable in vary(scene, {"length": 0.5}).cables] == [0.5, 0.5]
    assert [cable.length for cable in scene.cables] == [0.4, 0.4]


def test_a_field_of_one_cable(scene):
    assert [cable.length for cable in vary(scene, {"right.length": 0.5}).cables] == [0.4, 0.5]


def test_a_number_in_a_list(scene):
    changed = vary(scene, {"gravity.2": -1.62, "left.end.position.0": 0.2, "stiffness.1": 2e-3})
    assert np.array_equal(changed.gravity, [0, 0, -1.62])
    assert [cable.end.position[0] for cable in changed.cables] == [0.2, 0.0]
    assert [cable.stiffness[1] for cable in changed.cables] == [2e-3, 2e-3]


def test_a_hint_that_the_scene_does_not_have(scene):
    assert [cable.total_twist for cable in vary(scene, {"left.total_twist": 3.0}).cables] == [3.0, None]


@pytest.mark.parametrize("path", ["lenght", "end.position.7", "end.posture.0", "middle.length", "length.0"])
def test_no_such_field(scene, path):
    with pytest.raises(SceneError, match="there is no such"):
        vary(scene, {path: 0.1})


def test_a_refused_value(scene):
    with pytest.raises(SceneError, match="length"):
        vary(scene, {"length": -1.0})


def test_the_robot_stays(tmp_path):
    """A URDF named relative to the scene's file is found although the varied scene has no file."""
    (tmp_path / "arm.urdf").write_text(
        '<robot name="arm"><link name="base"/><link name="hand"/><joint name="elbow" type="revolute">'
        '<parent link="base"/><child link="hand"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
    )
    (tmp_path / "scene.yaml").write_text(
        "robot: {urdf: arm.urdf}\ngravity: [0, 0, -9.8]\ncables:\n"
        "  - {name: one, length: 0.4, stiffness: [1e-3, 1e-3, 7e-4], linear_density: 0.1,\n"
        "     start: {position: [0, 0, 0], orientation: [0, 0, 0, 1]},\n"
        "     end: {link: hand, position: [0.2, 0, 0], orientation: [0, 0, 0, 1]}}\n"
    )
    changed = vary(load_scene(tmp_path / "scene.yaml"), {"length": 0.5})
    assert changed.robot is not None
    assert changed.cables[0].length == 0.5
