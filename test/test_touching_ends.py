# SPDX-License-Identifier: Apache-2.0
"""Ends that are pinned, on a swivel, sliding or free, with obstacles: by shooting, and seen otherwise."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from references.contact import span
from references.held_ends import Ball, Problem
from scipy.optimize import root
from scipy.spatial.transform import Rotation
from test_ends import (
    ALONG_X,
    FLIP,
    GRAVITY,
    PAIRS,
    load,
    mapping,
    on_the_arm,
    reversed_scene,
    solved,
    wrenches_are_those,
)

from cable_ros import Tracker
from cable_ros.equilibrium import Equilibrium, Status
from cable_ros.scene import SceneError, load_scene

WEIGHT, RADIUS, DIAMETER = 10.0, 0.1, 0.01
DOWN = np.array([0.0, 0.0, -GRAVITY])
NATURAL = [0.3, -0.4, 0.6]
TILTED = {"position": [0.0, 0.0, 0.3], "rpy": [0.1, np.pi / 2 + 0.3, 0.2]}
STEEP = {"position": [0.0, 0.0, 0.205], "rpy": [0.0, np.pi / 2 + 0.5, 0.0]}
GROUND = {"name": "ground", "plane": {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}}
FREE = {"kind": "free"}


def among(
    start: dict[str, Any],
    end: dict[str, Any],
    *obstacles: dict[str, Any],
    weight: float = WEIGHT,
    **fields: Any,
) -> dict[str, Any]:
    """A scene of a cable 1 cm thick with EI = 1 N m^2 among obstacles."""
    ends = copy.deepcopy((start, end))
    scene = mapping(*ends, weight=weight, outer_diameter=DIAMETER, **fields)
    return scene | {"obstacles": copy.deepcopy(list(obstacles))} if obstacles else scene


def pushed(name: str, depth: float = 0.04, **fields: Any) -> dict[str, Any]:
    """The cable of `test_ends.PAIRS`, and a ball that would be `depth` inside of its middle."""
    alone = solved(among(*PAIRS[name], **fields), 1e-6)
    away = Rotation.from_quat(alone.orientations[50]).apply([0.6, 0.8, 0.0])
    centre = alone.points[50] - away * (RADIUS + 0.5 * DIAMETER - depth)
    ball = {"name": "ball", "sphere": {"center": centre.tolist(), "radius": RADIUS}}
    return among(*PAIRS[name], ball, **fields)


def wrenches(found: Equilibrium) -> np.ndarray:
    return np.stack([found.start_wrench, found.end_wrench])


def claimed(scene: dict[str, Any], **rests: Any) -> tuple[Equilibrium, Any]:
    """Our answer, and that of shooting from 1 % beside it; `rests`: of the free end, see `Problem`."""
    found, (cable,) = solved(scene), copy.deepcopy(scene["cables"])
    axes = Rotation.from_quat(found.wrench_axes[0])
    force, moment = axes.apply(found.start_wrench[:3]), axes.apply(found.start_wrench[3:])
    moment = moment - np.cross(found.points[0] - cable["start"].get("position", found.points[0]), force)
    frame = Rotation.from_quat(found.orientations[0]).as_rotvec()
    if rests:
        cable["end"] = cable["end"] | rests
    (obstacle,), reach = scene["obstacles"], RADIUS + 0.5 * DIAMETER
    balls = tuple(
        Ball(np.array(obstacle["sphere"]["center"]), reach, at.arc_length, float(np.linalg.norm(at.force)))
        for at in found.contacts
        if "sphere" in obstacle
    )
    guess = np.concatenate([found.points[0], frame, force, moment])
    return found, Problem(cable, DOWN, balls).solve(guess * (1.0 + 0.01 * np.cos(np.arange(12.0))))


@pytest.mark.parametrize("name", PAIRS)
def test_a_ball_that_pushes_is_that_of_shooting(name):
    scene = pushed(name, natural_strain=NATURAL)
    found, exact = claimed(scene)
    assert exact.converged
    ((mine,), (ball,)) = found.contacts, exact.balls
    size = np.abs(np.concatenate([exact.start_moment, exact.end_moment])).max()
    assert np.linalg.norm(mine.force) == pytest.approx(ball.push, abs=1e-6 * (1 + size))
    assert ball.push > 0.5
    # a point that slides along the cable moves by the root of what the gap is wrong by
    assert mine.arc_length == pytest.approx(ball.arc, abs=1e-6)
    wrenches_are_those(found, exact, scene, 1e-6 * (1 + size))


@pytest.mark.parametrize("force", [[0.0, 0.0, 0.0], [0.5, 1.5, -2.0]])
def test_a_free_end_that_rests_is_that_of_shooting(force):
    scene = among(TILTED, FREE | {"force": force}, GROUND, natural_strain=NATURAL)
    found, exact = claimed(scene, rests=(np.array([0.0, 0.0, 1.0]), 0.5 * DIAMETER))
    assert exact.converged
    (mine,) = found.contacts
    assert mine.arc_length == 1.0
    np.testing.assert_allclose(found.points[-1], exact.end, atol=1e-7)
    np.testing.assert_allclose(mine.force, exact.end_force - force, atol=1e-6 * WEIGHT)
    turn = Rotation.from_euler("xyz", TILTED["rpy"]).inv()
    np.testing.assert_allclose(found.start_wrench[:3], -turn.apply(exact.start_force), atol=1e-6 * WEIGHT)
    np.testing.assert_allclose(found.start_wrench[3:], -turn.apply(exact.start_moment), atol=1e-6 * WEIGHT)
    np.testing.assert_allclose(found.end_wrench, [*-np.array(force), 0.0, 0.0, 0.0], atol=0.0)


@pytest.mark.parametrize("pull", [0.0, 4.0])
@pytest.mark.parametrize("weight", [30.0, 100.0])
def test_a_cable_lies_up_to_its_free_end_as_the_elastica_does(weight, pull):
    """On the ground it is straight, under the tension that pulls at its end; where it lifts off is sought."""
    scene = among(STEEP, FREE | {"force": [pull, 0.0, 0.0]}, GROUND, weight=weight)
    found = solved(scene, 1e-6)

    def clamp(x: np.ndarray) -> np.ndarray:
        """State at the clamp for a lift-off at x[0] along the cable, x[1] from the clamp, pushed by x[2]."""
        return span(np.array([x[1], 0.5 * DIAMETER, 0.0, 0.0, pull, x[2]]), -x[0], weight)[:, -1]

    first = min(found.contacts, key=lambda one: one.arc_length)
    guess = [first.arc_length, first.position[0], first.force[2]]
    clamped = [0.0, STEEP["position"][2], np.pi / 2 - STEEP["rpy"][1]]
    exact = root(lambda x: clamp(x)[:3] - clamped, 1.01 * np.array(guess), tol=1e-12)
    assert np.abs(exact.fun).max() < 1e-10
    lifts, place, push = exact.x
    _, _, _, curvature, along, up = clamp(exact.x)
    np.testing.assert_allclose(found.points[-1], [place + 1.0 - lifts, 0.0, 0.5 * DIAMETER], atol=1e-6)
    turn = Rotation.from_euler("xyz", STEEP["rpy"]).inv()
    np.testing.assert_allclose(found.start_wrench[:3], turn.apply([along, 0.0, up]), atol=1e-5 * weight)
    assert abs(found.start_wrench[4]) == pytest.approx(abs(curvature), abs=1e-5 * weight)
    pressed = sum(one.force[2] for one in found.contacts)
    assert pressed == pytest.approx(weight * (1.0 - lifts) + push, rel=1e-5)
    assert min(one.arc_length for one in found.contacts) == pytest.approx(lifts, abs=1e-4)
    assert found.points[:, 2].min() > 0.5 * DIAMETER - 1e-7


@pytest.mark.parametrize("name", PAIRS)
def test_an_obstacle_out_of_reach_changes_nothing(name):
    """With one the end sections are unknowns beside the cable's, without one they are the cable's own."""
    far = {"name": "far", "sphere": {"center": [0.3, 0.0, -9.0], "radius": 0.1}}
    plain, other = solved(among(*PAIRS[name]), 1e-9), solved(among(*PAIRS[name], far), 1e-9)
    size = np.abs(wrenches(plain)).max()
    np.testing.assert_allclose(wrenches(other), wrenches(plain), atol=1e-7 * size)
    np.testing.assert_allclose(other.points, plain.points, atol=1e-7)
    assert other.energy == pytest.approx(plain.energy, abs=1e-8)
    stiffness = np.abs(plain.clamp_stiffness).max()
    np.testing.assert_allclose(other.clamp_stiffness, plain.clamp_stiffness, atol=1e-6 * stiffness)
    if "moment" not in name:  # a load without energy has no modes
        expected = plain.modes(3).frequencies
        np.testing.assert_allclose(other.modes(3).frequencies, expected, rtol=1e-5)


def read_both_ways(scene: dict[str, Any]) -> tuple[Equilibrium, Equilibrium]:
    """A cable and the same told from its other end, held to have the same points and wrenches."""
    one, other = solved(scene), solved(reversed_scene(scene))
    np.testing.assert_allclose(other.points[::-1], one.points, atol=1e-7)
    mounts = [scene["cables"][0][which] for which in ("start", "end")]
    for mine, theirs, mount in zip(wrenches(one), wrenches(other)[::-1], mounts, strict=True):
        turn = FLIP if "rpy" in mount else Rotation.identity()
        expected = turn.apply(mine.reshape(2, 3)).ravel()
        np.testing.assert_allclose(theirs, expected, atol=1e-6 * (1.0 + np.abs(mine).max()))
    return one, other


@pytest.mark.parametrize("name", PAIRS)
def test_a_cable_read_from_its_other_end_is_the_same(name):
    one, other = read_both_ways(pushed(name, natural_strain=NATURAL))
    assert other.energy == pytest.approx(one.energy, rel=1e-7)


def carried(scene: dict[str, Any], turn: np.ndarray, shift: np.ndarray) -> dict[str, Any]:
    """The scene after x -> turn x + shift; a reflection turns sections by its negative about y, too."""
    out = copy.deepcopy(scene)
    mirror = np.diag([1.0, np.linalg.det(turn), 1.0])
    out["gravity"] = (turn @ scene["gravity"]).tolist()
    for which in ("start", "end"):
        mount = out["cables"][0][which]
        if "position" in mount:
            mount["position"] = (turn @ mount["position"] + shift).tolist()
            own = turn @ Rotation.from_euler("xyz", mount.pop("rpy")).as_matrix() @ mirror
            mount["orientation"] = Rotation.from_matrix(own).as_quat().tolist()
            if "axis" in mount:
                mount["axis"] = (mirror @ mount["axis"]).tolist()
        for field, sign in (("force", 1.0), ("moment", np.linalg.det(turn))):
            if field in mount:
                mount[field] = (sign * turn @ mount[field]).tolist()
    for one in out["obstacles"]:
        for shape, at in (("sphere", "center"), ("plane", "point")):
            if shape in one:
                one[shape][at] = (turn @ one[shape][at] + shift).tolist()
        if "plane" in one:
            one["plane"]["normal"] = (turn @ one["plane"]["normal"]).tolist()
    return out


SCENES = [*PAIRS, "rests", "lies"]


def scene_of(name: str) -> dict[str, Any]:
    if name in PAIRS:
        return pushed(name)
    return among(TILTED, FREE, GROUND) if name == "rests" else among(STEEP, FREE, GROUND, weight=30.0)


@pytest.mark.parametrize("name", SCENES)
def test_a_rigid_motion_of_everything_changes_no_wrench(name):
    turn, shift = Rotation.from_rotvec([0.4, -1.1, 0.8]).as_matrix(), np.array([3.0, -2.0, 0.5])
    scene = scene_of(name)
    one, other = solved(scene, 1e-6), solved(carried(scene, turn, shift), 1e-6)
    np.testing.assert_allclose(other.points, one.points @ turn.T + shift, atol=1e-6)
    for which, mine, theirs in zip(("start", "end"), wrenches(one), wrenches(other), strict=True):
        if scene["cables"][0][which].get("kind") != "free":
            np.testing.assert_allclose(theirs, mine, atol=1e-5 * (1.0 + np.abs(mine).max()))


@pytest.mark.parametrize("name", SCENES)
def test_its_mirror_image_has_mirrored_wrenches(name):
    flip = np.diag([1.0, -1.0, 1.0])
    scene = scene_of(name)
    one, other = solved(scene, 1e-6), solved(carried(scene, flip, np.zeros(3)), 1e-6)
    np.testing.assert_allclose(other.points, one.points @ flip, atol=1e-6)
    mirror = np.kron(np.diag([1.0, -1.0]), flip)
    for mine, theirs in zip(wrenches(one), wrenches(other), strict=True):
        np.testing.assert_allclose(theirs, mirror @ mine, atol=1e-5 * (1.0 + np.abs(mine).max()))


CART = """
<robot name="r"><link name="base"/><link name="a"/><link name="b"/><link name="c"/><link name="d"/>
<link name="e"/><link name="cart"/>
{joints}</robot>
"""
NAMES = ("x", "y", "z", "rx", "ry", "rz")


def cart() -> str:
    """URDF of a link that may move along and turn about its own axes, which at rest are the world's."""
    links, limit = (
        ("base", "a", "b", "c", "d", "e", "cart"),
        '<limit lower="-1" upper="1" effort="1" velocity="1"/>',
    )
    axes = ("1 0 0", "0 1 0", "0 0 1")
    joints = [
        f'<joint name="{name}" type="{"revolute" if k > 2 else "prismatic"}"><parent link="{links[k]}"/>'
        f'<child link="{links[k + 1]}"/><axis xyz="{axes[k % 3]}"/>{limit}</joint>'
        for k, name in enumerate(NAMES)
    ]
    return CART.format(joints="".join(joints))


