# SPDX-License-Identifier: Apache-2.0
"""Compiled quaternions against SciPy's rotations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cable_ros.rod import quaternion

# A handful of products of numbers of the order of 1.
ROUNDING = 1e-15 * 10


def random(seed: int, count: int = 1) -> tuple[np.ndarray, Rotation]:
    """Unit quaternions (count, 4), scalar first, and what SciPy calls them."""
    rotation = Rotation.random(count, random_state=np.random.default_rng(seed))
    return quaternion.from_ros(rotation.as_quat()), rotation


def same(q: np.ndarray, rotation: Rotation) -> bool:
    """Whether q (4,) is the rotation; a quaternion and its negative are the same one."""
    return abs(abs(quaternion.to_ros(q) @ rotation.as_quat()) - 1.0) < ROUNDING


@pytest.mark.parametrize("seed", range(5))
def test_product_inverse_and_turned_vector(seed: int) -> None:
    (a, b), (first, second) = random(seed, 2)
    v = np.random.default_rng(seed).normal(size=3)
    assert same(quaternion.multiply(a, b), first * second)
    assert same(quaternion.conjugate(a), first.inv())
    assert quaternion.rotate(a, v) == pytest.approx(first.apply(v), abs=ROUNDING)


def test_largest_rotation_is_that_of_the_frame_that_turned_most() -> None:
    before, first = random(3, 6)
    turns = Rotation.from_rotvec(1e-5 * np.arange(18.0).reshape(6, 3))
    after = quaternion.from_ros((first * turns).as_quat())
    after *= np.sign(np.sum(before * after, axis=1, keepdims=True))
    # by its largest component: between half of it and all
    largest = turns.magnitude().max()
    assert 0.5 * largest < quaternion.largest_rotation(before, after) <= largest * (1.0 + 1e-4)


@pytest.mark.parametrize("angle", [0.0, 1e-15, 1e-9, 1e-3, 1.0, 3.0, np.pi - 1e-7])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_rotation_vector(angle: float, sign: float) -> None:
    axis = np.array([2.0, -1.0, 2.0]) / 3
    q = sign * np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * axis])
    # The sign of the quaternion names the same rotation; the vector is the shorter way.
    assert quaternion.rotation_vector(q) == pytest.approx(angle * axis, rel=1e-14, abs=1e-30)


# Either side of 0.02 rad (of psi), where the series gives way to sine and cosine.
@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-4, 0.0199, 0.0201, 1.0, 6.0])
def test_retraction_is_the_exponential(size: float) -> None:
    q, rotation = random(3, 4)
    psi = size * np.random.default_rng(1).normal(size=(4, 3)) / np.sqrt(3)
    out = np.empty_like(q)
    quaternion.retract(q, psi.ravel(), out)
    for row, turned in zip(out, rotation * Rotation.from_rotvec(psi), strict=True):
        assert same(row, turned)
    assert np.linalg.norm(out, axis=1) == pytest.approx(np.ones(4), abs=ROUNDING)
    assert np.sum(q * out, axis=1) == pytest.approx(np.cos(np.linalg.norm(psi, axis=1) / 2), abs=ROUNDING)


def test_retraction_resolves_the_smallest_step() -> None:
    q, _ = random(4)
    psi = np.array([1e-9, -2e-9, 3e-9])
    out = np.empty_like(q)
    quaternion.retract(q, psi, out)
    back = quaternion.rotation_vector(quaternion.multiply(quaternion.conjugate(q[0]), out[0]))
    # Components of the order of 1 keep 1e-16.
    assert back == pytest.approx(psi, abs=1e-15)


def test_retraction_in_place() -> None:
    q, _ = random(5, 3)
    psi = np.linspace(-0.5, 0.5, 9)
    out = np.empty_like(q)
    quaternion.retract(q, psi, out)
    quaternion.retract(q, psi, q)
    assert np.array_equal(q, out)


def test_order_of_components() -> None:
    assert quaternion.from_ros(np.array([1.0, 2.0, 3.0, 4.0])).tolist() == [4.0, 1.0, 2.0, 3.0]
    assert quaternion.to_ros(np.array([[4.0, 1.0, 2.0, 3.0]])).tolist() == [[1.0, 2.0, 3.0, 4.0]]
