# SPDX-License-Identifier: Apache-2.0
"""The reference element of the rod and the meshes made of it.

The section frame is interpolated by a unit quaternion: Lagrange polynomials of order `p` through the
Gauss-Lobatto points of each element, normalised pointwise, so that every iterate has unit tangents
and no strain under a rigid motion. Integrals use `p` Gauss points an element. With that pairing the
end wrench converges with order 2p, as for a collocation method of the same cost.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.polynomial import legendre

from cable_ros.rod.rod_state import Sampling, Tables

LANES = 8
"""Points or nodes that the kernels work out side by side: what the widest vector registers hold."""


@dataclass(frozen=True)
class ReferenceElement:
    """Tables of one element of order p on [0, 1], quadrature with g points.

    `nodes` (p + 1,), `points` (g,), `weights` (g,), `values` (g, p + 1) and `slopes` (g, p + 1):
    the shape functions and their derivatives at the quadrature points.
    """

    order: int
    nodes: np.ndarray
    points: np.ndarray
    weights: np.ndarray
    values: np.ndarray
    slopes: np.ndarray

    @cached_property
    def tables(self) -> Tables:
        """What the kernels need of the element."""
        return Tables(
            values=self.values,
            slopes=self.slopes,
            values3=np.repeat(self.values, 3, axis=1),
            slopes3=np.repeat(self.slopes, 3, axis=1),
            points=self.points,
            weights=self.weights,
            by_point=self.by_point,
            by_node=self.by_node,
            nodes=self.nodes,
            primitives=primitives(self),
        )

    @property
    def by_point(self) -> np.ndarray:
        """Values and slopes (2, blocks, p + 1, LANES) at LANES points side by side.

        Lanes beyond the last point repeat it, so that they hold a frame, too.
        """
        count = len(self.points)
        lane = np.minimum(np.arange(_whole(count)), count - 1).reshape(-1, LANES)
        tables = np.stack([self.values[lane], self.slopes[lane]])
        return np.ascontiguousarray(tables.swapaxes(2, 3))

    @property
    def by_node(self) -> np.ndarray:
        """Values and slopes (2, g, p + 1 and zeros up to whole LANES), times the weights of the points."""
        tables = self.weights[:, None] * np.stack([self.values, self.slopes])
        return np.pad(tables, ((0, 0), (0, 0), (0, _whole(self.order + 1) - self.order - 1)))


def _whole(count: int) -> int:
    """The next multiple of LANES."""
    return -(-count // LANES) * LANES


def lobatto_nodes(order: int) -> np.ndarray:
    """The order + 1 Gauss-Lobatto points on [0, 1]."""
    inner = legendre.Legendre.basis(order).deriv().roots()
    return 0.5 * (1.0 + np.concatenate(([-1.0], np.sort(inner.real), [1.0])))


def lagrange(nodes: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values and derivatives (m, n) of the n Lagrange polynomials through `nodes` at the m points `at`."""
    apart = nodes[:, None] - nodes
    np.fill_diagonal(apart, 1.0)
    values, slopes = np.ones((2, len(at), len(nodes)))
    slopes[:] = 0.0
    for j, node in enumerate(nodes):  # one factor after the other, by the product rule
        factor = (at[:, None] - node) / apart[:, j]
        factor[:, j] = 1.0
        slopes = slopes * factor + values / apart[:, j]
        slopes[:, j] -= values[:, j]
        values = values * factor
    return values, slopes


@cache
def reference_element(order: int, quadrature: int = 0) -> ReferenceElement:
    """The element of the given order with `quadrature` Gauss points (0: as many as the order)."""
    points, weights = legendre.leggauss(quadrature or order)
    points = 0.5 * (points + 1.0)
    nodes = lobatto_nodes(order)
    values, slopes = lagrange(nodes, points)
    return ReferenceElement(order, nodes, points, 0.5 * weights, values, slopes)


@cache
def enrichment(order: int) -> tuple[ReferenceElement, np.ndarray]:
    """What the error estimate of an element needs: it with two more Gauss points, and one order more.

    The polynomial (2, g) of order + 1 that vanishes at all nodes, its values and slopes at those points.
    """
    fine = reference_element(order, order + 2)
    roots = np.polynomial.Polynomial.fromroots(fine.nodes)
    scale = 1.0 / np.max(np.abs(roots.deriv()(np.linspace(0.0, 1.0, 101))))
    return fine, scale * np.array([roots(fine.points), roots.deriv()(fine.points)])


