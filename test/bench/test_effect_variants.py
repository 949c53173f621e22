# SPDX-License-Identifier: Apache-2.0
"""A scene with one effect more at a time."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cable_ros import Tracker
from cable_ros.bench.effect_variants import edited, nothing, plain, variants
from cable_ros.scene import SceneError, load_scene
from cable_ros.share import share_file

MIDDLE = np.array([0.0])


@pytest.fixture(scope="module")
def scene():
    return load_scene(share_file("config", "space_arm.yaml"))


@pytest.fixture(scope="module")
def by_name(scene):
    return dict(variants(scene, MIDDLE))


def test_each_variant_adds_its_effect_and_no_other(scene, by_name):
    assert list(by_name) == [
        "no weight",
        "weight",
        "natural curvature",
        "temperature, dose",
        "stretch, shear",
        "a ball",
        "sliding friction",
        "Coulomb friction",
    ]
    assert not by_name["no weight"].gravity.any()
    assert by_name["weight"] is scene
    assert plain(scene)
    expected = {
        "no weight": set(),
        "weight": set(),
        "natural curvature": {"natural"},
        "temperature, dose": {"influences"},
        "stretch, shear": {"stretch"},
        "a ball": {"ball"},
        "sliding friction": {"ball", "friction"},
        "Coulomb friction": {"ball", "friction"},
    }
    for name, one in by_name.items():
        cable = one.cables[0]
        called_for = {
            "natural": cable.natural_strain is not None,
            "influences": cable.temperature is not None and cable.dose is not None,
            "stretch": cable.axial_stiffness is not None and cable.shear_stiffness is not None,
            "ball": bool(one.obstacles),
            "friction": any(obstacle.friction > 0 for obstacle in one.obstacles),
        }
        assert {effect for effect, on in called_for.items() if on} == expected[name], name
    assert by_name["sliding friction"].friction_model == "sliding"


def test_every_effect_is_felt(by_name):
    forces = {}
    for name, one in by_name.items():
        tracker = Tracker(one)
        for degrees in range(-30, 1, 2):  # led there, all are on the branch of the scene
            (found,) = tracker.solve({"orientation": math.radians(degrees)}).values()
        assert found.status.trusted, name
        assert bool(found.contacts) == bool(one.obstacles), name
        forces[name] = found.end_wrench
    for name, before in (
        ("no weight", "weight"),
        ("natural curvature", "weight"),
        ("temperature, dose", "weight"),
        ("stretch, shear", "weight"),
        ("a ball", "weight"),
        ("sliding friction", "a ball"),
        ("Coulomb friction", "a ball"),
    ):
        difference = np.linalg.norm(forces[name] - forces[before]) / np.linalg.norm(forces[before])
        assert difference > 1e-3, name  # ten times the tolerance of each


def test_a_scene_with_obstacles_gets_no_ball():
    sphere = load_scene(share_file("config", "space_arm_sphere.yaml"))
    assert not plain(sphere)
    names = [name for name, _ in variants(sphere, MIDDLE)]
    assert names == ["no weight", "as it is", "natural curvature", "temperature, dose", "stretch, shear"]


def test_a_change_that_no_scene_may_have_is_a_scene_error(scene):
    with pytest.raises(SceneError, match="gravity"):
        edited(scene, {"gravity": "down"}, nothing)
