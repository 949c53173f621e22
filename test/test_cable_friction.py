# SPDX-License-Identifier: Apache-2.0
"""Cables that touch each other with friction: against shooting a path, tangents, invariances."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from references import rubbing_path
from references.rubbing import Rods, Touch
from scipy.spatial.transform import Rotation
from test_crossing import (
    ABOVE,
    BELOW,
    DISTANCE,
    GRAVITY,
    LIFT,
    backwards,
    in_world,
    lowered,
    mirrored,
    scene,
    transformed,
)

from cable_ros.branch.coulomb_contact import SLIPS, STICKS, Rub, key, law
from cable_ros.branch.rubbing_cables import RubbingCables
from cable_ros.branch.rubbing_newton import across
from cable_ros.branch.rubbing_tangent import RubbingTangent
from cable_ros.branch.shared_piece import Place
from cable_ros.contact.crossing import FREEDOMS
from cable_ros.equilibrium import Equilibrium, Status
from cable_ros.joint import joint_load
from cable_ros.scene import SceneError, load_scene
from cable_ros.tracker import Tracker

PATH = Path(__file__).parent / "data" / "rubbing.json"
"""By `references/rubbing_path.py`, in about a quarter of an hour."""


def tracker(
    friction: float, tolerance: float = 1e-6, cables: list[dict[str, Any]] | None = None, **more: Any
) -> Tracker:
    asked = {"cable_contact": {"friction": friction}} | more
    return Tracker(load_scene(scene(cables or [BELOW, ABOVE], **asked), urdf=LIFT), tolerance=tolerance)


BELOW_TWO = {
    "name": "hose", "length": 0.45, "stiffness": [0.0013, 0.0013, 0.0009], "outer_diameter": 0.008,
    "linear_density": 0.1, "start": {"position": [-0.2, 0.0, 0.0], "rpy": [0.0, 0.5 * np.pi, 0.0]},
    "end": {"link": "slider", "position": [0.2, 0.0, 0.0], "rpy": [0.0, 0.5 * np.pi, 0.0]},
}  # fmt: skip
SLIDE = """<robot name="r"><link name="base"/><link name="slider"/><joint name="slide" type="prismatic">
<parent link="base"/><child link="slider"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


def across_at(name: str, x: float) -> dict[str, Any]:
    """A wire that lies across the hose at about x, m."""
    turned = [-0.5 * np.pi, 0.0, 0.0]
    return {
        "name": name, "length": 0.45, "stiffness": [0.003, 0.003, 0.002], "outer_diameter": 0.01,
        "linear_density": 0.12, "start": {"position": [x, -0.2, 0.005], "rpy": turned},
        "end": {"position": [x + 0.01, 0.2, 0.005], "rpy": turned},
    }  # fmt: skip


def walk(model: Tracker, lifts: Any) -> list[dict[str, Equilibrium]]:
    found = []
    for lift in lifts:
        found.append(model.arrive({"lift": float(lift)}))
        assert all(one.converged for one in found[-1].values()), (lift, found[-1])
    return found


def placed(lift: float) -> list[dict[str, Any]]:
    """The cables in the world."""
    out = []
    for cable in (BELOW, ABOVE):
        ends = {name: dict(cable[name]) for name in ("start", "end")}
        for end in ends.values():
            if end.pop("link", None):
                end["position"] = np.add(end["position"], [0.0, 0.0, lift])
        out.append(cable | ends)
    return out


def stored() -> tuple[float, list[float], list[Touch]]:
    """Coefficient of friction, poses and states of the reference."""
    values = json.loads(PATH.read_text())
    states = [
        Touch(
            np.array(one["x"]), np.array(one["ends"]), np.array(one["normal"]),
            (np.array(one["arms"][0]), np.array(one["arms"][1])), one["slips"],
        )
        for one in values["states"]
    ]  # fmt: skip
    return values["friction"], [one["lift"] for one in values["states"]], states


