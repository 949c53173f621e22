# SPDX-License-Identifier: Apache-2.0
"""The tracker through the scene format: known equilibria cold, the arm tracked, faults, state."""

from __future__ import annotations

import copy
import math
import pickle
from typing import Any

import numpy as np
import pytest
from references.equilibria import KNOWN, Known
from scipy.spatial.transform import Rotation

from cable_ros import Equilibrium, Status, Tracker, load_scene
from cable_ros.share import share_file

ARM = share_file("config", "space_arm.yaml")
NAME = "camera_cable"
WHOLE = np.radians(np.concatenate([np.arange(-90, 91), np.arange(89, -91, -1)]))
"""-90 to 90 degrees and back, rad."""


def cold(known: Known, tolerance: float, **fields: Any) -> Equilibrium:
    found = Tracker(load_scene(known.scene(**fields)), tolerance=tolerance).solve({})["cable"]
    assert found.status is Status.CONVERGED, found.message
    assert found.converged
    return found


def errors(found: np.ndarray, expected: np.ndarray) -> tuple[float, float]:
    """Of force and moment, each relative to its own size."""
    force, moment = found[:3] - expected[:3], found[3:] - expected[3:]
    return (
        float(np.linalg.norm(force) / np.linalg.norm(expected[:3])),
        float(np.linalg.norm(moment) / np.linalg.norm(expected[3:])),
    )


# Known equilibria, cold


# 1e-6 at a tolerance of 1e-7: the wrenches of the file are good to about 1e-9.
@pytest.mark.parametrize(("tolerance", "allowed"), [(1e-2, 1e-2), (1e-4, 1e-4), (1e-7, 1e-6)])
@pytest.mark.parametrize("name", KNOWN)
def test_known_equilibrium_cold_on_the_branch_of_the_target_twist(
    name: str, tolerance: float, allowed: float
) -> None:
    known = KNOWN[name]
    found = cold(known, tolerance, total_twist=known.total_twist)
    force, moment = errors(found.end_wrench, known.end_wrench)
    assert force < allowed
    assert moment < allowed
    assert found.stable
    assert found.error_estimate <= tolerance
    # A few times the wrench's relative error, in radians; the twist is of the order of a few.
    assert found.total_twist == pytest.approx(known.total_twist, abs=10 * allowed)
    # The margin is a property of the shape; inverse iteration leaves 1e-4 of it.
    assert found.stability_margin == pytest.approx(known.margin, rel=max(1e-3, 30 * tolerance))


@pytest.mark.parametrize("name", KNOWN)
def test_known_energy_and_the_least_one_without_a_target_twist(name: str) -> None:
    known = KNOWN[name]
    # The file's energies are good to 3e-6; where they pass through zero, of what elastic energy and work are.
    scale = abs(known.energy) + known.units.moment + float(np.linalg.norm(known.weight)) * known.length**2
    # The file's heights are those above the start clamp.
    energy = known.energy - float(known.weight @ known.start[:3]) * known.length
    hinted = cold(known, 1e-7, total_twist=known.total_twist)
    assert hinted.energy == pytest.approx(energy, abs=3e-6 * scale)
    free = cold(known, 1e-7)
    assert free.stable
    assert free.energy <= energy + 3e-6 * scale


@pytest.mark.parametrize("name", ["space_arm_+30.0deg", "cable_03"])
def test_shape_lies_between_the_clamps(name: str) -> None:
    known = KNOWN[name]
    found = cold(known, 1e-7, total_twist=known.total_twist)
    for i, clamp in ((0, known.start), (-1, known.end)):
        assert found.points[i] == pytest.approx(clamp[:3], abs=1e-9)
        assert abs(found.orientations[i] @ clamp[3:]) == pytest.approx(1.0, abs=1e-12)
    # The z axis of every section is the tangent: fourth-order differences along the polyline.
    r, ds = found.points, known.length / 100
    slope = (r[:-4] - 8 * r[1:-3] + 8 * r[3:-1] - r[4:]) / (12 * ds)
    tangent = Rotation.from_quat(found.orientations[2:-2]).apply([0.0, 0.0, 1.0])
    assert np.abs(slope - tangent).max() < 1e-3


# The arm, tracked


