# SPDX-License-Identifier: Apache-2.0
"""Steps in which all points share friction: they arrive where others don't, and at the same place."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from references.hose_paths import known

from cable_ros import Tracker, load_scene
from cable_ros.contact.active_set_rod import ActiveSetRod
from cable_ros.contact.newton import MOST_SHARED
from cable_ros.rod.warm_step import ADVANCED, NOT_CONTRACTING

PATH = known()["turned_9"]
"""A hose is turned at its clamp, and turned back: its patch slips this way and that."""


class Solves:
    """Counts the solves of a rod by how they ended, and refuses those that share friction, or the others."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, shares: bool, others: bool = True) -> None:
        self.ended: dict[bool, list[int]] = {False: [], True: []}
        self.iterations = 0
        newton = ActiveSetRod._newton

        def solve(rod: ActiveSetRod, last: Any, goal: Any, factors: Any, shared: bool) -> Any:
            if not (shares if shared else others or not rod.lies):
                return NOT_CONTRACTING, 0, False, np.inf, 0.0, last[0], last[1]
            found = newton(rod, last, goal, factors, shared)
            self.ended[shared].append(found[0])
            self.iterations = max(self.iterations, found[1] if shared else 0)
            return found

        monkeypatch.setattr(ActiveSetRod, "_newton", solve)


def forces(poses: int = 24) -> np.ndarray:
    tracker = Tracker(load_scene(PATH.scene(), urdf=PATH.urdf()))
    return np.array([tracker.arrive(state)["hose"].end_wrench[:3] for state in PATH.states()[:poses]])


def apart(a: np.ndarray, b: np.ndarray) -> float:
    return float((np.linalg.norm(a - b, axis=1) / np.linalg.norm(a, axis=1)).max())


def test_a_patch_that_slips_this_way_and_that(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        with_it = Solves(patch, shares=True)
        shared = forces()
    without = Solves(monkeypatch, shares=False)
    cut = forces()
    assert without.ended[False].count(NOT_CONTRACTING) >= 5
    assert len(with_it.ended[True]) >= 5
    assert set(with_it.ended[True]) == {ADVANCED}
    assert with_it.iterations < MOST_SHARED
    # steps twice as long or half: of first order in the friction that turns within one
    assert apart(shared, cut) < 0.01


def test_it_is_the_same_equilibrium(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where each point finds out by itself whether it slips, sharing finds the same."""
    with monkeypatch.context() as patch:
        each = Solves(patch, shares=True)
        by_itself = forces(8)
    assert not each.ended[True]
    alone = Solves(monkeypatch, shares=True, others=False)
    shared = forces(8)
    assert len(alone.ended[True]) > 20
    assert apart(by_itself, shared) < 1e-4
