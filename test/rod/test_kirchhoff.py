# SPDX-License-Identifier: Apache-2.0
"""The discrete rod: order of convergence, error estimate, stability margin, warm-started steps."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
from references.equilibria import KNOWN, relative_difference, wrench
from references.plain_rod import dense
from references.rods import reference, uniform
from scipy.spatial.transform import Rotation

from cable_ros.branch.cold_start import Found, settle
from cable_ros.rod import quaternion, warm_step
from cable_ros.rod.kirchhoff import Rod
from cable_ros.rod.rod_state import Path
from cable_ros.solve.trust_region import Options

ARM = KNOWN["space_arm_+0.0deg"]
SOME = ("space_arm_+0.0deg", "space_arm_+90.0deg", "cable_02", "cable_05", "cable_08")


# Meshes fine enough for the limit whose error is still above the reference's, 1e-12.
@pytest.mark.parametrize(("order", "counts"), [(3, (24, 32)), (4, (12, 16)), (5, (8, 12)), (6, (6, 8))])
@pytest.mark.parametrize("name", ["space_arm_+90.0deg", "cable_02"])
def test_end_wrench_converges_with_twice_the_order(name: str, order: int, counts: tuple[int, int]) -> None:
    exact = wrench(reference(name))
    coarse, fine = (relative_difference(wrench(uniform(name, order, n)), exact) for n in counts)
    rate = np.log(coarse / fine) / np.log(counts[1] / counts[0])
    # Symmetric rules have even orders: anything less would be 2 order - 2 at most.
    assert rate == pytest.approx(2 * order, abs=0.8)


@pytest.mark.parametrize("name", SOME)
@pytest.mark.parametrize("count", [6, 8])
def test_error_estimate_is_the_error(name: str, count: int) -> None:
    found = uniform(name, 6, count)
    true = wrench(reference(name)) - wrench(found)
    estimate = found.rod.wrench_error(found.q, found.F)
    # To first order and with one polynomial more an element: a tenth is what the next ones add.
    for part in (slice(0, 3), slice(3, 6)):
        missed = np.linalg.norm(estimate[part] - true[part])
        assert missed < 0.3 * np.linalg.norm(true[part])
    relative = relative_difference(wrench(found), wrench(reference(name)))
    assert found.rod.relative_error(found.q, found.F) == pytest.approx(relative, rel=0.3)


@pytest.mark.parametrize("name", SOME)
def test_shares_tell_where_the_error_is(name: str) -> None:
    found = uniform(name, 6, 8)
    before = found.rod.relative_error(found.q, found.F)
    worst = np.zeros(8, bool)
    worst[np.argsort(found.rod.shares)[-4:]] = True
    # Halving the worse half of the elements wins more than halving the better half.
    errors = []
    for marked in (worst, ~worst):
        mesh = found.rod.mesh.split(marked)
        rod = Rod(mesh, found.rod.K)
        rod.set_conditions(found.rod.qe, found.rod.re, found.rod.f)
        q = found.rod.mesh.interpolate(found.q, mesh.nodes)
        q[0], q[-1] = found.q[0], found.q[-1]
        finer = settle(rod, q, found.F)
        assert finer is not None
        errors.append(rod.relative_error(finer.q, finer.F))
    assert errors[0] < min(errors[1], 0.5 * before)


@pytest.mark.parametrize("name", SOME)
def test_margin_is_the_smallest_eigenvalue_on_the_tangent_space(name: str) -> None:
    found = reference(name)
    rod = found.rod
    rod.linearize(found.q, found.F)
    rod.factor(0.0)
    inner = slice(3, len(rod.elastic) - 3)
    elastic, geometric = dense(rod.elastic)[inner, inner], dense(rod.geometric)[inner, inner]
    _, _, basis = np.linalg.svd(rod.C[:, inner])
    tangent = basis[3:]
    eigenvalues = scipy.linalg.eigvalsh(
        tangent @ (elastic + geometric) @ tangent.T, tangent @ elastic @ tangent.T
    )
    # Inverse iteration ends when the value changes by less than 1e-4 of itself.
    assert rod.stability_margin() == pytest.approx(eigenvalues[0], rel=1e-3)
    assert rod.stability_margin() == pytest.approx(KNOWN[name].margin, rel=2e-3)


def conditions_at(angle: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The arm at an angle of its joint, rad, in units of the cable."""
    x = np.array(
        [160 - 145 * np.sin(angle) + 80 * np.cos(angle), 80 * np.sin(angle) + 145 * np.cos(angle), 75]
    )
    start = Rotation.from_quat(ARM.start[3:])
    end = start.inv() * Rotation.from_rotvec([0, 0, angle])
    qe = quaternion.from_ros(end.as_quat())
    f = start.inv().apply(ARM.weight) / (ARM.units.force / ARM.units.length)
    return qe, start.inv().apply(x) * 1e-3 / ARM.length, f


