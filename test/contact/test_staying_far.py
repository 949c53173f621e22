# SPDX-License-Identifier: Apache-2.0
"""Obstacles that stay far: the bound of motions leaves out what a look at every sample says as well."""

from __future__ import annotations

import numpy as np
import pytest
from nodal_scenes import shapes
from references.rods import reference

from cable_ros import Tracker
from cable_ros.contact.distance import AXES, CENTRE, OFFSET, gaps
from cable_ros.contact.gap_search import largest_motion
from cable_ros.contact.touching_rod import TouchingRod
from cable_ros.rod import quaternion
from cable_ros.share import share_file


def test_a_path_down_to_the_ball_and_back_has_the_same_bits(monkeypatch):
    degrees = np.concatenate([np.arange(30.0, 60.0, 0.1), np.arange(60.0, 30.0, -0.1)])

    def led() -> list[bytes]:
        tracker = Tracker(share_file("config", "space_arm_sphere.yaml"))
        found = [tracker.arrive({"orientation": np.radians(at)})["camera_cable"] for at in degrees]
        assert any(one.contacts for one in found)
        return [one.end_wrench.tobytes() for one in found]

    looks, stays_far = [], TouchingRod._stays_far

    def counted(rod: TouchingRod, *step: np.ndarray) -> bool:
        looks.append(stays_far(rod, *step))
        return looks[-1]

    monkeypatch.setattr(TouchingRod, "_stays_far", counted)
    quick = led()
    assert np.mean(looks) > 0.2
    monkeypatch.setattr(TouchingRod, "_stays_far", lambda *_: False)
    assert led() == quick


def test_what_is_known_of_another_shape_or_among_others_is_not_used():
    """As after a rod was put back, where others touch it, and where it is looked for contact elsewhere."""
    tracker = Tracker(share_file("config", "space_arm_sphere.yaml"))
    for degrees in (0.0, 0.1, 0.2):
        tracker.arrive({"orientation": np.radians(degrees)})
    tracked = tracker._tracked_cables[0]
    rod, q = tracked.rod, tracked._q
    assert isinstance(rod, TouchingRod)
    room, obstacles = rod.room, rod.obstacles

    def far(shape: np.ndarray) -> bool:
        rod.room = room
        return rod._stays_far(shape, q, rod.obstacles)

    assert far(q)
    assert not far(q.copy())
    rod.set_conditions(rod.qe, rod.re, rod.f, obstacles.copy())
    assert not far(q)
    rod.set_conditions(rod.qe, rod.re, rod.f, obstacles)
    assert far(q)
    rod.densify(2)
    assert not far(q)


@pytest.mark.parametrize("shape", shapes())
def test_no_gap_changes_by_more_than_the_bound(shape):
    rng = np.random.default_rng(1)
    found, old = reference("space_arm_+0.0deg"), shapes()[shape][None]
    s = np.linspace(0.0, 1.0, 101)
    for size in (1e-3, 1e-2):
        new, q = old.copy(), np.empty_like(found.q)
        new[0, CENTRE:AXES] += size * rng.normal(size=3)
        turn = quaternion.matrix_from_ros(np.array([*(0.5 * size * rng.normal(size=3)), 1.0]))
        new[0, AXES : AXES + 9] = (turn @ old[0, AXES : AXES + 9].reshape(3, 3)).ravel()
        nodes = found.rod.mesh.nodes
        bend = size * np.stack([np.sin(nodes), nodes**2, np.sin(3.0 * nodes)], axis=1)
        quaternion.retract(found.q, bend.ravel(), q)
        most, _, _ = largest_motion(found.q, q, old, new)
        lines = []
        for frames in (found.q, q):
            t = quaternion.tangents(found.rod.mesh.interpolate(frames, s))
            steps = 0.5 * (t[1:] + t[:-1]) / 100
            lines.append(np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)]))
        changes = [gaps(new, b)[0] - gaps(old, a)[0] for a, b in zip(*lines, strict=True)]
        assert 0.0 < np.abs(changes).max() <= most


def test_what_is_out_of_reach_does_not_count():
    """Turning on a link far off, or left out by the cable: a point whose distance changes with the unit."""
    found, near = reference("space_arm_+0.0deg"), shapes()["sphere"][None]
    turning, left_out = near.copy(), near.copy()
    turning[0, CENTRE:AXES] = 0.0, 0.0, 9.0
    left_out[0, OFFSET] = -1e6
    old = np.concatenate([near, turning, left_out])
    new = old.copy()
    new[0, CENTRE] += 1e-3
    new[1, AXES : AXES + 9] = quaternion.matrix_from_ros(np.array([0.1, 0.0, 0.0, 1.0])).ravel()
    new[2, OFFSET] *= 1.01
    most, width, beyond = largest_motion(found.q, found.q, old, new)
    assert (most, width, np.inf) == largest_motion(found.q, found.q, near, new[:1])
    assert 0.0 < beyond <= gaps(new[1:2], np.zeros(3))[0] - 1.0
    closer = turning.copy()
    closer[0, CENTRE + 2] = 1.5
    new = closer.copy()
    new[0, CENTRE + 2] -= 0.4
    assert largest_motion(found.q, found.q, closer, new)[2] == np.inf
