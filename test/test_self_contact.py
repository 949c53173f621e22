# SPDX-License-Identifier: Apache-2.0
"""A cable that touches itself: against shooting, balance, virtual work, invariances, Michell's ring."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Any

import numpy as np
import pytest
from references import crossing, planar
from scipy.spatial.transform import Rotation
from test_crossing import (
    GRAVITY,
    backwards,
    check_virtual_work,
    in_world,
    lowered,
    mirrored,
    tracker,
    transformed,
)  # fmt: skip
from zoo_make import led
from zoo_strands import LOOP

from cable_ros.bench.cases import case_scene
from cable_ros.bench.strand_surfaces import with_strands
from cable_ros.equilibrium import Contact, Equilibrium, Status
from cable_ros.scene import load_scene
from cable_ros.tracker import Tracker

APART = 0.06
DIAMETER = 0.008
WIRE = {
    "name": "wire",
    "length": 0.402,
    "stiffness": [0.004, 0.004, 0.003],
    "outer_diameter": 0.006,
    "linear_density": 0.02,
    "start": {"position": [0.04, -0.2, -0.15], "rpy": [-math.pi / 2, 0.0, 0.0]},
    "end": {"position": [0.05, 0.2, -0.15], "rpy": [-math.pi / 2, 0.0, 0.0]},
}
"""The loop comes down on it, too."""


def followed(to: float, tolerance: float = 1e-8, **cable: Any) -> Equilibrium:
    return lowered(tracker([LOOP | cable], tolerance), to, APART)["loop"]


def strands(found: Equilibrium) -> tuple[Contact, Contact]:
    """The two sides of its contact with itself."""
    first, second = (one for one in found.contacts if one.obstacle == "loop")
    return first, second


@functools.cache
def shot(lift: float, axial: float) -> crossing.Itself:
    """By shooting, exact to some 1e-9 of these numbers."""
    stretch = {"axial_stiffness": axial} if axial else {}
    start, _ = in_world(found := followed(lift, **stretch))
    first, second = strands(found)
    end = {"position": np.add(LOOP["end"]["position"], [0.0, 0.0, lift]), "rpy": LOOP["end"]["rpy"]}
    guess = crossing.Itself(
        -start, np.empty(6), first.force[None], np.array([[first.arc_length, second.arc_length]])
    )
    return crossing.solve_itself(LOOP | stretch | {"end": end}, GRAVITY, guess)


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize("axial", [0.0, 50.0])
def test_agrees_with_shooting(tolerance: float, axial: float) -> None:
    """Wrenches, force and places of contact, also where 0.1 N stretch the cable by 0.2 %."""
    lift = -0.006
    found = followed(lift, tolerance, **({"axial_stiffness": axial} if axial else {}))
    first, _ = strands(found)
    exact = shot(lift, axial)
    start, end = in_world(found)
    for a, b in ((-start, exact.start), (-end, exact.end)):
        for part in (slice(0, 3), slice(3, 6)):
            assert np.linalg.norm(a[part] - b[part]) <= tolerance * np.linalg.norm(b[part])
    assert np.linalg.norm(first.force - exact.forces[0]) <= 10 * tolerance * np.linalg.norm(exact.forces)
    arcs = [first.arc_length, first.other_arc_length]
    assert np.abs(arcs - exact.arcs[0]).max() <= 10 * tolerance * LOOP["length"]


def test_forces_are_in_balance() -> None:
    """They are opposite, along the line between points that are a diameter apart, and cancel in sum."""
    found = followed(-0.01)
    first, second = strands(found)
    assert (first.other_arc_length, second.other_arc_length) == (second.arc_length, first.arc_length)
    np.testing.assert_allclose(first.force, -second.force, rtol=1e-8)
    between = second.position - first.position
    assert np.linalg.norm(between) == pytest.approx(DIAMETER, rel=1e-9)
    np.testing.assert_allclose(np.cross(between, second.force), 0.0, atol=1e-8 * DIAMETER)
    assert second.force @ between > 0.0
    start, end = in_world(found)
    weight = LOOP["length"] * LOOP["linear_density"] * GRAVITY
    np.testing.assert_allclose(weight, start[:3] + end[:3], atol=1e-8 * np.linalg.norm(weight))
    np.testing.assert_allclose(found.obstacle_wrenches["loop"], 0.0, atol=1e-8)


def test_the_zoos_judge_sees_wrong_strands() -> None:
    found = followed(-0.01, 1e-4)
    table = found._touching()
    told, surfaces, wrong = with_strands(found, "loop", LOOP["length"], DIAMETER)
    assert not wrong
    assert [one.obstacle for one in told.contacts] == list(surfaces)
    for one in told.contacts:
        assert abs(surfaces[one.obstacle].signed(one.position)) < 1e-9
    for change in (
        {"force": table.force * [[1.0], [0.9]]},
        {"position": table.position + [[0.0], [1e-5]] * table.normal},
        {"other_arc_length": table.other_arc_length + 1e-3},
    ):
        other = dataclasses.replace(table, **change)
        claim = dataclasses.replace(found, _touching=functools.partial(lambda it: it, other))
        assert with_strands(claim, "loop", LOOP["length"], DIAMETER)[2]


@pytest.mark.parametrize("axial", [{}, {"axial_stiffness": 50.0}])
def test_torque_is_the_work_and_stiffness_its_derivative(axial: dict[str, float]) -> None:
    model, at, step = tracker([LOOP | axial], 1e-9), -0.01, 2e-4
    lowered(model, at - 2.5 * step, APART)
    check_virtual_work(model, at, step, 1e-6)


def test_contact_with_itself_and_another_cable() -> None:
    """Balance of both, and the work of lowering the one on the other."""
    model, at, step = tracker([WIRE, LOOP], 1e-8), -0.013, 1e-4
    lowered(model, at - 2.5 * step, APART)
    found = check_virtual_work(model, at, step, 1e-5)
    first, second = strands(found["loop"])
    (own,) = (one for one in found["loop"].contacts if one.obstacle == "wire")
    (other,) = found["wire"].contacts
    np.testing.assert_allclose(first.force, -second.force, rtol=1e-7)
    np.testing.assert_allclose(own.force, -other.force, rtol=1e-7)
    start, end = in_world(found["loop"])
    weight = LOOP["length"] * LOOP["linear_density"] * GRAVITY
    np.testing.assert_allclose(weight + own.force, start[:3] + end[:3], atol=1e-7)


def test_contact_begins_and_ends_where_the_strands_meet() -> None:
    """Wrenches are continuous, forces grow from zero, and the way back is the same."""
    model = tracker([LOOP], 1e-7)
    lifts = [*np.linspace(0.04, 0.0, 21), *np.linspace(0.0, 0.04, 21)]
    forces, wrenches = [], []
    for lift in lifts:
        found = model.solve({"lift": lift})["loop"]
        assert found.converged
        assert not found.overlaps
        forces.append(sum(contact.normal_force for contact in found.contacts) / 2)
        wrenches.append(found.end_wrench)
    assert forces[0] == forces[-1] == 0.0
    assert forces[20] > 0.1
    np.testing.assert_allclose(forces, forces[::-1], atol=1e-6)
    np.testing.assert_allclose(wrenches, wrenches[::-1], atol=1e-6)
    # the steepest rise is 5 N/m: no jump
    assert np.abs(np.diff(forces)).max() < 0.015


def test_cables_whose_strands_are_apart_are_those_of_a_scene_without_contact() -> None:
    one, other = (
        tracker([LOOP], 1e-6, cable_contact=asked).solve({"lift": APART})["loop"] for asked in (True, False)
    )
    assert not one.contacts
    # two cold starts to the tolerance
    np.testing.assert_allclose(one.end_wrench, other.end_wrench, rtol=1e-5, atol=1e-8)


def test_does_not_depend_on_the_point_of_view() -> None:
    """Another end to begin at, another frame of the world, a mirror: the same forces."""
    base, close = followed(-0.01), {"rtol": 0.0, "atol": 1e-7}
    force, moment = (np.linalg.norm(part) for part in np.split(base.end_wrench, 2))
    scale = np.repeat([force, moment], 3)
    first, second = strands(base)
    turned_back = lowered(tracker([backwards(LOOP)]), -0.01, APART)["loop"]
    assert turned_back.energy == pytest.approx(base.energy, abs=1e-10)
    assert [one.arc_length for one in turned_back.contacts] == pytest.approx(
        [LOOP["length"] - second.arc_length, LOOP["length"] - first.arc_length], abs=1e-8
    )
    half = np.tile([1.0, -1.0, -1.0], 2)  # about the section's x axis
    np.testing.assert_allclose(half * turned_back.start_wrench / scale, base.end_wrench / scale, **close)
    # about the vertical, which the joint's axis is
    turn, shift = Rotation.from_euler("z", 0.7), np.array([0.3, -0.2, 0.1])
    moved = lowered(tracker([transformed(LOOP, turn, shift)]), -0.01, APART)["loop"]
    np.testing.assert_allclose(moved.end_wrench / scale, base.end_wrench / scale, **close)
    np.testing.assert_allclose(strands(moved)[0].force, turn.apply(first.force), atol=1e-8)
    image = lowered(tracker([mirrored(LOOP)]), -0.01, APART)["loop"]
    sign = np.array([-1.0, 1.0, 1.0, 1.0, -1.0, -1.0])
    np.testing.assert_allclose(image.end_wrench / scale, sign * base.end_wrench / scale, **close)


def test_order_of_contact_and_cable() -> None:
    """The same scene with the cables in another order."""
    one, other = (
        lowered(tracker(cables, 1e-7), -0.013, APART)["loop"] for cables in ([WIRE, LOOP], [LOOP, WIRE])
    )
    np.testing.assert_allclose(one.end_wrench, other.end_wrench, rtol=1e-6, atol=1e-9)


def test_a_cold_start_says_which_side_it_took() -> None:
    """The one on which the strands pass without contact; the path from where they are apart leads there."""
    path = tracker([LOOP], 1e-7)
    along = lowered(path, 0.02, APART)["loop"]
    cold = tracker([LOOP], 1e-7).solve({"lift": 0.02})["loop"]
    assert "on which side cable 'loop' passes itself" in cold.message
    assert "which side" not in along.message
    np.testing.assert_allclose(cold.end_wrench, along.end_wrench, rtol=1e-6, atol=1e-9)


LEVEL = LOOP | {
    "stiffness": [0.0013, 0.0013, 0.0009],
    "end": {"link": "tool", "position": [0.1, 0.0, 0.0], "rpy": [0.0, math.pi / 2, 0.0]},
}
"""In a plane."""


def test_a_cold_start_without_a_side_is_refused() -> None:
    """In a plane the strands would pass through each other's middle, and either side is as good."""
    found = tracker([LEVEL], 1e-6).solve({"lift": 0.0})["loop"]
    assert found.status is Status.NOT_CONVERGED
    assert "through the middle of itself: nothing tells on which side" in found.message
    assert np.isnan(found.end_wrench).all()