def at_zero() -> Found:
    found = ARM.solved(1e-8)
    found.rod.refactor(found.q, found.F)
    return found


@pytest.mark.parametrize("degrees", [0.0, 1e-7, 0.5, 2.0, -5.0])
def test_a_warm_started_step_is_the_equilibrium_there(degrees: float) -> None:
    found = at_zero()
    rod = found.rod
    qe, re, f = conditions_at(np.radians(degrees))
    qe = qe if qe @ found.q[-1] > 0 else -qe
    code, iterations, q, F = rod.advance(found.q, found.F, qe, re, f, 1e-11)
    assert code == warm_step.ADVANCED
    assert iterations <= 5
    moved = Rod(rod.mesh, rod.K)
    moved.set_conditions(qe, re, f)
    cold = settle(moved, q, F, Options(step_tolerance=1e-12, constraint_tolerance=1e-12))
    assert cold is not None
    # The same mesh, so the same discrete equilibrium: what is left is the iteration's tolerance.
    assert np.abs(q - cold.q).max() < 1e-9
    assert np.linalg.norm(F - cold.F) < 1e-9 * np.linalg.norm(F)


def test_a_step_too_far_is_not_taken() -> None:
    found = at_zero()
    qe, re, f = conditions_at(np.radians(60.0))
    before = found.rod.re.copy()
    code, _, _, _ = found.rod.advance(found.q, found.F, qe, re, f, 1e-8, limit=0.2)
    assert code == warm_step.TOO_FAR
    assert np.array_equal(found.rod.re, before)


def test_a_mode_is_found_that_the_last_one_hides() -> None:
    found = at_zero()
    rod = found.rod
    inner = slice(3, -3)
    elastic, geometric = dense(rod.elastic)[inner, inner], dense(rod.geometric)[inner, inner]
    tangent = scipy.linalg.null_space(rod.C[:, inner])
    values, modes = scipy.linalg.eigh(
        tangent.T @ (elastic + geometric) @ tangent, tangent.T @ elastic @ tangent
    )
    # The second mode, to which inverse iteration would keep if it started with nothing else.
    rod.mode[inner] = tangent @ modes[:, 1]
    assert values[1] > 1.05 * values[0]
    assert rod.stability_margin() == pytest.approx(values[0], rel=1e-3)


def test_the_margin_that_is_kept_is_right_to_a_part_of_itself() -> None:
    found = at_zero()
    q, F, rod, kept = found.q, found.F, found.rod, 0
    margin = rod.stability_margin()
    for degrees in np.arange(0.5, 90.0, 0.5):
        qe, re, f = conditions_at(np.radians(degrees))
        code, _, q, F = rod.advance(q, F, qe if qe @ q[-1] > 0 else -qe, re, f, 1e-9)
        assert code == warm_step.ADVANCED
        kept += rod.rotation > 0.0
        margin = rod.stability_margin() if rod.rotation == 0.0 else margin
        twin = rod.variant()
        assert twin.refactor(q, F)
        # a tenth is aimed at; how fast the margin changes is known from before
        assert margin == pytest.approx(twin.stability_margin(), rel=0.15)
    assert kept > 100