@pytest.fixture(scope="module")
def sweep() -> list[Equilibrium]:
    tracker = Tracker(load_scene(ARM))
    return [tracker.solve({"orientation": angle})[NAME] for angle in WHOLE]


def test_the_way_back_passes_through_the_same_equilibria(sweep: list[Equilibrium]) -> None:
    for there, back in zip(sweep[:181], sweep[:179:-1], strict=True):
        assert errors(back.end_wrench, there.end_wrench) < (1e-6, 1e-6)
        assert back.total_twist == pytest.approx(there.total_twist, abs=1e-6)


def test_every_step_of_a_degree_takes_at_most_three_iterations(sweep: list[Equilibrium]) -> None:
    assert max(found.iterations for found in sweep[1:]) <= 3


def test_every_step_is_a_stable_equilibrium_of_one_branch(sweep: list[Equilibrium]) -> None:
    assert {found.status for found in sweep} == {Status.CONVERGED}
    assert all(found.stable for found in sweep)
    assert min(found.stability_margin for found in sweep) > 0.1
    assert max(found.error_estimate for found in sweep) <= 1e-4
    twists = np.array([found.total_twist for found in sweep])
    assert np.abs(np.diff(twists)).max() < 0.05


@pytest.mark.parametrize("name", [name for name in KNOWN if name.startswith("space_arm")])
def test_tracked_equilibria_are_the_known_ones(sweep: list[Equilibrium], name: str) -> None:
    known = KNOWN[name]
    angle = round(float(name.removeprefix("space_arm_").removesuffix("deg")))
    force, moment = errors(sweep[angle + 90].end_wrench, known.end_wrench)
    # The tolerance; the scene file gives moduli and diameter, from which the same stiffness follows.
    assert max(force, moment) < 1e-4


def test_wrenches_change_smoothly(sweep: list[Equilibrium]) -> None:
    """No jitter from the mesh or the iteration: second differences as small as the true solution's."""
    force = np.array([found.end_wrench for found in sweep[:181]])
    size = np.linalg.norm(force[:, :3], axis=1)
    third = np.linalg.norm(np.diff(force[:, :3], 3, axis=0), axis=1) / size[1:-2]
    # Smooth on the scale of some 10 degrees: third differences of about 1e-3 of the size at most; away from
    # -90 degrees, where the cable is nearly taut and the force steep, a tenth of that.
    assert third[30:].max() < 1e-4


def test_a_jump_arrives_where_steps_lead(sweep: list[Equilibrium]) -> None:
    tracker = Tracker(load_scene(ARM))
    tracker.solve({"orientation": WHOLE[0]})
    for index in (180, 20, 175, 176, 90, 0):
        found = tracker.solve({"orientation": WHOLE[index]})[NAME]
        # Two answers, each within the tolerance.
        assert max(errors(found.end_wrench, sweep[index].end_wrench)) < 2e-4
        assert found.total_twist == pytest.approx(sweep[index].total_twist, abs=1e-3)


def test_standing_still_changes_nothing(sweep: list[Equilibrium]) -> None:
    tracker = Tracker(load_scene(ARM))
    first = tracker.solve({"orientation": 0.3})[NAME]
    for by in (0.0, 0.0, 1e-9, -1e-9, 0.0):
        again = tracker.solve({"orientation": 0.3 + by})[NAME]
        assert again.status is Status.CONVERGED
        # The iteration leaves a thousandth of the tolerance.
        assert max(errors(again.end_wrench, first.end_wrench)) < 1e-6


@pytest.mark.parametrize("tolerance", [1e-2, 1e-5, 1e-8])
def test_tracked_answers_keep_other_tolerances(tolerance: float) -> None:
    tracker = Tracker(load_scene(ARM), tolerance=tolerance)
    for degrees in range(-90, 91, 5):
        found = tracker.solve({"orientation": math.radians(degrees)})[NAME]
        assert found.error_estimate <= tolerance
        known = KNOWN.get(f"space_arm_{degrees:+.1f}deg")
        if known:
            # The scene file's weight is that of 1 N/m to seven digits.
            assert max(errors(found.end_wrench, known.end_wrench)) < max(tolerance, 3e-7)


# Input


