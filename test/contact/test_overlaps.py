# SPDX-License-Identifier: Apache-2.0
"""Cables that meet themselves or each other are flagged; those that keep apart, or share a clamp, are not."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from cable_ros import Status, Tracker, load_scene
from cable_ros.contact.overlaps import SelfApproach, closest_approach, closest_between

LOOP = {
    "name": "loop",
    "length": 1.0,
    "stiffness": [0.02, 0.02, 0.015],
    "linear_density": 0.0,
    "start": {"position": [0, 0, 0], "orientation": [0, 0, 0, 1]},
    "end": {"position": [0.05, 0, 0.02], "orientation": [0, 0, 0, 1]},
}
DOWN = [1.0, 0.0, 0.0, 0.0]


def sagging(name: str, start: list[float], end: list[float], **more: Any) -> dict[str, Any]:
    """A cable that hangs in a U between two clamps."""
    turned = [0, 0, 1, 0]
    return {
        "name": name, "length": 0.6, "stiffness": [2e-3, 2e-3, 1.5e-3], "linear_density": 0.1,
        "outer_diameter": 0.01, "start": {"position": start, "orientation": DOWN},
        "end": {"position": end, "orientation": turned}, **more,
    }  # fmt: skip


def solve(*cables: dict[str, Any], points: int = 2):
    scene = load_scene({"gravity": [0, 0, -9.81], "cables": list(cables)})
    found = Tracker(scene, polyline_points=points).solve({})
    assert all(one.status is Status.CONVERGED for one in found.values())
    return found


@pytest.mark.parametrize(("outer", "meets"), [(0.004, False), (0.08, True)])
def test_a_loop_that_meets_itself(outer: float, meets: bool) -> None:
    found = solve({**LOOP, "outer_diameter": outer})["loop"]
    assert found.overlapping == meets
    assert ("matters here" in found.message) == meets
    if meets:
        (overlap,) = found.overlaps
        assert overlap.other == "loop"
        assert overlap.distance < overlap.contact_distance == outer


@pytest.mark.parametrize("points", [2, 301])
@pytest.mark.parametrize(("rise", "meets"), [(0.0, True), (0.008, True), (0.013, False), (0.5, False)])
def test_two_cables_that_cross(rise: float, meets: bool, points: int) -> None:
    # the same shape across the first: both lowest points lie on one vertical, `rise` apart
    along = sagging("along", [-0.1, 0, 0], [0.1, 0, 0])
    half = 0.5**0.5
    across = sagging("across", [0, -0.1, rise], [0, 0.1, rise])
    across["start"]["orientation"], across["end"]["orientation"] = [half, half, 0, 0], [0, 0, half, -half]
    found = solve(along, across, points=points)
    assert [one.overlapping for one in found.values()] == [meets, meets]
    for name, other in (("along", "across"), ("across", "along")):
        for overlap in found[name].overlaps:
            assert overlap.other == other
            assert overlap.distance == pytest.approx(rise, abs=1e-4)
            assert overlap.contact_distance == pytest.approx(0.01)
            assert f"of cable '{other}'" in found[name].message
            assert found[name].as_dict()["overlaps"][0]["other"] == other


def test_cables_that_share_a_clamp_are_neighbours() -> None:
    first = sagging("first", [-0.2, 0, 0], [0, 0, 0])
    second = sagging("second", [0, 0, 0], [0.2, 0, 0])
    second["start"]["orientation"] = [0, 0, 1, 0]
    second["length"] = 0.4
    found = solve(first, second)
    assert not any(one.overlapping for one in found.values())


def test_closest_of_polylines_by_dense_sampling() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        a, b = (np.cumsum(rng.normal(size=(30, 3)), axis=0) for _ in range(2))
        steps = [float(np.linalg.norm(np.diff(one, axis=0), axis=1).max()) for one in (a, b)]
        dense = [
            np.concatenate([p + np.linspace(0, 1, 60)[:, None] * (q - p) for p, q in itertools.pairwise(one)])
            for one in (a, b)
        ]
        expected = min(np.linalg.norm(dense[1] - point, axis=1).min() for point in dense[0])
        found = closest_between(a, b, *steps)
        assert found <= expected + 1e-12
        # the nearest points are at most half a sample away on either
        assert found >= expected - sum(steps) / 118


def test_a_bound_by_motions_says_the_same_as_the_distance():
    """A loop that closes and opens: what is near is told exactly, and nothing is told nearer than it is."""
    needed, spacing, angle = 0.05, 0.15, np.linspace(0.0, 1.0, 101)
    approach, looked = SelfApproach(1.0, spacing), 0
    for k, part in enumerate(np.concatenate([np.linspace(0.7, 1.02, 60), np.linspace(1.02, 0.7, 60)])):
        turn = 2.0 * np.pi * part * angle
        points = np.stack([np.cos(turn), np.sin(turn), 0.02 * angle + 0.01 * k], axis=1) / (
            2.0 * np.pi * part
        )
        exact = closest_approach(points, 1.0, spacing)
        told = approach.bound(points, needed)
        assert told <= exact
        assert (told < needed) == (exact < needed)
        assert told == exact or exact >= needed
        looked += told == exact
    assert looked < 100
