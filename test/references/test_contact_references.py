# SPDX-License-Identifier: Apache-2.0
"""The contact references: admissible, in balance, and agreeing where two of them meet."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from scipy.special import ellipk

from references import contact, planar
from references.reference import Reference, planar_frame

TOUCHING = {
    "lifted": contact.lifted(),
    "sagging": contact.sagging(),
    "draped": contact.draped(),
    "capstan": contact.draped(weight=0.0, friction=0.35, tension=6.0),
}


def world(pose: np.ndarray, wrench: np.ndarray) -> np.ndarray:
    """(6,) wrench on the body in world axes, moment about the world's origin."""
    frame = Rotation.from_quat(pose[3:])
    force = frame.apply(wrench[:3])
    return np.concatenate([force, frame.apply(wrench[3:]) + np.cross(pose[:3], force)])


@pytest.mark.parametrize("name", TOUCHING)
def test_admissible(name: str) -> None:
    case = TOUCHING[name]
    facts = case.reference.facts
    assert facts["point_force_start"] >= 0
    assert facts["point_force_end"] > 0
    assert case.least_pressure > 0
    if name in ("lifted", "sagging"):
        gap = case.points[:, 1]
    else:
        gap = np.linalg.norm(case.points - contact.cylinder_centre(0.15, 1.4), axis=1) - 0.15
    assert gap.min() > -1e-12


@pytest.mark.parametrize("name", TOUCHING)
def test_forces_balance(name: str) -> None:
    # All that pulls on the bodies comes from the weight and the obstacle.
    reference = TOUCHING[name].reference
    pulls = world(reference.start, reference.start_wrench) + world(reference.end, reference.end_wrench)
    obstacle = np.array([reference.facts["contact_force_x"], reference.facts["contact_force_y"], 0.0])
    assert pulls[:3] == pytest.approx(reference.weight * reference.length + obstacle, abs=1e-9)


def test_ground_carries_the_lying_weight_and_the_point_force() -> None:
    reference = contact.lifted(weight=60.0, lying=0.45, shear=19.0).reference
    assert reference.facts["contact_force_y"] == pytest.approx(60.0 * 0.45 + 19.0, abs=1e-9)
    assert reference.facts["contact_force_x"] == pytest.approx(0.0, abs=1e-9)


def test_capstan_ratio() -> None:
    # Without weight and with point forces the tension grows by exp(mu * wrap) along the arc alone.
    case = contact.draped(weight=0.0, friction=0.35, tension=6.0).reference
    start = np.linalg.norm(case.start_wrench[:3])
    # Just inside the stretch the tension is 6 at its start, 6 exp(mu * wrap) at its end.
    inside_end = 6.0 * np.exp(0.35 * 1.4)
    assert start == pytest.approx(np.hypot(6.0 - 0.35 * 28.0, 28.0), rel=1e-9)
    end = np.linalg.norm(case.end_wrench[:3])
    assert end == pytest.approx(np.hypot(inside_end + 0.35 * 32.0, 32.0), rel=1e-9)


def test_scaling_of_a_manufactured_case() -> None:
    one = contact.manufacture((0.3, 0.35), 0.35, 0.0, 5.0, (9.0, 8.0), 120.0).reference
    case = contact.manufacture((0.3, 0.35), 0.35, 0.0, 5.0, (9.0, 8.0), 120.0, length=2.0, bending=3.0)
    two = case.reference
    unit = np.array([3 / 4] * 3 + [3 / 2] * 3)
    assert two.end_wrench == pytest.approx(one.end_wrench * unit, rel=1e-9)
    assert two.weight[1] * 8 / 3 == pytest.approx(one.weight[1], rel=1e-12)


def half(reference: Reference) -> np.ndarray:
    """x, y, theta, kappa at half the rod's length, from its start clamp."""
    fx, fy, _ = planar_frame(0.0) @ reference.start_wrench[:3]
    state = [*reference.start[:2], 0.0, reference.start_wrench[4], fx, fy]
    span = min(reference.facts["touchdown_start"], 0.5)
    return solve_ivp(contact._rates, (0, span), state, "DOP853", args=(0.0,), rtol=1e-12, atol=1e-13).y[:, -1]


def test_closed_forms_land_on_the_plane() -> None:
    k = 0.45
    middle = half(contact.pressed_at_a_point(k, 1.4 * float(ellipk(k * k))))
    assert middle[:3] == pytest.approx([0, 0, 0], abs=1e-9)
    assert middle[3] > 0
    lift_off = half(contact.pressed_flat(k, 0.4))
    assert lift_off[:4] == pytest.approx([-0.1, 0, 0, 0], abs=1e-8)


def test_point_contact_starts_at_the_free_buckled_rod_and_ends_at_the_flat_one() -> None:
    k = 0.4
    big = float(ellipk(k * k))
    free = contact.pressed_at_a_point(k, big)
    assert free.facts["contact_force_y"] == pytest.approx(0, abs=1e-9)
    buckled = planar.buckled(1.0, 1.0, 2 * free.end[0])
    assert np.linalg.norm(free.end_wrench[:3]) == pytest.approx(np.linalg.norm(buckled.end_wrench[:3]))
    onset, flat = contact.pressed_at_a_point(k, 2 * big), contact.pressed_flat(k, 0.5)
    assert onset.end_wrench == pytest.approx(flat.end_wrench, abs=1e-8)
    assert onset.end == pytest.approx(flat.end, abs=1e-9)


def test_pressed_finds_both_regimes() -> None:
    free_height = contact.pressed_at_a_point(0.4, float(ellipk(0.16))).end
    chord = 2 * free_height[0]
    point = contact.pressed(0.9 * free_height[1], chord)
    assert point.facts["touchdown_start"] == point.facts["touchdown_end"]
    flat = contact.pressed(0.35 * free_height[1], chord)
    assert flat.facts["touchdown_start"] < flat.facts["touchdown_end"]
    assert flat.end[1] == pytest.approx(0.35 * free_height[1], abs=1e-10)


def test_dragged_rod_carries_the_friction() -> None:
    reference = contact.dragged_sideways()
    pulls = world(reference.start, reference.start_wrench) + world(reference.end, reference.end_wrench)
    assert pulls[:3] == pytest.approx([0.0, -0.35 * 40.0, 0.0], abs=1e-7)
    assert pulls[3:5] == pytest.approx([0, 0], abs=1e-9)