@pytest.mark.parametrize("moves", ["start", "obstacle"])
@pytest.mark.parametrize("name", ["pinned", "swivel", "sliding", "free, with a moment", "rests", "lies"])
def test_tangents_are_those_of_finite_differences(name, moves):
    """Wrenches by motions of the start or of the obstacle, and minus the energy's derivative, too."""
    scene = scene_of(name)
    (scene["cables"][0]["start"] if moves == "start" else scene["obstacles"][0])["link"] = "cart"
    tracker = Tracker(load_scene(scene, urdf=cart()), tolerance=1e-6 if name == "lies" else 1e-8)
    (obstacle,) = (one["name"] for one in scene["obstacles"])
    at_rest = tracker.arrive(dict.fromkeys(NAMES, 0.0))["c"]
    assert at_rest.status is Status.CONVERGED, at_rest.message
    exact = at_rest.wrench_response([obstacle])

    def at(joint: str, value: float) -> tuple[np.ndarray, float]:
        found = tracker.arrive(dict.fromkeys(NAMES, 0.0) | {joint: value})["c"]
        assert found.status is Status.CONVERGED, found.message
        return np.concatenate([found.start_wrench, found.end_wrench]), found.energy

    # the start's columns are along its own axes, and told of its own point
    own = Rotation.from_euler("xyz", scene["cables"][0]["start"]["rpy"]).as_matrix()
    r = np.array(scene["cables"][0]["start"]["position"])
    shift = np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])
    motion = np.block([[own.T, -own.T @ shift], [np.zeros((3, 3)), own.T]])
    columns = exact[:12, :6] @ motion if moves == "start" else exact[:12, 12:]
    if moves == "start":
        load = motion.T @ at_rest.start_wrench
    else:
        load = at_rest.obstacle_wrenches[obstacle]
    step = 2e-4  # wrenches are good to 1e-8 of them, over the step
    for k, joint in enumerate(NAMES):
        (ahead, up), (back, low) = at(joint, step), at(joint, -step)
        slope = (ahead - back) / (2.0 * step)
        np.testing.assert_allclose(columns[:, k], slope, atol=2e-5 * max(1.0, np.abs(columns).max()))
        if "moment" not in name:  # whose work is no potential
            assert load[k] == pytest.approx(-(up - low) / (2.0 * step), abs=1e-4 * WEIGHT)


