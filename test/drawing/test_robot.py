# SPDX-License-Identifier: Apache-2.0
"""The robot's links and what they carry, in the world."""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros.drawing.robot import Skeleton, moved
from cable_ros.scene import load_scene
from cable_ros.scene.obstacles import Box, Capsule, Cylinder, Plane, Sphere
from cable_ros.share import share_file

# A quarter turn about z, then a metre along x.
QUARTER = np.array([1.0, 0.0, 0.0, 0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])


def turned(points: np.ndarray) -> np.ndarray:
    return np.column_stack([1.0 - points[:, 1], points[:, 0], points[:, 2]])


@pytest.mark.parametrize(
    "shape",
    [
        Sphere(np.array([0.1, 0.2, 0.3]), 0.05),
        Capsule(np.array([0.1, 0.2, 0.3]), np.array([0.4, 0.2, 0.1]), 0.05),
        Cylinder(np.array([0.1, 0.2, 0.3]), np.array([0.4, 0.2, 0.1]), 0.05),
        Box(np.array([0.1, 0.2, 0.3]), np.array([0.4, 0.2, 0.1]), np.array([0.0, 0.6, 0.0, 0.8])),
    ],
)
def test_a_moved_shape_reaches_as_far_in_moved_directions(shape):
    directions = np.random.default_rng(1).normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    there = turned(directions) - [1.0, 0.0, 0.0]
    assert moved(shape, QUARTER).farthest(there) == pytest.approx(turned(shape.farthest(directions)))


def test_a_moved_plane_holds_the_moved_points():
    plane = moved(Plane(np.array([0.1, 0.2, 0.3]), np.array([0.6, 0.8, 0.0])), QUARTER)
    assert plane.point == pytest.approx([0.8, 0.1, 0.3])
    assert plane.normal == pytest.approx([-0.8, 0.6, 0.0])


@pytest.mark.parametrize("angle", [0.0, 0.5, -1.5])
def test_the_arm_s_links_lead_to_its_clamp(angle):
    """Root to the joint's axis at (0.16, 0, 0) m, and from there to the clamp, (47) of the paper."""
    pose = Skeleton(load_scene(share_file("config", "space_arm.yaml"))).at({"orientation": angle}, "here")
    s, c = np.sin(angle), np.cos(angle)
    clamp = [0.160 - 0.145 * s + 0.080 * c, 0.080 * s + 0.145 * c, 0.075]
    assert pose.lines[0] == pytest.approx(np.array([[0, 0, 0], [0.16, 0, 0]]), abs=1e-12)
    assert pose.lines[-1] == pytest.approx(np.array([[0.16, 0, 0], clamp]), abs=1e-12)
    assert pose.label == "here"
    assert pose.carried == ()


def test_a_scene_without_a_robot_has_no_lines():
    strip = {
        "gravity": [0, 0, -9.81],
        "cables": [
            {
                "name": "strip", "length": 0.4, "stiffness": [1e-3, 1e-3, 7e-4], "linear_density": 0.1,
                "start": {"position": [0, 0, 0], "orientation": [0, 0, 0, 1]},
                "end": {"position": [0.2, 0.1, 0.05], "orientation": [0, 0, 0, 1]},
            }
        ],
    }  # fmt: skip
    assert Skeleton(load_scene(strip)).at({}, "").lines.shape == (0, 2, 3)