@pytest.mark.parametrize(
    ("joints", "says"),
    [
        ({}, "missing"),
        ({"pitch": 0.1}, "missing"),
        ({"orientation": math.nan}, "finite"),
        ({"orientation": math.inf}, "finite"),
        ({"orientation": -math.inf}, "finite"),
        ({"orientation": 1e5}, "within"),
        ({"orientation": None}, "number"),
        ({"orientation": "far"}, "number"),
        ({"orientation": [1.0, 2.0]}, "number"),
    ],
)
def test_unusable_input_is_told_and_forgotten(joints: dict[str, Any], says: str) -> None:
    tracker, other = Tracker(load_scene(ARM)), Tracker(load_scene(ARM))
    for one in (tracker, other):
        one.solve({"orientation": 0.1})
    bad = tracker.solve(joints)[NAME]
    assert bad.status is Status.INVALID_INPUT
    assert not bad.converged
    assert not bad.stable
    assert "orientation" in bad.message
    assert says in bad.message
    assert np.isnan(bad.end_wrench).all()
    assert np.isnan(bad.points).all()
    assert bad.points.shape == (101, 3)
    assert np.isnan(bad.stiffness).all()
    # It leaves no trace: the next pose is followed from the last usable one, bit for bit.
    after, without = (one.solve({"orientation": 0.12})[NAME] for one in (tracker, other))
    assert np.array_equal(after.end_wrench, without.end_wrench)


def test_unusable_input_first() -> None:
    tracker = Tracker(load_scene(ARM))
    assert tracker.solve({"orientation": math.nan})[NAME].status is Status.INVALID_INPUT
    assert tracker.solve({"orientation": 0.0})[NAME].status is Status.CONVERGED


def test_other_joints_are_ignored() -> None:
    tracker = Tracker(load_scene(ARM))
    assert tracker.joint_names == ("orientation",)
    joints = {"pitch": math.nan, "orientation": 0.2, "": "nonsense"}
    assert tracker.solve(joints)[NAME].status is Status.CONVERGED


def test_numbers_of_other_types() -> None:
    found = [
        Tracker(load_scene(ARM)).solve({"orientation": kind(1)})[NAME].end_wrench
        for kind in (float, int, np.float32, np.array)
    ]
    assert all(np.array_equal(one, found[0]) for one in found)


@pytest.mark.parametrize("tolerance", [0.0, -1e-4, 1e-13, 0.2, math.nan, math.inf])
def test_tolerance_out_of_range(tolerance: float) -> None:
    with pytest.raises(ValueError, match=r"tolerance is .*; give the accepted relative error"):
        Tracker(load_scene(ARM), tolerance=tolerance)
    tracker = Tracker(load_scene(ARM))
    with pytest.raises(ValueError, match="tolerance is"):
        tracker.tolerance = tolerance
    assert tracker.tolerance == 1e-4


@pytest.mark.parametrize("count", [1, 0, -5, 10**12])
def test_polyline_points_out_of_range(count: int) -> None:
    with pytest.raises(ValueError, match=r"polyline_points is .*; give 2 to 100001"):
        Tracker(load_scene(ARM), polyline_points=count)
    tracker = Tracker(load_scene(ARM))
    with pytest.raises(ValueError, match="polyline_points is"):
        tracker.polyline_points = count
    assert tracker.polyline_points == 101


# State


def path(tracker: Tracker, *angles: float) -> list[Equilibrium]:
    return [tracker.solve({"orientation": angle})[NAME] for angle in angles]


def same(a: Equilibrium, b: Equilibrium) -> bool:
    return (
        a.status is b.status
        and np.array_equal(a.end_wrench, b.end_wrench)
        and np.array_equal(a.start_wrench, b.start_wrench)
        and np.array_equal(a.points, b.points)
        and a.stability_margin == b.stability_margin
        and a.error_estimate == b.error_estimate
        and a.iterations == b.iterations
    )


def test_reset_starts_over() -> None:
    tracker = Tracker(load_scene(ARM))
    first = path(tracker, 0.4, 0.5, -0.2)
    tracker.reset()
    assert all(same(a, b) for a, b in zip(first, path(tracker, 0.4, 0.5, -0.2), strict=True))


