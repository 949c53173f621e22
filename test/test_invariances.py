# SPDX-License-Identifier: Apache-2.0
"""What must not change, and what must change in step: motions, mirror, reversal, units, work."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from scipy.integrate import simpson
from scipy.spatial.transform import Rotation

from cable_ros import Equilibrium, Status, Tracker, load_scene
from cable_ros.bench.fuzz import random_cable

SEEDS = (3, 4, 5, 6)
# Two solves at this tolerance may differ by twice as much.
TOLERANCE = 1e-7
CLOSE = 3e-7
REVERSE = Rotation.from_rotvec([np.pi, 0.0, 0.0])
"""A clamp's frame seen from the other end: tangent and y axis reversed."""


def solve(mapping: dict[str, Any], tolerance: float = TOLERANCE) -> Equilibrium:
    found = Tracker(load_scene(mapping), tolerance=tolerance).solve({})["cable"]
    assert found.status is Status.CONVERGED, found.message
    return found


def case(seed: int) -> tuple[dict[str, Any], Equilibrium]:
    """A random cable, with its own twist as the target so that changed copies stay on the branch."""
    mapping = random_cable(np.random.default_rng(seed))
    found = solve(mapping)
    mapping["cables"][0]["total_twist"] = found.total_twist
    return mapping, found


def clamp(mapping: dict[str, Any], end: str) -> tuple[np.ndarray, Rotation]:
    mount = mapping["cables"][0][end]
    return np.array(mount["position"]), Rotation.from_quat(mount["orientation"])


def with_clamps(
    mapping: dict[str, Any],
    start: tuple[np.ndarray, Rotation],
    end: tuple[np.ndarray, Rotation],
    **fields: Any,
) -> dict[str, Any]:
    changed = copy.deepcopy(mapping)
    cable = changed["cables"][0]
    for name, (position, orientation) in (("start", start), ("end", end)):
        cable[name] = {"position": position.tolist(), "orientation": orientation.as_quat().tolist()}
    cable.update(fields)
    return changed


def difference(found: np.ndarray, expected: np.ndarray, length: float) -> float:
    unit = np.array([1.0] * 3 + [1 / length] * 3)
    return float(np.linalg.norm((found - expected) * unit) / np.linalg.norm(expected * unit))


@pytest.mark.parametrize("seed", SEEDS)
def test_rigid_motion(seed: int) -> None:
    mapping, before = case(seed)
    turn, shift = Rotation.from_rotvec([0.5, -1.2, 2.0]), np.array([10.0, -3.0, 7.0])
    ends = [(turn.apply(p) + shift, turn * r) for p, r in (clamp(mapping, "start"), clamp(mapping, "end"))]
    moved = with_clamps(mapping, *ends)
    moved["gravity"] = turn.apply(mapping["gravity"]).tolist()
    after = solve(moved)
    length = mapping["cables"][0]["length"]
    assert difference(after.end_wrench, before.end_wrench, length) < CLOSE
    assert difference(after.start_wrench, before.start_wrench, length) < CLOSE
    assert after.total_twist == pytest.approx(before.total_twist, abs=1e-6)
    assert after.points == pytest.approx(turn.apply(before.points) + shift, abs=1e-6 * length)
    assert after.stability_margin == pytest.approx(before.stability_margin, rel=1e-3)


@pytest.mark.parametrize("seed", SEEDS)
def test_mirror(seed: int) -> None:
    mapping, before = case(seed)
    world, section = np.diag([1.0, 1.0, -1.0]), np.diag([-1.0, 1.0, 1.0])

    def mirrored(position: np.ndarray, frame: Rotation) -> tuple[np.ndarray, Rotation]:
        # The section's x axis is reversed too, which keeps the frame right-handed and EIx where it was.
        return world @ position, Rotation.from_matrix(world @ frame.as_matrix() @ section)

    start, end = mirrored(*clamp(mapping, "start")), mirrored(*clamp(mapping, "end"))
    image = with_clamps(mapping, start, end, total_twist=-before.total_twist)
    image["gravity"] = (world @ mapping["gravity"]).tolist()
    after = solve(image)
    length = mapping["cables"][0]["length"]
    # Forces are mirrored, moments (axial vectors) mirrored and reversed.
    expected = np.concatenate([section @ before.end_wrench[:3], -section @ before.end_wrench[3:]])
    assert difference(after.end_wrench, expected, length) < CLOSE
    assert after.total_twist == pytest.approx(-before.total_twist, abs=1e-6)
    assert after.energy - before.energy == pytest.approx(0, abs=1e-6 * _energy_scale(mapping))


