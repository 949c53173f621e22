# SPDX-License-Identifier: Apache-2.0
"""Links that a scene does not have among its obstacles: how deep a cable is in them, and where."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cable_ros import Status, Tracker, load_scene
from cable_ros.cli.main import main
from cable_ros.contact.distance import gap
from cable_ros.effects.contact import encode
from cable_ros.robot_overlaps import inside
from cable_ros.scene import Box, Capsule, Cylinder, Obstacle, Sphere

pytest.importorskip("pinocchio")

RADIUS = 0.005
ALONG_X = [0, math.pi / 2, 0]


def urdf(base="", arm="", hand=""):
    """An arm that turns about z at the origin, and a hand on it that no clamp depends on."""
    links = {"base": base, "arm": arm, "hand": hand}
    return (
        "<robot name='r'>"
        + "".join(f"<link name='{name}'>{inner}</link>" for name, inner in links.items())
        + "".join(
            f"<joint name='{child}_joint' type='revolute'><parent link='{parent}'/><child link='{child}'/>"
            "<axis xyz='0 0 1'/><limit lower='-3' upper='3' effort='1' velocity='1'/></joint>"
            for parent, child in (("base", "arm"), ("arm", "hand"))
        )
        + "</robot>"
    )


def ball(x, y, z, radius=0.1):
    return (
        f"<collision><origin xyz='{x} {y} {z}'/><geometry><sphere radius='{radius}'/></geometry></collision>"
    )


def scene(text, obstacles=(), effects=None, link="arm"):
    """A straight cable of 1 m on the arm, along its x axis from x = 0.5 m on; among obstacles it is slack."""
    clamp = {"link": link, "rpy": ALONG_X}
    cable = {
        "name": "hose", "length": 1.0, "stiffness": [1, 1, 1], "linear_density": 0.0,
        "outer_diameter": 2 * RADIUS, "start": {**clamp, "position": [0.5, 0, 0]},
        "end": {**clamp, "position": [1.5 - 1e-3 * bool(obstacles), 0, 0]}, "total_twist": 0.0,
    }  # fmt: skip
    cable |= {} if obstacles else {"axial_stiffness": 1e3}
    values = {"gravity": [0, 0, -9.81], "cables": [cable]}
    values |= {"obstacles": list(obstacles)} if obstacles else {}
    values |= {"effects": effects} if effects else {}
    return load_scene(values, urdf=text)


def solve(*args, angle=0.0, points=1001, **more):
    tracker = Tracker(scene(*args, **more), polyline_points=points)
    (found,) = tracker.solve({"arm_joint": angle}).values()
    assert found.status is Status.CONVERGED, found.message
    return found


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_a_straight_cable_in_a_ball(angle):
    """A chord: half as long as the root of (R + r)^2 - z^2. The ball of the base is passed at one angle."""
    found = solve(urdf(base=ball(1.0, 0, 0.06)), angle=angle)
    if angle:
        assert found.overlaps == ()
        assert found.message == Status.CONVERGED.sentence
        return
    (overlap,) = found.overlaps
    half = math.sqrt((0.1 + RADIUS) ** 2 - 0.06**2)
    assert overlap.other == "base"
    assert overlap.contact_distance == RADIUS
    assert overlap.contact_distance - overlap.distance == pytest.approx(0.045, abs=1e-6)
    np.testing.assert_allclose(overlap.between, [0.5 - half, 0.5 + half], atol=1e-3)  # points 1 mm apart
    assert (
        "It passes through base by 45 mm between 0.414 and 0.586 m: the robot is not among" in found.message
    )


def test_few_points_of_the_polyline_hide_nothing():
    (overlap,) = solve(urdf(base=ball(1.0, 0, 0.06)), points=2).overlaps
    assert overlap.distance == pytest.approx(-0.04, abs=1e-4)


def test_two_solids_of_a_link_are_one_link():
    (overlap,) = solve(urdf(base=ball(0.8, 0, 0.06) + ball(1.2, 0, 0.0))).overlaps
    half = math.sqrt((0.1 + RADIUS) ** 2 - 0.06**2)
    assert overlap.distance == pytest.approx(-0.1, abs=1e-6)
    np.testing.assert_allclose(overlap.between, [0.3 - half, 0.7 + 0.1 + RADIUS], atol=2e-3)


@pytest.mark.parametrize(
    ("text", "obstacles", "effects", "passes"),
    [
        (urdf(arm=ball(1.0, 0, 0)), [], None, True),
        (urdf(arm=ball(0.5, 0, 0)), [], None, False),  # it is clamped in it
        (urdf(hand=ball(1.0, 0, 0)), [], None, False),  # nobody knows where the hand is
        (urdf(arm=ball(1.0, 0, 0), base=ball(9, 9, 9)), [{"robot": {"except": ["arm"]}}], None, False),
        (urdf(arm=ball(1.0, 0, 0), base=ball(9, 9, 9)), [{"robot": {"links": ["base"]}}], None, True),
        (urdf(base=ball(1.0, 0, 0)), [{"robot": {"links": ["base"]}}], ["weight"], True),
    ],
)
def test_which_links_are_told(text, obstacles, effects, passes):
    found = solve(text, obstacles, effects)
    assert bool(found.overlaps) == passes
    assert found.overlapping == passes


def test_a_link_whose_geometry_is_of_no_use_does_not_stop_the_cable():
    bad = "<collision><geometry><cone/></geometry></collision>"
    tracker = Tracker(scene(urdf(arm=bad, base=ball(1.0, 0, 0.06))))
    found = tracker.solve({"arm_joint": 0.0})["hose"]
    assert found.status.trusted
    assert [one.other for one in found.overlaps] == ["base"]
    assert tracker.robot_overlaps.unknown.startswith("Cables are not compared with arm: robot description")
    assert "geometry <cone> is unknown" in tracker.robot_overlaps.unknown


def test_cable_solve_tells(tmp_path, capsys):
    (tmp_path / "arm.urdf").write_text(urdf(base=ball(1.0, 0, 0.06)))
    text = scene(urdf()).text.replace("gravity:", "robot: {urdf: arm.urdf}\ngravity:")
    (tmp_path / "scene.yaml").write_text(text)
    assert main(["solve", str(tmp_path / "scene.yaml"), "--joint", "arm_joint=0"]) == 0
    assert "passes through base by 45 mm" in capsys.readouterr().out


@pytest.mark.parametrize(
    "shape",
    [
        Sphere(np.array([0.1, 0.0, 0.0]), 0.3),
        Box(np.array([0.1, 0.2, 0.0]), np.array([0.3, 0.1, 0.5]), np.array([0.0, 0.0, 0.6, 0.8])),
        Capsule(np.array([-0.3, 0.0, 0.0]), np.array([0.3, 0.1, 0.0]), 0.05),
        Cylinder(np.array([-0.3, 0.0, 0.0]), np.array([0.3, 0.1, 0.0]), 0.05),
    ],
)
def test_leaving_points_out_finds_what_all_of_them_find(shape):
    """Against the distance of every point of a curve with many turns, of unit speed."""
    s = np.linspace(0, 3, 301)
    curve = np.column_stack([0.3 * np.cos(s / 0.3), 0.3 * np.sin(s / 0.3), 0 * s])
    row = encode([Obstacle("one", shape)], 0.01)
    n, directions, bends = np.empty(3), np.empty((2, 3)), np.empty(2)
    every = np.array([gap(row[0], point, n, directions, bends) for point in curve])
    deepest, first, last = inside(curve, 0.011, row)
    within = np.flatnonzero(every < 0)
    assert len(within)
    assert deepest[0] == -every.min()
    assert (first[0], last[0]) == (within[0], within[-1])
