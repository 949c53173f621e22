# SPDX-License-Identifier: Apache-2.0
"""Pins, rings and tubes of cables that rub on obstacles: against rollers, plain cables and themselves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from cable_ros import Tracker
from cable_ros.bench.drawn import refined
from cable_ros.branch.cable_tracker import CableTracker
from cable_ros.effects.registry import properties
from cable_ros.equilibrium import Equilibrium, Status
from cable_ros.scene import Kinematics, SceneError, load_scene

JOINTS = {"x": ("base", "a", "1 0 0"), "y": ("a", "b", "0 1 0"), "z": ("b", "hook", "0 0 1"),
          "rise": ("base", "lift", "0 0 1"), "hump": ("base", "ground", "0 0 1")}  # fmt: skip
URDF = "<robot name='r'>" + "".join(
    [f"<link name='{link}'/>" for link in ("base", "a", "b", "hook", "lift", "ground")]
    + [f"<joint name='{name}' type='prismatic'><parent link='{parent}'/><child link='{child}'/>"
       f"<axis xyz='{axis}'/><limit lower='-1' upper='1' effort='1' velocity='1'/></joint>"
       for name, (parent, child, axis) in JOINTS.items()]
) + "</robot>"  # fmt: skip
FLIP = np.diag([1.0, -1.0, 1.0])


def arrived(tracker: Tracker, **joints: float) -> Equilibrium:
    """The result at a pose, after as many calls as it takes; joints that are not named are 0."""
    (found,) = tracker.arrive(dict.fromkeys(JOINTS, 0.0) | joints).values()
    return found


# Against a roller


RADIUS = 5e-5
"""Of the cable of `hanging`, m."""


def hanging(friction: float, roller: float | None = None, arc_length: float = 0.67) -> dict[str, Any]:
    """A cable in a vertical plane over a rough hump and through a ring, or over a smooth roller in its place.

    `roller`: its radius and the cable's together, m; `arc_length`: of the ring at first, m.
    """
    hump = {"name": "hump", "link": "ground", "friction": friction,
            "capsule": {"start": [0.3, -0.5, -0.03], "end": [0.3, 0.5, -0.03], "radius": 0.05}}  # fmt: skip
    cable = {
        "name": "c", "length": 1.06, "stiffness": [0.5, 0.02, 0.5], "outer_diameter": 2 * RADIUS,
        "linear_density": 0.12,
        "start": {"position": [0.0, 0.0, 0.1], "rpy": [0.0, np.pi / 2 + 0.3, 0.0]},
        "end": {"link": "hook", "position": [1.0, 0.0, 0.1], "rpy": [0.0, np.pi / 2 - 0.3, 0.0]},
    }  # fmt: skip
    obstacles = [hump]
    if roller is None:
        cable["supports"] = [{"name": "s", "ring": {"arc_length": arc_length, "position": [0.62, 0.0, 0.02]}}]
    else:
        ends = {"start": [0.62, -0.5, 0.02 - roller], "end": [0.62, 0.5, 0.02 - roller]}
        obstacles.append({"name": "roller", "link": "lift", "capsule": ends | {"radius": roller - RADIUS}})
    return {"gravity": [0.0, 0.0, -9.80665], "obstacles": obstacles, "cables": [cable]}


def pulled(friction: float, roller: float | None, arc_length: float = 0.67) -> tuple[np.ndarray, float]:
    """Both end wrenches (poses, 12) as the end is pulled out and let back, and the arc length in the ring.

    The hump rises before that, and the roller before the hump.
    """
    scene = load_scene(hanging(friction, roller, arc_length), urdf=URDF)
    tracker = Tracker(scene, tolerance=1e-6, joint_limits="ignore")
    for rise in np.linspace(-0.2, 0.0, 21) if roller else []:
        found = arrived(tracker, rise=rise, hump=-0.3)
        arc_length = found.contacts[0].arc_length if found.contacts else np.nan
    out = [arrived(tracker, hump=hump) for hump in np.linspace(-0.1, 0.0, 21)]
    out += [arrived(tracker, x=0.015 * (1.0 - abs(k / 20 - 1.0))) for k in range(41)]
    assert all(one.status is Status.CONVERGED for one in out), [one.message for one in out]
    return np.array([[*one.start_wrench, *one.end_wrench] for one in out]), arc_length


@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_a_ring_is_a_roller_of_vanishing_radius(friction):
    """With a roller the cable is one rod, whose friction is held to other references."""
    coarse, _ = pulled(friction, 2e-3)
    fine, arc_length = pulled(friction, 1e-3)
    ring, _ = pulled(friction, None, arc_length)
    size = np.abs(ring).max()
    errors = [np.abs(one - ring).max() / size for one in (coarse, fine)]
    assert errors[0] / errors[1] == pytest.approx(2.0, abs=0.1), "of first order in the radius"
    np.testing.assert_allclose(2.0 * fine - coarse, ring, atol=5e-4 * size)
    back, forth = ring[-1], ring[-41]  # with friction it does not come back to where it was
    assert np.abs(back - forth).max() > 0.1 * size or not friction


# In space


def bent(
    kind: str, friction: float = 0.4, ring_friction: float = 0.0, mirrored: bool = False
) -> dict[str, Any]:
    """A heavy cable over a rough beam and through a support."""
    place: dict[str, Any] = {"arc_length": 0.6, "position": [0.55, 0.1, 0.12]}
    if ring_friction:
        place["friction"] = ring_friction
    if kind == "tube":
        place["orientation"] = Rotation.from_euler("xyz", [0.0, 1.5, 0.0]).as_quat().tolist()
    mounts = [{"position": [0.0, 0.0, 0.11]}, {"link": "hook", "position": [1.02, 0.2, 0.15]}, place]
    for mount, yaw in zip(mounts, (0.3, 0.35), strict=False):
        mount["orientation"] = Rotation.from_euler("xyz", [0.0, np.pi / 2, yaw]).as_quat().tolist()
    if mirrored:
        for mount in mounts:
            mount["position"] = (FLIP @ mount["position"]).tolist()
            if "orientation" in mount:
                own = Rotation.from_quat(mount["orientation"]).as_matrix()
                mount["orientation"] = Rotation.from_matrix(FLIP @ own @ FLIP).as_quat().tolist()
    beam = {"start": [0.3, -0.5, 0.05], "end": [0.3, 0.5, 0.05], "radius": 0.05}
    cable = {"name": "c", "length": 1.2, "stiffness": [0.02, 0.02, 0.015], "outer_diameter": 0.01,
             "linear_density": 0.1, "start": mounts[0], "end": mounts[1],
             "supports": [{"name": "s", kind: place}]}  # fmt: skip
    return {"gravity": [0.0, 0.0, -9.80665], "cables": [cable],
            "obstacles": [{"name": "beam", "capsule": beam, "friction": friction}]}  # fmt: skip


def path(part: float) -> dict[str, float]:
    """Joint values at a fraction of a path round, and nearly back."""
    out = 1.0 - abs(2.0 * part - 1.0)
    return {
        "x": -0.06 * out,
        "y": 0.15 * np.sin(np.pi * out / 2) - 0.1 * part,
        "z": 0.05 * np.sin(2 * np.pi * part),
    }


def led(
    scene: dict[str, Any], poses: int, told: int = 10, sign: float = 1.0
) -> tuple[Tracker, list[Equilibrium]]:
    """The tracker after `poses` poses of the path, and `told` + 1 of the results; `sign` of y."""
    tracker, out = Tracker(load_scene(scene, urdf=URDF), joint_limits="ignore"), []
    for k in range(poses + 1):
        there = path(k / poses)
        out.append(arrived(tracker, **there | {"y": sign * there["y"]}))
    assert all(one.status is Status.CONVERGED for one in out), [one.message for one in out]
    assert any(contact.sliding for one in out for contact in one.contacts)
    return tracker, out[:: poses // told]


def wrenches(results: list[Equilibrium]) -> np.ndarray:
    """(n, 12) of start and end."""
    return np.array([[*one.start_wrench, *one.end_wrench] for one in results])


@pytest.mark.parametrize(("kind", "friction"), [("pin", 0.0), ("ring", 0.0), ("ring", 0.2), ("tube", 0.0)])
def test_the_path_may_be_told_in_other_steps(kind, friction):
    scene = bent(kind, ring_friction=friction)
    few, many = (wrenches(led(scene, poses)[1]) for poses in (10, 80))
    np.testing.assert_allclose(few, many, atol=0.01 * np.abs(many).max())


# what slips in a tube sticks for a step or not, by the last bit: 0.2 to 0.6 %, in 20 and in 80 poses
@pytest.mark.parametrize(("kind", "apart"), [("pin", 1e-3), ("ring", 1e-3), ("tube", 6e-3)])
def test_a_mirror_image_has_mirrored_wrenches(kind, apart):
    _, one = led(bent(kind), 20)
    _, other = led(bent(kind, mirrored=True), 20, sign=-1.0)
    signs = np.tile([1.0, -1.0, 1.0, -1.0, 1.0, -1.0], 2)
    mine, theirs = wrenches(one), wrenches(other) * signs  # sections are mirrored in their own y axis
    np.testing.assert_allclose(theirs, mine, atol=apart * np.abs(mine).max())


class Led:
    """Kinematics of one plain cable that is led from place to place; its only joint counts them."""

    def __init__(self, places: list[np.ndarray], scene: Kinematics, home: np.ndarray) -> None:
        self.places, self.scene, self.home = places, scene, home

    def poses(self, joints: np.ndarray) -> np.ndarray:
        """(1, 2, 7) of its clamps."""
        k = min(int(joints[0]), len(self.places) - 2)
        one, two = self.places[k : k + 2]
        part = float(joints[0]) - k
        out = (1.0 - part) * one + part * two
        for end in range(2):
            turns = Slerp([0.0, 1.0], Rotation.from_quat([one[end, 3:], two[end, 3:]]))
            out[end, 3:] = turns(part).as_quat()
        return out[None]

    def obstacle_poses(self, joints: np.ndarray) -> np.ndarray:
        """(n, 7) of the links that carry obstacles, which stand still."""
        return self.scene.obstacle_poses(self.home)


def beside_a_pin(
    values: dict[str, Any], route: Sequence[dict[str, float]]
) -> tuple[list[Equilibrium], list[Equilibrium]]:
    """Results along a route, and those of a plain cable that is led as the pin leads the first piece."""
    scene = load_scene(values, urdf=URDF)
    tracker = Tracker(scene, joint_limits="ignore")
    kinematics, places, found = Kinematics(scene), [], []
    for pose in route:
        joints = dict.fromkeys(JOINTS, 0.0) | pose
        found.append(arrived(tracker, **joints))
        mounts = kinematics.poses(np.array([joints[name] for name in kinematics.joint_names]))
        places.append(tracker._coupled[0].places(mounts)[0].poses.copy())
    piece, home = scene.pieces[0], np.zeros(len(kinematics.joint_names))
    plain = CableTracker(piece, properties(scene, piece), 1e-4, 101, [values["obstacles"][0]["name"]])
    way, alone = Led(places, kinematics, home), []
    for k, place in enumerate(places):
        one = plain.solve(way, 0, np.array([float(k)]), place, 0.0)
        while one.status is Status.UNFINISHED:
            one = plain.solve(way, 0, np.array([float(k)]), place, 0.0)
        assert one.status is Status.CONVERGED, one.message
        alone.append(one)
    return found, alone


def starts(results: list[Equilibrium]) -> np.ndarray:
    """(n, 6) wrenches on the start clamp."""
    return np.array([one.start_wrench for one in results])


def test_a_piece_beside_a_pin_is_a_plain_cable_that_is_led_as_the_pin_leads_it():
    found, alone = beside_a_pin(bent("pin"), [path(k / 40) for k in range(41)])
    assert sum(any(contact.sliding for contact in one.contacts) for one in found) > 8
    # between two poses one is led straight, the other as balance at the pin leads it
    theirs = starts(found)
    np.testing.assert_allclose(starts(alone), theirs, atol=5e-3 * np.abs(theirs).max())


# On the ground


def lying(kind: str) -> dict[str, Any]:
    """A hose on rough ground, through a support above it, to an end that is lifted."""
    flat = Rotation.from_euler("y", np.pi / 2).as_quat().tolist()
    support = {"arc_length": 0.8, "position": [0.7, 0.0, 0.05]} | (
        {"friction": 0.5} if kind == "ring" else {}
    )
    hose = {"name": "c", "length": 2.0, "stiffness": [0.5, 0.5, 0.375], "outer_diameter": 0.02,
            "linear_density": 0.5, "start": {"position": [0.0, 0.0, 0.01], "orientation": flat},
            "end": {"link": "hook", "position": [1.6, 0.0, 0.5], "rpy": [0.0, 0.0, 0.0]},
            "supports": [{"name": "s", kind: support}]}  # fmt: skip
    ground = {
        "name": "ground",
        "plane": {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]},
        "friction": 0.5,
    }
    return {"gravity": [0.0, 0.0, -9.80665], "obstacles": [ground], "cables": [hose]}


def about(poses: int) -> tuple[dict[str, float], ...]:
    """To a side, back through the middle to the other, in and out again, and down, each in so many poses."""
    corners = [(0.0, 0.0, 0.0), (0.0, 0.15, 0.0), (0.0, -0.15, 0.0), (-0.1, -0.15, 0.0), (0.0, -0.15, 0.0),
               (0.0, -0.15, -0.2)]  # fmt: skip
    return refined([dict(zip("xyz", corner, strict=True)) for corner in corners], poses)


def led_about(kind: str, poses: int) -> list[Equilibrium]:
    """The results along `about`."""
    tracker = Tracker(load_scene(lying(kind), urdf=URDF), joint_limits="ignore")
    return [arrived(tracker, **pose) for pose in about(poses)]


@pytest.mark.parametrize("kind", ["pin", "ring"])
def test_a_hose_lies_beside_a_support_and_is_led_about(kind):
    """Its stability, judged with the friction of what slips as it is, was said to end where it does not."""
    few, many = led_about(kind, 6), led_about(kind, 24)
    assert [one.message for one in few + many if one.status is not Status.CONVERGED] == []
    assert max(len(one.contacts) for one in many) > 10, "it lies"
    assert any(contact.sliding for one in many for contact in one.contacts)
    # every try of Newton's method at the supports counted as a step: estimates of 1e9
    assert max(one.error_estimate for one in few + many) < 0.05
    coarse, fine = wrenches(few), wrenches(many[::4])
    np.testing.assert_allclose(coarse, fine, atol=0.01 * np.abs(fine).max())


def test_a_piece_that_lies_beside_a_pin_is_a_plain_cable_that_is_led_as_the_pin_leads_it():
    found, alone = beside_a_pin(lying("pin"), about(40))
    theirs = starts(found)
    np.testing.assert_allclose(starts(alone), theirs, atol=0.01 * np.abs(theirs).max())


def test_mobilised_friction_and_rings_are_refused_together():
    scene = bent("ring") | {"friction_model": "sliding"}
    with pytest.raises(SceneError, match="ring 's' and friction_model sliding cannot be combined"):
        load_scene(scene, urdf=URDF)