@pytest.mark.parametrize("seed", SEEDS)
def test_reversal(seed: int) -> None:
    mapping, before = case(seed)
    (first, first_frame), (last, last_frame) = clamp(mapping, "start"), clamp(mapping, "end")
    after = solve(with_clamps(mapping, (last, last_frame * REVERSE), (first, first_frame * REVERSE)))
    length = mapping["cables"][0]["length"]

    def seen_from_the_other_end(wrench: np.ndarray) -> np.ndarray:
        return np.concatenate([REVERSE.inv().apply(wrench[:3]), REVERSE.inv().apply(wrench[3:])])

    assert difference(after.end_wrench, seen_from_the_other_end(before.start_wrench), length) < CLOSE
    assert difference(after.start_wrench, seen_from_the_other_end(before.end_wrench), length) < CLOSE
    assert after.total_twist == pytest.approx(before.total_twist, abs=1e-6)
    assert after.points[::-1] == pytest.approx(before.points, abs=1e-6 * length)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(("stretch", "stiffen"), [(7.0, 1.0), (1.0, 30.0), (0.1, 0.01)])
def test_units(seed: int, stretch: float, stiffen: float) -> None:
    mapping, before = case(seed)
    cable = mapping["cables"][0]
    length = cable["length"]
    if not 0.01 <= length * stretch <= 100:
        pytest.skip("outside the sizes that a scene may have")
    ends = [(stretch * p, r) for p, r in (clamp(mapping, "start"), clamp(mapping, "end"))]
    stiffness = [stiffen * k for k in cable["stiffness"]]
    scaled = with_clamps(mapping, *ends, length=length * stretch, stiffness=stiffness)
    # Weight per length goes as EI / L^3.
    scaled["gravity"] = [g * stiffen / stretch**3 for g in mapping["gravity"]]
    after = solve(scaled)
    unit = np.array([stiffen / stretch**2] * 3 + [stiffen / stretch] * 3)
    assert difference(after.end_wrench, before.end_wrench * unit, length * stretch) < CLOSE
    assert after.stability_margin == pytest.approx(before.stability_margin, rel=1e-3)
    assert after.energy * stretch / stiffen - before.energy == pytest.approx(
        0, abs=1e-6 * _energy_scale(mapping)
    )


def test_weight_is_gravity_times_density() -> None:
    mapping, before = case(7)
    mapping["gravity"] = [2.0 * g for g in mapping["gravity"]]
    mapping["cables"][0]["linear_density"] /= 2.0
    # Powers of two: the same bits reach the solver.
    assert np.array_equal(solve(mapping).end_wrench, solve(mapping).end_wrench)
    assert difference(solve(mapping).end_wrench, before.end_wrench, mapping["cables"][0]["length"]) < CLOSE


def test_no_gravity_is_no_density() -> None:
    mapping = random_cable(np.random.default_rng(8))
    mapping["gravity"] = [0.0, 0.0, 0.0]
    floating = solve(mapping)
    mapping["gravity"] = [0.0, 0.0, -9.80665]
    mapping["cables"][0]["linear_density"] = 0.0
    assert np.array_equal(solve(mapping).end_wrench, floating.end_wrench)


@pytest.mark.parametrize("seed", SEEDS)
def test_both_wrenches_and_the_weight_balance(seed: int) -> None:
    mapping, found = case(seed)
    cable = mapping["cables"][0]
    weight = np.array(mapping["gravity"]) * cable["linear_density"]
    force, moment = np.zeros(3), np.zeros(3)
    for wrench, end in ((found.start_wrench, "start"), (found.end_wrench, "end")):
        position, frame = clamp(mapping, end)
        force += frame.apply(wrench[:3])
        moment += frame.apply(wrench[3:]) + np.cross(position, frame.apply(wrench[:3]))
    assert force == pytest.approx(weight * cable["length"], abs=CLOSE * np.linalg.norm(found.end_wrench[:3]))
    # Simpson over the polyline: its error is of fourth order in the spacing of 1/100.
    s = np.linspace(0, cable["length"], len(found.points))
    arm = simpson(found.points, x=s, axis=0)
    scale = np.linalg.norm(weight) * cable["length"] ** 2 + np.linalg.norm(found.end_wrench[3:])
    assert moment == pytest.approx(np.cross(arm, weight), abs=1e-5 * scale)