PATHS = {
    "straight on": [0.5 * k for k in range(1, 12)],
    "uneven": [0.1, 0.5, 0.6, 1.4, 1.41, 2.0, 2.8],
    "turning back": [0.5, 1.0, 1.5, 1.0, 0.5, 0.0, -0.5],
    "to and fro": [0.5, 0.0] * 4,
    "standing still": [0.5, 1.0, 1.0, 1.0, 1.5, 1.5, 2.0],
    "stopping short": [0.5, 1.0, 1.5, 1.5 + 1e-9, 1.5 + 2e-9, 2.0],
}


@pytest.mark.parametrize("path", PATHS)
def test_every_path_leads_to_the_equilibria_on_it(path: str) -> None:
    found = at_zero()
    q, F, rod = found.q, found.F, found.rod
    for degrees in PATHS[path]:
        q, F = _followed(rod, q, F, *conditions_at(np.radians(degrees)))


def test_a_path_that_bends_and_a_load_that_turns() -> None:
    found = at_zero()
    q, F, rod = found.q, found.F, found.rod
    qe, re, f = conditions_at(0.0)
    for k in range(1, 5):
        q, F = _followed(rod, q, F, qe, re + [0.005 * k, 0.0, 0.0], f)
    for k in range(1, 5):
        q, F = _followed(rod, q, F, qe, re + [0.02, 0.005 * k, 0.0], f)
    for k in range(1, 5):
        turn = Rotation.from_rotvec([0.01 * k, 0.0, 0.0])
        q, F = _followed(rod, q, F, qe, re + [0.02, 0.02, 0.0], turn.apply(f))


