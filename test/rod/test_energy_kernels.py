# SPDX-License-Identifier: Apache-2.0
"""The compiled kernels against their plain twin, derivatives by the complex step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from references import plain_rod

from cable_ros.rod import quaternion
from cable_ros.rod.elements import Mesh, reference_element
from cable_ros.rod.energy_kernels import gradient, hessian, workspace
from cable_ros.rod.rod_state import Evaluation, Grid, Section, Tangents

# Sums of some thousand products of numbers up to the largest entry of what is compared.
ROUNDING = 1e-12
ORDERS = (2, 3, 5, 6, 7, 9)


@dataclass
class State:
    """A rod far from any equilibrium, with everything that the kernels know of."""

    mesh: Mesh
    q: np.ndarray
    F: np.ndarray
    f: np.ndarray
    K: np.ndarray
    kappa0: np.ndarray

    @property
    def size(self) -> int:
        return 3 * len(self.q)


def state(order: int, seed: int = 0) -> State:
    rng = np.random.default_rng([order, seed])
    mesh = Mesh(reference_element(order), np.array([0.2, 0.5, 0.3]))
    s = mesh.nodes[:, None]
    # Smooth, but turning by about a radian an element about a changing axis.
    turn = 3.0 * s * rng.normal(size=3) + np.sin(4.0 * s + rng.normal(size=3))
    q = np.empty((len(s), 4))
    quaternion.retract(np.tile([1.0, 0.0, 0.0, 0.0], (len(s), 1)), turn.ravel(), q)
    # The force differs from element to element, as point forces between them make it.
    return State(
        mesh,
        q,
        rng.normal(size=(3, 3)) * 20,
        rng.normal(size=3) * 30,
        np.array([1.0, 1.7, 0.6]),
        rng.normal(size=3),
    )


def grid(mesh: Mesh) -> Grid:
    return Grid(mesh.lengths, mesh.starts, mesh.element.tables)


def run_gradient(at: State, q: np.ndarray, acc: np.ndarray | None = None):
    mesh = at.mesh
    acc = np.zeros_like(q) if acc is None else acc
    g, radial, totals = np.empty((len(q), 3)), np.empty(len(q)), np.empty(5)
    lanes = workspace(mesh.lengths, mesh.element.tables.by_point)
    gradient(q, at.F, at.f, Section(at.K, at.kappa0), grid(mesh), Evaluation(acc, g, radial, totals, lanes))
    return g, radial, totals


def run_hessian(at: State):
    _, radial, _ = run_gradient(at, at.q)
    nodes, order = len(at.q), at.mesh.element.order
    band = 3 * (order + 1)
    elastic, geometric = np.empty((3 * nodes, band)), np.empty((3 * nodes, band))
    parts, C = np.empty((len(at.mesh.lengths), 3, band)), np.empty((3, 3 * nodes))
    tangents = Tangents(elastic, geometric, parts, C)
    hessian(at.q, at.F, at.f, Section(at.K, at.kappa0), grid(at.mesh), radial, tangents)
    return elastic, geometric, parts, C


def plain_gradient(at: State, psi: np.ndarray):
    return plain_rod.gradients(at.q, psi, at.F, at.f, at.K, at.kappa0, at.mesh)


def close(found: np.ndarray, expected: np.ndarray, tolerance: float = ROUNDING) -> bool:
    return bool(np.abs(found - expected).max() <= tolerance * np.abs(expected).max())


@pytest.mark.parametrize("order", ORDERS)
def test_end_position_energy_and_twist(order: int) -> None:
    at = state(order)
    _, _, totals = run_gradient(at, at.q)
    _, position, energy, twist = plain_rod.integrals(at.q, at.F, at.f, at.K, at.kappa0, at.mesh)
    assert close(totals, np.real([*position, energy, twist]))


@pytest.mark.parametrize("order", ORDERS)
def test_gradient(order: int) -> None:
    at = state(order)
    g, _, _ = run_gradient(at, at.q)
    expected, _ = plain_gradient(at, np.zeros((len(at.q), 3)))
    assert close(g.ravel(), expected)


def test_what_else_pulls_is_added_to_the_gradient() -> None:
    at = state(4)
    pull = np.random.default_rng(1).normal(size=at.q.shape)
    g, _, _ = run_gradient(at, at.q)
    pulled, _, _ = run_gradient(at, at.q, pull.copy())
    # A pull u at q does the work u.(q exp(psi / 2)): its derivative along psi is u . q (0, psi) / 2.
    expected = np.empty_like(g)
    for axis in range(3):
        basis = np.zeros((len(at.q), 4))
        basis[:, 1 + axis] = 0.5
        expected[:, axis] = np.sum(pull * plain_rod.multiply(at.q, basis), axis=1)
    assert pulled - g == pytest.approx(expected, abs=ROUNDING * np.abs(g).max())


@pytest.mark.parametrize("order", ORDERS)
def test_hessian_is_the_derivative_of_the_gradient(order: int) -> None:
    at = state(order)
    elastic, geometric, _, _ = run_hessian(at)
    found = plain_rod.dense(elastic) + plain_rod.dense(geometric)
    rng = np.random.default_rng(2)
    for _ in range(3):
        # A wrong entry shows in any random direction. Central difference of fourth order of the twin's
        # exact gradient: truncation step^4, rounding 1e-16 / step; together below 1e-10.
        direction, step = rng.normal(size=at.q[:, 1:].shape), 1e-3
        side = [plain_gradient(at, k * step * direction)[0] for k in (-2, -1, 1, 2)]
        expected = (side[0] - 8 * side[1] + 8 * side[2] - side[3]) / (12 * step)
        assert close(found @ direction.ravel(), expected, 1e-9)


@pytest.mark.parametrize("order", ORDERS)
def test_elastic_part_is_the_stiffness_of_the_strain(order: int) -> None:
    # B^T K B has no negative direction, and exactly those of a rigid turn without stiffness.
    at = state(order)
    elastic, _, _, _ = run_hessian(at)
    eigenvalues = np.linalg.eigvalsh(plain_rod.dense(elastic))
    assert np.all(np.abs(eigenvalues[:3]) < 1e-11 * eigenvalues[-1])
    assert eigenvalues[3] > 1e-8 * eigenvalues[-1]


@pytest.mark.parametrize("order", ORDERS)
def test_derivative_of_the_end_position(order: int) -> None:
    at = state(order)
    _, _, parts, C = run_hessian(at)
    _, expected = plain_gradient(at, np.zeros((len(at.q), 3)))
    assert close(C, expected)
    summed = np.zeros_like(C)
    for e in range(len(parts)):
        first = 3 * order * e
        summed[:, first : first + 3 * (order + 1)] += parts[e]
    assert close(C, summed)


def test_a_rigid_turn_changes_nothing_inside() -> None:
    at = state(5)
    turn = np.array([0.6, -0.48, 0.0, 0.64])
    free = State(at.mesh, at.q, np.zeros((3, 3)), np.zeros(3), at.K, at.kappa0)
    g, _, totals = run_gradient(free, at.q)
    turned = np.array([quaternion.multiply(turn, q) for q in at.q])
    g2, _, totals2 = run_gradient(free, turned)
    assert close(g2, g)
    assert totals2[3:] == pytest.approx(totals[3:], rel=ROUNDING)
    assert totals2[:3] == pytest.approx(quaternion.rotate(turn, totals[:3]), abs=ROUNDING)


def test_a_uniform_helix_has_constant_strain() -> None:
    # q(s) = exp(s kappa / 2): any strain is exact at the nodes, and to order 2 p in the integrals.
    kappa = np.array([0.8, -0.5, 1.1])
    errors = []
    for count in (1, 2, 4):
        mesh = Mesh(reference_element(4), np.full(count, 1 / count))
        q = np.empty((4 * count + 1, 4))
        quaternion.retract(np.tile([1.0, 0, 0, 0], (len(q), 1)), np.outer(mesh.nodes, kappa).ravel(), q)
        at = State(mesh, q, np.zeros((count, 3)), np.zeros(3), np.array([1.0, 2.0, 0.7]), np.zeros(3))
        _, _, totals = run_gradient(at, q)
        errors.append(abs(totals[3] - 0.5 * kappa @ (at.K * kappa)))
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx([8.0, 8.0], abs=0.5)