def test_agrees_with_shooting_there_and_back() -> None:
    """Ours goes in shorter steps where contact begins or much slips: they differ by the steps' error."""
    limit, lifts, states = stored()
    assert {one.slips for one in states[1:]} == {True, False}
    model = tracker(limit, 1e-7)
    walk(model, np.linspace(0.03, lifts[0] + 2e-4, 5))
    for lift, exact, found in zip(lifts[1:], states[1:], walk(model, lifts[1:]), strict=True):
        (one,), (other,) = found["below"].contacts, found["above"].contacts
        if exact.normal_force > 0.02:
            assert one.sliding == exact.slips, lift
            assert np.linalg.norm(one.force - exact.x[12:15]) < 3e-3 * exact.normal_force
        assert np.abs([one.arc_length, other.arc_length] - exact.arcs).max() < 1e-4
        for name, end in zip(("below", "above"), exact.ends, strict=True):
            for part in (slice(0, 3), slice(3, 6)):
                off = -in_world(found[name])[1][part] - end[part]
                assert np.linalg.norm(off) < 1e-3 * np.linalg.norm(end[part])


def test_the_stored_path_solves_the_equations_of_shooting() -> None:
    limit, lifts, states = stored()
    rods = Rods(GRAVITY, (0.5 * BELOW["outer_diameter"], 0.5 * ABOVE["outer_diameter"]), limit, 1e-9)
    for k in (4, len(states) // 2 - 2, len(states) // 2 + 3, len(states) - 2):
        last, one = states[k - 1], states[k]
        assert np.abs(rods.missed(placed(lifts[k]), one.x, last, one.slips)).max() < 1e-7
        size = np.linalg.norm(one.friction) / one.normal_force
        assert size <= limit * (1.0 + 1e-6)


def test_the_script_of_the_stored_path_makes_it() -> None:
    """Where they first touch, and a step that sticks, to the accuracy asked for here."""
    limit, known, states = stored()
    assert limit == rubbing_path.FRICTION
    assert rubbing_path.lifts(known[0]) == pytest.approx(known, abs=1e-12)
    both = rubbing_path.rods(1e-6)
    near = np.round(states[0].x[:12], 3).reshape(2, 6)
    touch = both.begin(rubbing_path.placed(known[0]), near, rubbing_path.ARCS)
    assert np.abs(touch.x - states[0].x).max() < 1e-5
    assert both.distance(rubbing_path.placed(known[0]), touch) == pytest.approx(DISTANCE, abs=1e-6)
    found = both.step(rubbing_path.placed(known[23]), states[22])
    assert not found.slips
    assert not states[23].slips
    assert np.abs(found.x - states[23].x).max() < 1e-5
    for made, used in zip(rubbing_path.placed(known[3]), placed(known[3]), strict=True):
        for name in ("length", "stiffness", "linear_density"):
            assert made[name] == used[name]
        for end in ("start", "end"):
            for name in ("position", "rpy"):
                np.testing.assert_allclose(made[end][name], used[end][name])


class Probe:
    """The equations of one contact with friction, as functions of the spacer's motion and of the friction."""

    def __init__(self, limit: float, state: int) -> None:
        model = tracker(limit, 1e-9)
        walk(model, np.linspace(0.03, 0.002, 8))
        group = model._crossed
        assert isinstance(group, RubbingCables)
        self.group, self.state, self.kinematics = group, state, model.kinematics
        self.joints = np.array([0.001])
        self.poses = model.kinematics.poses(self.joints)
        (self.spacer,) = group.spacers
        self.at = key(self.spacer)
        self.force = group._last[self.at][0].copy()
        for _ in range(15):
            off, step = self.residual(np.zeros(FREEDOMS), self.force), self.step()
            part = min(1.0, 0.2 * DISTANCE / np.abs(step[:FREEDOMS]).max())
            self.spacer = self.spacer.moved(part * step[:FREEDOMS])
            self.force = across(self.force + part * step[FREEDOMS:], self.spacer.frame[2])
        assert np.abs(off).max() < 1e-9

    def residual(self, motion: np.ndarray, force: np.ndarray) -> np.ndarray:
        """(8,) on the spacer, of the law, and what is along the normal; also sets the state."""
        group, spacer = self.group, self.spacer.moved(motion)
        for _ in range(5):  # springs give way and arms turn as the cables are solved
            group._forces, group._states = {self.at: force}, {self.at: self.state}
            group._hold([spacer], {self.at: np.zeros((2, 3))})
            for cable in group.cables:
                cable.hold({k: one._replace(stiffness=0.0) for k, one in cable._holds.items()})
            group._show(self.kinematics, self.joints, self.poses, [spacer])
            for cable, own in zip(group.cables, self.poses, strict=True):
                assert cable.attempt(self.kinematics, self.joints, Place(own, cable.length))
        pressed = group._residual([spacer], self.poses)
        self.rub: Rub = group._rubs([spacer], self.poses)[0]
        self.now = spacer
        return np.concatenate([pressed, law(self.rub, spacer.frame).residual, [force @ spacer.frame[2]]])

    def tangent(self) -> np.ndarray:
        """(8, 8) derivative of `residual` at its last state, the couples as the friction asks for."""
        group = self.group
        system, _ = RubbingTangent(
            group.cables, group._radii, [self.now], self.poses, {0: self.rub}, {0: group._grips[self.at]}
        ).whole()
        K = system.tangent
        out: np.ndarray = K[:8, :8] - K[:8, 8:] @ np.linalg.solve(K[8:, 8:], K[8:, :8])
        return out

    def step(self) -> np.ndarray:
        off = np.concatenate([self.residual(np.zeros(FREEDOMS), self.force)])
        return -np.linalg.solve(self.tangent(), off)


@pytest.mark.parametrize(("state", "limit"), [(STICKS, 0.3), (SLIPS, 0.1)])
def test_tangent_is_the_derivative(state: int, limit: float) -> None:
    probe = Probe(limit, state)
    probe.residual(np.zeros(FREEDOMS), probe.force)
    tangent, numeric = probe.tangent(), np.empty((8, 8))
    for k in range(8):
        step = np.zeros(8)
        step[k] = 6e-7 if k < FREEDOMS else 4e-5
        twice_back, back, there, twice_there = (
            probe.residual(n * step[:FREEDOMS], probe.force + n * step[FREEDOMS:]) for n in (-2, -1, 1, 2)
        )
        numeric[:, k] = (8.0 * (there - back) - twice_there + twice_back) / (12.0 * step[k])
    scale = np.abs(numeric).max(axis=1)[:, None]
    # the points that touched are read off between nodes of a mesh that moves with the contact
    near = np.array([1e-5] * 5 + [2e-4] * 2 + [1e-6])[:, None]
    assert (np.abs(tangent - numeric) < near * scale).all()


LIFTS = [*np.linspace(0.03, -0.02, 11), *np.linspace(-0.02, 0.0, 5)[1:]]
"""Stick, slip, and stick the other way."""


@pytest.fixture(scope="module")
def base() -> dict[str, Equilibrium]:
    """The cables at the end of `LIFTS`."""
    return walk(tracker(0.15), LIFTS)[-1]


def test_does_not_depend_on_the_point_of_view(base: dict[str, Equilibrium]) -> None:
    """Another order, another end to begin at, another frame of the world: the same forces, with a history."""
    assert abs(np.linalg.norm(base["below"].contacts[0].force)) > 0.05
    turn, shift = Rotation.from_euler("z", 0.7), np.array([0.3, -0.2, 0.1])
    moved = [transformed(one, turn, shift) for one in (BELOW, ABOVE)]
    for cables, same in (
        ([ABOVE, BELOW], True), ([BELOW, backwards(ABOVE)], False), (moved, True),
    ):  # fmt: skip
        found = walk(tracker(0.15, cables=cables), LIFTS)[-1]
        for name in ("below", "above") if same else ("below",):
            scale = np.linalg.norm(base[name].end_wrench)
            np.testing.assert_allclose(found[name].end_wrench, base[name].end_wrench, atol=1e-4 * scale)


def test_mirror_image(base: dict[str, Equilibrium]) -> None:
    image = walk(tracker(0.15, cables=[mirrored(BELOW), mirrored(ABOVE)]), LIFTS)[-1]
    sign = np.array([-1.0, 1.0, 1.0, 1.0, -1.0, -1.0])
    for name in ("below", "above"):
        scale = np.linalg.norm(base[name].end_wrench)
        np.testing.assert_allclose(image[name].end_wrench, sign * base[name].end_wrench, atol=1e-4 * scale)


def test_little_friction_is_none() -> None:
    """Half the friction, half the difference."""
    free = walk(tracker(0.0), LIFTS)[-1]["above"].end_wrench
    one, two = (walk(tracker(mu), LIFTS)[-1]["above"].end_wrench - free for mu in (2e-3, 1e-3))
    assert 0.0 < np.linalg.norm(one) < 5e-3 * np.linalg.norm(free)
    assert np.linalg.norm(one - 2.0 * two) < 0.1 * np.linalg.norm(one)


def test_the_same_path_in_other_steps() -> None:
    """Down and half the way up again, in 2, 8 or 32 steps each."""
    ends = []
    for count in (2, 8, 32):
        model = tracker(0.15)
        walk(model, [0.03])
        walk(model, np.linspace(0.03, -0.02, count + 1)[1:])
        ends.append(walk(model, np.linspace(-0.02, 0.005, count + 1)[1:])[-1])
    for found in ends[:2]:
        for name in ("below", "above"):
            exact = ends[2][name].end_wrench
            for part in (slice(0, 3), slice(3, 6)):
                off = found[name].end_wrench[part] - exact[part]
                assert np.linalg.norm(off) < 1e-2 * np.linalg.norm(exact[part])


def test_the_way_back_is_another_one() -> None:
    down, *_, back = walk(tracker(0.15), [*np.linspace(0.03, 0.0, 7), -0.01, -0.02, -0.01, 0.0])[6:]
    change = back["above"].end_wrench - down["above"].end_wrench
    assert np.linalg.norm(change[:3]) > 0.03 * np.linalg.norm(down["above"].end_wrench[:3])


@pytest.mark.parametrize("count", [2, 4, 8, 16, 32])
def test_two_contacts_in_other_steps(count: int) -> None:
    # a hose drawn along under two wires until it leaves one, and back: the same however the path is told
    wires = [across_at("first", -0.05), across_at("second", 0.06)]
    asked: dict[str, Any] = {"cable_contact": {"friction": 0.3}}
    model = Tracker(load_scene(scene([BELOW_TWO, *wires], **asked), urdf=SLIDE), tolerance=1e-3)
    for slide in [*np.linspace(0.0, 0.004, count + 1), 0.001, -0.002]:
        found = model.arrive({"slide": float(slide)})
        assert all(one.status is Status.CONVERGED for one in found.values()), (slide, found)
    told = found["hose"].contacts
    assert [one.obstacle for one in told] == ["first", "second"]
    assert all(one.sliding for one in told)
    assert found["hose"].end_wrench[:3] == pytest.approx([0.126374, 0.000366, 0.243441], abs=5e-6)


def test_a_step_that_leaves_two_contacts_and_meets_one_again_is_cut() -> None:
    wires = [across_at("first", -0.05), across_at("second", 0.06)]
    asked: dict[str, Any] = {"cable_contact": {"friction": 0.3}}
    model = Tracker(load_scene(scene([BELOW_TWO, *wires], **asked), urdf=SLIDE))
    model.solve({"slide": 0.0})
    found = model.solve({"slide": 0.00375})["hose"]
    assert found.status is Status.CONVERGED
    (touch,) = found.contacts
    assert touch.obstacle == "first"
    assert touch.sliding


def test_stick_does_work_without_a_loss() -> None:
    """Torque against the energy's differences, and stiffness against the torque's, while all sticks."""
    model, at, step = tracker(0.6, 1e-9), -0.004, 2e-4
    walk(model, np.linspace(0.03, at - 2.5 * step, 8))
    energies, loads = [], []
    for k in range(-2, 3):
        joints = {"lift": at + k * step}
        found = model.solve(joints)
        assert not found["below"].contacts[0].sliding
        energies.append(sum(one.energy for one in found.values()))
        loads.append(joint_load(model, found, joints))
    derivative = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / (12.0 * step)
    torques = [load.torque[0] for load in loads]
    assert torques[2] == pytest.approx(-derivative @ energies, rel=1e-5)
    assert loads[2].stiffness[0, 0] == pytest.approx(derivative @ torques, rel=1e-4)


def test_slip_loses_energy() -> None:
    """There and back the joint does work, which is what friction has taken."""
    model = tracker(0.15)
    walk(model, np.linspace(0.03, 0.0, 7))
    lifts = np.concatenate([np.linspace(0.0, -0.02, 17), np.linspace(-0.02, 0.0, 17)[1:]])
    found = walk(model, lifts)
    torques = [
        joint_load(model, one, {"lift": lift}).torque[0] for one, lift in zip(found, lifts, strict=True)
    ]
    work = -np.trapezoid(torques, lifts)  # of the joint on the cables
    stored_energy = [sum(one.energy for one in each.values()) for each in (found[0], found[-1])]
    assert work - (stored_energy[1] - stored_energy[0]) > 1e-5


def test_forces_are_in_balance() -> None:
    found = walk(tracker(0.15, 1e-8), LIFTS)[-1]
    (one,), (other,) = found["below"].contacts, found["above"].contacts
    np.testing.assert_allclose(one.force, -other.force, rtol=1e-7, atol=1e-9)
    assert np.linalg.norm(other.position - one.position) == pytest.approx(DISTANCE, rel=1e-8)
    for cable, contact in (("below", one), ("above", other)):
        start, end = in_world(found[cable])
        own = BELOW if cable == "below" else ABOVE
        weight = own["length"] * own["linear_density"] * GRAVITY
        np.testing.assert_allclose(weight + contact.force - start[:3] - end[:3], 0.0, atol=1e-8)


def test_a_snapshot_remembers_and_reset_forgets() -> None:
    model, other = tracker(0.15), tracker(0.15)
    walk(model, LIFTS)
    other.restore(model.snapshot())
    one, two = (walk(each, [0.001])[0]["above"].end_wrench for each in (model, other))
    np.testing.assert_array_equal(one, two)
    again = model.solve({"lift": 0.001})["above"].end_wrench  # nothing moves
    np.testing.assert_allclose(again, two, atol=1e-5 * np.linalg.norm(two))
    model.reset()
    forgotten = lowered(model, 0.001)["above"].end_wrench
    assert np.linalg.norm(forgotten - two) > 1e-3 * np.linalg.norm(two)


def test_history_that_is_lost_is_told() -> None:
    """Where the cables cannot be followed any more, numbers are not those of the branch."""
    model = tracker(0.15)
    walk(model, LIFTS)
    group = model._crossed
    assert isinstance(group, RubbingCables)
    group._failures = 99
    found = model.solve({"lift": 0.0005})
    assert found["above"].status is Status.BRANCH_LOST


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (
            {"obstacles": [{"name": "ground", "plane": {"point": [0, 0, -1], "normal": [0, 0, 1]}}]},
            "obstacles",
        ),
        ({"cables": [BELOW, ABOVE | {"axial_stiffness": 20.0}]}, "axial_stiffness"),
        ({"cables": [BELOW, ABOVE | {"limits": {"bend_radius": 0.01}}]}, "limits"),
    ],
)
def test_refuses_what_it_is_not_combined_with(change: dict[str, Any], told: str) -> None:
    with pytest.raises(SceneError, match=f"{told}.*combined"):
        tracker(0.3, **change)


def test_refuses_other_values() -> None:
    with pytest.raises(SceneError, match="friction"):
        tracker(-0.1)
    with pytest.raises(SceneError, match="true, false or"):
        tracker(0.1, cable_contact=0.3)


def test_without_the_effect_there_is_none() -> None:
    model = tracker(0.3, effects=["weight", "contact"])
    assert not model.scene.cable_friction
