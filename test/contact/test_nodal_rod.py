# SPDX-License-Identifier: Apache-2.0
"""A rod on fixed contact points: order of convergence, invariances, friction's history, falls."""

from __future__ import annotations

import numpy as np
import pytest
from nodal_scenes import (
    STIFFNESS,
    advance,
    free_rod,
    go,
    ground,
    matrix,
    pressed,
    raised,
    rotation,
    shapes,
    start,
    wrench,
)
from references import contact
from references.reference import Reference

from cable_ros.branch.cold_start import Conditions, settle
from cable_ros.branch.refinement import refine
from cable_ros.branch.snap_through import snap_through
from cable_ros.contact.distance import gap
from cable_ros.contact.nodal_kernels import COMPLIANCE
from cable_ros.contact.nodal_rod import NodalRod
from cable_ros.linalg import banded
from cable_ros.linalg.band_lu import band_solve
from cable_ros.rod import quaternion, warm_step
from cable_ros.solve.trust_region import Options

HEAVY = Conditions(
    rotation([0.1, -0.2, 0.15]), np.array([0.05, 0.04, 0.92]), np.array([-30.0, 2.1, 0.0]),
    ground(-9.0)[None],
)  # fmt: skip
SHAPES = ("plane", "sphere", "capsule", "cylinder", "box")


def off(found: np.ndarray, exact: np.ndarray) -> float:
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))


# convergence


def test_a_heavy_rod_that_touches_nothing_converges_with_order_two() -> None:
    """The weight acts in the middles of the cells: the midpoint rule."""
    fine, _ = refine(free_rod(HEAVY), 1e-9)
    exact = np.concatenate((fine.F, fine.rod.g[-1]))
    errors = np.array([off(wrench(start(HEAVY, n)), exact) for n in (32, 64, 128)])
    orders = np.log2(errors[:-1] / errors[1:])
    assert orders == pytest.approx([2.0, 2.0], abs=0.1)
    assert errors[1] < 1e-3


def between(reference: Reference) -> tuple[np.ndarray, Conditions]:
    """Stiffness and conditions of a reference of length 1, in the start clamp's frame."""
    q0, qe = (quaternion.from_ros(pose[3:]) for pose in (reference.start, reference.end))
    R = matrix(q0).T
    place = reference.obstacles[0]["plane"]
    up = quaternion.between(np.array([0.0, 0.0, 1.0]), R @ np.array(place["normal"]))
    body = ground(0.0, reference.obstacles[0]["friction"])
    body[1:4], body[4:13] = R @ (np.array(place["point"]) - reference.start[:3]), matrix(up).ravel()
    body[16] = 0.0
    there = quaternion.multiply(quaternion.conjugate(q0), qe)
    re = R @ (reference.end[:3] - reference.start[:3])
    return reference.stiffness, Conditions(there, re, R @ reference.weight, body[None])


def dragged(cells: int) -> float:
    """Relative error of the end wrench on ground that has been drawn sideways."""
    reference = contact.dragged_sideways()
    K, there = between(reference)
    across = matrix(quaternion.from_ros(reference.start[3:])).T @ np.array([0.0, -1.0, 0.0])
    friction = reference.facts["friction_force"]
    hanging = free_rod(Conditions(there.qe, there.re, friction * across), K)
    # friction as it will be, on ground that stands: all sticks
    hanging.rod.set_conditions(there.qe, there.re, there.f)
    assert there.obstacles is not None
    hanging.rod.obstacles = there.obstacles
    rod = NodalRod(K, None, there.obstacles, cells)
    places = (np.arange(cells) + 0.5) / cells
    forces = np.tile((friction * across - there.f) / cells, (cells, 1))
    assert rod.adopt(hanging.rod, hanging.q, hanging.F, places, forces, np.zeros(cells, int), pair=False)
    drawn = there.obstacles.copy()
    drawn[:, 1:4] += 0.3 * across
    go(rod, Conditions(there.qe, there.re, there.f, drawn))
    assert rod.sliding().sum() == cells
    back = matrix(there.qe).T
    found = -np.concatenate((back @ rod.state.F[-1], rod.g[-1]))
    return off(found, reference.end_wrench)


