# SPDX-License-Identifier: Apache-2.0
"""The least arithmetic that an equilibrium needs: matrix products, factorisation, solves, nothing else.

Random numbers in arrays of a rod's sizes, straight into BLAS and LAPACK (dgemm, dpbtrf, dpbtrs) with all
memory at hand: no physics, no checks, no result. What `benchmarks/speed.py` holds the tracker's time against.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack


@dataclass(frozen=True)
class Floor:
    """Seconds of each part; what an equilibrium costs follows from how often it needs them."""

    interpolation: float
    """Nodal quaternions to values and slopes at the quadrature points, and back to nodal gradients."""
    products: float
    """The Hessian's: 8 x 8 and 3 x 8 blocks at every point between the shape functions of its element."""
    factorisation: float
    """Banded Cholesky, the solves with the three borders, and their Schur complement."""
    solve: float
    """One pair of triangular solves, with the borders' correction."""

    def equilibrium(self, evaluations: float, renewals: float) -> float:
        """Seconds of residual evaluations with a solve each, and of tangents assembled and factored."""
        return evaluations * (self.interpolation + self.solve) + renewals * (
            self.products + self.factorisation
        )


def measure(elements: int, order: int) -> Floor:
    """Times for so many elements of that order, with as many Gauss points as the order in each."""
    draw = np.random.default_rng(0).normal
    points, nd, inner = order, 3 * (order + 1), 3 * (elements * order - 1)
    q, shapes = draw(size=(elements, order + 1, 4)), draw(size=(2 * points, order + 1))
    there, back = np.empty((elements, 2 * points, 4)), np.empty_like(q)

    def interpolation() -> None:
        np.matmul(shapes, q, out=there)
        np.matmul(shapes.T, there, out=back)

    D, H, k = (draw(size=(elements * points, rows, columns)) for rows, columns in ((8, nd), (8, 8), (3, 8)))
    HD, kD = np.empty((elements, points, 8, nd)), np.empty((elements, points, 3, nd))
    geometric, elastic = np.empty((elements, nd, nd)), np.empty((elements, nd, nd))
    by_element = D.reshape(elements, points * 8, nd), kD.reshape(elements, points * 3, nd)

    def products() -> None:
        np.matmul(H, D, out=HD.reshape(D.shape))
        np.matmul(k, D, out=kD.reshape(-1, 3, nd))
        np.matmul(by_element[0].transpose(0, 2, 1), HD.reshape(by_element[0].shape), out=geometric)
        np.matmul(by_element[1].transpose(0, 2, 1), by_element[1], out=elastic)

    band = np.zeros((nd, inner), order="F")  # LAPACK's lower storage of the nodes between the clamps
    band[:] = 1e-3 * draw(size=band.shape)
    band[0] = float(nd)
    borders, right = np.asfortranarray(draw(size=(inner, 3))), draw(size=inner)
    factors, _ = lapack.dpbtrf(band, lower=1)
    spread, _ = lapack.dpbtrs(factors, borders, lower=1)

    def factorisation() -> None:
        L, _ = lapack.dpbtrf(band, lower=1)
        X, _ = lapack.dpbtrs(L, borders, lower=1)
        np.dot(borders.T, X)

    def solve() -> None:
        x, _ = lapack.dpbtrs(factors, right, lower=1)
        x -= np.dot(spread, np.dot(borders.T, x))

    return Floor(_time(interpolation), _time(products), _time(factorisation), _time(solve))


def _time(call: Callable[[], object], repeats: int = 2000) -> float:
    """Median seconds of one call."""
    seconds = []
    for _ in range(repeats):
        begin = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - begin)
    return float(np.median(seconds))
