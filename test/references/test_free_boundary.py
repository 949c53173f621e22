# SPDX-License-Identifier: Apache-2.0
"""Rods along obstacles between given clamps: two methods agree, and known limits are reached."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from references import contact
from references.free_boundary import GROUND, Lying, Surface, clamp, collocate, meet, walk
from references.reference import Reference

DRUM = Surface(tuple(contact.cylinder_centre(0.15, 1.4)), 0.15)
SPANS = 0.45 * (1 - 0.21), 0.55 * (1 - 0.21)
CASES = {
    "lifted": (contact.lifted, Lying(0.0, 0.55, 0.0, 10.0, 0.0, 19.0), GROUND, 60.0),
    "sagging": (contact.sagging, Lying(0.3, 0.35, 0.0, 12.0, 38.0, 37.0), GROUND, 120.0),
    "draped": (contact.draped, Lying(*SPANS, 0.7, 12.0, 28.0, 32.0), DRUM, 20.0),
}


def clamps(reference: Reference) -> tuple[np.ndarray, np.ndarray]:
    return clamp(reference.start), clamp(reference.end)


def off(lying: Lying, by: float) -> Lying:
    return Lying(*(x * (1 + by) for x in astuple(lying)))


@pytest.mark.parametrize("name", CASES)
def test_what_was_manufactured_is_found_between_its_clamps(name: str) -> None:
    make, lying, surface, weight = CASES[name]
    reference = make().reference
    for found in (
        meet(clamps(reference), off(lying, 0.02), surface, weight)[0],
        collocate(clamps(reference), off(lying, 0.02), surface, weight),
    ):
        # collocation is asked for 1e-10, relative, of lengths of 1 and forces of 10 to 40
        assert astuple(found) == pytest.approx(astuple(lying), abs=1e-8)


@pytest.mark.parametrize("friction", [0.35, -0.35])
@pytest.mark.parametrize("name", CASES)
def test_shooting_and_collocation_agree_with_friction(name: str, friction: float) -> None:
    make, lying, surface, weight = CASES[name]
    ends = clamps(make().reference)
    guess = lying
    for part in (0.25, 0.5, 0.75, 1.0):
        guess, reference = meet(ends, guess, surface, weight, part * friction)
    found = collocate(ends, guess, surface, weight, friction, 1e-9)
    assert astuple(found) == pytest.approx(astuple(guess), abs=1e-7)
    assert clamp(reference.end) == pytest.approx(ends[1], abs=1e-9)


def test_a_higher_end_lifts_more_of_the_cable() -> None:
    _, lying, _, weight = CASES["lifted"]
    start, end = clamps(contact.lifted().reference)
    stations = [(start, end + np.array([0.0, up, 0.0])) for up in np.linspace(0.0, 0.1, 6)]
    lengths = [one.after for one, _ in walk(stations, lying, GROUND, weight)]
    assert np.all(np.diff(lengths) > 0)


def test_a_pulling_surface_is_refused() -> None:
    make, lying, surface, weight = CASES["draped"]
    start, end = clamps(make().reference)
    up = np.array([0.0, 0.1, 0.0])
    with pytest.raises(ValueError, match=r"pull|No rod"):
        # high above the drum the rod would have to be drawn down to it
        walk([(start + t * up, end + t * up) for t in np.linspace(0.2, 2.0, 10)], lying, surface, weight)


def test_friction_along_the_ground_is_the_weight_times_its_coefficient() -> None:
    make, lying, surface, weight = CASES["lifted"]
    ends = clamps(make().reference)
    found, reference = meet(ends, lying, surface, weight, 0.2)
    along = 1.0 - found.after
    force = reference.facts["contact_force_x"], reference.facts["contact_force_y"]
    assert force[1] == pytest.approx(weight * along + found.last, abs=1e-9)
    assert -force[0] == pytest.approx(0.2 * force[1], abs=1e-9)


@pytest.mark.parametrize("friction", [0.2, -0.35])
def test_a_taut_rod_over_a_drum_is_a_capstan_with_its_order(friction: float) -> None:
    bare, corrected = [], []
    for pull in (400.0, 800.0, 1600.0):
        reference = contact.capstan(pull, friction).reference
        sizes, angles = [], []
        for pose, wrench, sign in (
            (reference.start, reference.start_wrench, 1.0),
            (reference.end, reference.end_wrench, -1.0),
        ):
            force = sign * Rotation.from_quat(pose[3:]).apply(wrench[:3])
            sizes.append(np.linalg.norm(force))
            angles.append(np.arctan2(force[1], force[0]))
        ratio = np.log(sizes[1] / sizes[0]) - friction * (angles[0] - angles[1])
        bend = 0.5 * (1 + friction**2) / 0.15**2 * (1 / sizes[1] - 1 / sizes[0])
        bare.append(abs(ratio))
        corrected.append(abs(ratio - bend))
    # halving EI halves what bending adds, and what is left goes with d^3, as EI^1.5
    assert np.log2(np.divide(bare[:-1], bare[1:])) == pytest.approx([1.0, 1.0], abs=0.15)
    assert np.log2(np.divide(corrected[:-1], corrected[1:])) == pytest.approx([1.5, 1.5], abs=0.15)