@pytest.mark.parametrize("name", SCENES)
def test_the_error_estimate_bounds_the_error(name):
    scene = scene_of(name)
    exact = solved(scene, 1e-6 if name == "lies" else 1e-8)
    for tolerance in (1e-3, 1e-4, 1e-5):
        found = solved(scene, tolerance)
        assert found.error_estimate <= tolerance
        for mine, theirs in zip(wrenches(found), wrenches(exact), strict=True):
            for part in (slice(0, 3), slice(3, 6)):
                size = max(np.linalg.norm(theirs[part]), 1.0)
                assert np.linalg.norm(mine[part] - theirs[part]) <= 3.0 * tolerance * size


def test_what_rests_on_an_obstacle_is_among_its_contacts_and_wrenches():
    """All that is outside adds up: the clamp, the ground, the weight."""
    found = solved(among(TILTED, FREE, GROUND), 1e-8)
    turn = Rotation.from_euler("xyz", TILTED["rpy"])
    on_ground = found.obstacle_wrenches["ground"]
    total = turn.apply(found.start_wrench[:3]) + on_ground[:3]
    np.testing.assert_allclose(total, [0.0, 0.0, -WEIGHT], atol=1e-6 * WEIGHT)
    np.testing.assert_allclose(on_ground[3:], np.cross(found.points[-1], on_ground[:3]), atol=1e-6 * WEIGHT)