ACROSS = (
    '<robot name="across"><link name="world"/><link name="tool"/><joint name="y" type="prismatic">'
    '<parent link="world"/><child link="tool"/><axis xyz="0 1 0"/>'
    '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
)


def across(tolerance: float = 1e-6) -> Tracker:
    """The end of `LEVEL` on a joint across its plane."""
    scene = {
        "robot": {"urdf": "a.urdf"}, "gravity": GRAVITY, "cable_contact": True, "cables": [LEVEL],
    }  # fmt: skip
    return Tracker(load_scene(scene, urdf=ACROSS), tolerance=tolerance)


def test_strands_never_pass_through_each_other() -> None:
    """Its end is led across the loop, in one step or many, until it is not followed any more."""
    model = across()
    assert model.arrive({"y": 0.03})["loop"].converged
    (held,) = model.arrive({"y": -0.012}).values()
    assert held.converged
    first, second = strands(held)
    assert first.position[1] < second.position[1]
    # loop and strands are symmetric about a vertical axis
    assert first.arc_length + second.arc_length == pytest.approx(LOOP["length"], abs=1e-7)
    for y in np.arange(-0.012, -0.1, -0.002):
        (found,) = model.arrive({"y": y}).values()
        if not found.status.trusted:
            break
        assert strands(found)[0].position[1] < strands(found)[1].position[1]
    assert found.status is Status.NOT_CONVERGED
    stepped = across()
    stepped.arrive({"y": 0.03})
    (found,) = stepped.arrive({"y": -0.1}).values()
    assert not found.status.trusted