def test_ground_drawn_sideways_converges_with_order_two() -> None:
    errors = np.array([dragged(n) for n in (32, 64, 128)])
    orders = np.log2(errors[:-1] / errors[1:])
    assert orders == pytest.approx([2.0, 2.0], abs=0.3), errors
    assert errors[1] < 2e-3


# invariances


def moved(conditions: Conditions, q: np.ndarray) -> Conditions:
    """Everything turned by q (4,) about the start clamp's axis, but for that clamp's own frame."""
    R = matrix(q)
    assert conditions.obstacles is not None
    bodies = conditions.obstacles.copy()
    for body in bodies:
        body[1:4] = R @ body[1:4]
        body[4:13] = (R @ body[4:13].reshape(3, 3)).ravel()
    qe = quaternion.multiply(quaternion.multiply(q, conditions.qe), quaternion.conjugate(q))
    return Conditions(qe, R @ conditions.re, R @ conditions.f, bodies)


def mirrored(conditions: Conditions) -> Conditions:
    """Everything on the other side of the plane y = 0."""
    M = np.diag([1.0, -1.0, 1.0])
    assert conditions.obstacles is not None
    bodies = conditions.obstacles.copy()
    for body in bodies:
        body[1:4] = M @ body[1:4]
        body[4:13] = (M @ body[4:13].reshape(3, 3) @ M).ravel()
    return Conditions(conditions.qe * [1, -1, 1, -1], M @ conditions.re, M @ conditions.f, bodies)


def led(shape: str, change, stiffness: np.ndarray = STIFFNESS) -> NodalRod:
    """A shape raised against the rod, then its end led sideways and back, all changed alike."""
    bodies = shapes(0.4)[shape][None]
    rod = start(
        change(Conditions(HEAVY.qe, HEAVY.re, HEAVY.f, raised(bodies, -0.35))), 64, stiffness=stiffness
    )
    for lift, y in ((0.05, 0.0), (0.05, 0.08), (0.05, 0.02)):
        re = HEAVY.re + [0.0, y, 0.0]
        go(rod, change(Conditions(HEAVY.qe, re, HEAVY.f, raised(bodies, lift))))
    assert rod.touches
    return rod


@pytest.mark.parametrize("shape", ["plane", "capsule"])
def test_everything_turned_gives_the_wrench_turned(shape: str) -> None:
    K, q = np.array([1.0, 1.0, 0.7]), rotation([0.0, 0.0, 0.8])
    one, other = led(shape, lambda c: c, K), led(shape, lambda c: moved(c, q), K)
    turned = np.concatenate((matrix(q) @ one.end_force, matrix(q) @ one.g[-1]))
    assert off(wrench(other), turned) < 1e-7


@pytest.mark.parametrize("shape", ["plane", "sphere"])
def test_a_mirror_image_has_the_mirror_images_wrench(shape: str) -> None:
    one, other = led(shape, lambda c: c), led(shape, mirrored)
    assert off(wrench(other), wrench(one) * [1, -1, 1, -1, 1, -1]) < 1e-7
    assert np.array_equal(one.sliding(), other.sliding())


@pytest.mark.parametrize("weight", [0.0, 30.0])
def test_forces_and_moments_balance_with_and_without_weight(weight: float) -> None:
    rod = pressed("capsule", 0.4, weight=weight, lift=0.08 if weight else 0.27)
    assert rod.touches
    state, forces = rod.state, rod.contact_forces()
    assert state.F[0] == pytest.approx(state.F[-1] + rod.f + rod.contact_force(), abs=1e-9)
    lumped = rod.f / rod.cells + forces.sum(axis=1)[1:-1]
    at_end = matrix(rod.qe) @ rod.g[-1] + np.cross(rod.re, rod.end_force)
    assert rod.g[0] + at_end + np.cross(state.r[1:-1], lumped).sum(axis=0) == pytest.approx(
        np.zeros(3), abs=1e-7
    )


