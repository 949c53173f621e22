"""Coulomb friction against what it must come to: a capstan, a cable drawn over the ground either way.

The obstacle moves under a cable between fixed clamps, so where it slides all along the equilibrium is one of
a boundary-value problem, and what it was before is the other way round.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from references import contact
from references.free_boundary import GROUND, Lying, Surface, clamp, meet
from references.reference import Reference

from cable_ros import Equilibrium, Status, Tracker, load_scene

MU, RADIUS, WRAP = 0.35, 0.15, 1.4
CENTRE = contact.cylinder_centre(RADIUS, WRAP)
REACHED = 5e-3
"""Relative error of a wrench that is had on a stretch held by springs at samples; measured: up to 4e-3."""
ROOM = 1e-6
"""Of the cone, for rounding."""


def moved(name: str, kind: str, axis: str, origin: Sequence[float] = (0.0, 0.0, 0.0)) -> str:
    """URDF of one joint `name` between the world and the link `body`."""
    place = " ".join(str(float(x)) for x in origin)
    return (
        f'<robot name="{name}"><link name="world"/><link name="body"/><joint name="{name}" type="{kind}">'
        f'<parent link="world"/><child link="body"/><origin xyz="{place}" rpy="0 0 0"/><axis xyz="{axis}"/>'
        '<limit lower="-10" upper="10" effort="1" velocity="1"/></joint></robot>'
    )


def tracker(reference: Reference, obstacle: dict, urdf: str, tolerance: float = 1e-4) -> Tracker:
    scene = replace(reference, obstacles=({**obstacle, "link": "body"},)).scene()
    return Tracker(load_scene(scene, urdf=urdf), tolerance=tolerance)


def follow(tracker: Tracker, joint: str, values: Sequence[float]) -> list[Equilibrium]:
    found = [tracker.solve({joint: float(value)})["cable"] for value in values]
    for one in found:
        assert one.status is Status.CONVERGED, one.message
    return found


def on_drum(reference: Reference, friction: float, tolerance: float = 1e-4) -> Tracker:
    drum = {
        "name": "drum",
        "cylinder": {"start": [0.0, 0.0, -1.0], "end": [0.0, 0.0, 1.0], "radius": RADIUS},
        "friction": friction,
    }
    return tracker(reference, drum, moved("turn", "continuous", "0 0 1", (*CENTRE, 0.0)), tolerance)


@cache
def draped(friction: float) -> Reference:
    """The rod between the clamps of `contact.draped` with friction mobilised, by boundary values."""
    ends = [clamp(pose) for pose in (contact.draped().reference.start, contact.draped().reference.end)]
    found = Lying(0.45 * (1 - 0.21), 0.55 * (1 - 0.21), 0.7, 12.0, 28.0, 32.0)
    for part in (0.0, 0.5, 1.0):
        found, reference = meet(
            (ends[0], ends[1]), found, Surface(tuple(CENTRE), RADIUS), 20.0, part * friction
        )
    return reference


def error(found: np.ndarray, exact: np.ndarray) -> float:
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))


def keeps_the_cone(found: Equilibrium, friction: float) -> None:
    largest = max(touch.normal_force for touch in found.contacts)
    for touch in found.contacts:
        assert touch.normal_force >= -ROOM * largest
        assert np.linalg.norm(touch.friction) <= friction * touch.normal_force + ROOM * largest


def test_a_drum_turned_under_the_rod_there_and_back() -> None:
    there = np.array([0.0, 0.02, 0.04, 0.06])
    back = np.linspace(0.04, -0.06, 6)
    again = np.linspace(-0.04, 0.06, 6)
    found = follow(on_drum(draped(0.0), MU), "turn", [*there, *back, *again])
    assert error(found[0].end_wrench, draped(0.0).end_wrench) < REACHED
    for one, friction in ((found[3], MU), (found[9], -MU), (found[15], MU)):
        assert error(one.end_wrench, draped(friction).end_wrench) < REACHED
        assert error(one.start_wrench, draped(friction).start_wrench) < REACHED
        assert all(touch.sliding for touch in one.contacts)
    for one in found:
        keeps_the_cone(one, MU)
    # the way there is forgotten: the second time round is the first
    assert error(found[15].end_wrench, found[3].end_wrench) < REACHED


def test_what_sticks_comes_back() -> None:
    small = follow(on_drum(draped(0.0), MU), "turn", [0.0, 1e-4, 2e-4, 1e-4, 0.0])
    rest = small[0].end_wrench
    first, second = (error(one.end_wrench, rest) for one in small[1:3])
    # 2e-4 rad move the rod by 3e-5: the drum carries it along
    assert first > 1e-5
    assert second == pytest.approx(2 * first, rel=0.2)
    assert not all(touch.sliding for touch in small[2].contacts)
    # what slipped at the ends does not come back, the rest does
    assert error(small[4].end_wrench, rest) < 0.2 * second
    for one in small:
        if one.contacts:
            keeps_the_cone(one, MU)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6])
def test_a_taut_rod_over_a_drum_is_a_capstan(tolerance: float) -> None:
    reference = contact.capstan(200.0, MU).reference
    found = follow(on_drum(reference, MU, tolerance), "turn", [0.0, 0.02, 0.04, 0.06])[-1]
    pulls = [float(np.linalg.norm(wrench[:3])) for wrench in (found.start_wrench, found.end_wrench)]
    exact = [np.linalg.norm(w[:3]) for w in (reference.start_wrench, reference.end_wrench)]
    assert pulls == pytest.approx(exact, rel=REACHED)
    assert error(found.end_wrench, reference.end_wrench) < REACHED
    # the rule of the flexible cable is off by what bending adds, see `contact.capstan`: here by 0.15
    assert np.log(pulls[1] / pulls[0]) == pytest.approx(np.log(exact[1] / exact[0]), abs=REACHED)


def test_ground_drawn_lengthwise_under_a_cable_that_is_lifted() -> None:
    friction, weight = 0.2, 60.0
    made = contact.lifted().reference
    ends = clamp(made.start), clamp(made.end)
    table = {**contact.GROUND, "friction": friction}
    steps = tracker(made, table, moved("x", "prismatic", "1 0 0"))
    there, back = follow(steps, "x", [0.0, 0.01, 0.02, 0.01, 0.0])[2::2]
    for one, sign in ((there, -1.0), (back, 1.0)):
        lying, exact = meet(ends, Lying(0.0, 0.55, 0.0, 10.0, 0.0, 19.0), GROUND, weight, sign * friction)
        # the shape is that without friction: what lies is straight, and cannot be drawn out
        assert error(one.end_wrench, made.end_wrench) < REACHED
        borne = weight * (1.0 - lying.after) + lying.last
        rub = sum(touch.friction[0] for touch in one.contacts)
        assert rub == pytest.approx(-sign * friction * borne, rel=REACHED)
        # all of it pulls at the start clamp, beside what the lifted span pulls
        assert one.start_wrench[2] == pytest.approx(exact.start_wrench[2], abs=REACHED * friction * borne)
        keeps_the_cone(one, friction)


def test_ground_drawn_sideways_under_a_lying_rod() -> None:
    reference = contact.dragged_sideways()
    (table,) = reference.obstacles
    there, back = follow(
        tracker(reference, table, moved("y", "prismatic", "0 1 0")),
        "y",
        [0.0, -0.01, -0.02, -0.03, -0.02, 0.03],
    )[3::2]
    assert error(there.end_wrench, reference.end_wrench) < REACHED
    assert error(there.start_wrench, reference.start_wrench) < REACHED
    for one, sign in ((there, -1.0), (back, 1.0)):
        rub = sum(touch.friction for touch in one.contacts)
        assert rub == pytest.approx([0.0, sign * 0.35 * 40.0, 0.0], abs=REACHED * 40.0)
        assert all(touch.sliding for touch in one.contacts)
        keeps_the_cone(one, 0.35)
