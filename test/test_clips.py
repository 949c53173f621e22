# SPDX-License-Identifier: Apache-2.0
"""Clips between the ends: what they hold, and that they change nothing where the cable is anyway."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pages import blocks
from scipy.spatial.transform import Rotation
from test_ends import END, START, mapping, on_the_arm

from cable_ros import Tracker
from cable_ros.batch import solve_many
from cable_ros.branch.enumeration import branches
from cable_ros.equilibrium import Equilibrium, Status
from cable_ros.joint import joint_load, joint_torques
from cable_ros.scene import SceneError, load_scene
from cable_ros.scene.text import parse_yaml

POINTS = 101


def solve(scene: dict[str, Any], tolerance: float = 1e-9, **joints: float) -> Equilibrium:
    found = Tracker(scene, tolerance=tolerance, polyline_points=POINTS).arrive(joints)
    (one,) = found.values()
    assert one.status.trusted, one.message
    return one


def clip(found: Equilibrium, k: int, name: str = "clip") -> dict[str, Any]:
    """A clip that holds a solved cable of 1 m at its point k, as it is there."""
    mount = {"position": found.points[k].tolist(), "orientation": found.orientations[k].tolist()}
    return {"name": name, "clip": {"arc_length": k / (POINTS - 1), **mount}}


@pytest.mark.parametrize("where", [[30], [17, 55, 80], [50]])
@pytest.mark.parametrize("ends", ["clamped", "sliding"])
def test_a_clip_anywhere_on_a_solved_cable_changes_nothing(where, ends):
    end = END if ends == "clamped" else END | {"kind": "sliding", "axial_force": 2.0}
    plain = mapping(START, end)
    without = solve(plain)
    held = copy.deepcopy(plain)
    held["cables"][0]["supports"] = [clip(without, k, f"clip_{k}") for k in where]
    with_clips = solve(held)
    # frames between nodes, and so the clip's, are right to 1e-7 at this tolerance; a short piece is stiff
    reach = 1e-8 * max(np.abs(piece.clamp_stiffness).max() for piece in with_clips.pieces)
    for wrench in ("start_wrench", "end_wrench"):
        np.testing.assert_allclose(getattr(with_clips, wrench), getattr(without, wrench), atol=reach)
    for name, wrench in with_clips.support_wrenches.items():
        np.testing.assert_allclose(wrench, 0.0, atol=2 * reach, err_msg=name)
    np.testing.assert_allclose(with_clips.points, without.points, atol=1e-8)
    turn = Rotation.from_quat(with_clips.orientations) * Rotation.from_quat(without.orientations).inv()
    assert turn.magnitude().max() < 1e-6
    assert with_clips.energy == pytest.approx(without.energy, abs=1e-7)
    assert with_clips.total_twist == pytest.approx(without.total_twist, abs=1e-6)


def test_the_points_are_at_equal_arc_lengths_of_the_whole_cable():
    scene = mapping(START, END)
    plain = solve(scene)
    scene["cables"][0]["supports"] = [clip(plain, 37), clip(plain, 90, "other")]
    for count in (2, 3, 50, POINTS):
        fine = Tracker(scene, tolerance=1e-9, polyline_points=count).solve({})["c"]
        whole = Tracker(mapping(START, END), tolerance=1e-9, polyline_points=count).solve({})["c"]
        np.testing.assert_allclose(fine.points, whole.points, atol=1e-8)


def test_a_clip_on_a_straight_cable_carries_half_of_each_span():
    """Two equal spans of a heavy, nearly taut cable: by symmetry its clip holds the weight of a span."""
    level = [0.0, np.pi / 2, 0.0]
    ends = ({"position": [x, 0.0, 0.0], "rpy": level} for x in (0.0, 0.98))
    scene = mapping(*ends, weight=5.0, supports=[
        {"name": "middle", "clip": {"arc_length": 0.5, "position": [0.49, 0.0, 0.0], "rpy": level}}
    ])  # fmt: skip
    found = solve(scene, 1e-7)
    # the clip's x axis points down
    np.testing.assert_allclose(found.support_wrenches["middle"], [2.5, 0, 0, 0, 0, 0], atol=1e-5)
    assert found.points[50] == pytest.approx([0.49, 0.0, 0.0], abs=1e-9)


def clipped_arm(link: str | None = "turret") -> dict[str, Any]:
    """The arm with a clip in the middle of its cable, on the turret or in the world."""
    scene = on_the_arm({})
    (cable,) = scene["cables"]
    free = Tracker(scene, tolerance=1e-9, polyline_points=POINTS).solve({"orientation": 0.3})["camera_cable"]
    half = 0.5 * float(cable["length"])
    mount = {"position": free.points[50].tolist(), "orientation": free.orientations[50].tolist()}
    if link is not None:
        turn, pivot = Rotation.from_rotvec([0.0, 0.0, 0.3]).inv(), np.array([0.16, 0.0, 0.0])
        mount = {
            "link": link,
            "position": turn.apply(free.points[50] - pivot).tolist(),
            "orientation": (turn * Rotation.from_quat(free.orientations[50])).as_quat().tolist(),
        }
    cable["supports"] = [{"name": "clip", "clip": {"arc_length": half, **mount}}]
    return scene


def load_at(tracker: Tracker, angle: float) -> tuple[float, float, float]:
    """Torque and stiffness of the cable on the arm's one joint at an angle, rad, and its energy: SI units."""
    (name,) = tracker.joint_names
    joints = {name: angle}
    found = tracker.arrive(joints)
    assert found["camera_cable"].status.trusted
    load = joint_load(tracker, found, joints)
    (many,) = joint_torques(tracker, [found], np.array([[angle]]))
    assert many == pytest.approx(load.torque, rel=1e-12, abs=1e-15)
    return float(load.torque[0]), float(load.stiffness[0, 0]), found["camera_cable"].energy


