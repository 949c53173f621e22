# SPDX-License-Identifier: Apache-2.0
"""From contact points to the grid of contacts and back: the equilibrium and its friction stay."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from zoo_drawn import in_slot

from cable_ros import Tracker
from cable_ros.bench.cases import Case, case_scene
from cable_ros.bench.drawn import drawn_case, refined
from cable_ros.branch import handover
from cable_ros.branch.tracked_equilibrium import TrackedEquilibrium
from cable_ros.contact.friction_kernels import COULOMB
from cable_ros.contact.grid_friction import Friction
from cable_ros.contact.nodal_rod import NodalRod
from cable_ros.contact.points import FORCE, FRICTION, OBSTACLE, SLIPS
from cable_ros.contact.touching_rod import TouchingRod


def led(case: Case, poses: int, tolerance: float = 1e-6) -> TrackedEquilibrium:
    """The case's cable after so many poses, in contact with friction."""
    tracker = Tracker(case_scene(case), tolerance=tolerance)
    for pose in case.path[:poses]:
        tracker.arrive(pose)
    (cable,) = tracker._tracked_cables
    assert isinstance(cable.rod, TouchingRod)
    assert cable.rod.frictional
    return cable


@pytest.mark.parametrize("poses", [2, 3, 4])
def test_there_and_back_is_the_same(poses: int) -> None:
    """The truth is what it started from; the grid's own error is a hundred times the tolerance and more."""
    cable = led(in_slot(), poses)
    rod = cable.rod
    assert isinstance(rod, TouchingRod)
    points = rod.points[: rod.count].copy()
    force, moment = cable._F.copy(), rod.g[-1].copy()
    grid = handover.nodal(rod, cable._q, cable._F)
    assert isinstance(grid, NodalRod)
    found = handover.exact(grid, 1e-6, COULOMB)
    assert found is not None
    assert isinstance(found.rod, TouchingRod)
    back = found.rod.points[: found.rod.count]
    # friction that the grid kept is off by what it lumps, and so is the wrench
    near = grid.relative_error(grid.state.q, grid.state.F[-1])
    assert near < 0.05
    assert np.linalg.norm(found.F - force) < near * np.linalg.norm(force)
    assert np.linalg.norm(found.rod.g[-1] - moment) < near * np.linalg.norm(force)
    assert back[:, FORCE].sum() == pytest.approx(points[:, FORCE].sum(), rel=near)
    # what sticks has its friction from cells to both sides of the point
    total, before = (p[:, FRICTION : FRICTION + 3].sum(axis=0) for p in (back, points))
    assert np.linalg.norm(total - before) < 2.0 * near * points[:, FORCE].sum()


def test_friction_that_is_given_adds_up_to_the_grids() -> None:
    """What slides may be given more than its cone: it returns to it."""
    cable = led(in_slot(), 3)
    grid = handover.nodal(cable.rod, cable._q, cable._F)
    assert isinstance(grid, NodalRod)
    friction = Friction.of(grid)
    rod = cable.rod
    assert isinstance(rod, TouchingRod)
    points = rod.points[: rod.count]
    for o in np.unique(friction.obstacles):
        theirs, mine = friction.obstacles == o, points[:, OBSTACLE] == o
        points[mine, SLIPS] = 0.0
        friction.sliding[theirs] = False  # all of it sticks
    points[:, FORCE] *= 1.3
    friction.give(rod)
    given, total = points[:, FRICTION : FRICTION + 3].sum(axis=0), friction.forces.sum(axis=0)
    assert given == pytest.approx(total, abs=1e-9 * np.abs(friction.forces).sum())


def test_a_grid_that_is_off_at_once_says_so() -> None:
    """A heavy cable that is about to slide has other forces on the grid: 0.26 % here."""
    cable = led(drawn_case(101, 2, 1e-4), 4, 1e-4)
    rod = cable.rod
    grid = handover.nodal(rod, cable._q, cable._F)
    assert isinstance(grid, NodalRod)
    away = handover.apart(grid, rod, cable._F)
    assert away > 0.002
    assert grid.relative_error(grid.state.q, grid.end_force) >= away
    grid.pair()
    assert grid.relative_error(grid.state.q, grid.end_force) >= 0.9 * away  # and it fades slowly


