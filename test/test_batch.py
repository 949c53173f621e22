# SPDX-License-Identifier: Apache-2.0
"""Many poses at once: the same numbers as a tracker's, on any number of processes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from references import planar
from zoo_make import led

from cable_ros import Status, Tracker, load_scene
from cable_ros.batch import CHUNK, Batch, solve_many, solve_paths
from cable_ros.bench.cases import case_scene
from cable_ros.joint import joint_torque, joint_torques
from cable_ros.share import share_file


@pytest.fixture(scope="module")
def arm():
    return load_scene(share_file("config", "space_arm.yaml"))


def _equal(a: Batch, b: Batch) -> bool:
    names = [field.name for field in dataclasses.fields(Batch)][4:-4]
    return all(
        np.array_equal(getattr(a, name), getattr(b, name), equal_nan=getattr(a, name).dtype == float)
        for name in names
    )


def test_it_is_what_a_tracker_finds(arm):
    angles = np.radians(np.arange(-90, 90.01, 1.0))
    batch = solve_many(arm, angles)
    tracker = Tracker(arm, polyline_points=2)
    assert batch.cables == ("camera_cable",)
    assert batch.joints.shape == (181, 1)
    assert batch.trusted.all()
    for index, angle in enumerate(angles):
        found = tracker.solve({"orientation": angle})["camera_cable"]
        # Both are within the tolerance of the truth, so within twice of each other.
        scale = np.linalg.norm(found.end_wrench[:3])
        assert batch.end_wrench[index, 0, :3] == pytest.approx(found.end_wrench[:3], abs=2e-4 * scale)
        assert batch.total_twist[index, 0] == pytest.approx(found.total_twist, abs=1e-2)


def test_joint_load_is_that_of_each_pose(arm):
    two = dataclasses.replace(arm, cables=(arm.cables[0], dataclasses.replace(arm.cables[0], name="other")))
    poses = np.radians(np.arange(0.0, 10.0, 2.0))
    batch = solve_many(two, poses)
    tracker = Tracker(two, polyline_points=2)
    for pose, load in zip(poses, batch.joint_load, strict=True):
        joints = {"orientation": float(pose)}
        # Another way to the same pose: twice the tolerance, of force and moment together.
        assert load == pytest.approx(joint_torque(tracker, tracker.solve(joints), joints), rel=1e-3)
    row = tracker.solve({"orientation": 0.1})
    (one,) = joint_torques(tracker, [row], np.array([[0.1]]))
    assert one == pytest.approx(joint_torque(tracker, row, {"orientation": 0.1}), rel=1e-12)
    lost = {"other": dataclasses.replace(row["other"], status=Status.NOT_CONVERGED)}
    both = joint_torques(tracker, [row | lost, row], np.full((2, 1), 0.1))
    assert np.isnan(both[0]).all()
    assert both[1] == one


def test_the_number_of_processes_changes_no_bit(arm):
    angles = np.radians(np.linspace(-90, 90, 2 * CHUNK + 5))
    assert _equal(solve_many(arm, angles, workers=1), solve_many(arm, angles, workers=2))


def _as_tracked(scene, poses: np.ndarray, batch: Batch) -> None:
    """The batch is what a tracker finds that is led along the path."""
    tracker = Tracker(scene, polyline_points=2)
    for i, pose in enumerate(poses):
        (found,) = tracker.solve(dict(zip(tracker.joint_names, pose, strict=True))).values()
        # Twice the tolerance, as above, of force and moment together.
        apart = np.linalg.norm(batch.end_wrench[i, 0] - found.end_wrench)
        assert apart < 4e-4 * np.linalg.norm(found.end_wrench)


def test_what_snaps_within_a_stride_stays_snapped():
    """An arch is turned beyond its fold and most of the way back while the stride does not look."""
    yaw = np.radians([*np.linspace(-20, 60, 33), *np.linspace(60, 0, CHUNK - 33), *np.linspace(0, 10, 8)])
    case = led("arch", "", planar.buckled(1.0, 1.0, 0.9).scene(), [{"yaw": angle} for angle in yaw])
    scene = case_scene(case)
    poses = np.array([[pose[name] for name in Tracker(scene).joint_names] for pose in case.path])
    batch = solve_many(scene, poses)
    assert (batch.status == Status.SNAPPED).sum() == 1
    _as_tracked(scene, poses, batch)
    assert _equal(batch, solve_many(scene, poses, workers=2))


def test_friction_remembers_the_whole_way():
    ball = load_scene(share_file("config", "space_arm_sphere.yaml"))
    there = np.radians(np.arange(20.0, 70.0, 1.0))
    poses = np.concatenate([there, there[::-1]])[:, None]
    _as_tracked(ball, poses, solve_many(ball, poses))


def test_a_path_starts_where_the_one_before_it_started(arm):
    """Each of several paths keeps to the branch of the first, and none spans two of them."""
    paths = [np.linspace(-1.0, 1.0, 5), np.linspace(-0.9, 1.0, CHUNK + 1)]
    batches = [batch for _, batch in solve_paths([(arm, paths)])]
    assert [len(batch) for batch in batches] == [5, CHUNK, 1]
    again = solve_many(arm, np.array([-1.0, -0.9]))
    # Twice the tolerance, as above; twist and wrench are of size 1.
    assert batches[1].total_twist[0] == pytest.approx(again.total_twist[1], abs=1e-2)


def test_what_cannot_be_trusted_has_no_numbers(arm):
    batch = solve_many(arm, np.array([0.0, np.nan, 0.1]))
    assert batch.status[:, 0].tolist() == [Status.CONVERGED, Status.INVALID_INPUT, Status.CONVERGED]
    assert np.isnan(batch.end_wrench[1]).all()
    assert np.isfinite(batch.end_wrench[[0, 2]]).all()
    assert batch.trusted[:, 0].tolist() == [True, False, True]


def test_shapes(arm):
    batch = solve_many(arm, np.zeros((3, 1)), polyline_points=7)
    assert batch.points.shape == (3, 1, 7, 3)
    assert batch.orientations.shape == (3, 1, 7, 4)
    assert batch.stiffness is None
    stiffness = solve_many(arm, np.zeros((3, 1)), stiffness=True).stiffness
    assert stiffness.shape == (3, 1, 6, 6)
    assert np.isfinite(stiffness).all()


@pytest.mark.parametrize("shape", [(0,), (3, 2), (2, 1, 1), ()])
def test_joints_of_a_wrong_shape(arm, shape):
    with pytest.raises(ValueError, match=r"must be \(m, 1\), a column for each of orientation"):
        solve_many(arm, np.zeros(shape))