@pytest.mark.parametrize("link", ["turret", None])
def test_joint_load_counts_clips_by_virtual_work(link):
    tracker = Tracker(clipped_arm(link), tolerance=1e-9)
    step = 1e-4
    angles = (0.35 - step, 0.35, 0.35 + step)
    (before, _, low), (torque, slope, _), (after, _, high) = (load_at(tracker, one) for one in angles)
    size = max(abs(torque), 1e-3)
    assert torque == pytest.approx((low - high) / (2 * step), abs=1e-5 * size)
    assert slope == pytest.approx((after - before) / (2 * step), abs=1e-4 * max(abs(slope), size))


def test_a_clip_in_the_same_link_as_the_end_leaves_no_torque_beyond_it():
    """What is between two mounts on one link turns with it: only its weight, along the axis, changes."""
    scene = clipped_arm()
    here = Tracker(scene, tolerance=1e-8)
    one, other = (here.arrive({"orientation": a})["camera_cable"] for a in (0.2, 0.6))
    np.testing.assert_allclose(one.end_wrench, other.end_wrench, atol=1e-7)


def test_pieces_meet_obstacles_and_limits_of_the_whole_cable():
    scene = mapping(
        {"position": [0.0, 0.0, 0.0], "rpy": [0.0, np.pi / 2, 0.0]},
        {"position": [0.9, 0.0, 0.0], "rpy": [0.0, np.pi / 2, 0.0]},
        weight=30.0, diameter=0.02, youngs_modulus=1.3e8, shear_modulus=4.5e7,
        limits={"bend_radius": 0.05, "clearance": 0.001},
        supports=[
            {"name": "clip", "clip": {"arc_length": 0.3, "position": [0.28, 0, 0], "rpy": [0, np.pi / 2, 0]}}
        ],
    )  # fmt: skip
    del scene["cables"][0]["stiffness"]
    scene["obstacles"] = [{"name": "ground", "plane": {"point": [0, 0, -0.08], "normal": [0, 0, 1]}}]
    found = Tracker(scene).arrive({})["c"]
    assert found.status is Status.CONVERGED, found.message
    assert found.contacts
    for contact in found.contacts:
        assert contact.arc_length > 0.3
        s = np.linspace(0.0, 1.0, len(found.points))
        nearest = found.points[np.argmin(np.abs(s - contact.arc_length))]
        assert np.linalg.norm(nearest - contact.position) < 0.01
    weight = 30.0
    up = [Rotation.from_euler("xyz", [0, np.pi / 2, 0]).apply(w[:3])[2] for w in (
        found.start_wrench, found.end_wrench, found.support_wrenches["clip"]
    )]  # fmt: skip
    assert sum(up) - found.obstacle_wrenches["ground"][2] * -1 == pytest.approx(-weight, rel=1e-3)
    worst = {one.quantity.name: one for one in found.extremes}
    assert worst["clearance"].arc_length > 0.3
    assert worst["clearance"].value == pytest.approx(0.0, abs=1e-6)
    assert found.wrench_response(["ground"]).shape == (18, 18)


