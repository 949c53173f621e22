# SPDX-License-Identifier: Apache-2.0
"""The collision geometry of a robot as obstacles: which solids, where, for which cables."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from pages import blocks
from scipy.spatial.transform import Rotation

from cable_ros import Tracker
from cable_ros.bench import surfaces
from cable_ros.contact.distance import gaps, placed
from cable_ros.effects.contact import encode
from cable_ros.scene import Box, Capsule, Cylinder, Kinematics, Scene, SceneError, Sphere, load_scene
from cable_ros.scene.solids import distances

UPRIGHT = [0, 0, 0, 1]
ORIGIN = "0.1 -0.2 0.3", "0.4 -0.7 1.1"
KINDS = {
    "sphere": '<sphere radius="0.07"/>',
    "cylinder": '<cylinder radius="0.05" length="0.3"/>',
    "box": '<box size="0.1 0.2 0.3"/>',
    "capsule": '<capsule radius="0.04" length="0.2"/>',
}


def collision(geometry: str, xyz: str = "0 0 0", rpy: str = "0 0 0") -> str:
    return f'<collision><origin xyz="{xyz}" rpy="{rpy}"/><geometry>{geometry}</geometry></collision>'


def urdf(base: str = "", arm: str = "", tool: str = "") -> str:
    """A base, an arm that turns about z at (0.2, 0, 0.1), a tool fixed to it 0.5 m along x, a hand beyond."""
    links = {"base": base, "arm": arm, "tool": tool, "hand": ""}
    joints = (
        ("base", "arm", "revolute", "0.2 0 0.1"),
        ("arm", "tool", "fixed", "0.5 0 0"),
        ("tool", "hand", "revolute", "0 0 0.1"),
    )
    return (
        "<robot name='r'>"
        + "".join(f"<link name='{name}'>{inside}</link>" for name, inside in links.items())
        + "".join(
            f"<joint name='{child}_joint' type='{kind}'><parent link='{parent}'/><child link='{child}'/>"
            f"<origin xyz='{xyz}'/><axis xyz='0 0 1'/></joint>"
            for parent, child, kind, xyz in joints
        )
        + "</robot>"
    )


def scene(
    robot: dict[str, Any], text: str, end: tuple[str | None, list[float]] = (None, [0.4, 5, 0]), **more: Any
) -> Scene:
    """A cable of 0.01 m diameter far away at y = 5 m, but for its end's link and place."""
    start = {"position": [0, 5, 0], "orientation": UPRIGHT}
    link = {"link": end[0]} if end[0] else {}
    cable = {
        "name": "hose", "length": 1.0, "stiffness": [0.02, 0.02, 0.015], "linear_density": 0.1,
        "outer_diameter": 0.01, "start": start,
        "end": {"position": end[1], "orientation": UPRIGHT, **link},
    }  # fmt: skip
    values = {"gravity": [0, 0, -9.81], "cables": [cable], "obstacles": [{"robot": robot, **more}]}
    return load_scene(values, urdf=text)