@pytest.mark.parametrize(
    "end", [{"kind": "pinned"}, {"kind": "swivel"}, {"kind": "sliding", "axial_force": 0.02}]
)
def test_joint_load_is_the_derivative_of_the_energy_and_its_derivative(end):
    arm = on_the_arm(end)
    points = (
        Tracker(arm, tolerance=1e-6, polyline_points=101).arrive({"orientation": 0.3})["camera_cable"].points
    )
    ball = (points[50] + [0.0, 0.0, -0.012]).tolist()
    arm["obstacles"] = [{"name": "ball", "sphere": {"center": ball, "radius": 0.01}}]
    tracker, step = Tracker(arm, tolerance=1e-8), 1e-4
    assert tracker.arrive({"orientation": 0.3})["camera_cable"].contacts
    (before, _, low), (torque, slope, _), (after, _, high) = (
        load(tracker, 0.3 + d) for d in (-step, 0, step)
    )
    assert torque == pytest.approx((low - high) / (2 * step), rel=1e-4)
    assert slope == pytest.approx((after - before) / (2 * step), rel=1e-4)


MISTAKES = {
    "a pinned end and friction_model sliding": (
        ALONG_X, PAIRS["pinned"][1], GROUND | {"friction": 0.3}, {"friction_model": "sliding"},
    ),
}  # fmt: skip


@pytest.mark.parametrize("words", MISTAKES)
def test_what_is_not_done_is_refused_in_one_sentence(words):
    start, end, obstacle, fields = MISTAKES[words]
    with pytest.raises(SceneError, match=rf"cables\[0\]\.end\.kind: {words}"):
        load_scene(among(start, end, obstacle) | fields)
