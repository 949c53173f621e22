# SPDX-License-Identifier: Apache-2.0
"""Which effects a scene calls for, and cables that follow their environment."""

from __future__ import annotations

import math
import pickle
from typing import Any

import numpy as np
import pytest

from cable_ros import Status, Tracker, load_scene
from cable_ros.effects.registry import ALL, called_for, properties, wanted
from cable_ros.scene import EFFECTS, Scene
from cable_ros.scene.text import parse_yaml
from cable_ros.share import share_file

COLD = share_file("config", "space_arm_cold.yaml")
POSE = {"orientation": 0.3}
CABLE = "camera_cable"


def changed(name: str, **fields: Any) -> Scene:
    """A shipped scene with other fields in its cable; a value of None takes one away."""
    path = share_file("config", name)
    values = parse_yaml(path.read_text(), str(path))
    values["robot"]["urdf"] = str(path.with_name(values["robot"]["urdf"]))
    for key, value in fields.items():
        place = values if key in ("effects", "gravity", "obstacles") else values["cables"][0]
        if value is None:
            place.pop(key)
        else:
            place[key] = value
    return load_scene(values)


def relative(found: np.ndarray, expected: np.ndarray, length: float = 0.38) -> float:
    unit = np.array([1.0] * 3 + [1 / length] * 3)
    return float(np.linalg.norm((found - expected) * unit) / np.linalg.norm(expected * unit))


def test_one_file_for_every_effect_that_a_scene_may_list() -> None:
    assert tuple(effect.NAME for effect in ALL) == EFFECTS


@pytest.mark.parametrize(
    ("scene", "expected"),
    [
        ("space_arm.yaml", ("weight",)),
        ("space_arm_cold.yaml", ("weight", "temperature", "dose")),
        ("space_arm_sphere.yaml", ("weight", "contact", "friction")),
        ("draped.yaml", ("weight", "contact")),
    ],
)
def test_shipped_scenes_call_for(scene: str, expected: tuple[str, ...]) -> None:
    loaded = changed(scene)
    assert called_for(loaded, loaded.cables[0]) == expected
    assert wanted(loaded, loaded.cables[0]) == expected


def test_a_list_lets_in_only_what_it_names() -> None:
    scene = changed("space_arm_cold.yaml", effects=["temperature", "stretch"])
    (cable,) = scene.cables
    assert wanted(scene, cable) == ("temperature",)
    found = properties(scene, cable)
    np.testing.assert_array_equal(found.weight, np.zeros(3))
    np.testing.assert_allclose(found.stiffness / cable.stiffness, [2.64, 2.64, 2.36])
    assert found.compliance is None


def test_cold_cable_is_the_cable_of_that_stiffness() -> None:
    cold = Tracker(load_scene(COLD), tolerance=1e-8).solve(POSE)[CABLE]
    factor = np.array([2.64 * 1.05] * 2 + [2.36 * 1.04])
    stiffness = (load_scene(COLD).cables[0].stiffness * factor).tolist()
    section = dict.fromkeys(("diameter", "youngs_modulus", "shear_modulus", "temperature", "dose"))
    plain = Tracker(changed("space_arm_cold.yaml", **section, stiffness=stiffness), tolerance=1e-8).solve(
        POSE
    )
    # The same numbers but for the rounding of the factors' product, on the mesh of either.
    assert relative(cold.end_wrench, plain[CABLE].end_wrench) < 1e-8


@pytest.mark.parametrize("temperature", [-79.0, -150.0, 20.0, 100.0])
def test_environment_is_followed_on_the_branch(temperature: float) -> None:
    tracker = Tracker(load_scene(COLD), tolerance=1e-6)
    twist = tracker.solve(POSE)[CABLE].total_twist
    tracker.set_environment({"temperature": temperature})
    warm = tracker.solve(POSE)[CABLE]
    fresh = Tracker(load_scene(COLD), tolerance=1e-8)
    fresh.set_environment({CABLE: {"temperature": temperature}})
    cold = fresh.solve(POSE)[CABLE]
    assert warm.status is cold.status is Status.CONVERGED
    assert abs(warm.total_twist - twist) < 0.5  # a whole turn would be another branch
    assert relative(warm.end_wrench, cold.end_wrench) < 2e-6  # both tolerances, and as much for the estimate
    # Warm: the way there took no search, which is told by the few iterations of the solve.
    assert warm.iterations <= 3


