# SPDX-License-Identifier: Apache-2.0
"""`effects: auto` leaves out what does not matter and notices a change; absent effects cost nothing."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

from cable_ros import Equilibrium, Status, Tracker, load_scene
from cable_ros.contact import touching_rod
from cable_ros.rod import extensible, kirchhoff
from cable_ros.scene import Scene
from cable_ros.scene.text import parse_yaml
from cable_ros.share import share_file

CABLE = "camera_cable"


def arm(effects: Any = None, **fields: Any) -> Scene:
    """The arm with more fields in its cable, and a choice of effects."""
    path = share_file("config", "space_arm.yaml")
    values: dict[str, Any] = parse_yaml(path.read_text(), str(path))
    values["robot"]["urdf"] = str(path.with_name("space_arm.urdf"))
    values["cables"][0].update(fields)
    if effects is not None:
        values["effects"] = effects
    return load_scene(values)


def stiffer(part: float) -> dict[str, Any]:
    """A temperature that changes the stiffness by that part at 20 degC, and twenty times that at 40 degC."""
    rows = [[20, 1 + part, 1 + part], [40, 1 + 20 * part, 1 + 20 * part]]
    return {"temperature": {"value": 20, "table": rows}}


def sweep(tracker: Tracker, degrees: Any) -> list[Equilibrium]:
    return [tracker.solve({"orientation": np.radians(d)})[CABLE] for d in degrees]


def error(found: Equilibrium, expected: Equilibrium) -> float:
    unit = np.array([1.0] * 3 + [1 / 0.38] * 3)
    return float(
        np.linalg.norm((found.end_wrench - expected.end_wrench) * unit)
        / np.linalg.norm(expected.end_wrench * unit)
    )


def test_small_effects_are_left_out_and_told() -> None:
    tracker = Tracker(arm("auto", natural_strain=[1e-5, 0, 0], **stiffer(1e-6)), tolerance=1e-3)
    (found,) = sweep(tracker, [20])
    assert tracker.left_out == {CABLE: ("natural_strain", "temperature")} or tracker.left_out == {
        CABLE: ("temperature", "natural_strain")
    }
    assert "Left out: " in found.message
    assert "temperature" in found.message
    assert "natural_strain" in found.message
    # Exactly the equations without them.
    (plain,) = sweep(Tracker(arm(), tolerance=1e-3), [20])
    assert error(found, plain) < 1e-3
    assert plain.message == Status.CONVERGED.sentence


def test_what_matters_stays() -> None:
    tracker = Tracker(arm("auto", natural_strain=[0.5, 0, 0], **stiffer(0.05)), tolerance=1e-3)
    (found,) = sweep(tracker, [20])
    assert tracker.left_out == {CABLE: ()}
    assert found.message == Status.CONVERGED.sentence
    (everything,) = sweep(Tracker(arm("all", natural_strain=[0.5, 0, 0], **stiffer(0.05)), 1e-3), [20])
    np.testing.assert_array_equal(found.end_wrench, everything.end_wrench)


def test_tolerance_decides() -> None:
    scene = arm("auto", **stiffer(1e-4))
    left_out = {}
    tracker = Tracker(scene, tolerance=1e-2)
    for tolerance in (1e-2, 1e-4, 1e-2):
        tracker.tolerance = tolerance
        sweep(tracker, [0])
        left_out[tolerance] = tracker.left_out[CABLE]
    # The stiffness moves the wrench by about as much as itself: 1e-4, beside a tenth of the tolerance.
    assert left_out == {1e-2: ("temperature",), 1e-4: ()}


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4])
def test_error_stays_within_the_tolerance_along_a_sweep(tolerance: float) -> None:
    fields = {"natural_strain": [2e-5, 1e-5, 0], "axial_stiffness": 2e3, **stiffer(3e-5)}
    degrees = np.arange(-90, 91, 5)
    reduced = sweep(Tracker(arm("auto", **fields), tolerance), degrees)
    exact = sweep(Tracker(arm("all", **fields), tolerance / 100), degrees)
    assert max(error(a, b) for a, b in zip(reduced, exact, strict=True)) < tolerance
    assert all("Left out" in one.message for one in reduced) or tolerance < 1e-2


def test_guard_takes_stretch_in_when_the_cable_gets_taut() -> None:
    # A cable between a fixed clamp and one that a lift pulls away: slack first, then taut.
    urdf = """<robot name="r"><link name="a"/><link name="b"/><joint name="pull" type="prismatic">
        <parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
        <limit lower="0" upper="2" effort="1" velocity="1"/></joint></robot>"""
    scene = {
        "gravity": [0, -9.81, 0],
        "effects": "auto",
        "cables": [
            {
                "name": "cable",
                "length": 1.0,
                "stiffness": [0.02, 0.02, 0.015],
                "linear_density": 0.05,
                "axial_stiffness": 2e4,
                "start": {"position": [0, 0, 0], "orientation": [0, 0, 0, 1]},
                "end": {"link": "b", "position": [0, 0, 0], "orientation": [0, 0, 0, 1]},
            }
        ],
    }
    tracker = Tracker(load_scene(scene, urdf=urdf), tolerance=1e-2)
    exact = Tracker(load_scene({**scene, "effects": "all"}, urdf=urdf), tolerance=1e-4)
    seen = []
    for pull in np.concatenate([np.linspace(0.8, 0.99, 20), np.linspace(0.99, 1.001, 12)]):
        found, expected = (one.solve({"pull": pull})["cable"] for one in (tracker, exact))
        assert found.status is expected.status is Status.CONVERGED, pull
        seen.append("stretch" in tracker.left_out["cable"])
        change = np.linalg.norm(found.end_wrench[:3] - expected.end_wrench[:3])
        assert change < 1e-2 * np.linalg.norm(expected.end_wrench[:3])
    assert seen[0]
    assert not seen[-1]


def test_environment_is_measured_anew() -> None:
    tracker = Tracker(arm("auto", **stiffer(1e-4)), tolerance=1e-2)
    sweep(tracker, [0])
    assert tracker.left_out[CABLE] == ("temperature",)
    tracker.set_environment({"temperature": 40.0})  # a change of 2e-3, above a tenth of the tolerance
    (found,) = sweep(tracker, [0])
    assert tracker.left_out[CABLE] == ()
    expected = Tracker(arm("all", **stiffer(1e-4)), tolerance=1e-5)
    expected.set_environment({"temperature": 40.0})
    assert error(found, sweep(expected, [0])[0]) < 1e-3


def test_choice_is_part_of_the_snapshot_and_ends_with_reset() -> None:
    scene = arm("auto", **stiffer(1e-4))
    tracker = Tracker(scene, tolerance=1e-2)
    sweep(tracker, [0, 10])
    snapshot = pickle.loads(pickle.dumps(tracker.snapshot()))
    other = Tracker(scene, tolerance=1e-2)
    other.restore(snapshot)
    assert other.left_out == tracker.left_out
    np.testing.assert_array_equal(sweep(other, [12])[0].end_wrench, sweep(tracker, [12])[0].end_wrench)
    tracker.reset()
    fresh = sweep(Tracker(scene, tolerance=1e-2), [5])[0]
    np.testing.assert_array_equal(sweep(tracker, [5])[0].end_wrench, fresh.end_wrench)


POSES = (0, 10, 12, 40, 12)


@pytest.mark.parametrize(
    ("effects", "fields"),
    [
        ("all", {}),
        ("auto", {}),
        (["weight"], {}),
        (["weight"], {"axial_stiffness": 10.0, "shear_stiffness": [5.0, 5.0]}),
        (["weight"], {"natural_strain": [3.0, 2.0, 1.0], **stiffer(0.5)}),
        ("all", {"natural_strain": [0.0, 0.0, 0.0]}),
    ],
)
def test_an_absent_effect_leaves_every_bit_and_call_as_it_was(
    effects: Any, fields: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: dict[str, int] = {}

    def counted(owner: Any, name: str) -> None:
        function = getattr(owner, name)

        def wrapper(*args: Any, **keywords: Any) -> Any:
            calls[name] = calls.get(name, 0) + 1
            return function(*args, **keywords)

        monkeypatch.setattr(owner, name, wrapper)

    for owner, name in (
        (kirchhoff.entry_points, "linearize"),
        (kirchhoff.warm_step, "advance"),
        (kirchhoff.entry_points, "factor"),
        (kirchhoff.error_estimate, "error"),
        (kirchhoff.entry_points, "saddle_step"),
    ):
        counted(owner, name)
    expected = sweep(Tracker(arm(None)), POSES)
    plain = dict(calls)
    assert plain["advance"] >= len(POSES) - 1
    calls.clear()
    # Whatever an absent effect would build cannot be built.
    for owner in (extensible.StretchingRod, touching_rod.TouchingRod):
        monkeypatch.setattr(owner, "__init__", None)
    found = sweep(Tracker(arm(effects, **fields)), POSES)
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_array_equal(a.end_wrench, b.end_wrench)
        np.testing.assert_array_equal(a.points, b.points)
        assert (a.energy, a.error_estimate, a.iterations) == (b.energy, b.error_estimate, b.iterations)
    if effects != "auto":
        assert calls == plain
    else:  # what is measured at the cold start, to see that the weight matters
        assert calls["advance"] - plain["advance"] <= 20


@pytest.mark.parametrize("tolerance", [1e-3, 1e-4])
def test_with_contact_and_friction(tolerance: float) -> None:
    fields = {"natural_strain": [1e-4, 0, 0], **stiffer(2e-5)}
    sphere = parse_yaml(share_file("config", "space_arm_sphere.yaml").read_text(), "sphere")
    scenes = []
    for effects in ("auto", "all"):
        scene = arm(effects, **fields)
        values = parse_yaml(scene.text, "arm")
        scenes.append(load_scene({**values, "obstacles": sphere["obstacles"], "cable_radius": "ignore"}))
    reduced, exact = (Tracker(scene, tolerance) for scene in scenes)
    left_out = []
    touched = 0
    for degrees in [*range(0, 76, 3), *range(75, -1, -3)]:
        (a,), (b,) = sweep(reduced, [degrees]), sweep(exact, [degrees])
        assert a.status is b.status is Status.CONVERGED
        touched += len(b.contacts) > 0
        left_out.append(reduced.left_out[CABLE])
        # Both solves' errors and what is left out: stick and slip may answer to either a little more.
        assert error(a, b) < 3 * tolerance
    assert touched > 20
    assert left_out[0]
    assert all("contact" not in names for names in left_out)