def _followed(
    rod: Rod, q: np.ndarray, F: np.ndarray, qe: np.ndarray, re: np.ndarray, f: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The next equilibrium by `advance`, compared with Newton's own of the same mesh."""
    qe = qe if qe @ q[-1] > 0 else -qe
    code, _, q, F = rod.advance(q, F, qe, re, f, 1e-11)
    assert code == warm_step.ADVANCED
    moved = Rod(rod.mesh, rod.K)
    moved.set_conditions(qe, re, f)
    cold = settle(moved, q, F, Options(step_tolerance=1e-12, constraint_tolerance=1e-12))
    assert cold is not None
    # what is left is the iteration's tolerance, 1e-11, and the trust region's
    assert np.abs(q - cold.q).max() < 1e-9
    assert np.linalg.norm(F - cold.F) < 1e-9 * np.linalg.norm(F)
    # the gradient that the next step starts from, and the moments that are read off, are those of the end
    assert np.abs(rod.g - moved.g).max() < 1e-7
    return q, F


def test_on_a_smooth_path_one_or_two_corrections_do() -> None:
    found = at_zero()
    q, F, rod = found.q, found.F, found.rod
    corrections = []
    for degrees in np.arange(0.5, 20.0, 0.5):
        qe, re, f = conditions_at(np.radians(degrees))
        _, count, q, F = rod.advance(q, F, qe if qe @ q[-1] > 0 else -qe, re, f, 1e-7)
        corrections.append(count)
    assert max(corrections[3:]) <= 2


def test_a_start_ahead_is_on_the_polynomial_through_the_last_ones() -> None:
    # Conditions on a line, at uneven distances; forces and frames quadratic in the distance along it.
    t = np.array([0.3, 0.2, 0.05, 0.38])  # the latest first, then where to go
    line = np.linspace(1.0, 2.0, 10)
    places = t[:, None] * line
    forces = np.outer(t**2, [1.0, -2.0, 3.0]) + np.outer(t, [0.5, 0.0, 1.0])
    shapes = np.array([[[1.0, 0.1 * x + x * x, 0.0, -x]] * 4 for x in t])
    q, F = np.empty((4, 4)), np.empty(3)
    turned = warm_step.extrapolate(Path(shapes[:3], forces[:3], places[:3]), 3, places[3], q, F)
    assert pytest.approx(forces[3], rel=1e-12) == F
    assert q == pytest.approx(shapes[3] / np.linalg.norm(shapes[3], axis=1)[:, None], rel=1e-12)
    assert turned == pytest.approx(2.0 * np.abs(shapes[3] - shapes[0]).max(), rel=1e-12)
    # Two known: a line, which misses the parabola but tells the conditions as well.
    warm_step.extrapolate(Path(shapes[:3], forces[:3], places[:3]), 2, places[3], q, F)
    assert pytest.approx(forces[0] + (forces[0] - forces[1]) * 0.8, rel=1e-12) == F
    # Nothing where the way bends, or the last ones are too close together to tell.
    aside = places[0] + 0.1 * np.eye(10)[0]
    assert warm_step.extrapolate(Path(shapes[:3], forces[:3], places[:3]), 3, aside, q, F) == 0.0
    close = places[0] + np.outer([0.0, 1e-3, 2e-3], line)
    assert warm_step.extrapolate(Path(shapes[:3], forces[:3], close), 3, places[3], q, F) == 0.0


def test_old_factors_serve_small_steps() -> None:
    # Within REFACTOR the factors stay: more corrections, the same equilibrium.
    found = at_zero()
    q, F = found.q, found.F
    kept = 0
    for degrees in np.arange(0.05, 0.6, 0.05):
        qe, re, f = conditions_at(np.radians(degrees))
        qe = qe if qe @ q[-1] > 0 else -qe
        code, _, q, F = found.rod.advance(q, F, qe, re, f, 1e-11)
        assert code == warm_step.ADVANCED
        kept += found.rod.rotation > 0.0
    assert kept > 5
    moved = Rod(found.rod.mesh, found.rod.K)
    moved.set_conditions(found.rod.qe, found.rod.re, found.rod.f)
    cold = settle(moved, q, F, Options(step_tolerance=1e-12, constraint_tolerance=1e-12))
    assert cold is not None
    assert np.linalg.norm(F - cold.F) < 1e-9 * np.linalg.norm(F)


@pytest.mark.parametrize("name", ["space_arm_+0.0deg", "cable_03"])
def test_answer_of_both_clamps_is_the_derivative_of_both_wrenches(name: str) -> None:
    """All twelve motions of the clamps against differences of cold solutions on the same mesh."""
    found = KNOWN[name].solved(1e-8)
    rod = found.rod
    start, end = Rotation.identity(), Rotation.from_quat(quaternion.to_ros(rod.qe))

    def wrenches(motion: np.ndarray) -> np.ndarray:
        """On the cable, each in its clamp's frame, after motions along and about the clamps' own axes."""
        first = start * Rotation.from_rotvec(motion[3:6])
        last = end * Rotation.from_rotvec(motion[9:])
        chord = rod.re + end.apply(motion[6:9]) - start.apply(motion[:3])
        moved = Rod(rod.mesh, rod.K)
        qe = quaternion.from_ros((first.inv() * last).as_quat())
        qe = qe if qe @ found.q[-1] > 0 else -qe
        moved.set_conditions(qe, first.inv().apply(chord), first.inv().apply(rod.f))
        q = found.q.copy()
        q[-1] = qe
        there = settle(moved, q, found.F, Options(step_tolerance=1e-12, constraint_tolerance=1e-12))
        assert there is not None
        load = moved.f
        in_end = quaternion.rotate(quaternion.conjugate(qe), there.F)
        return np.concatenate([-(there.F + load), moved.g[0], in_end, moved.g[-1]])

    columns = []
    for direction in range(12):
        # Central differences of fourth order: truncation and rounding both near 1e-9 of the stiffness.
        step = np.zeros(12)
        step[direction] = 1e-3
        w = [wrenches(k * step) for k in (-2, -1, 1, 2)]
        columns.append((w[0] - 8 * w[1] + 8 * w[2] - w[3]) / 12e-3)
    numeric = np.array(columns).T
    exact = rod.clamp_stiffness(found.q, found.F)
    assert exact == pytest.approx(numeric, abs=1e-6 * np.abs(numeric).max())