def primitives(element: ReferenceElement) -> np.ndarray:
    """Integrals (g, g) of the Lagrange polynomials through the g points: column k in powers 1 to g of x."""
    powers = np.vander(element.points, increasing=True)
    return np.linalg.inv(powers) / np.arange(1, len(element.points) + 1)[:, None]


@dataclass(frozen=True, eq=False)
class Mesh:
    """Elements of one order along the rod; lengths in units of the rod's."""

    element: ReferenceElement
    lengths: np.ndarray
    """(elements,) their lengths, summing to 1."""

    @property
    def starts(self) -> np.ndarray:
        """(elements,) arc length at which each begins."""
        return np.concatenate(([0.0], np.cumsum(self.lengths)[:-1]))

    @property
    def nodes(self) -> np.ndarray:
        """(elements * order + 1,) arc lengths of the nodes."""
        inner = self.starts[:, None] + self.lengths[:, None] * self.element.nodes[None, :-1]
        return np.append(inner.ravel(), 1.0)

    def locate(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Elements (m,) of the arc lengths s (m,), and the fractions (m,) of their lengths before them."""
        ends = np.cumsum(self.lengths)
        element = np.minimum(np.searchsorted(ends, s, side="left"), len(self.lengths) - 1)
        return element, np.clip((s - self.starts[element]) / self.lengths[element], 0.0, 1.0)

    def interpolate(self, q: np.ndarray, s: np.ndarray) -> np.ndarray:
        """Unit quaternions (m, 4) at the arc lengths s (m,) of the nodal q (n, 4)."""
        element, fraction = self.locate(s)
        values, _ = lagrange(self.element.nodes, fraction)
        index = element[:, None] * self.element.order + np.arange(self.element.order + 1)[None, :]
        out = np.einsum("mi,mia->ma", values, q[index])
        return out / np.linalg.norm(out, axis=1, keepdims=True)

    def split(self, which: np.ndarray) -> Mesh:
        """The mesh with the elements marked in `which` (elements,) halved."""
        times = np.where(which, 2, 1)
        return Mesh(self.element, np.repeat(self.lengths / times, times))


def sampling(mesh: Mesh, where: int | np.ndarray) -> Sampling:
    """The tables for so many points at equal arc lengths, both ends included, or for rising ones (c,), L."""
    at = np.linspace(0.0, 1.0, where) if isinstance(where, int) else where
    count = len(at)
    element, fraction = mesh.locate(at)
    values, _ = lagrange(mesh.element.nodes, fraction)
    # the tangent is no polynomial: a few more points than the solve keep the polyline as good as its ends
    points, weights = legendre.leggauss(mesh.element.order + 4)
    points, weights = 0.5 * (points + 1.0), 0.5 * weights
    quadrature, _ = lagrange(mesh.element.nodes, points)
    inner, _ = lagrange(points, np.outer(fraction, points).ravel())
    inner = inner.reshape(count, len(points), len(points))
    integrals = fraction[:, None] * np.einsum("g,mgk->mk", weights, inner)
    return Sampling(element.astype(np.int64), values, np.vstack([integrals, weights]), quadrature, points)


@cache
def integrals(order: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For positions and frames anywhere along an element.

    Shape functions at more Gauss points, their `primitives`, and the shape functions' coefficients (order +
    1, order + 1): column i in powers 0 to order of the fraction.
    """
    element = reference_element(order, order + 4)
    return element.values, primitives(element), np.linalg.inv(np.vander(element.nodes, increasing=True))


@cache
def equally_spaced(count: int) -> np.ndarray:
    """(count,) arc lengths from 0 to 1, L, at equal distances."""
    return np.arange(count) / (count - 1)


@cache
def end_bubbles(order: int) -> np.ndarray:
    """(2, order + 2): what adds a tangent 1 at the start or at the end to a `centreline.curve`.

    In powers 1 to order + 2 of the fraction. The tangent is 0 at the Gauss points and at the other end, where
    by Gauss's rule the position stays, too.
    """
    vanishing = legendre.Legendre.basis(order, [0.0, 1.0]).convert(kind=np.polynomial.Polynomial)
    ramps = np.polynomial.Polynomial([(-1) ** order, -((-1) ** order)]), np.polynomial.Polynomial([0.0, 1.0])
    return np.array([(vanishing * ramp).integ().coef[1:] for ramp in ramps])
