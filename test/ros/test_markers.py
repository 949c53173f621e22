# SPDX-License-Identifier: Apache-2.0
"""The marker view: where the tube, the arrows and the obstacles are, and that rclpy writes the same bytes."""

from __future__ import annotations

import math

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="rclpy is not on this machine")
pytest.importorskip("pinocchio", reason="the arm's kinematics need Pinocchio")

from rclpy.serialization import deserialize_message, serialize_message
from visualization_msgs.msg import Marker, MarkerArray

from cable_ros import Tracker, load_scene
from cable_ros.rod.quaternion import matrices_from_ros
from cable_ros.ros.markers import CableMarkers, bending_moments
from cable_ros.ros.obstacle_markers import ObstacleMarkers
from cable_ros.scene.kinematics import Kinematics
from cable_ros.scene.text import parse_yaml
from cable_ros.share import share_file

STAMP = 1_700_000_000_123_456_789
SIDES = 8


def read(data):
    """The markers of these bytes, which are as rclpy would write them."""
    message = deserialize_message(data, MarkerArray)
    theirs = serialize_message(message)
    assert len(theirs) in (
        len(data),
        -(-len(data) // 4) * 4,
    )  # the end of a message may be padded, to 4 bytes
    # rclpy leaves other padding as its buffer happened to be; ours is zero.
    assert not any(ours for ours, other in zip(data, theirs, strict=False) if ours != other)
    return message.markers


def points_of(marker):
    return np.array([[point.x, point.y, point.z] for point in marker.points])


@pytest.fixture(scope="module")
def arm():
    return load_scene(str(share_file("config", "space_arm.yaml")))


@pytest.mark.parametrize("count", [2, 3, 101])
def test_tube_and_arrows(arm, count):
    cable = arm.cables[0]
    equilibrium = Tracker(arm, polyline_points=count).solve({"orientation": 0.4})["camera_cable"]
    scale = 0.5
    tube, end, start = read(CableMarkers(cable, "base", count).fill(STAMP, equilibrium, scale))
    assert {marker.header.frame_id for marker in (tube, end, start)} == {"base"}
    assert tube.header.stamp.sec * 10**9 + tube.header.stamp.nanosec == STAMP
    corners = points_of(tube).reshape(-1, 3, 3)
    assert len(corners) == 2 * SIDES * (count - 1)
    assert len(tube.colors) == 3 * len(corners)
    # Every corner lies on the cable's surface at one of the polyline's points.
    away = np.linalg.norm(corners.reshape(-1, 1, 3) - equilibrium.points[None], axis=2).min(axis=1)
    np.testing.assert_allclose(away, cable.diameter / 2, rtol=1e-9)
    if count > 100:
        # Triangles turn their outside out: their normals point away from the centreline.
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        middles = corners.mean(axis=1)
        nearest = np.linalg.norm(middles[:, None] - equilibrium.points[None], axis=2).argmin(axis=1)
        assert np.all(np.sum(normals * (middles - equilibrium.points[nearest]), axis=1) > 0)
    frames = matrices_from_ros(equilibrium.orientations)
    for arrow, index, wrench in ((end, -1, equilibrium.end_wrench), (start, 0, equilibrium.start_wrench)):
        tail, tip = points_of(arrow)
        np.testing.assert_allclose(tail, equilibrium.points[index], atol=1e-15)
        np.testing.assert_allclose((tip - tail) / scale, frames[index] @ wrench[:3], atol=1e-12)
    # The forces on both links and the weight balance: the links carry the cable.
    weight = cable.linear_density * cable.length * arm.gravity
    total = frames[-1] @ equilibrium.end_wrench[:3] + frames[0] @ equilibrium.start_wrench[:3]
    np.testing.assert_allclose(total, weight, atol=2e-4 * np.linalg.norm(weight))  # twice the tolerance


def test_what_is_not_trusted_leaves_the_view(arm):
    markers = CableMarkers(arm.cables[0], "base", 11)
    equilibrium = Tracker(arm, polyline_points=11).solve({"orientation": 0.4})["camera_cable"]
    shown, gone = read(markers.fill(STAMP, equilibrium, 0.5)), read(markers.remove())
    contacts = {("camera_cable/contact_forces", 0)}
    assert {(m.ns, m.id) for m in gone} == {(m.ns, m.id) for m in shown} | contacts
    assert {m.action for m in gone} == {Marker.DELETE}


def test_contact_forces_are_lines_that_go_when_they_end():
    scene = load_scene(str(share_file("config", "space_arm_sphere.yaml")))
    tracker, markers, scale = Tracker(scene), CableMarkers(scene.cables[0], "base", 101), 2.0
    clear, touching = (tracker.solve({"orientation": math.radians(a)})["camera_cable"] for a in (30, 60))
    assert markers.contacts(STAMP, clear, scale) is None
    (lines,) = read(markers.contacts(STAMP, touching, scale))
    assert (lines.type, lines.action) == (Marker.LINE_LIST, Marker.ADD)
    ends = points_of(lines).reshape(-1, 2, 3)
    for (foot, tip), contact in zip(ends, touching.contacts, strict=True):
        np.testing.assert_array_equal(foot, contact.position)
        np.testing.assert_allclose((tip - foot) / scale, contact.force, atol=1e-15)
    (lines,) = read(markers.contacts(STAMP, clear, scale))
    assert lines.action == Marker.DELETE
    assert markers.contacts(STAMP, clear, scale) is None


@pytest.mark.parametrize("natural", [None, [0.0, 2.0, 0.0]])
def test_the_bending_moment_of_an_arc(natural):
    """A circular arc: |M| = EI (1/radius - natural curvature), the same everywhere."""
    curvature, length, n = 5.0, 0.4, 41
    strain = None if natural is None else np.array(natural)
    scene = load_scene(
        {
            "gravity": [0, 0, -9.80665],
            "cables": [
                {
                    "name": "c",
                    "length": length,
                    "stiffness": [2e-3, 3e-3, 1e-3],
                    "linear_density": 0.1,
                    "start": {"position": [0, 0, 0], "orientation": [0, 0, 0, 1]},
                    "end": {"position": [0.1, 0, 0.2], "orientation": [0, 0, 0, 1]},
                }
                | ({} if natural is None else {"natural_strain": natural})
            ],
        }
    )
    angle = curvature * np.linspace(0, length, n)
    quaternions = np.stack([0 * angle, np.sin(angle / 2), 0 * angle, np.cos(angle / 2)], axis=1)
    expected = 3e-3 * (curvature - (strain[1] if strain is not None else 0.0))
    # The turn between two sections of an arc is exact; what is left is rounding, of angles near 0.05.
    np.testing.assert_allclose(bending_moments(scene.cables[0], quaternions), expected, rtol=1e-12)


def test_obstacles():
    source = share_file("config", "space_arm.yaml")
    scene = parse_yaml(source.read_text(), "scene")
    scene["robot"] = {"urdf": str(source.with_suffix(".urdf"))}
    scene["obstacles"] = [
        {"name": "ball", "sphere": {"center": [0.1, 0.2, 0.3], "radius": 0.04}},
        {"name": "floor", "plane": {"point": [5, 5, -0.3], "normal": [0, 0, 2]}},
        {"name": "rod", "link": "turret",
         "capsule": {"start": [0.1, 0, 0], "end": [0.2, 0, 0], "radius": 0.01}},
        {"name": "post", "cylinder": {"start": [0, 0, 0.2], "end": [0, 0, 0.1], "radius": 0.02}},
        {"name": "crate", "link": "turret",
         "box": {"center": [0, 0.1, 0], "size": [0.1, 0.2, 0.3], "orientation": [0, 0, 0, 1]}},
    ]  # fmt: skip
    loaded = load_scene(scene)
    kinematics = Kinematics(loaded)
    angle = 0.5
    joints = np.full(len(kinematics.joint_names), angle)
    centre = np.array([0.2, 0.1, 0.4])
    message = ObstacleMarkers(loaded, "base").fill(STAMP, kinematics.obstacle_poses(joints), centre)
    markers = {(marker.ns, marker.id): marker for marker in read(message)}
    axis = np.array([0.160, 0.0, 0.0])
    turn = np.array(
        [[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1]]
    )

    def place(name, number=0):
        pose = markers[f"obstacle/{name}", number].pose
        p, q = pose.position, pose.orientation
        return np.array([p.x, p.y, p.z]), matrices_from_ros(np.array([[q.x, q.y, q.z, q.w]]))[0]

    def scale(name, number=0):
        size = markers[f"obstacle/{name}", number].scale
        return [size.x, size.y, size.z]

    np.testing.assert_allclose(place("ball")[0], [0.1, 0.2, 0.3], atol=1e-15)
    assert scale("ball") == [0.08, 0.08, 0.08]
    # A plane is a sheet just under its surface, beneath what is looked at.
    position, _ = place("floor")
    np.testing.assert_allclose(position[:2], centre[:2], atol=1e-12)
    assert position[2] + scale("floor")[2] / 2 == pytest.approx(-0.3, abs=1e-12)
    # On the turned link: the rod's middle, and its axis along the link's x.
    position, frame = place("rod")
    np.testing.assert_allclose(position, axis + turn @ [0.15, 0, 0], atol=1e-12)
    np.testing.assert_allclose(frame[:, 2], turn[:, 0], atol=1e-12)
    np.testing.assert_allclose(scale("rod"), [0.02, 0.02, 0.1], atol=1e-15)
    for number, end in ((1, [0.1, 0, 0]), (2, [0.2, 0, 0])):
        np.testing.assert_allclose(place("rod", number)[0], axis + turn @ end, atol=1e-12)
    np.testing.assert_allclose(place("post")[1][:, 2], [0, 0, -1], atol=1e-12)
    position, frame = place("crate")
    np.testing.assert_allclose(position, axis + turn @ [0, 0.1, 0], atol=1e-12)
    np.testing.assert_allclose(frame, turn, atol=1e-12)
    assert scale("crate") == [0.1, 0.2, 0.3]