def test_one_piece_out_of_reach_is_told_with_its_place():
    scene = mapping(START, END)
    far = {"arc_length": 0.2, "position": [2.0, 0.0, 0.0], "rpy": [0.0, 0.0, 0.0]}
    scene["cables"][0]["supports"] = [{"name": "bracket", "clip": far}]
    found = Tracker(scene).solve({})["c"]
    assert found.status is Status.OUT_OF_REACH
    assert "etween start and bracket" in found.message
    assert len(found.points) == 101


def test_many_poses_and_branches_of_a_cable_with_clips():
    scene = load_scene(clipped_arm())
    poses = np.linspace(-0.2, 0.6, 9)
    batch = solve_many(scene, poses)
    tracker = Tracker(scene)
    for pose, wrench in zip(poses, batch.end_wrench[:, 0], strict=True):
        found = tracker.arrive({"orientation": pose})["camera_cable"]
        np.testing.assert_allclose(wrench, found.end_wrench, rtol=1e-8)
    listed = branches(scene, {"orientation": 0.3})
    assert list(listed) == ["camera_cable between start and clip", "camera_cable between clip and end"]
    assert all(listed.values())


CLIP = {"arc_length": 0.3, "position": [0.3, 0.0, 0.0], "rpy": [0.0, 0.0, 0.0]}
MISTAKES = {
    "supports[0].hook": ([{"name": "a", "hook": {}}], "no such field"),
    "supports": ([{"name": "a", "clip": CLIP | {"arc_length": 1.2}}], "between the arc lengths"),
    "supports[1].name": ([{"name": "a", "clip": CLIP}, {"name": "a", "clip": CLIP}], "already the name"),
    "supports[0].name": ([{"name": "end", "clip": CLIP}], "taken by an end"),
    "supports[0].clip.link": ([{"name": "a", "clip": CLIP | {"link": "arm"}}], "needs a robot"),
    "total_twist": ([{"name": "a", "clip": CLIP}], "leave 'total_twist' out"),
}


@pytest.mark.parametrize("field", MISTAKES)
def test_what_makes_no_sense_is_one_sentence_with_its_field(field):
    supports, words = MISTAKES[field]
    extra = {"total_twist": 1.0} if field == "total_twist" else {}
    with pytest.raises(SceneError) as error:
        load_scene(mapping(START, END, supports=supports, **extra))
    assert f"cables[0].{field}:" in str(error.value)
    assert words in str(error.value)


def test_the_example_of_the_page_is_held_by_its_clip():
    page = Path(__file__).parents[1] / "docs" / "ends.md"
    *_, example, _ = [block.text for block in blocks(page) if block.language == "yaml"]
    scene = parse_yaml(example, str(page))
    found = Tracker(scene).arrive({})["dress_pack"]
    assert found.status is Status.CONVERGED, found.message
    points = np.array([0.45 * (len(found.points) - 1)]).round().astype(int)
    np.testing.assert_allclose(found.points[points[0]], [0.4, 0.0, 0.05], atol=1e-6)
    up = found.start_wrench[:3], found.support_wrenches["forearm_clip"][:3], found.end_wrench[:3]
    turns = [np.pi / 2, 1.2, np.pi / 2]
    total = sum(Rotation.from_euler("y", a).apply(f) for a, f in zip(turns, up, strict=True))
    np.testing.assert_allclose(total, [0.0, 0.0, -0.2 * 9.81], atol=1e-4)
