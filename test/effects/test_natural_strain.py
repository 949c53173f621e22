# SPDX-License-Identifier: Apache-2.0
"""A cable that is curved and twisted without load: closed forms, mirror and reversal."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cable_ros import Equilibrium, Status, Tracker, load_scene

LENGTH = 0.8
REVERSE = Rotation.from_rotvec([np.pi, 0.0, 0.0])
TOLERANCE = 1e-7
CLOSE = 3e-7  # two solves at this tolerance, or one and an exact number


def helix(strain: np.ndarray) -> tuple[np.ndarray, Rotation]:
    """End of a rod of uniform strain that starts at the origin along z: Rodrigues' formula, integrated."""
    rate = float(np.linalg.norm(strain))
    axis, angle = strain / rate, rate * LENGTH
    z = np.array([0.0, 0.0, 1.0])
    along = axis * (axis @ z)
    position = (
        along * LENGTH + (z - along) * np.sin(angle) / rate + np.cross(axis, z) * (1 - np.cos(angle)) / rate
    )
    return position, Rotation.from_rotvec(strain * LENGTH)


def scene(
    natural: Any, position: np.ndarray, frame: Rotation, stiffness: Any = (0.02, 0.02, 0.015), **fields: Any
) -> dict[str, Any]:
    gravity = fields.pop("gravity", [0.0, 0.0, 0.0])
    start = fields.pop("start", (np.zeros(3), Rotation.identity()))
    clamps = {
        name: {"position": list(map(float, p)), "orientation": r.as_quat().tolist()}
        for name, (p, r) in {"start": start, "end": (position, frame)}.items()
    }
    cable = {
        "name": "cable", "length": LENGTH, "stiffness": list(stiffness), "linear_density": 0.2,
        "natural_strain": [float(k) for k in natural], **clamps, **fields,
    }  # fmt: skip
    return {"gravity": list(map(float, gravity)), "cables": [cable]}


def solve(mapping: dict[str, Any], tolerance: float = TOLERANCE) -> Equilibrium:
    found = Tracker(load_scene(mapping), tolerance=tolerance).solve({})["cable"]
    assert found.status is Status.CONVERGED, found.message
    return found


def distance(found: np.ndarray, expected: np.ndarray) -> float:
    unit = np.array([1.0] * 3 + [1 / LENGTH] * 3)
    return float(np.linalg.norm((found - expected) * unit) / np.linalg.norm(expected * unit))


@pytest.mark.parametrize("natural", [(0.0, 2.5, 0.0), (1.0, 2.0, 3.0), (0.0, 6.0, 2.0), (0.0, 35.0, 2.0)])
def test_held_as_it_lies_it_pulls_at_nothing(natural: tuple[float, float, float]) -> None:
    # No finer: a vanishing wrench's error is told relative to 1e-6 EI / L^2, where rounding soon counts.
    found = solve(scene(natural, *helix(np.array(natural))), 1e-4)
    # The last step's square, and rounding, beside EI / L^2 = 0.03 N: the elements hold this shape exactly.
    assert np.abs(found.end_wrench).max() < 1e-9
    assert found.total_twist == pytest.approx(natural[2] * LENGTH, abs=1e-9)
    assert found.energy < 1e-12


@pytest.mark.parametrize("curvature", [1.0, 2.0, 4.5])
def test_bent_from_one_circle_to_another(curvature: float) -> None:
    # Uniform bending: the moment is EIy (k - k0) all along, and no force.
    found = solve(
        scene((0.0, 2.5, 0.0), *helix(np.array([0.0, curvature, 0.0])), stiffness=(0.03, 0.02, 0.01))
    )
    moment = 0.02 * (curvature - 2.5)
    assert distance(found.end_wrench, np.array([0, 0, 0, 0, -moment, 0])) < CLOSE
    assert found.energy == pytest.approx(0.5 * 0.02 * (curvature - 2.5) ** 2 * LENGTH, rel=1e-6)