def to_the_side(step: float, tolerance: float = 1e-6) -> tuple[float, Equilibrium]:
    """Where the loop of `LEVEL` gives way to one side, being led across, and how it is then."""
    model, y = across(tolerance), -0.012
    model.arrive({"y": 0.03})
    while (found := model.arrive({"y": y})["loop"]).status is Status.CONVERGED:
        y -= step
    assert found.status is Status.SNAPPED
    return y, found


def test_a_symmetric_loop_gives_way_to_one_side_at_the_same_place_whatever_the_steps() -> None:
    """No unstable pose is published on the way; what follows is an equilibrium, by shooting."""
    (far, _), (near, found) = to_the_side(0.002), to_the_side(0.0005)
    assert abs(far - near) <= 0.002
    first, second = strands(found)
    assert abs(first.arc_length + second.arc_length - LOOP["length"]) > 1e-3
    start, end = in_world(found)
    cable = LEVEL | {"end": LEVEL["end"] | {"position": [0.1, near, 0.0]}}
    guess = crossing.Itself(
        -start, np.empty(6), first.force[None], np.array([[first.arc_length, second.arc_length]])
    )
    exact = crossing.solve_itself(cable, GRAVITY, guess)
    for a, b in ((-start, exact.start), (-end, exact.end)):
        for part in (slice(0, 3), slice(3, 6)):
            assert np.linalg.norm(a[part] - b[part]) <= 1e-6 * np.linalg.norm(b[part])
    assert np.abs([first.arc_length, second.arc_length] - exact.arcs[0]).max() <= 1e-5 * LOOP["length"]


