# SPDX-License-Identifier: Apache-2.0
"""Outlines of obstacles against the definition of the shapes: points of the surface, and nothing beyond."""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros.drawing.silhouettes import silhouette
from cable_ros.scene.obstacles import Box, Capsule, Cylinder, Plane, Sphere

LOW, HIGH = np.full(3, -1.0), np.full(3, 1.0)
TURNED = np.array([0.5, 0.5, 0.5, 0.5])  # x to y, y to z, z to x
BAR = {"start": np.array([0.0, 0.0, 0.0]), "end": np.array([0.3, 0.0, 0.4])}


def test_a_ball_is_a_circle_in_every_view():
    ball = Sphere(np.array([0.1, 0.2, 0.3]), 0.05)
    for across, up in ((0, 2), (1, 2), (0, 1)):
        outline = silhouette(ball, across, up, LOW, HIGH) - ball.center[[across, up]]
        assert np.linalg.norm(outline, axis=1) == pytest.approx(0.05)


def test_a_box_reaches_half_its_edges():
    box = Box(np.zeros(3), np.array([0.2, 0.4, 0.6]), TURNED)
    assert box.farthest(np.eye(3)).diagonal() == pytest.approx([0.3, 0.1, 0.2])


def test_bars_reach_past_their_ends_by_what_their_ends_are():
    along = np.array([[0.6, 0.0, 0.8]])
    assert Capsule(**BAR, radius=0.1).farthest(along)[0] == pytest.approx([0.36, 0.0, 0.48])
    assert Cylinder(**BAR, radius=0.1).farthest(along)[0] == pytest.approx([0.3, 0.0, 0.4])
    # The rim of the cylinder's face is higher than its centre by the radius times the sine to the axis.
    assert Cylinder(**BAR, radius=0.1).farthest(np.array([[0.0, 0.0, 1.0]]))[0, 2] == pytest.approx(0.46)


def test_the_ground_is_what_lies_below_it():
    ground = Plane(np.array([0.0, 0.0, -0.2]), np.array([0.0, 0.0, 1.0]))
    outline = silhouette(ground, 0, 2, LOW, HIGH)
    corners = np.array(sorted(map(tuple, outline.round(12))))
    assert corners == pytest.approx(np.array([(-1, -1), (-1, -0.2), (1, -1), (1, -0.2)]))
    assert len(silhouette(ground, 0, 1, LOW, HIGH)) == 0  # from above it is everywhere
    assert len(silhouette(Plane(np.array([0.0, 0.0, -3.0]), ground.normal), 0, 2, LOW, HIGH)) == 0
