# SPDX-License-Identifier: Apache-2.0
"""Elements and meshes: what their polynomials and quadratures hold exactly."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from cable_ros.rod import quaternion
from cable_ros.rod.elements import (
    LANES,
    Mesh,
    enrichment,
    lagrange,
    lobatto_nodes,
    primitives,
    reference_element,
    sampling,
)

ORDERS = (1, 2, 3, 4, 5, 6, 7, 8)
# Lagrange polynomials of these orders through Lobatto points are of the order of 1: rounding alone.
ROUNDING = 1e-13


@pytest.mark.parametrize("order", ORDERS)
def test_nodes_are_gauss_lobatto(order: int) -> None:
    nodes = lobatto_nodes(order)
    assert nodes[0] == 0.0
    assert nodes[-1] == 1.0
    assert nodes + nodes[::-1] == pytest.approx(np.ones(order + 1), abs=ROUNDING)
    # Gauss-Lobatto: the interpolating quadrature is exact up to degree 2 order - 1.
    points, gauss = np.polynomial.legendre.leggauss(20)
    weights = 0.5 * gauss @ lagrange(nodes, 0.5 * (points + 1.0))[0]
    for degree in range(2 * order):
        assert weights @ nodes**degree == pytest.approx(1 / (degree + 1), abs=ROUNDING)
    assert abs(weights @ nodes ** (2 * order) - 1 / (2 * order + 1)) > 100 * ROUNDING


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("extra", [0, 2])
def test_quadrature_is_gauss(order: int, extra: int) -> None:
    element = reference_element(order, order + extra if extra else 0)
    count = order + extra
    assert element.points.shape == element.weights.shape == (count,)
    for degree in range(2 * count):
        assert element.weights @ element.points**degree == pytest.approx(1 / (degree + 1), abs=ROUNDING)


@pytest.mark.parametrize("order", ORDERS)
def test_polynomials_of_the_order_are_interpolated_exactly(order: int) -> None:
    element = reference_element(order)
    polynomial = Polynomial(np.random.default_rng(order).normal(size=order + 1))
    nodal = polynomial(element.nodes)
    assert element.values @ nodal == pytest.approx(polynomial(element.points), abs=ROUNDING * 10)
    assert element.slopes @ nodal == pytest.approx(polynomial.deriv()(element.points), abs=ROUNDING * 100)
    values, slopes = lagrange(element.nodes, element.nodes)
    assert values == pytest.approx(np.eye(order + 1), abs=ROUNDING)
    assert slopes.sum(axis=1) == pytest.approx(np.zeros(order + 1), abs=ROUNDING * 100)


@pytest.mark.parametrize("order", [3, 6, 9])
def test_tables_as_the_kernels_take_them(order: int) -> None:
    element = reference_element(order)
    values, slopes, three, three_slopes, points, weights, by_point, by_node, nodes, integrals = element.tables
    assert nodes is element.nodes
    assert np.array_equal(integrals, primitives(element))
    assert values is element.values
    assert slopes is element.slopes
    assert points is element.points
    assert weights is element.weights
    for component in range(3):
        assert np.array_equal(three[:, component::3], values)
        assert np.array_equal(three_slopes[:, component::3], slopes)
    for k, table in enumerate((values, slopes)):
        lanes = by_point[k].swapaxes(1, 2).reshape(-1, order + 1)
        assert np.array_equal(lanes[:order], table)
        assert np.array_equal(lanes[order:], np.tile(table[-1], (len(lanes) - order, 1)))
        assert np.array_equal(by_node[k, :, : order + 1], weights[:, None] * table)
        assert not by_node[k, :, order + 1 :].any()
    assert by_point.shape[-1] == LANES
    assert by_node.shape[-1] % LANES == 0


@pytest.mark.parametrize("order", [3, 6])
def test_enrichment_is_the_next_order_and_nothing_at_the_nodes(order: int) -> None:
    fine, bubble = enrichment(order)
    assert len(fine.points) == order + 2
    # Together with the element's own shapes it spans the polynomials of one order more.
    space = np.column_stack([fine.values, bubble[0]])
    target = fine.points ** (order + 1)
    coefficients, *_ = np.linalg.lstsq(space, target, rcond=None)
    assert space @ coefficients == pytest.approx(target, abs=ROUNDING * 10)
    slopes = np.column_stack([fine.slopes, bubble[1]]) @ coefficients
    assert slopes == pytest.approx((order + 1) * fine.points**order, abs=ROUNDING * 100)
    # x^(order + 1) less its interpolant is a multiple of the product of (x - node)
    assert bubble[0] == pytest.approx(
        bubble[0][0]
        / np.prod(fine.points[0] - fine.nodes)
        * np.prod(fine.points[:, None] - fine.nodes, axis=1),
        abs=ROUNDING,
    )


MESH = Mesh(reference_element(4), np.array([0.1, 0.5, 0.15, 0.25]))


def test_mesh_places() -> None:
    assert MESH.starts == pytest.approx([0.0, 0.1, 0.6, 0.75])
    nodes = MESH.nodes
    assert len(nodes) == 17
    assert nodes[[0, 4, 8, 12, 16]] == pytest.approx([0.0, 0.1, 0.6, 0.75, 1.0])
    assert np.all(np.diff(nodes) > 0)
    element, place = MESH.locate(np.array([0.0, 0.05, 0.35, 0.675, 1.0, 1.0 + 1e-15]))
    assert element.tolist() == [0, 0, 1, 2, 3, 3]
    assert place == pytest.approx([0.0, 0.5, 0.5, 0.5, 1.0, 1.0])


def test_split_halves_what_is_marked() -> None:
    halved = MESH.split(np.array([False, True, False, True]))
    assert halved.lengths == pytest.approx([0.1, 0.25, 0.25, 0.15, 0.125, 0.125])


def frames(s: np.ndarray) -> np.ndarray:
    """Smooth unit quaternions (m, 4)."""
    q = np.stack([np.cos(s), np.sin(2 * s), s**2, np.exp(s)], axis=1)
    return q / np.linalg.norm(q, axis=1, keepdims=True)


@pytest.mark.parametrize("order", [3, 5])
def test_interpolation_converges_with_one_order_more_than_the_element(order: int) -> None:
    s = np.random.default_rng(0).uniform(size=1000)
    errors = []
    for count in (8, 16, 32):
        mesh = Mesh(reference_element(order), np.full(count, 1 / count))
        found = mesh.interpolate(frames(mesh.nodes), s)
        assert np.linalg.norm(found, axis=1) == pytest.approx(np.ones(1000), abs=ROUNDING)
        errors.append(np.abs(found - frames(s)).max())
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    # A mesh is never quite fine enough for the limit: a fifth of an order.
    assert rates[-1] == pytest.approx(order + 1, abs=0.2)


@pytest.mark.parametrize("count", [2, 3, 101])
def test_sampling_integrates_tangents_up_to_every_point(count: int) -> None:
    table = sampling(MESH, count)
    assert table.weights.shape == (count + 1, 8)
    _, place = MESH.locate(np.linspace(0.0, 1.0, count))
    # The last row is the whole element. Gauss with 8 points: degree 7 in the antiderivative, exactly.
    points = 0.5 * (np.polynomial.legendre.leggauss(8)[0] + 1.0)
    for degree in range(8):
        expected = np.append(place, 1.0) ** (degree + 1) / (degree + 1)
        assert table.weights @ points**degree == pytest.approx(expected, abs=ROUNDING)
    nodal = frames(MESH.nodes)
    for i, s in enumerate(np.linspace(0.0, 1.0, count)):
        first = 4 * table.element[i]
        q = table.values[i] @ nodal[first : first + 5]
        assert q / np.linalg.norm(q) == pytest.approx(MESH.interpolate(nodal, np.array([s]))[0], abs=ROUNDING)


def test_frames_of_a_mesh_keep_a_rigid_turn() -> None:
    turn = frames(np.array([0.3]))[0]
    nodal = frames(MESH.nodes)
    s = np.linspace(0.0, 1.0, 11)
    both = np.array([quaternion.multiply(turn, q) for q in nodal])
    expected = [quaternion.multiply(turn, q) for q in MESH.interpolate(nodal, s)]
    assert MESH.interpolate(both, s) == pytest.approx(np.array(expected), abs=ROUNDING)
