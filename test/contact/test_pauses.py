# SPDX-License-Identifier: Apache-2.0
"""A robot that stands still, and goes on: a lying cable's friction is what it was."""

from __future__ import annotations

import numpy as np
import pytest
from references.hose_paths import known

from cable_ros import Equilibrium, Status, Tracker, load_scene

CHANGE = 1e-3
"""Largest change of an end force: the tenth of what a path told otherwise may do to it (1 %)."""


def told(name: str, times: int, noise: float) -> list[Equilibrium]:
    """The last answer at each pose of a hose path, told several times, with noise of the joint values."""
    path, rng = known()[name], np.random.default_rng(1)
    tracker, out = Tracker(load_scene(path.scene(), urdf=path.urdf())), []
    for state in path.states():
        for k in range(times):
            there = {joint: value + noise * rng.standard_normal() * (k > 0) for joint, value in state.items()}
            answer = tracker.arrive(there)["hose"]
            assert answer.status is Status.CONVERGED, answer.message
        out.append(answer)
    return out


@pytest.mark.parametrize("name", ["issue_10_10", "lifted_59", "turned_37"])
def test_standing_still_changes_nothing(name: str) -> None:
    """All that slipped used to stick, by rounding, and up to 0.7 % of the end force changed as it went on."""
    moving = told(name, 1, 0.0)
    for noise in (0.0, 1e-12):
        for before, after in zip(moving, told(name, 3, noise), strict=True):
            change = np.linalg.norm(after.end_wrench[:3] - before.end_wrench[:3])
            assert change < CHANGE * np.linalg.norm(before.end_wrench[:3])
