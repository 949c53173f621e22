# SPDX-License-Identifier: Apache-2.0
"""The cold search: which equilibria it finds, and on what meshes it puts them."""

from __future__ import annotations

import numpy as np
import pytest
from references.equilibria import KNOWN, relative_difference, wrench

from cable_ros.branch import refinement
from cable_ros.branch.cold_start import Conditions, Found, equilibria, first_mesh
from cable_ros.branch.refinement import AIM, better_mesh, on_mesh, refine
from cable_ros.rod.elements import Mesh

ARM = KNOWN["space_arm_+0.0deg"]
NAMES = ("space_arm_+0.0deg", "space_arm_+90.0deg", "cable_00", "cable_04", "cable_09")


def search(name: str, target_twist: float | None = None, thorough: bool = True, tolerance: float = 1e-4):
    known = KNOWN[name]
    stiffness = known.stiffness / known.units.stiffness
    return equilibria(stiffness, None, known.conditions(), target_twist, tolerance, thorough)


def test_the_arms_two_lowest_branches() -> None:
    found = search(ARM.name)
    # 42.1 and 45.1 mJ with total twists of -2.74 and +3.25 rad: found by an independent homotopy.
    energies = np.array([one.energy for one in found]) * ARM.units.moment
    assert energies[:2] == pytest.approx([42.1e-3, 45.1e-3], abs=0.1e-3)
    assert [one.twist for one in found[:2]] == pytest.approx([-2.74, 3.25], abs=0.01)


@pytest.mark.parametrize("name", NAMES)
def test_equilibria_are_distinct_stable_and_sorted(name: str) -> None:
    found = search(name)
    assert found
    energies = [one.energy for one in found]
    assert energies == sorted(energies)
    names = {(round(one.twist, 2), round(one.energy, 3), *np.round(one.rod.g[-1], 1)) for one in found}
    assert len(names) == len(found)
    for one in found:
        gap = one.rod.totals[:3] - one.rod.re
        assert np.linalg.norm(gap) < 1e-7
        assert np.abs(one.rod.g[1:-1]).max() < 1e-5 * (1.0 + np.abs(one.F).max())
        assert one.rod.refactor(one.q, one.F)
        assert one.rod.stability_margin() > 0.0


@pytest.mark.parametrize("name", NAMES[:3])
def test_the_same_search_finds_the_same(name: str) -> None:
    first, second = search(name), search(name)
    assert len(first) == len(second)
    for a, b in zip(first, second, strict=True):
        assert np.array_equal(a.q, b.q)
        assert np.array_equal(a.F, b.F)


@pytest.mark.parametrize("name", KNOWN)
def test_the_target_twist_is_found_first(name: str) -> None:
    known = KNOWN[name]
    found = search(name, known.total_twist, thorough=False)
    # On the coarse mesh of the search the twist is good to a few 1e-3.
    assert min(abs(one.twist - known.total_twist) for one in found) < 0.02


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-7, 1e-10])
def test_refinement_meets_the_tolerance(name: str, tolerance: float) -> None:
    known = KNOWN[name]
    found = search(name, known.total_twist, thorough=False, tolerance=tolerance)
    coarse = min(found, key=lambda one: abs(one.twist - known.total_twist))
    fine, estimate = refine(coarse, tolerance)
    assert estimate <= tolerance
    # Against four times as many elements: an error 2^24 times smaller.
    halved = fine
    for _ in range(2):
        halved = on_mesh(halved, halved.rod.mesh.split(np.ones(len(halved.rod.h), bool)))
        assert halved is not None
    assert relative_difference(wrench(fine), wrench(halved)) < tolerance
    assert fine.twist == pytest.approx(known.total_twist, abs=10 * tolerance + 1e-8)
    # Not finer than needed: at most twice the elements that an even split of the aim asks for.
    needed = len(fine.rod.h) * (max(estimate, 1e-13) / (AIM * tolerance)) ** (1 / 12)
    assert len(fine.rod.h) <= max(2.0 * needed, 4)


def test_a_better_mesh_evens_the_shares_out() -> None:
    found = min(search("cable_09", KNOWN["cable_09"].total_twist), key=lambda one: one.energy)
    estimate = found.rod.relative_error(found.q, found.F)
    before = found.rod.shares.max() / found.rod.shares.min()
    mesh = better_mesh(found.rod, estimate, 1e-8)
    assert mesh.lengths.sum() == pytest.approx(1.0, abs=1e-14)
    assert np.all(mesh.lengths > 0)
    fine = on_mesh(found, mesh)
    assert fine is not None
    fine.rod.relative_error(fine.q, fine.F)
    assert fine.rod.shares.max() / fine.rod.shares.min() < max(0.1 * before, 100.0)


@pytest.mark.parametrize("gravity_number", [0.0, 50.0, 1e3, 1e5])
@pytest.mark.parametrize("twist", [0.0, 30.0])
def test_first_mesh(gravity_number: float, twist: float) -> None:
    at = Conditions(
        np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.0, 0.3, 0.4]), np.array([0.0, -gravity_number, 0.0])
    )
    mesh = first_mesh(at, twist, 1e-4)
    assert mesh.lengths.sum() == pytest.approx(1.0, abs=1e-14)
    # The bends at the clamps of a heavy cable are some (EI / w L^3)^1/2 long; about one turn an element.
    if gravity_number:
        assert max(mesh.lengths[0], mesh.lengths[-1]) <= max(12.0 / np.sqrt(gravity_number), 0.25)
    assert len(mesh.lengths) >= twist / (2 * np.pi)


def test_the_same_equilibrium_on_another_mesh() -> None:
    found = ARM.solved(1e-9)
    halved = on_mesh(found, found.rod.mesh.split(np.ones(len(found.rod.h), bool)))
    assert halved is not None
    assert relative_difference(wrench(halved), wrench(found)) < 1e-9
    assert halved.iterations <= 3


def test_refinement_ends_when_its_work_is_done(monkeypatch: pytest.MonkeyPatch) -> None:
    """A heavy lift on rough ground took 8 s to try seven meshes, none of which would do."""
    tried = []

    def on_mesh(found: Found, mesh: Mesh) -> Found | None:
        found.rod.work -= refinement.MOST_WORK
        tried.append(mesh)
        return None

    monkeypatch.setattr(refinement, "on_mesh", on_mesh)
    coarse = search(ARM.name)[0]
    coarse.rod.work = 1e6
    same, estimate = refinement.refine(coarse, 1e-9)
    assert len(tried) == 1
    assert same.rod is coarse.rod
    assert estimate > 1e-9
    assert coarse.rod.work == 1e6 - refinement.MOST_WORK
