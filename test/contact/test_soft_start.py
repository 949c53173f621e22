# SPDX-License-Identifier: Apache-2.0
"""Steps that begin with a soft stick: they arrive where others don't, and at the same place."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from references.hose_paths import known
from zoo_hose import sideways

from cable_ros import Tracker, load_scene
from cable_ros.bench.cases import case_scene
from cable_ros.bench.drawn import drawn_case
from cable_ros.contact.active_set_rod import FAILED, ActiveSetRod, Solved
from cable_ros.rod.warm_step import ADVANCED, NOT_CONTRACTING

PATH = known()["turned_9"]
"""A hose is turned at its clamp, and turned back: its patch slips this way and that."""


FEW = 6
"""Iterations of a solve without any trouble."""


class Solves:
    """Counts the solves of a rod by how they ended, and refuses those that begin soft, or the others.

    `soft_points`: of those that begin soft the ones of points alone.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch, soft: bool, firm: bool = True) -> None:
        self.soft: list[int] = []
        self.soft_points: list[int] = []
        self.firm: list[int] = []
        newton = ActiveSetRod._newton

        def solve(rod: ActiveSetRod, q: Any, F: Any, goal: Any, factors: Any, softest: float = 0.0) -> Any:
            if not (soft if softest > 0.0 else firm or not rod.lies):
                return Solved(NOT_CONTRACTING, 0, False, np.inf, 0.0, q, F)
            points = not rod.lies
            found = newton(rod, q, F, goal, factors, softest)
            if softest > 0.0 and points:
                self.soft_points.append(found.code)
            (self.soft if softest > 0.0 else self.firm).append(found.code)
            # as few iterations either way: steps are as long as these are few
            return found if firm else found._replace(iterations=min(found.iterations, FEW))

        monkeypatch.setattr(ActiveSetRod, "_newton", solve)


def forces(poses: int = 24) -> np.ndarray:
    tracker = Tracker(load_scene(PATH.scene(), urdf=PATH.urdf()))
    return np.array([tracker.arrive(state)["hose"].end_wrench[:3] for state in PATH.states()[:poses]])


def apart(a: np.ndarray, b: np.ndarray) -> float:
    return float((np.linalg.norm(a - b, axis=1) / np.linalg.norm(a, axis=1)).max())


def test_a_patch_that_slips_this_way_and_that(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        with_it = Solves(patch, soft=True)
        eased = forces()
    without = Solves(monkeypatch, soft=False)
    cut = forces()
    assert without.firm.count(NOT_CONTRACTING) >= 3
    assert len(with_it.soft) >= 5
    assert with_it.soft.count(ADVANCED) >= 0.8 * len(with_it.soft)  # what fails even so is cut
    # steps twice as long or half: of first order in the friction that turns within one
    assert apart(eased, cut) < 0.01


def test_it_is_the_same_equilibrium(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the stick that is asked for leads to an end at once, a soft beginning leads to the same one."""
    with monkeypatch.context() as patch:
        at_once = Solves(patch, soft=True)
        expected = forces(8)
    assert not at_once.soft
    alone = Solves(monkeypatch, soft=True, firm=False)
    found = forces(8)
    assert len(alone.soft) > 20
    assert apart(expected, found) < 1e-4


def test_points_that_press_against_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """A cable on both edges of a rough beam: of two points one sticks, and which changed in a cycle."""
    case = drawn_case(173, 74, 1e-4, "beams")
    tracker, solves = Tracker(case_scene(case)), Solves(monkeypatch, soft=True)
    for joints in case.path[:8]:
        (found,) = tracker.arrive(joints).values()
        assert found.status.trusted, found.message
    # from a third to three quarters of them end, as the last digits of the joints are; without them none does
    assert solves.soft_points.count(ADVANCED) > max(0.25 * len(solves.soft_points), 5.0)


@pytest.mark.parametrize("digit", [-1.0, 0.0, 1.0])
def test_a_patch_that_turns_round(monkeypatch: pytest.MonkeyPatch, digit: float) -> None:
    """All of a cable slides and is drawn back: a step of a few 1e-4 L in which all of it turns is made."""
    case = sideways(80.0, 0.5, 0.03)
    there, back = case.path[1]["y"], case.path[2]["y"] + digit * 1e-12
    tracker = Tracker(case_scene(replace(case, tolerance=1e-4)))
    tracker.arrive(case.path[0])
    tracker.arrive({"y": there})
    solves = Solves(monkeypatch, soft=True)
    (turned,) = tracker.arrive({"y": back}).values()
    assert turned.status.trusted, turned.message
    assert any(code in FAILED for code in solves.firm)
    assert set(solves.soft) == {ADVANCED}