@pytest.mark.parametrize("torsion", [0.0013, 0.0009])
def test_michells_ring_is_unstable_at_the_published_twist(torsion: float) -> None:
    """2 pi sqrt(3) EI / GJ: Michell (1889), see Goriely, J. Elasticity 84 (2006), 281-299.

    A ring that is cut and clamped is one that is whole: what it may do is the same but for a rigid motion.
    """
    bending = 0.0013
    urdf = (
        '<robot name="r"><link name="world"/><link name="tool"/><joint name="turn" type="continuous">'
        '<parent link="world"/><child link="tool"/><axis xyz="1 0 0"/></joint></robot>'
    )
    pose = {"position": [0.0, 0.0, 0.0], "rpy": [0.0, math.pi / 2, 0.0]}
    ring = {
        "name": "ring", "length": 0.5, "stiffness": [bending, bending, torsion], "outer_diameter": 0.008,
        "linear_density": 0.0,
        "start": pose, "end": pose | {"link": "tool"},
    }  # fmt: skip
    scene = {"robot": {"urdf": "r.urdf"}, "gravity": [0, 0, 0], "cable_contact": True, "cables": [ring]}
    model = Tracker(load_scene(scene, urdf=urdf), tolerance=1e-6)
    critical = 2.0 * math.pi * math.sqrt(3.0) * bending / torsion
    for part in (0.0, *np.arange(0.02, 0.99, 0.02), 0.999):
        (found,) = model.arrive({"turn": part * critical}).values()
        assert found.converged
        assert not found.overlaps
        assert abs(found.total_twist) == pytest.approx(part * critical, abs=1e-5)
    assert not model.arrive({"turn": 1.001 * critical})["ring"].status.trusted