def test_helix_wound_tighter() -> None:
    # A round rod of natural strain (0, k0, c0) as a helix of (0, k, c): with the strain uniform, the force is
    # parallel to it, F = p (0, k, c); the balance of moments gives p = (k GJ (c - c0) - c EI (k - k0)) / k.
    k0, c0, k, c = 3.0, 1.0, 3.6, 1.5
    bending, torsion = 0.02, 0.015
    found = solve(scene((0.0, k0, c0), *helix(np.array([0.0, k, c]))))
    p = (k * torsion * (c - c0) - c * bending * (k - k0)) / k
    expected = -np.array([0.0, p * k, p * c, 0.0, bending * (k - k0), torsion * (c - c0)])
    assert distance(found.end_wrench, expected) < CLOSE


NATURAL = np.array([1.2, -2.0, 3.0])
POSITION, FRAME = np.array([0.3, 0.2, 0.45]), Rotation.from_rotvec([0.3, 0.8, -0.5])
GRAVITY = np.array([1.0, -3.0, 2.0])


@pytest.fixture(scope="module")
def found() -> Equilibrium:
    return solve(scene(NATURAL, POSITION, FRAME, stiffness=(0.02, 0.03, 0.015), gravity=GRAVITY))


def test_mirror(found: Equilibrium) -> None:
    world, section = np.diag([1.0, 1.0, -1.0]), np.diag([-1.0, 1.0, 1.0])
    start = Rotation.from_matrix(world @ section)
    frame = Rotation.from_matrix(world @ FRAME.as_matrix() @ section)
    image = scene(
        -section @ NATURAL, world @ POSITION, frame, (0.02, 0.03, 0.015), gravity=world @ GRAVITY,
        start=(np.zeros(3), start), total_twist=-found.total_twist,
    )  # fmt: skip
    expected = np.concatenate([section @ found.end_wrench[:3], -section @ found.end_wrench[3:]])
    assert distance(solve(image).end_wrench, expected) < CLOSE


def test_reversal(found: Equilibrium) -> None:
    # Seen from the other end, with x kept and the tangent reversed, s runs the other way.
    natural = -REVERSE.apply(NATURAL)
    other = scene(
        natural, np.zeros(3), REVERSE, (0.02, 0.03, 0.015), gravity=GRAVITY,
        start=(POSITION, FRAME * REVERSE), total_twist=found.total_twist,
    )  # fmt: skip
    expected = np.concatenate([REVERSE.apply(found.start_wrench[:3]), REVERSE.apply(found.start_wrench[3:])])
    assert distance(solve(other).end_wrench, expected) < CLOSE


def test_stiffness_is_the_wrench_s_derivative(found: Equilibrium) -> None:
    step = 1e-4
    columns = []
    for k in range(6):
        wrenches = []
        for sign in (1, -1):
            motion = np.zeros(6)
            motion[k] = sign * step
            moved = scene(
                NATURAL, POSITION + FRAME.apply(motion[:3]), FRAME * Rotation.from_rotvec(motion[3:]),
                (0.02, 0.03, 0.015), gravity=GRAVITY, total_twist=found.total_twist,
            )  # fmt: skip
            wrenches.append(solve(moved, 1e-9).end_wrench)
        columns.append((wrenches[0] - wrenches[1]) / (2 * step))
    expected = np.array(columns).T
    # Central differences: the square of the step times the third derivative, and 1e-9 / step of the solves.
    np.testing.assert_allclose(found.stiffness, expected, atol=3e-5 * np.abs(expected).max())


def test_straight_by_zeros_is_straight_by_leaving_it_out() -> None:
    position, frame = helix(np.array([0.0, 2.0, 1.0]))
    zeros = scene((0.0, 0.0, 0.0), position, frame, gravity=GRAVITY)
    without = scene((0.0, 0.0, 0.0), position, frame, gravity=GRAVITY)
    del without["cables"][0]["natural_strain"]
    np.testing.assert_array_equal(solve(zeros).end_wrench, solve(without).end_wrench)