def test_environment_there_and_back() -> None:
    tracker = Tracker(load_scene(COLD), tolerance=1e-6)
    before = tracker.solve(POSE)[CABLE]
    for value in (100.0, -150.0, -80.0):
        tracker.set_environment({"temperature": value, "dose": 1e6})
    tracker.set_environment({CABLE: {"dose": 2e5}})
    after = tracker.solve(POSE)[CABLE]
    assert relative(after.end_wrench, before.end_wrench) < 2e-6


def test_environment_outlives_reset_and_goes_into_snapshots() -> None:
    tracker = Tracker(load_scene(COLD), tolerance=1e-6)
    tracker.set_environment({"temperature": 20.0})  # before the first solve
    first = tracker.solve(POSE)[CABLE]
    tracker.reset()
    assert relative(tracker.solve(POSE)[CABLE].end_wrench, first.end_wrench) < 2e-6
    snapshot = pickle.loads(pickle.dumps(tracker.snapshot()))
    other = Tracker(load_scene(COLD), tolerance=1e-6)
    other.restore(snapshot)
    assert relative(other.solve(POSE)[CABLE].end_wrench, first.end_wrench) < 2e-6
    other.set_environment({"dose": 2e5})  # as it is: the temperature stays that of the snapshot
    assert relative(other.solve(POSE)[CABLE].end_wrench, first.end_wrench) < 2e-6


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"temperatur": 1.0}, "no cable depends on 'temperatur'; it is dose and temperature that the scene"),
        ({"temperature": "warm"}, "temperature of cable 'camera_cable' must be a finite number in degC"),
        ({"temperature": math.nan}, "must be a finite number in degC"),
        ({"dose": None}, "dose of cable 'camera_cable' must be a finite number in Gy"),
        ({"temperature": 500}, "500 degC is outside the table, which ends at -150 and 100 degC"),
        ({"hose": {"temperature": 20.0}}, "there is no cable 'hose'; the cables are camera_cable"),
        ({CABLE: {"humidity": 1.0}}, "cable 'camera_cable' does not depend on 'humidity'"),
    ],
)
def test_environment_that_is_refused_changes_nothing(values: dict[str, Any], sentence: str) -> None:
    tracker = Tracker(load_scene(COLD), tolerance=1e-6)
    before = tracker.solve(POSE)[CABLE]
    with pytest.raises(ValueError, match=r"^[^\n]*$") as caught:
        tracker.set_environment({"dose": 1e6, **values})
    assert sentence in str(caught.value)
    assert relative(tracker.solve(POSE)[CABLE].end_wrench, before.end_wrench) < 1e-9


def test_a_scene_without_tables_says_so() -> None:
    with pytest.raises(ValueError, match="the scene gives it no table"):
        Tracker(changed("space_arm.yaml")).set_environment({"temperature": 20.0})


@pytest.mark.parametrize("friction", [0.0, 0.35])
def test_environment_changes_while_the_cable_touches(friction: float) -> None:
    temperature = parse_yaml(COLD.read_text(), str(COLD))["cables"][0]["temperature"]
    ball = {"sphere": {"center": [0.092, 0.010, -0.095], "radius": 0.045}, "friction": friction}
    scene = changed("space_arm_sphere.yaml", temperature=temperature, obstacles=[{"name": "ball", **ball}])
    tracker = Tracker(scene, tolerance=1e-4)
    for angle in np.radians(np.arange(30, 66, 3)):
        found = tracker.solve({"orientation": float(angle)})[CABLE]
    touched = []
    for value in (-50.0, 20.0, 100.0, -150.0, 60.0):
        tracker.set_environment({"temperature": value})
        found = tracker.solve({"orientation": float(angle)})[CABLE]
        assert found.status is Status.CONVERGED
        touched.append(len(found.contacts) > 0)
        if not friction:  # with it, the way counts
            fresh = Tracker(scene, tolerance=1e-5)
            fresh.set_environment({"temperature": value})
            cold = fresh.solve({"orientation": float(angle)})[CABLE]
            assert relative(found.end_wrench, cold.end_wrench) < 2e-4
    assert touched[2]  # warm and soft it rests on the ball,
    assert not touched[3]  # cold and stiff it is clear of it,
    assert touched[4]  # and comes back