def test_the_energy_is_that_of_the_conditions_whatever_was_asked_in_between() -> None:
    rod = pressed("sphere")
    energy = float(rod.totals[3])
    # minus its derivative by the end's place is the end force
    lifted = rod.snapshot()()
    assert isinstance(lifted, NodalRod)
    step = 1e-4
    sides = []
    for sign in (1.0, -1.0):
        new = rod.snapshot()()
        assert isinstance(new, NodalRod)
        re = rod.re + [0.0, 0.0, sign * step]
        assert advance(new, Conditions(rod.qe, re, rod.f, rod._under)) == warm_step.ADVANCED
        sides.append(float(new.totals[3]))
    assert (sides[0] - sides[1]) / (2 * step) == pytest.approx(rod.end_force[2], rel=1e-5)
    rod.stability_margin()
    assert rod.refactor(rod.shape, rod.end_force)
    rod.clamp_stiffness(rod.shape, rod.end_force)
    assert rod.refactor(rod.shape, rod.end_force)
    assert rod.totals[3] == pytest.approx(energy, rel=1e-12)


# friction


@pytest.mark.parametrize("shape", SHAPES)
def test_friction_stays_inside_the_cone_and_contacts_outside_the_obstacle(shape: str) -> None:
    bodies = shapes(0.4)[shape][None]
    rod = start(Conditions(HEAVY.qe, HEAVY.re, HEAVY.f, raised(bodies, -0.35)), 64)
    seen = 0
    for lift, y in ((0.03, 0.0), (0.06, 0.02), (0.06, 0.05), (0.04, 0.02), (0.06, -0.02)):
        re = HEAVY.re + [0.0, y, 0.0]
        go(rod, Conditions(HEAVY.qe, re, HEAVY.f, raised(bodies, lift)))
        lam, tau = rod.state.lam, np.linalg.norm(rod.state.tau, axis=2)
        assert (lam >= 0.0).all()
        assert (tau <= 0.4 * lam * (1 + 1e-6) + 1e-9).all()
        slides = rod.sliding()
        assert tau[slides] == pytest.approx(0.4 * lam[slides], rel=1e-6)
        n, d, bends = np.empty(3), np.empty((2, 3)), np.empty(2)
        gaps = np.array([gap(rod._under[0], r, n, d, bends) for r in rod.state.r[1:-1]])
        assert gaps.min() > -1e-9
        assert np.abs(gaps[lam[1:-1, 0] > 0.0]).max(initial=0.0) < 1e-9
        seen += int((lam > 0.0).sum())
    assert seen > 4


@pytest.mark.parametrize("shape", SHAPES)
def test_an_obstacle_that_moves_carries_what_sticks_to_it(shape: str) -> None:
    rod = pressed(shape, 0.4)
    rough = rod._under.copy()
    rough[:, 17] = 5.0
    go(rod, Conditions(rod.qe, rod.re, rod.f, rough))
    begin, touching = wrench(rod), rod.state.lam[:, 0] > 0.0
    turn = rotation([3e-4, -2e-4, 4e-4])
    after = rough.copy()
    after[0, 4:13] = (matrix(turn) @ rough[0, 4:13].reshape(3, 3)).ravel()
    after[0, 1:4] += [1e-4, 2e-4, -1e-4]

    def own(bodies: np.ndarray) -> np.ndarray:
        return (rod.state.r[touching] - bodies[0, 1:4]) @ bodies[0, 4:13].reshape(3, 3)

    places = own(rough)
    go(rod, Conditions(rod.qe, rod.re, rod.f, after))
    assert not rod.sliding().any()
    assert np.array_equal(rod.state.lam[:, 0] > 0.0, touching)
    assert own(after) == pytest.approx(places, abs=50.0 * COMPLIANCE)  # forces change by up to 50
    assert off(wrench(rod), begin) > 1e-4
    go(rod, Conditions(rod.qe, rod.re, rod.f, rough))
    assert off(wrench(rod), begin) < 1e-6


# falls


