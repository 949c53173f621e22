# SPDX-License-Identifier: Apache-2.0
"""The verification itself: it must find closed forms, tell stable from unstable, and refuse wrong claims."""

from __future__ import annotations

import numpy as np
import pytest
from references import planar, spatial
from references.boundary_value import solve_planar_shape
from references.reference import Reference, shoot
from scipy.spatial.transform import Rotation
from scipy.special import ellipk

from cable_ros.bench.verification import Rod, Verification, refine


def rod_of(reference: Reference) -> Rod:
    return Rod(
        reference.length, np.asarray(reference.stiffness), reference.weight, reference.start, reference.end
    )


def check(reference: Reference, noise: float = 0.0) -> Verification:
    """Verify a claim made of the reference itself, its wrenches off by a relative `noise`."""
    points, orientations, _ = shoot(reference)
    return refine(
        rod_of(reference),
        points,
        orientations,
        reference.start_wrench * (1 + noise),
        reference.end_wrench * (1 + noise),
    )


CLOSED = {
    "cantilever": planar.cantilever(0.7, 0.02, 0.35),
    "orbital": planar.elastica(1.0, 1.0, 4.0, 0.7, 0.3, -0.2, orbital=True),
    "buckled": planar.buckled(0.5, 0.01, 0.8),
    "helix": spatial.helix(1.0, 1.0, 0.7, 3.0, 2.0, 2.0),
}


@pytest.mark.parametrize("name", CLOSED)
def test_finds_closed_forms_and_measures_a_wrong_wrench(name: str) -> None:
    exact = check(CLOSED[name])
    assert exact.converged
    assert exact.stable
    # Pieces are integrated to about 1e-11; the claim's shape comes from an integration at 1e-12.
    assert exact.wrench_error < 1e-8
    assert exact.start_wrench_error < 1e-8
    assert exact.shape_error < 1e-8
    off = check(CLOSED[name], noise=1e-3)
    assert off.wrench_error == pytest.approx(1e-3, rel=1e-4)


def test_a_second_buckling_mode_is_not_stable() -> None:
    # Two whole waves between the clamps: an equilibrium, but never a minimum.
    m = 0.2
    thrust = (8 * ellipk(m)) ** 2
    result = check(planar.elastica(1.0, 1.0, thrust, np.sqrt(m), 0.0))
    assert result.converged
    assert not result.stable


def test_twist_makes_a_buckled_arc_unstable() -> None:
    # A helix of more than two turns between clamps throws a loop: an equilibrium, but no minimum.
    result = check(spatial.helix(1.0, 1.0, 1.0, 14.0, 3.0, 3.0))
    assert result.converged
    assert not result.stable


@pytest.mark.parametrize("gravity_number", [1e3, 1e5])
def test_heavy_cable_against_collocation(gravity_number: float) -> None:
    guess = spatial.catenary(1.0, 1.0, gravity_number, (0.6, 0.2), (0.3, 1.9))
    true, points, orientations = solve_planar_shape(guess, 2001)
    result = refine(rod_of(guess), points, orientations, true.start_wrench, true.end_wrench)
    assert result.converged
    assert result.stable
    # solve_bvp at 1e-9 relative residual.
    assert result.wrench_error < 1e-7


def test_non_finite_or_absurd_claims_are_not_converged() -> None:
    reference = CLOSED["helix"]
    rng = np.random.default_rng(1)
    absurd = Rotation.random(101, random_state=rng).as_quat()
    wrench = reference.start_wrench
    result = refine(rod_of(reference), rng.normal(size=(101, 3)), absurd, 1e3 * wrench, wrench)
    assert not result.converged or result.wrench_error > 0.1