def test_a_finer_grid_stands_where_the_coarser_does() -> None:
    """Each is off by its own estimate at most."""
    cable = led(in_slot(), 3)
    grid = handover.nodal(cable.rod, cable._q, cable._F)
    assert isinstance(grid, NodalRod)
    fine = grid.finer()
    assert fine is not None
    assert fine.cells > grid.cells
    within = sum(one.relative_error(one.shape, one.end_force) for one in (grid, fine))
    assert within < 0.05
    size = float(np.linalg.norm(grid.end_force))
    assert np.linalg.norm(fine.end_force - grid.end_force) < within * size
    before, after = (Friction.of(one).forces.sum(axis=0) for one in (grid, fine))
    assert np.linalg.norm(after - before) < within * size


def test_a_finer_grid_keeps_the_error_of_frictions_history() -> None:
    cable = led(in_slot(), 3)
    grid = handover.nodal(cable.rod, cable._q, cable._F)
    assert isinstance(grid, NodalRod)
    grid.doubt(0.04)
    fine = grid.finer()
    assert fine is not None
    # relative to its own wrench, which is a little larger
    assert fine.relative_error(fine.shape, fine.end_force) >= 0.99 * 0.04


def lift() -> Case:
    """Heavy, on rough ground, its lifted end led up and down: friction along it adds up to the end force.

    Its first step is told in three: in one it goes to a grid with some last bits.
    """
    case = drawn_case(130, 102, 1e-4)
    return replace(case, path=refined(case.path[:2], 3))


def kept_exact(case: Case, monkeypatch: pytest.MonkeyPatch) -> TrackedEquilibrium:
    """The cable after four poses, told a grid nowhere: whether one is better hangs on the last bits."""
    monkeypatch.setattr(TrackedEquilibrium, "_onto_better_grid", lambda *_: False)
    return led(case, 4, 1e-4)


@pytest.mark.parametrize("cells", [96, 128, 204])
def test_what_lies_takes_its_friction_to_any_grid(cells: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The grid's own error is F / 12 m^2 < 0.002. Given to the nearest cells, some had more than they can
    hold: 4.7 % of the end force were lost with 128, 12 % with 204.
    """
    cable = kept_exact(lift(), monkeypatch)
    monkeypatch.setattr(handover, "point_count", lambda _: cells)
    grid = handover.nodal(cable.rod, cable._q, cable._F)
    assert isinstance(grid, NodalRod)
    assert grid.cells == cells
    assert handover.apart(grid, cable.rod, cable._F) < 0.004


def test_what_lies_takes_its_friction_from_grid_to_grid(monkeypatch: pytest.MonkeyPatch) -> None:
    """Shared from the cells' middles, 12.5 % of the wrench were lost on the finer grid, 2 % on the twin's."""
    cable = kept_exact(lift(), monkeypatch)
    grid = handover.nodal(cable.rod, cable._q, cable._F)
    assert grid is not None
    fine = grid.finer()
    assert fine is not None
    assert handover.apart(fine, grid, grid.end_force) < 0.005
    grid.pair()
    assert grid.twin is not None
    assert handover.apart(grid.twin, grid, grid.end_force) < 0.005


@pytest.mark.parametrize(("key", "poses"), [((136, 40), 8), ((154, 8, "lift"), 3)])
def test_what_slides_does_so_there_and_back(key: Any, poses: int) -> None:
    """Nothing moves, so nothing comes to rest: 4 of 50 points did on the grid, 5 of 53 on the way back."""
    cable = led(drawn_case(*key[:2], 1e-4, *key[2:]), poses, 1e-4)
    rod = cable.rod
    assert isinstance(rod, TouchingRod)
    assert (rod.points[: rod.count, SLIPS] == 1.0).all()
    force = cable._F.copy()
    grid = handover.nodal(rod, cable._q, cable._F)
    assert isinstance(grid, NodalRod)
    assert isinstance(grid.twin, NodalRod)
    for one in (grid, grid.twin):
        assert (one.sliding() == (one.state.lam > 0.0)).all()
    found = handover.exact(grid, 1e-4, COULOMB)
    assert found is not None
    assert isinstance(found.rod, TouchingRod)
    assert (found.rod.points[: found.rod.count, SLIPS] == 1.0).all()
    assert np.linalg.norm(found.F - force) < 5e-5 * np.linalg.norm(force)
