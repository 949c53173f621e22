# SPDX-License-Identifier: Apache-2.0
"""The closed forms against direct integration of the rod's equations: one must find what the other states."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import ellipk

from references import planar, spatial
from references.reference import Reference, shoot

EXACT = {
    "cantilever": planar.cantilever(0.7, 0.02, 0.35),
    "cantilever strongly bent": planar.cantilever(1.0, 1.0, 12.0),
    "inflectional": planar.elastica(1.3, 2.0, 9.0, 0.8, -0.6, 0.4),
    "orbital": planar.elastica(1.0, 1.0, 4.0, 0.7, 0.3, -0.2, orbital=True),
    "buckled": planar.buckled(0.5, 0.01, 0.8),
    "buckled far": planar.buckled(2.0, 1.0, 0.1),
    "arc": planar.arc(1.0, 1.0, 2.0),
    "helix": spatial.helix(1.0, 1.0, 0.7, 3.0, 2.0, 2.0),
    "helix with extra twist": spatial.helix(0.4, 0.02, 0.05, 5.0, -4.0, 2.0),
}


def gaps(reference: Reference) -> tuple[float, float, float]:
    """Position gap / L, rotation gap [rad], wrench gap / wrench of integrating from the start clamp."""
    points, orientations, wrench = shoot(reference)
    turn = Rotation.from_quat(orientations[-1]).inv() * Rotation.from_quat(reference.end[3:])
    unit = np.array([1.0] * 3 + [1 / reference.length] * 3)
    size = max(np.linalg.norm(w * unit) for w in (reference.end_wrench, reference.start_wrench))
    return (
        float(np.linalg.norm(points[-1] - reference.end[:3]) / reference.length),
        float(turn.magnitude()),
        float(np.linalg.norm((wrench - reference.end_wrench) * unit) / size),
    )


@pytest.mark.parametrize("name", EXACT)
def test_exact_closed_forms_satisfy_the_rod_equations(name: str) -> None:
    # Integration at 1e-12 and roots at 1e-15, amplified by a small exponential: 1e-9 leaves room.
    assert max(gaps(EXACT[name])) < 1e-9


def test_cantilever_tip_carries_force_only() -> None:
    reference = planar.cantilever(0.7, 0.02, 0.35)
    assert np.linalg.norm(reference.end_wrench[:3]) == pytest.approx(0.35, rel=1e-12)
    assert np.linalg.norm(reference.end_wrench[3:]) < 1e-12 * 0.35 * 0.7


def test_cantilever_tends_to_the_linear_beam() -> None:
    # Tip deflection P L^3 / (3 EI) for a small force; the next term is of relative order (P L^2 / EI)^2.
    deflection = planar.cantilever(1.0, 1.0, 1e-3).end[1]
    assert deflection == pytest.approx(1e-3 / 3, rel=1e-6)


def test_buckling_starts_at_euler_load() -> None:
    # P / P_Euler = (2 K / pi)^2 -> 1 + m/2, with chord = 1 - m + ...: linear in the shortening.
    for shortening in (1e-3, 1e-4):
        force = np.linalg.norm(planar.buckled(1.0, 1.0, 1 - shortening).end_wrench[:3])
        assert force / (4 * np.pi**2) - 1 == pytest.approx(shortening / 2, rel=2e-3 * shortening / 1e-3)
    assert ellipk(0.0) == pytest.approx(np.pi / 2)


def test_beam_limit_is_second_order_in_the_gravity_number() -> None:
    # Integrated from the stated start wrench, the miss of the end's height is of relative order gamma^2.
    misses = []
    for gamma in (8.0, 4.0, 2.0):
        reference = spatial.beam(1.0, 1.0, gamma)
        points, _, _ = shoot(reference)
        misses.append(abs(points[-1, 1]) / gamma)
    orders = np.log2(np.array(misses[:-1]) / np.array(misses[1:]))
    assert orders == pytest.approx([2.0, 2.0], abs=0.1)