def test_a_fall_lands_where_the_free_rods_does() -> None:
    """An arch whose end turns against it until it snaps through."""
    K = np.array([3.0, 1.0, 1.0])
    none = ground(-9.0)[None]

    def there(yaw: float) -> Conditions:
        return Conditions(rotation([0.0, yaw, 0.0]), np.array([0.0, 0.0, 0.9]), np.zeros(3), none)

    found = free_rod(there(-0.35), K)
    found.rod.obstacles = none
    free, q, F = found.rod, found.q, found.F
    rod = NodalRod(K, None, none, 96)
    assert rod.adopt(free, q, F, np.zeros(0), np.zeros((0, 3)), np.zeros(0, int), False)
    yaw, size = -0.35, 0.01
    while size > 1e-4:
        c = there(yaw + size)
        code, _, q_new, F_new = free.advance(q, F, c.qe, c.re, c.f, 1e-8)
        if code != warm_step.ADVANCED or not free.refactor(q_new, F_new):
            assert free.refactor(q, F)
            size *= 0.5
            continue
        assert advance(rod, c) == warm_step.ADVANCED
        yaw, q, F = yaw + size, q_new, F_new
    assert yaw > 0.2
    beyond = there(yaw + 0.02)
    landed = snap_through(free, q, F, beyond)
    assert landed is not None
    exact = np.concatenate((landed.F, landed.rod.g[-1]))
    assert off(exact, wrench(rod)) > 0.3  # far away
    rod.set_conditions(beyond.qe, beyond.re, beyond.f, beyond.obstacles)
    mine = settle(rod, rod.shape, rod.end_force, Options())
    assert mine is not None
    assert off(wrench(rod), exact) < 1e-3
    assert mine.energy == pytest.approx(landed.energy, rel=1e-3)
    assert rod.stability_margin() == pytest.approx(free.stability_margin(), rel=0.02)


# stability


def margins(rod: NodalRod) -> np.ndarray:
    """All eigenvalues of the tangent with forces eliminated, relative to the elastic stiffness."""
    assert rod.refactor(rod.shape, rod.end_force)
    total, low = rod._size
    rows = (rod._rows.psi[1:-1, None] + np.arange(3)).ravel()
    n = len(rows)
    flexible, elastic = np.empty((n, n)), np.empty((n, n))
    for i in range(n):
        b, unit, y = np.zeros(total), np.zeros(n + 6), np.empty(n + 6)
        b[rows[i]] = unit[3 + i] = 1.0
        band_solve(rod._band.a, total, low, rod._band.pivots, b)
        banded.multiply(rod.elastic, unit, y)
        flexible[:, i], elastic[:, i] = b[rows], y[3:-3]
    inverse = np.linalg.eigvals(flexible @ elastic)
    return np.sort((1.0 / inverse[np.abs(inverse) > 1e-9]).real)


@pytest.mark.parametrize("friction", [0.0, 0.4])
@pytest.mark.parametrize(("shape", "soft"), [*((shape, 0.0) for shape in SHAPES), ("sphere", 2e-3)])
def test_the_margin_is_the_smallest_eigenvalue(shape: str, soft: float, friction: float) -> None:
    rod = pressed(shape, friction, cells=32, soft=soft)
    exact = margins(rod)[0]
    # friction that slips makes the tangent unsymmetric, which the margin leaves out
    assert rod.stability_margin() == pytest.approx(exact, rel=0.1 if friction else 5e-3)


def test_what_is_unstable_is_told_and_no_step_ends_there() -> None:
    """A planar cable on smooth ground that rises: it can leave its plane before the ground is at its top."""
    conditions = Conditions(
        rotation([0.0, -0.2, 0.0]), np.array([0.05, 0.0, 0.92]), np.array([-30.0, 0.0, 0.0]),
        ground(-0.4)[None],
    )  # fmt: skip
    assert conditions.obstacles is not None
    rod = start(conditions, 32, friction=False)
    lift, size, seen = 0.24, 0.004, []
    go(rod, Conditions(conditions.qe, conditions.re, conditions.f, raised(conditions.obstacles, lift)))
    while size > 1e-5:
        there = Conditions(
            conditions.qe, conditions.re, conditions.f, raised(conditions.obstacles, lift + size)
        )
        known, before = rod._known(), rod.state.copy()
        code = advance(rod, there)
        if code == warm_step.ADVANCED:
            lift += size
            assert margins(rod)[0] > 0.0
            continue
        for mine, kept in zip(rod.state, before, strict=True):
            assert np.array_equal(mine, kept)
        assert np.array_equal(rod._under, known.under)
        assert rod.re is known.conditions[1]
        # where Newton's method would have ended
        if rod._solve(there.qe, there.re, there.f, there.obstacles, 0.0)[0] == 0:
            seen.append((margins(rod)[0], rod.stability_margin()))
            rod._return(known)
        size *= 0.5
    assert 0.0 < lift < 0.4
    assert seen
    for exact, told in seen:
        assert (exact > 0.0) == (told > 0.0)
    assert min(exact for exact, _ in seen) < 0.0