def test_each_solid_becomes_the_shape_of_its_kind_and_of_its_numbers():
    text = urdf(arm="".join(collision(one, *ORIGIN) for one in KINDS.values()))
    found = scene({"friction": 0.2}, text).obstacles
    assert [one.name for one in found] == ["arm/1", "arm/2", "arm/3", "arm/4"]
    assert {(one.link, one.friction, one.margin) for one in found} == {("arm", 0.2, 0.0)}
    ball, bar, box, capsule = (one.shape for one in found)
    centre, turn = np.array([0.1, -0.2, 0.3]), Rotation.from_euler("xyz", [0.4, -0.7, 1.1])
    z = turn.apply([0, 0, 1])
    assert isinstance(ball, Sphere)
    np.testing.assert_allclose(ball.center, centre, atol=1e-15)
    assert isinstance(bar, Cylinder)
    np.testing.assert_allclose([bar.start, bar.end], [centre - 0.15 * z, centre + 0.15 * z], atol=1e-15)
    assert isinstance(box, Box)
    np.testing.assert_allclose(box.size, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(Rotation.from_quat(box.orientation).as_matrix(), turn.as_matrix(), atol=1e-15)
    assert isinstance(capsule, Capsule)
    np.testing.assert_allclose(capsule.end - capsule.start, 0.2 * z, atol=1e-15)
    assert (ball.radius, bar.radius, capsule.radius) == (0.07, 0.05, 0.04)


def world(found: Scene, q: list[float], radius: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    links = Kinematics(found).obstacle_poses(np.array(q))
    identity = np.array([0, 0, 0, 0, 0, 0, 1.0])
    return placed(encode(found.obstacles, radius, "hose"), links, identity, 1.0), links


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("margin", [0.0, 0.013])
def test_the_distance_from_a_link_is_that_of_its_definition(kind, margin):
    """By the arm's closed-form kinematics and the judges' distances; a rigid motion of the link moves it."""
    pytest.importorskip("pinocchio")
    found = scene({"margin": margin}, urdf(arm=collision(KINDS[kind], *ORIGIN)))
    angle, rng = 0.8, np.random.default_rng(1)
    points = rng.uniform(-0.7, 0.7, (50, 3)) + [0.2, 0, 0.1]
    solid, links = world(found, [angle], radius=0.005)
    turn = Rotation.from_euler("z", angle)
    np.testing.assert_allclose(links[0, :3], [0.2, 0, 0.1], atol=1e-15)
    own = turn.inv().apply(points - [0.2, 0, 0.1])
    (obstacle,) = found.obstacles
    judge = surfaces.distance(obstacle, np.array([0, 0, 0, 0, 0, 0, 1.0]), 0.005)
    got = np.array([gaps(solid, point)[0] for point in points])
    np.testing.assert_allclose(got, judge(own), atol=1e-12)
    np.testing.assert_allclose(distances(obstacle.shape, own) - margin - 0.005, judge(own), atol=1e-12)


def test_links_and_exceptions():
    ball = collision(KINDS["sphere"])
    text = urdf(base=ball, arm=ball, tool=ball)
    names = [one.name for one in scene({"except": ["tool"]}, text).obstacles]
    assert names == ["base", "arm"]
    assert [one.name for one in scene({"links": ["tool", "hand"]}, text).obstacles] == ["tool"]
    named = scene({"links": ["arm"]}, text, name="crane").obstacles
    assert [one.name for one in named] == ["crane/arm"]


@pytest.mark.parametrize(
    ("link", "place", "left_out"),
    [
        ("arm", [0.1, 0.0, 0.071], True),  # its surface, 5 mm away from the clamp, meets the ball
        ("arm", [0.1, 0.0, 0.076], False),
        ("tool", [-0.4, 0.0, 0.071], True),  # fixed to the arm: the same body
        ("hand", [-0.4, 0.0, -0.029], False),  # another body, though at the same place now
        (None, [0.3, 0.0, 0.17], False),
    ],
)
def test_a_cable_leaves_out_what_it_is_clamped_in(link, place, left_out):
    text = urdf(arm=collision(KINDS["sphere"], "0.1 0 0") + collision(KINDS["box"], "9 0 0"))
    near, far = scene({}, text, (link, place)).obstacles
    assert near.left_out_by == (("hose",) if left_out else ())
    assert far.left_out_by == ()
    row = encode([near], 0.005, "hose")[0]
    distance = gaps(row[None], np.array([0.1, 0.0, 0.0]))[0]
    assert distance > 1e5 if left_out else distance == pytest.approx(-0.075)
    assert gaps(encode([near], 0.005, "another"), np.array([0.1, 0, 0]))[0] == pytest.approx(-0.075)


def test_the_world_is_part_of_the_root_link():
    found = scene({}, urdf(base=collision(KINDS["sphere"], "0.4 5 0"))).obstacles
    assert found[0].left_out_by == ("hose",)


@pytest.mark.parametrize("kind", KINDS)
def test_a_cable_rests_on_a_link_as_on_the_same_obstacle(kind):
    """The link of an arm below a cable, against that shape given by hand."""
    pytest.importorskip("pinocchio")
    place = {"xyz": "0.25 0 -0.12", "rpy": "0 0 0.3"}
    text = urdf(base=collision(KINDS[kind].replace("0.3", "0.2").replace('"0.2"', '"0.12"'), **place))
    clamps = {
        end: {"position": [x, 0, 0], "rpy": [0, 1.5707963, 0]} for end, x in (("start", 0), ("end", 0.5))
    }
    cable = {
        "name": "hose", "length": 0.62, "stiffness": [0.02, 0.02, 0.015], "linear_density": 0.2,
        "outer_diameter": 0.01, **clamps,
    }  # fmt: skip
    values = {"gravity": [0, 0, -9.81], "cables": [cable]}
    robot = load_scene({**values, "obstacles": [{"robot": {"friction": 0.0}}]}, urdf=text)
    (solid,) = robot.obstacles
    hand = {
        "sphere": lambda s: {"center": s.center, "radius": s.radius},
        "box": lambda s: {"center": s.center, "size": s.size, "orientation": s.orientation},
    }.get(kind, lambda s: {"start": s.start, "end": s.end, "radius": s.radius})(solid.shape)
    (one,) = Tracker(robot).solve({}).values()
    (other,) = Tracker({**values, "obstacles": [{"name": "own", kind: hand}]}).solve({}).values()
    assert one.status.trusted
    assert {contact.obstacle for contact in one.contacts} == {"base"}
    np.testing.assert_array_equal(one.end_wrench, other.end_wrench)


BALL = collision(KINDS["sphere"])


@pytest.mark.parametrize(
    ("robot", "text", "told"),
    [
        ({"links": ["amr"]}, urdf(arm=BALL), r"obstacles\[0\].robot.links\[0\]: .*did you mean 'arm'"),
        ({"except": ["elbow"]}, urdf(arm=BALL), r"robot.except\[0\]: the robot has no link 'elbow'; its lin"),
        ({"links": "some"}, urdf(arm=BALL), "robot.links: must be all, or a list of links, not the text"),
        ({"except": [["arm"]]}, urdf(arm=BALL), "has no link a list of 1"),
        ({"except": ["base", "arm", "tool", "hand"]}, urdf(arm=BALL), "except: no link is left; leave the r"),
        ({"links": ["hand"]}, urdf(arm=BALL), "links: none of these links has collision geometry"),
        ({"margin": -0.1}, urdf(arm=BALL), "robot.margin: must not be negative"),
        ({}, urdf(arm=collision("<cone/>")), "link 'arm', collision 1: its geometry <cone> is unknown; give"),
        ({}, urdf(arm="<collision/>"), "it has no geometry; give sphere"),
        ({}, urdf(arm=collision("<box size='1 2'/>")), "its size '1 2' is not 3 numbers"),
        ({}, urdf(arm=collision("<sphere radius='-1'/>")), "its radius '-1' is outside 1e-05 to 100 m"),
        ({}, urdf(arm=collision("<sphere radius='450'/>")), "radius '450' .*it looks like millimetres"),
        ({}, urdf(arm=collision(KINDS["box"], "0 0 x")), "its xyz '0 0 x' is not 3 numbers"),
    ],
)
def test_mistakes(robot, text, told):
    with pytest.raises(SceneError, match=told) as caught:
        scene(robot, text)
    assert "\n" not in str(caught.value)


def test_what_stands_beside_a_robot():
    with pytest.raises(SceneError, match=r"obstacles\[0\].friction: it stands beside robot; give it within"):
        scene({}, urdf(arm=BALL), friction=0.1)
    with pytest.raises(SceneError, match="both sphere and robot are given; give exactly one of"):
        scene({}, urdf(arm=BALL), sphere={"center": [0, 0, 0], "radius": 1.0})
    with pytest.raises(SceneError, match=r"robot: there is no robot; add 'robot: \{urdf: FILE\}'"):
        scene({}, None)
    twice = [{"name": "arm", "sphere": {"center": [0, 0, 0], "radius": 1.0}}, {"robot": {}}]
    cable = {"name": "c", "length": 1, "stiffness": [1, 1, 1], "linear_density": 0.1}
    clamp = {"position": [0, 5, 0], "orientation": UPRIGHT}
    values = {"gravity": [0, 0, 0], "cables": [{**cable, "start": clamp, "end": clamp}], "obstacles": twice}
    with pytest.raises(SceneError, match=r"'arm' is already the name of obstacles\[0\]"):
        load_scene(values, urdf=urdf(arm=BALL))


def test_the_page_s_example_is_read(tmp_path):
    page = Path(__file__).parents[2] / "docs" / "robot_obstacle.md"
    (block,) = [block for block in blocks(page) if block.language == "yaml"]
    text = urdf(arm=BALL).replace("hand", "gripper")
    (tmp_path / "arm.urdf").write_text(text)
    clamp = {"position": [0, 5, 0], "orientation": UPRIGHT}
    cable = {"name": "c", "length": 1, "stiffness": [1, 1, 1], "linear_density": 0.1, "start": clamp}
    values = yaml.safe_load(block.text) | {"gravity": [0, 0, 0], "cables": [{**cable, "end": clamp}]}
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(values))
    found = load_scene(tmp_path / "scene.yaml")
    assert [(one.name, one.friction) for one in found.obstacles] == [("arm", 0.2)]
    assert found.robot.named == {"base", "arm", "tool", "gripper"}
