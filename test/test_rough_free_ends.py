# SPDX-License-Identifier: Apache-2.0
"""Free ends that rest, drag or lie on rough obstacles: against a discrete rod, and seen otherwise."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from pathlib import Path as File
from typing import Any

import numpy as np
import pytest
from pages import blocks
from references.coulomb_rod import Led, Obstacle, Path, lead
from scipy.spatial.transform import Rotation
from test_touching_ends import DIAMETER, FREE, GROUND, among, wrenches
from zoo_supports import Case, there_and_back

from cable_ros import Tracker
from cable_ros.branch import followed_pieces
from cable_ros.branch.coupled_pieces import CoupledPieces
from cable_ros.branch.grip import friction_force, landed
from cable_ros.contact.distance import BOX, WIDTH
from cable_ros.equilibrium import Equilibrium, Status
from cable_ros.joint import joint_load
from cable_ros.scene import SceneError, load_scene
from cable_ros.scene.text import parse_yaml

STEEP = {"position": [0.0, 0.0, 0.5], "rpy": [0.0, np.pi / 2 + 0.5, 0.0]}
DOWN = {"position": [0.0, 0.0, 0.2], "rpy": [0.0, np.pi / 2 + 0.6, 0.0]}
LEVEL = {"position": [0.0, 0.0, 0.2], "rpy": [0.0, np.pi / 2, 0.0]}
BENT = {"turn": np.array([0.0, -0.65, 0.0]), "bent": (0.0, 0.4)}
"""A first guess from which the discrete rod of `DOWN` comes to lie."""
FRICTION, STEPS = 0.4, 20
PATHS: dict[str, tuple[dict[str, Any], float, list[float], dict[str, Any]]] = {
    "rests, dragged across": (STEEP, 8.0, [0.0, 0.4, 0.0], {}),
    "rests, pushed": (STEEP, 8.0, [0.3, 0.1, 0.0], {}),
    "rests, drawn": (STEEP, 8.0, [-0.3, 0.1, 0.0], {}),
    "lies, lowered and lifted": (LEVEL, 30.0, [0.0, 0.0, -0.15], {}),
    "lies, led across": (DOWN, 30.0, [0.0, 0.15, 0.0], BENT),
    "lies, drawn": (DOWN, 30.0, [-0.3, 0.0, 0.0], BENT),
}
"""Start, weight per length, way of the start, and how the discrete rod begins."""
STEP = 1e-3
"""Of the discrete rod, lengths: in steps of 4e-3 it is 3 % off itself, half of these change 0.3 %."""
OFF = 0.015
"""Error of a force, over the end force."""
EVERY = pytest.mark.parametrize("name", PATHS)


def led(name: str, steps: int = STEPS, **fields: Any) -> Case:
    start, weight, to, _ = PATHS[name]
    ground = GROUND | {"friction": fields.pop("friction", FRICTION)}
    return Case(name, among(start | {"link": "cart"}, FREE, ground, weight=weight, **fields), np.array(to))


@cache
def ours(name: str, steps: int = STEPS) -> list[Equilibrium]:
    return led(name).led(there_and_back(steps), 1e-4)


@cache
def reference(name: str, segments: int) -> Led:
    """The discrete rod with its start led there and back."""
    case, (start, _, to, begin) = led(name), PATHS[name]
    (cable,), parts = case.scene["cables"], there_and_back(STEPS)
    turn = Rotation.from_euler("xyz", start["rpy"]).as_quat()
    starts = np.array([np.concatenate([start["position"] + part * np.array(to), turn]) for part in parts])
    ground = Obstacle("plane", (0.0, 0.0, 0.0, 0.0, 0.0, 1.0), FRICTION)
    weight = np.array(case.scene["gravity"]) * cable["linear_density"]
    stiffness, radius = np.array(cable["stiffness"]), 0.5 * cable["outer_diameter"]
    path = Path(cable["length"], stiffness, weight, starts[0], starts, radius, (ground,), free=True, **begin)
    return lead(path, segments, STEP)


@EVERY
def test_it_goes_as_a_discrete_rod_does_along_the_whole_path(name):
    # 1e-5 of a length of slip is 3 % of the force that pulls a stuck end
    there = reference(name, 60)
    for k, (one, two) in enumerate(zip(ours(name), there.start_wrench, strict=True)):
        assert not there.jumped[k]
        np.testing.assert_allclose(one.start_wrench[:3], two[:3], atol=OFF * np.linalg.norm(two[:3]))
        np.testing.assert_allclose(one.points[-1], there.points[k, -1], atol=2e-3)


@EVERY
def test_its_contacts_obey_coulomb(name):
    for one in ours(name):
        for at in one.contacts:
            normal = at.force @ at.normal
            across = float(np.linalg.norm(at.force - normal * at.normal))
            assert normal >= -1e-6
            assert across <= FRICTION * normal * (1.0 + 1e-4) + 1e-6


def test_friction_at_an_end_that_drags_is_all_that_there_is():
    for one in ours("rests, dragged across"):
        (at,) = one.contacts
        normal = at.force @ at.normal
        if at.sliding:
            across = np.linalg.norm(at.force - normal * at.normal)
            assert across == pytest.approx(FRICTION * normal, rel=1e-5)


def test_an_end_that_drags_is_held_back_along_its_way():
    # in steps so short that the way has no time to turn
    found = ours("rests, dragged across", 160)
    slid = 0
    for before, now in pairwise(found):
        (at,) = now.contacts
        way = now.points[-1] - before.points[-1]
        if at.sliding:
            across = at.force - at.force @ at.normal * at.normal
            # to the tolerance
            assert np.linalg.norm(across) == pytest.approx(FRICTION * (at.force @ at.normal), rel=1e-4)
            np.testing.assert_allclose(across / np.linalg.norm(across), -way / np.linalg.norm(way), atol=0.03)
            slid += 1
        else:
            assert np.linalg.norm(way) < 1e-4
    assert slid > 200


def along_a_polygon(corners: int, parts: int) -> np.ndarray:
    """(corners, 3) force at the start of one that rests, at the corners of its way; (parts) poses a side."""
    case, turns = led("rests, drawn"), np.linspace(0.0, 2.0 * np.pi, corners + 1)
    ways = 0.15 * np.stack([np.cos(turns) - 1.0, np.sin(turns), 0.0 * turns], axis=1)
    tracker, out = case.tracker(1e-4), []
    tracker.arrive(case.joints(0.0))
    for start, end in pairwise(ways):
        for part in np.arange(1, parts + 1) / parts:
            joints = dict(zip("xyz", (start + part * (end - start)).tolist(), strict=True))
            found = tracker.arrive(joints)["c"]
            assert found.status is Status.CONVERGED, found.message
        out.append(found.start_wrench[:3])
    return np.array(out)


def test_an_end_that_slips_round_bends_bears_the_same_in_more_poses():
    # friction against the mean slip of a step, of first order, was 1.7e-3 off; against that at its end 7e-5
    few, many = along_a_polygon(16, 1), along_a_polygon(16, 16)
    np.testing.assert_allclose(few, many, atol=2e-4 * np.linalg.norm(many, axis=1).min())


def test_the_error_of_the_path_is_that_of_the_force_at_the_clamp():
    # beside the force of the free end, which is none, it was told as hundreds
    assert 1e-3 < max(one.error_estimate for one in ours("lies, led across")) < 0.3


def test_a_call_that_ends_with_nothing_left_of_the_way_does_not_stop_the_next_ones(monkeypatch):
    case = led("lies, drawn")
    tracker = case.tracker(1e-4)
    tracker.arrive(case.joints(0.0))
    monkeypatch.setattr(followed_pieces, "MOST_STEPS", 1)
    calls = [tracker.solve(case.joints(0.05))["c"].status for _ in range(40)]
    assert {calls[0], calls[-1]} == {Status.UNFINISHED, Status.CONVERGED}
    monkeypatch.undo()
    assert tracker.solve(case.joints(0.06))["c"].status is Status.CONVERGED


HEAVY = 9.9e3


def over_drum(radius: float, above: float) -> Case:
    """A heavy rope that hangs over a drum, its start a little above the top, and is drawn over it."""
    drum = {"start": [0.0, -0.2, 0.0], "end": [0.0, 0.2, 0.0], "radius": radius}
    top = radius + 0.5 * DIAMETER + above
    hand = {"link": "cart", "position": [0.0, 0.0, top], "rpy": [0.0, -np.pi / 2, 0.0]}
    obstacle = {"name": "drum", "cylinder": drum, "friction": FRICTION}
    return Case("", among(hand, FREE, obstacle, weight=HEAVY), np.array([0.1, 0.0, 0.0]))


def test_a_finer_mesh_that_cannot_be_balanced_is_not_gone_on_from(monkeypatch):
    case, parts = over_drum(0.07, 0.006), np.linspace(0.0, 1.0, 8)
    exact, tracker, failed = case.led(parts, 1e-5)[-1], case.tracker(1e-5), []
    tracker.arrive(case.joints(0.0))
    plain = CoupledPieces._newton

    def fails_at_rest(self, kinematics, joints, mounts, guess):
        if np.array_equal(joints, self._joints):  # on another mesh than it has come on
            failed.append((self.pieces[0], self.pieces[0].mesh))
            return None
        return plain(self, kinematics, joints, mounts, guess)

    with monkeypatch.context() as patch:
        patch.setattr(CoupledPieces, "_newton", fails_at_rest)
        found = [tracker.arrive(case.joints(part))["c"].status for part in parts[1:4]]
    assert found[-1] is Status.NOT_CONVERGED
    piece, finer = failed[-1]
    assert piece.mesh is not finer
    last = [tracker.arrive(case.joints(part))["c"] for part in parts[4:]][-1]
    assert last.status is Status.CONVERGED
    assert last.start_wrench == pytest.approx(exact.start_wrench, abs=0.01 * np.abs(exact.start_wrench).max())


@pytest.mark.parametrize(
    ("radius", "above"), [(0.08, 0.006), (0.07, 0.014), (0.1, 0.006), (0.07, 0.006), (0.075, 0.006)]
)
def test_a_heavy_rope_drawn_over_a_drum_slides_at_the_capstans_ratio(radius, above):
    """As more of it comes to lie on the drum, its mesh has to become finer within a step."""
    case, weight, rim = over_drum(radius, above), HEAVY, radius + 0.5 * DIAMETER
    found = case.led(np.linspace(0.0, 1.0, 3), 1e-3)[-1]
    # tension where the span leaves the drum, and the angle about which the cable has turned on it
    down, _, back = found.start_wrench[:3]
    pull = np.array([back, -down - weight * found.contacts[0].arc_length])
    end, tension = np.arctan2(*pull), float(np.linalg.norm(pull))
    # dT/dphi = mu T + w R (cos phi + mu sin phi), from the weight that hangs on the other side
    hangs, square = -weight * found.points[-1, 2], FRICTION**2
    spread = ((1.0 - square) * np.sin(end) - 2.0 * FRICTION * np.cos(end)) / (1.0 + square)
    begins = hangs + 2.0 * FRICTION / (1.0 + square) * weight * rim
    rope = np.exp(FRICTION * end) * begins + weight * rim * spread
    bending = 0.5 * (1.0 + square) * (1.0 / tension - 1.0 / hangs) / rim**2
    assert np.log(tension / rope) == pytest.approx(bending, abs=3e-3)


def test_how_a_heavy_rope_was_led_there_tells_no_more_than_a_thousandth():
    """Its mesh became finer at other poses, and each time what slips was told anew: 1.4 % apart."""
    forces = []
    for k, steps in enumerate((8, 8, 11, 16)):
        case = over_drum(0.07 * (1.0 + 1e-7 * k), 0.006)
        forces.append(case.led(np.linspace(0.0, 1.0, steps), 1e-5)[-1].start_wrench[:3])
    np.testing.assert_allclose(forces, [forces[0]] * 4, atol=1e-3 * np.linalg.norm(forces[0]))


@EVERY
def test_few_poses_and_many_lead_to_one_answer(name):
    few, many = ours(name)[STEPS], led(name).led(np.linspace(0, 1, 4 * STEPS + 1), 1e-4)[-1]
    np.testing.assert_allclose(
        few.start_wrench, many.start_wrench, atol=0.01 * np.abs(many.start_wrench).max()
    )


@pytest.mark.parametrize("name", ["rests, pushed", "lies, drawn"])
def test_the_ground_may_move_instead(name):
    start, weight, to, _ = PATHS[name]
    ground = GROUND | {"friction": FRICTION, "link": "cart"}
    other = Case(name, among(start, FREE, ground, weight=weight), -np.array(to)).led(
        there_and_back(STEPS), 1e-4
    )
    for one, two in zip(ours(name), other, strict=True):
        # steps are shortened by what fails, which is another one here
        np.testing.assert_allclose(wrenches(one), wrenches(two), atol=1e-3 * np.abs(wrenches(two)).max())


@pytest.mark.parametrize("name", ["rests, dragged across", "lies, led across"])
def test_its_mirror_image_is_its_image(name):
    start, weight, to, _ = PATHS[name]
    ground = GROUND | {"friction": FRICTION}
    mirrored = among(start | {"link": "cart"}, FREE, ground, weight=weight)
    image = Case(name, mirrored, np.array(to) * [1.0, -1.0, 1.0]).led(np.linspace(0, 1, STEPS + 1), 1e-4)
    for one, two in zip(ours(name), image, strict=False):
        force, moment = one.start_wrench.reshape(2, 3)
        # in a frame with x down, y along world's y, z along the cable
        expected = np.concatenate([force * [1.0, -1.0, 1.0], moment * [-1.0, 1.0, -1.0]])
        np.testing.assert_allclose(two.start_wrench, expected, atol=2e-3 * np.abs(expected).max())


def test_ever_less_friction_is_none():
    smooth = led("rests, dragged across", friction=0.0).led(np.linspace(0, 1, 6), 1e-6)[-1]
    errors = [
        np.abs(led("rests, dragged across", friction=mu).led(np.linspace(0, 1, 6), 1e-6)[-1].start_wrench
               - smooth.start_wrench).max()
        for mu in (1e-2, 1e-3)
    ]  # fmt: skip
    assert errors[1] == pytest.approx(0.1 * errors[0], rel=0.05)


def test_its_friction_is_in_the_load_of_the_joint_that_carries_the_ground():
    ground = GROUND | {"friction": FRICTION, "link": "cart"}
    case = Case("", among(STEEP, FREE, ground, weight=8.0), np.array([0.2, 0.1, 0.0]))
    tracker = case.tracker(1e-6)
    for part in (0.0, 0.5, 1.0):
        found = tracker.arrive(case.joints(part))
        torque = dict(
            zip(tracker.joint_names, joint_load(tracker, found, case.joints(part)).torque, strict=True)
        )
    (at,) = found["c"].contacts
    assert at.sliding
    np.testing.assert_allclose([torque[axis] for axis in "xyz"], -at.force, atol=1e-9)


def test_the_stiffness_of_an_end_that_sticks_is_that_of_its_motion():
    case, step = led("rests, dragged across"), 1e-5

    def at(parts: list[float]) -> Equilibrium:
        return case.led(np.array(parts), 1e-8)[-1]

    here = at([0.0, 0.01])
    assert not here.contacts[0].sliding
    slope = (at([0.0, 0.01, 0.01 + step]).start_wrench - at([0.0, 0.01, 0.01 - step]).start_wrench) / (
        2 * step
    )
    turn = Rotation.from_euler("xyz", STEEP["rpy"]).inv()
    motion = np.concatenate([turn.apply(case.to), np.zeros(3)])
    predicted = here.clamp_stiffness[:6, :6] @ motion
    np.testing.assert_allclose(predicted, slope, atol=1e-4 * np.abs(slope).max())


@pytest.mark.parametrize("seed", range(20))
def test_friction_is_along_the_way_and_as_large_as_coulomb_says(seed):
    rng = np.random.default_rng(seed)
    half = rng.normal(size=(2, 2))
    compliance = half @ half.T @ np.diag([1.0, 1e-4]) + 1e-9 * np.eye(
        2
    )  # a cable hardly gives way along itself
    compliance = 0.5 * (compliance + compliance.T) + 0.1 * rng.normal() * np.array(
        [[0.0, 1e-4], [-1e-4, 0.0]]
    )
    way, relief, friction = rng.normal(size=2), 0.1 * rng.normal(size=2), rng.uniform(0.05, 0.8)
    normal = rng.uniform(0.1, 3.0)
    force = friction_force(friction, way, compliance, normal, relief)
    gone, most = way - compliance @ force, friction * (normal - relief @ force)
    if np.linalg.norm(gone) < 1e-11:
        assert np.linalg.norm(force) <= most * (1.0 + 1e-9)
    else:
        np.testing.assert_allclose(force, most * gone / np.linalg.norm(gone), rtol=1e-6)


def test_an_end_sticks_where_less_friction_is_enough():
    force = friction_force(0.5, np.array([0.1, 0.2]), 0.5 * np.eye(2), 1.0, np.zeros(2))
    np.testing.assert_allclose(force, [0.2, 0.4], rtol=1e-12)


def test_it_lands_where_it_meets_the_surface():
    row = np.zeros(WIDTH)
    row[0], row[4:13], row[13:16] = BOX, np.eye(3).ravel(), 0.5
    place = landed(row, np.array([0.1, 0.0, 0.7]), np.array([0.3, 0.0, 0.4]))
    np.testing.assert_allclose(place, [0.1 + 0.2 * 2 / 3, 0.0, 0.5])


def test_a_free_start_on_something_rough_is_refused_in_one_sentence():
    scene = among(FREE, DOWN, GROUND | {"friction": 0.3}, weight=30.0)
    with pytest.raises(SceneError, match=r"cables\[0\]\.start\.kind: a free start and friction of obstacles"):
        load_scene(scene)


def test_no_pose_is_told_of_another_branch():
    assert all(one.status is Status.CONVERGED for name in PATHS for one in ours(name))


def test_the_tether_of_the_page_drags_on_the_ground():
    page = File(__file__).parents[1] / "docs" / "ends.md"
    _, example, *_ = [block.text for block in blocks(page) if block.language == "yaml"]
    found = Tracker(parse_yaml(example, str(page))).arrive({})["tether"]
    assert found.status is Status.CONVERGED, found.message
    held = found.obstacle_wrenches["ground"][:3]
    assert held[2] < 0.0  # the ground carries a part of it
    up = Rotation.from_quat(found.wrench_axes[0]).apply(found.start_wrench[:3])
    np.testing.assert_allclose(up + held, [0.0, 0.0, -0.06 * 9.81], atol=1e-4)
