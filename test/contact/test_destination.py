# SPDX-License-Identifier: Apache-2.0
"""Where a step leads, against rotations of SciPy and distances one by one."""

from __future__ import annotations

import numpy as np
import pytest
from nodal_scenes import shapes
from scipy.spatial.transform import Rotation

from cable_ros.contact.destination import RESTS, destination, rest_clamps
from cable_ros.contact.distance import AXES, CENTRE, DIMENSIONS, OFFSET, WIDTH, gap, gaps
from cable_ros.contact.travel import TURN


def posed(rng: np.random.Generator) -> np.ndarray:
    return np.concatenate([rng.normal(size=3), Rotation.random(random_state=rng).as_quat()])


@pytest.mark.parametrize("seed", range(5))
def test_conditions_obstacles_and_travel_are_those_of_rotations(seed):
    rng = np.random.default_rng(seed)
    local, length, force, weight = np.array(list(shapes().values())), 0.4, 2.5, rng.normal(size=3)
    poses, links = np.array([posed(rng), posed(rng)]), np.array([posed(rng) for _ in local])
    own = Rotation.from_quat(poses[0, 3:])
    out = np.empty(4), np.empty(3), np.empty(3), local.copy()
    end = own.inv() * Rotation.from_quat(poses[1, 3:])
    last = end.as_quat(scalar_first=True), np.zeros(3), np.zeros((len(local), WIDTH))
    travel, room = destination(poses, last, weight, (length, force), (local, links), out)
    qe, re, f, there = out
    np.testing.assert_allclose(qe, last[0], atol=1e-12)
    np.testing.assert_allclose(re, own.inv().apply(poses[1, :3] - poses[0, :3]) / length, atol=1e-12)
    np.testing.assert_allclose(f, own.inv().apply(weight) * length / force, atol=1e-12)
    for row, link, found in zip(local, links, there, strict=True):
        turn = own.inv() * Rotation.from_quat(link[3:])
        centre = own.inv().apply(link[:3] - poses[0, :3]) + turn.apply(row[CENTRE:AXES])
        np.testing.assert_allclose(found[CENTRE:AXES], centre / length, atol=1e-12)
        axes = turn.as_matrix() @ row[AXES:DIMENSIONS].reshape(3, 3)
        np.testing.assert_allclose(found[AXES:DIMENSIONS], axes.ravel(), atol=1e-12)
    # from nothing: what has moved farthest is how far it is
    farthest = max(
        np.abs(re).max(), np.abs(there[:, CENTRE:AXES]).max(), TURN * np.abs(there[:, AXES:DIMENSIONS]).max()
    )
    assert travel == pytest.approx(farthest, abs=1e-12)
    assert room == min(gaps(there, np.zeros(3)).min(), gaps(there, re).min())


@pytest.mark.parametrize("beside", [0.3 * RESTS, 30.0 * RESTS], ids=["rests", "stands off"])
def test_a_clamp_that_all_but_rests_on_a_plane_is_brought_onto_it(beside: float) -> None:
    # the plane of y and z, all but; its normal is its third axis
    normal = Rotation.from_rotvec([0.0, np.pi / 2, 0.0])
    planes = np.array([shapes()["plane"]])
    planes[0, OFFSET] = 0.0
    planes[0, CENTRE:AXES] = [-beside, 0.0, 0.0]
    planes[0, AXES:DIMENSIONS] = (Rotation.from_rotvec([0.0, beside, beside]) * normal).as_matrix().ravel()
    re = np.array([beside, 0.2, 0.7])
    qe = Rotation.from_euler("XY", [0.4, beside]).as_quat(scalar_first=True)
    before = planes.copy(), qe.copy(), re.copy()
    room = rest_clamps(planes, qe, re)
    assert room == pytest.approx(beside, rel=1e-3)
    n = np.empty(3)
    for r, q in ((np.zeros(3), [1.0, 0.0, 0.0, 0.0]), (re, qe)):
        off = gap(planes[0], r, n, np.empty((2, 3)), np.empty(2))
        across = Rotation.from_quat(q, scalar_first=True).apply([0.0, 0.0, 1.0]) @ n
        if beside < RESTS:
            assert max(abs(off), abs(across)) < 1e-15
        else:
            assert min(abs(off), abs(across)) > RESTS
    for after, old in zip((planes, qe, re), before, strict=True):
        np.testing.assert_allclose(after, old, rtol=0.0, atol=4.0 * beside if beside < RESTS else 0.0)
