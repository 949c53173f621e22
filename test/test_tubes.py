# SPDX-License-Identifier: Apache-2.0
"""Tubes: against Euler's elastica, against rings in pairs, and by balance. More in `test_supports`."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation
from scipy.special import ellipk
from test_ends import END, START, mapping
from test_supports import FREE, away, axes_of, support, tensions, tracked

from cable_ros.scene import SceneError, load_scene


def pushed(force: float) -> dict[str, Any]:
    """A weightless cable, bent by a quarter turn and then straight through a tube, pushed in at its free end.

    Its bending stiffness in the plane of the turn is 1 N m^2, across it 2 N m^2: it buckles in that plane.
    """
    end = {"kind": "free", "force": [0.0, -force, 0.0]}
    tube = support("tube", "t", 0.27, [0.16, 0.16, 0.0], rpy=[-np.pi / 2, 0.0, 0.0])
    start = {"position": [0.0, 0.0, 0.0], "rpy": [0.0, np.pi / 2, 0.0]}
    return mapping(start, end, 0.0, supports=[tube], stiffness=[1.0, 2.0, 0.7])


@pytest.mark.parametrize("part", [0.3, 0.9, 0.99])
def test_the_piece_beyond_a_tube_stays_straight_up_to_eulers_load(part):
    beyond = 1.0 - 0.2529
    force = part * np.pi**2 / 4 / beyond**2
    tracker, found = tracked(pushed(force), 1e-9)
    (arc,) = tracker._coupled[0].arcs
    np.testing.assert_allclose(found.points[-1], [0.16, 0.16 + 1.0 - arc, 0.0], atol=1e-9)
    critical = np.pi**2 / 4 / (1.0 - arc) ** 2
    piece = tracker._coupled[0].pieces[1]
    # stability is judged again after a change of the length by 1e-3, and Euler's load goes by its square
    assert piece._margin == pytest.approx(1.0 - force / critical, abs=2e-3)
    before, after = (one.ends() for one in tracker._coupled[0].pieces)
    assert after.wrenches[2] == pytest.approx(-force, rel=1e-9)
    # the tension before the tube is less by the force of the moment there, EI = 1 N m^2 in that plane
    moment = np.hypot(*before.wrenches[9:11])
    assert -before.wrenches[8] == pytest.approx(-force - 0.5 * moment**2, rel=1e-7)


@pytest.mark.parametrize("part", [1.02, 1.3])
def test_beyond_eulers_load_it_is_his_elastica_and_pushes_back_less(part):
    force = part * np.pi**2 / 4 / (1.0 - 0.2529) ** 2
    tracker, found = tracked(pushed(force), 1e-9)
    (arc,) = tracker._coupled[0].arcs
    modulus = brentq(lambda k: ellipk(k * k) - (1.0 - arc) * np.sqrt(force), 1e-9, 0.999)
    tip = 2.0 * np.arcsin(modulus)
    before, after = (one.ends() for one in tracker._coupled[0].pieces)
    assert np.hypot(*after.wrenches[3:5]) == pytest.approx(np.sqrt(2 * force * (1 - np.cos(tip))), rel=1e-6)
    assert before.forces[1] == pytest.approx(-force * np.cos(tip), rel=1e-6)
    assert found.orientations.shape == (101, 4)
    tangent = Rotation.from_quat(found.orientations[-1]).apply([0.0, 0.0, 1.0])
    assert tangent[1] == pytest.approx(np.cos(tip), abs=1e-6)


def test_two_rings_close_together_hold_as_a_tube_does():
    """Of rings only the equal tension is used; two that are nearer are more of a tube, by first order."""
    tube = away(("tube",))
    tracker, exact = tracked(tube, 1e-9)
    (one,) = tube["cables"][0]["supports"]
    turn, middle = axes_of(one), np.array(one["tube"]["position"])
    force = turn.apply(exact.support_wrenches["tube_0"][:3])
    gaps, misses = [0.05, 0.025, 0.0125], []
    for gap in gaps:
        half = turn.apply([0.0, 0.0, 0.5 * gap])
        rings = [
            support("ring", name, 0.3 + sign * 0.5 * gap, middle + sign * half)
            for name, sign in (("a", -1), ("b", 1))
        ]
        _, found = tracked(mapping(START, END, weight=30.0, supports=rings), 1e-6)
        both = sum(wrench[:3] for wrench in found.support_wrenches.values())
        misses.append([np.linalg.norm(both - force), np.linalg.norm(found.end_wrench - exact.end_wrench)])
    rates = np.log2(np.array(misses)[:-1] / np.array(misses)[1:])
    assert (rates > 0.8).all(), rates
    before, after = tensions(tracker)
    assert abs(after - before) > 2 * misses[-1][0]  # a tube has two tensions, and the rings tell so


def test_a_tube_holds_no_torsion_and_passes_it_on():
    tracker, found = tracked(away(("tube", "tube")), 1e-9)
    pieces = [piece.ends().wrenches for piece in tracker._coupled[0].pieces]
    twisting = np.abs(FREE.end_wrench[3:]).max()
    for one, other in itertools.pairwise(pieces):
        assert -one[11] == pytest.approx(other[5], abs=1e-7 * twisting)
    for wrench in found.support_wrenches.values():
        assert wrench[5] == 0.0
        assert np.abs(wrench[3:5]).max() > 1e-2


def test_forces_of_a_tube_are_in_balance_with_ends_and_weight():
    scene = away(("tube",))
    _, found = tracked(scene, 1e-9)
    (cable,) = scene["cables"]
    frames = [Rotation.from_euler("xyz", cable[end]["rpy"]) for end in ("start", "end")]
    tube = cable["supports"][0]
    wrenches = [found.start_wrench, found.end_wrench, found.support_wrenches["tube_0"]]
    places = [cable["start"]["position"], cable["end"]["position"], tube["tube"]["position"]]
    points = np.linspace(0.0, 1.0, len(found.points))
    force, moment = np.array([0.0, 0.0, 30.0]), np.zeros(3)
    centre = np.trapezoid(found.points, points, axis=0)
    moment += np.cross(centre, force)
    for frame, place, wrench in zip((*frames, axes_of(tube)), places, wrenches, strict=True):
        force += frame.apply(wrench[:3])
        moment += frame.apply(wrench[3:]) + np.cross(place, frame.apply(wrench[:3]))
    np.testing.assert_allclose(force, 0.0, atol=1e-6)
    np.testing.assert_allclose(moment, 0.0, atol=2e-2)  # the centre of mass is that of a polyline


MISTAKES = {
    "tube": ({}, "orientation"),
    "tube.friction": ({"rpy": [0, 0, 0], "friction": 0.1}, "friction"),
}


@pytest.mark.parametrize("field", MISTAKES)
def test_what_makes_no_sense_is_one_sentence_with_its_field(field):
    fields, words = MISTAKES[field]
    with pytest.raises(SceneError) as error:
        load_scene(mapping(START, END, supports=[support("tube", "a", 0.3, [0.3, 0, 0], **fields)]))
    assert f"cables[0].supports[0].{field}" in str(error.value)
    assert words in str(error.value)