def test_snapshot_and_restore() -> None:
    scene = load_scene(ARM)
    tracker = Tracker(scene)
    path(tracker, 0.0, 0.3, 0.31)
    kept = pickle.loads(pickle.dumps(tracker.snapshot()))
    first = path(tracker, 0.33, 0.5, 0.4)
    path(tracker, -1.0)
    tracker.restore(kept)
    again = path(tracker, 0.33, 0.5, 0.4)
    assert all(same(a, b) for a, b in zip(first, again, strict=True))
    # Another tracker of the same scene goes on from it as well, and using it does not use it up.
    other = Tracker(scene)
    other.restore(kept)
    assert all(same(a, b) for a, b in zip(first, path(other, 0.33, 0.5, 0.4), strict=True))


def test_a_restored_tracker_keeps_its_own_settings() -> None:
    scene = load_scene(ARM)
    fine = Tracker(scene, tolerance=1e-8, polyline_points=5)
    coarse = Tracker(scene)
    path(coarse, 0.2)
    fine.restore(coarse.snapshot())
    (found,) = path(fine, 0.2)
    assert found.points.shape == (5, 3)
    assert found.error_estimate <= 1e-8
    (again,) = path(coarse, 0.2)
    assert again.points.shape == (101, 3)


def test_settings_change_under_way() -> None:
    tracker = Tracker(load_scene(ARM))
    (before,) = path(tracker, 0.2)
    tracker.tolerance = 1e-9
    tracker.polyline_points = 11
    (after,) = path(tracker, 0.2)
    assert after.error_estimate <= 1e-9
    assert after.points == pytest.approx(before.points[::10], abs=1e-4 * 0.38)
    assert max(errors(before.end_wrench, after.end_wrench)) < 1e-4
    assert after.total_twist == pytest.approx(before.total_twist, abs=1e-3)
    tracker.tolerance = 1e-3
    (coarser,) = path(tracker, 0.21)
    assert coarser.status is Status.CONVERGED


def test_a_result_does_not_change_when_the_tracker_goes_on() -> None:
    tracker = Tracker(load_scene(ARM))
    (first,) = path(tracker, 0.2)
    late = copy.deepcopy(first)
    path(tracker, 0.25, -0.5, 1.2)
    # Also what is computed when it is first read.
    assert same(first, late)
    fresh = Tracker(load_scene(ARM))
    (again,) = path(fresh, 0.2)
    assert first.stiffness == pytest.approx(
        again.stiffness, rel=1e-9, abs=1e-9 * np.abs(again.stiffness).max()
    )


def test_fields_of_a_result_by_name() -> None:
    (found,) = path(Tracker(load_scene(ARM), polyline_points=3), 0.2)
    fields = found.as_dict()
    assert {
        "status",
        "converged",
        "stable",
        "stability_margin",
        "end_wrench",
        "start_wrench",
        "points",
    } <= set(fields)
    assert {"orientations", "total_twist", "energy", "error_estimate", "iterations", "solve_time"} <= set(
        fields
    )
    assert fields["stiffness"].shape == (6, 6)
    assert not any(name.startswith("_") for name in fields)
    assert found.solve_time > 0.0


# Several cables


def two_cables() -> dict[str, Any]:
    arm = KNOWN["space_arm_+0.0deg"].scene(total_twist=-2.7)["cables"][0]
    other = KNOWN["cable_05"].scene()["cables"][0]
    return {"gravity": [0.0, 0.0, -1.0], "cables": [{**arm, "name": "one"}, {**other, "name": "two"}]}


def test_several_cables_are_each_their_own() -> None:
    mapping = two_cables()
    both = Tracker(load_scene(mapping)).solve({})
    assert list(both) == ["one", "two"]
    for cable in mapping["cables"]:
        alone = Tracker(load_scene({**mapping, "cables": [cable]})).solve({})[cable["name"]]
        assert same(both[cable["name"]], alone)


def test_one_cable_out_of_reach_leaves_the_other() -> None:
    mapping = two_cables()
    mapping["cables"][1]["length"] = 0.5 * math.dist(
        mapping["cables"][1]["start"]["position"], mapping["cables"][1]["end"]["position"]
    )
    found = Tracker(load_scene(mapping)).solve({})
    assert found["one"].status is Status.CONVERGED
    assert found["two"].status is Status.OUT_OF_REACH
    assert "farther apart than the cable is long" in found["two"].message
    assert np.isnan(found["two"].end_wrench).all()