def moved_end(mapping: dict[str, Any], direction: int, by: float) -> dict[str, Any]:
    """The scene with its end clamp moved along (0..2, m) or about (3..5, rad) one of the clamp's own axes."""
    position, frame = clamp(mapping, "end")
    along, about = np.zeros(3), np.zeros(3)
    (along if direction < 3 else about)[direction % 3] = by
    end = (position + frame.apply(along), frame * Rotation.from_rotvec(about))
    return with_clamps(mapping, clamp(mapping, "start"), end)


@pytest.mark.parametrize("seed", SEEDS)
def test_virtual_work(seed: int) -> None:
    # What the cable does to the body is minus the derivative of its energy along the body's motion.
    mapping, _ = case(seed)
    found = solve(mapping, 1e-10)
    length = mapping["cables"][0]["length"]
    scale = np.array([length] * 3 + [1.0] * 3)
    slopes = []
    for direction in range(6):
        # Fourth-order central difference: the truncation is far below the tolerance.
        by = 5e-4 * scale[direction]
        e = [solve(moved_end(mapping, direction, k * by), 1e-10).energy for k in (-2, -1, 1, 2)]
        slopes.append((e[0] - 8 * e[1] + 8 * e[2] - e[3]) / (12 * by))
    assert difference(-np.array(slopes), found.end_wrench, length) < 1e-5


@pytest.mark.parametrize("seed", SEEDS)
def test_stiffness_is_the_derivative_of_the_wrench(seed: int) -> None:
    mapping, _ = case(seed)
    found = solve(mapping, 1e-9)
    length = mapping["cables"][0]["length"]
    scale = np.array([length] * 3 + [1.0] * 3)
    columns = []
    for direction in range(6):
        by = 5e-4 * scale[direction]
        w = [solve(moved_end(mapping, direction, k * by), 1e-9).end_wrench for k in (-2, -1, 1, 2)]
        columns.append((w[0] - 8 * w[1] + 8 * w[2] - w[3]) / (12 * by))
    unit = np.outer(scale, scale)
    numeric = np.array(columns).T * unit
    assert found.stiffness * unit == pytest.approx(numeric, abs=1e-4 * np.abs(numeric).max())


@pytest.mark.parametrize("seed", SEEDS)
def test_stiffness_is_symmetric_but_for_the_turning_frame(seed: int) -> None:
    # w_i = -X_i E along the clamp's own axes, K_ij = X_j w_i: so K_ij - K_ji = sum_k c_jik w_k with
    # [X_j, X_i] = c_jik X_k, the commutators of motions along and about the body's own axes.
    mapping, found = case(seed)
    force, moment = found.end_wrench[:3], found.end_wrench[3:]
    commutator = np.zeros((6, 6))
    epsilon = np.zeros((3, 3, 3))
    for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        epsilon[a, b, c], epsilon[b, a, c] = 1.0, -1.0
    for i in range(3):
        for j in range(3):
            commutator[i, 3 + j] = epsilon[j, i] @ force  # turn j, then slide i: [omega_j, v_i] = v_k
            commutator[3 + j, i] = -commutator[i, 3 + j]
            commutator[3 + i, 3 + j] = epsilon[j, i] @ moment
    length = mapping["cables"][0]["length"]
    unit = np.outer([length] * 3 + [1.0] * 3, [length] * 3 + [1.0] * 3)
    rest = (found.stiffness - found.stiffness.T - commutator) * unit
    assert np.abs(rest).max() < 1e-5 * np.abs(found.stiffness * unit).max()


def _energy_scale(mapping: dict[str, Any]) -> float:
    cable = mapping["cables"][0]
    weight = np.linalg.norm(mapping["gravity"]) * cable["linear_density"]
    return float(max(cable["stiffness"]) / cable["length"] + weight * cable["length"] ** 2)
