# SPDX-License-Identifier: Apache-2.0
"""What a change of the mesh must leave as it is."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cable_ros import Status, Tracker, load_scene
from cable_ros.bench.drawn import drawn_case, refined
from cable_ros.bench.metamorphic import follow
from cable_ros.branch.cold_start import Found
from cable_ros.branch.refinement import on_mesh
from cable_ros.contact.active_set_rod import ActiveSetRod, Solved
from cable_ros.contact.points import ARC_LENGTH, INTERFACE, SLIPS
from cable_ros.rod import warm_step
from cable_ros.rod.elements import Mesh

STEP_TOLERANCE = 1e-7
"""rad, or part of the end force: a thousandth of what the scene asks for, as in a warm step."""
STICKING, SLIPPING = 1e-5, 3e-4
"""Relative change of the end force on another mesh where all that lies sticks, and where all of it slips."""


def test_what_slips_slips_on_after_a_change_of_mesh() -> None:
    """On another mesh it is solved over no distance, in which nothing slips: it was taken to stick.

    The next step started from there and did not converge: a cable drawn ever tauter over a rough table was
    lost to a grid, and 15 of 31 poses with it.
    """
    case = drawn_case(132, 100, 1e-4)
    tracker = Tracker(load_scene(case.scene, urdf=case.urdf), tolerance=case.tolerance)
    for pose in case.path[:10]:
        tracker.solve(pose)
    (cable,) = tracker._tracked_cables
    rod = cable.rod
    assert isinstance(rod, ActiveSetRod)
    assert (rod.points[: rod.count, SLIPS] == 1.0).all()
    count, rod.work = rod.count, np.inf
    code, _, _, _ = rod.correct(rod.refined(cable.q), cable.end_force, STEP_TOLERANCE, 0.6, remesh=False)
    assert code == warm_step.ADVANCED
    assert rod.count > count
    assert (rod.points[: rod.count, SLIPS] == 1.0).mean() > 0.95


def taut(index: int, poses: int) -> Found:
    """What a cable led through the first poses of a drawn path comes to, which pulls it taut."""
    case = drawn_case(159, index, 1e-4)
    tracker = Tracker(load_scene(case.scene, urdf=case.urdf), tolerance=case.tolerance)
    for pose in case.path[:poses]:
        tracker.solve(pose)
    (cable,) = tracker._tracked_cables
    assert cable.rod.lies
    return Found.at(cable.rod, cable.q, cable.end_force)


def change(found: Found, mesh: Mesh) -> float:
    """Relative change of the end force on another mesh."""
    other = on_mesh(found, mesh)
    assert other is not None
    assert not other.rod.forgot
    return float(np.linalg.norm(other.F - found.F) / np.linalg.norm(found.F))


def test_what_sticks_stays_where_it_was_on_another_mesh() -> None:
    """It stuck where interpolated frames took it, 2e-6 lengths away: 1.7 % of the end force at pose 65."""
    found = taut(740, 64)
    assert not found.rod.points[: found.rod.count, SLIPS].any()
    assert change(found, Mesh(found.rod.mesh.element, np.full(8, 0.125))) < STICKING


def test_a_cable_does_not_slide_along_two_edges_as_its_mesh_changes() -> None:
    """Its friction was held on a new mesh, where it slid by 2e-3 lengths: most of its side force went."""
    case = drawn_case(189, 858, 1e-4)
    first = [refined(case.path[:2], parts)[: parts // 16 + 1] for parts in (16, 64)]
    once, finer = (follow(case, path).found[-1].end_wrench[:3] for path in first)
    assert abs(finer[1]) > 0.5
    assert np.linalg.norm(once - finer) < case.tolerance * np.linalg.norm(finer)


def test_what_slips_keeps_its_friction_on_another_mesh() -> None:
    """With friction of the nearest sample 8 of 10 were taken to stick, and 1 % of the end force went."""
    found = taut(74, 57)
    assert found.rod.points[: found.rod.count, SLIPS].all()
    mesh = found.rod.mesh.split(np.ones(len(found.rod.h), bool))
    assert change(found, mesh) < SLIPPING


def test_what_is_put_back_is_the_mesh_its_contacts_and_the_conditions() -> None:
    """A descent that failed left its own: the next index was out of bounds."""
    case = drawn_case(132, 100, 1e-4)
    tracker = Tracker(load_scene(case.scene, urdf=case.urdf), tolerance=case.tolerance)
    tracker.solve(case.path[0])
    (cable,) = tracker._tracked_cables
    rod = cable.rod
    assert isinstance(rod, ActiveSetRod)
    count, mesh, end = rod.count, rod.mesh, rod.re
    points = rod.points[:count].copy()
    put_back = rod.kept()
    rod.set_conditions(rod.qe, rod.re + 0.1, rod.f, rod.obstacles)
    rod.refined(cable.q)
    assert len(rod.h) == 2 * len(mesh.lengths)
    put_back()
    assert rod.mesh is mesh
    assert rod.re is end
    assert rod.count == count
    changes = points.shape[1] - 1
    assert (rod.points[:count, :changes] == points[:, :changes]).all()
    assert rod.refactor(cable.q, cable.end_force)


def test_a_step_that_lacks_boundaries_for_its_contacts_is_taken_on_a_split_mesh() -> None:
    """A point on each of two beams became two, on three elements: a grid took over, and was 1.2 % off."""
    case = drawn_case(156, 0, 1e-4, "beams")
    tracker = Tracker(load_scene(case.scene, urdf=case.urdf), tolerance=case.tolerance)
    for pose in case.path[:31]:
        tracker.solve(pose)
    (cable,) = tracker._tracked_cables
    assert (cable.rod.count, len(cable.rod.h)) == (2, 3)
    (found,) = tracker.solve(case.path[31]).values()
    assert found.status is Status.CONVERGED
    rod = cable.rod
    assert isinstance(rod, ActiveSetRod)
    assert (rod.count, len(cable.q)) == (4, len(rod.mesh.nodes))
    assert (rod.points[: rod.count, INTERFACE] >= 0.0).all()


def test_a_step_to_what_is_unstable_is_undone(monkeypatch: pytest.MonkeyPatch) -> None:
    """The rod stayed there if no fitted mesh was found: its mesh and contacts met the shape before."""
    case = drawn_case(156, 0, 1e-4, "beams")
    tracker = Tracker(load_scene(case.scene, urdf=case.urdf), tolerance=case.tolerance)
    for pose in case.path[:20]:
        tracker.solve(pose)
    (cable,) = tracker._tracked_cables
    rod, q, F = cable.rod, cable.q, cable.end_force
    assert isinstance(rod, ActiveSetRod)
    assert rod.obstacles is not None
    lengths, points = rod.h.copy(), rod.points[: rod.count].copy()
    before, there, newton = (rod.qe, rod.re, rod.f, rod.obstacles), rod.re + [1e-3, 0.0, 0.0], rod._newton

    def asks_for_another_mesh(*of_newton: Any) -> Solved:
        found = newton(*of_newton)
        assert found.code == warm_step.ADVANCED
        return found._replace(moved=True)

    monkeypatch.setattr(rod, "_newton", asks_for_another_mesh)
    monkeypatch.setattr(rod, "_remesh", lambda *_: None)
    monkeypatch.setattr(rod, "refactor", lambda *_: False)
    code, _, _, _ = rod.step_in_contact(q, F, rod.qe, there, rod.f, STEP_TOLERANCE, 0.6, rod.obstacles)
    assert code == warm_step.NOT_CONVEX
    assert all(a is b for a, b in zip((rod.qe, rod.re, rod.f, rod.obstacles), before, strict=True))
    assert (rod.h == lengths).all()
    assert (rod.points[: rod.count, ARC_LENGTH] == points[:, ARC_LENGTH]).all()