def test_a_snap_past_itself_is_that_of_a_scene_without_contact() -> None:
    """An arch that snaps through without touching itself: the same energy in the same step."""
    angles = np.arange(-20.0, 45.0, 1.0)
    bow = planar.buckled(1.0, 1.0, 0.9)
    case = led("arch", "", bow.scene(), [{"yaw": math.radians(a)} for a in angles])
    base = case_scene(case)
    thick = tuple(dataclasses.replace(cable, outer_diameter=0.01) for cable in base.cables)
    found = []
    for contact in (False, True):
        model = Tracker(dataclasses.replace(base, cable_contact=contact, cables=thick), tolerance=1e-6)
        found.append([model.solve(dict(pose))["cable"] for pose in case.path])
    plain, touching = found
    assert [one.status for one in plain] == [one.status for one in touching]
    assert sum(one.status is Status.SNAPPED for one in touching) == 1
    for one, other in zip(plain, touching, strict=True):
        assert one.energy == pytest.approx(other.energy, rel=1e-6)


def test_a_twisted_cable_that_snaps_onto_itself_says_so() -> None:
    """Twisted by its end, it throws a loop that its strands close: there it is not followed."""
    urdf = ACROSS.replace('name="y" type="prismatic"', 'name="turn" type="continuous"').replace(
        'axis xyz="0 1 0"', 'axis xyz="1 0 0"'
    )
    slack = LEVEL | {
        "length": 1.0, "outer_diameter": 0.006, "linear_density": 0.002,
        "end": {"link": "tool", "position": [0.5, 0.03, 0.0], "rpy": [0.0, math.pi / 2, 0.0]},
    }  # fmt: skip
    scene = {"robot": {"urdf": "t.urdf"}, "gravity": GRAVITY, "cable_contact": True, "cables": [slack]}
    model = Tracker(load_scene(scene, urdf=urdf), tolerance=1e-5)
    for turn in np.arange(0.0, 20.0, 0.2):
        (found,) = model.arrive({"turn": turn}).values()
        if not found.converged:
            break
        assert not found.overlaps
    assert found.status is Status.NOT_CONVERGED
    assert "snaps onto itself" in found.message


def test_turns_of_a_coil_that_lie_on_each_other_are_told() -> None:
    """Two turns, half a diameter apart where they do not feel each other: contact along a line."""
    length, turns, pitch = 0.6, 2, 0.5 * DIAMETER
    start = {"position": [0.0, 0.0, 0.0], "rpy": [0.0, 0.0, 0.0]}
    end = start | {"position": [turns * pitch, 0.0, 0.0]}
    curvature = 2.0 * math.pi * turns / length
    coil = LOOP | {
        "length": length, "linear_density": 0.0, "natural_strain": [curvature, 0.0, 0.0], "start": start,
        "end": end,
    }  # fmt: skip
    scene = {"gravity": GRAVITY, "cable_contact": True, "cables": [coil]}
    found = Tracker(load_scene(scene), tolerance=1e-4).solve({})["loop"]
    assert found.status is Status.NOT_CONVERGED
    assert "could not be pushed apart" in found.message
    apart = Tracker(load_scene(scene | {"cable_contact": False}), tolerance=1e-4).solve({})["loop"]
    assert apart.converged
    assert [one.other for one in apart.overlaps] == ["loop"]


def test_snapshot_goes_on_with_the_contact() -> None:
    model, other = (tracker([LOOP], 1e-6) for _ in range(2))
    lowered(model, -0.01, APART)
    other.restore(model.snapshot())
    one, two = (each.solve({"lift": -0.012})["loop"] for each in (model, other))
    np.testing.assert_array_equal(one.end_wrench, two.end_wrench)
    assert len(two.contacts) == 2
