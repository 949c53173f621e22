# SPDX-License-Identifier: Apache-2.0
"""Compiled: whether an equilibrium with contacts at fixed material points is stable, and by how much.

The tangent's stiffness with all forces eliminated, symmetric: rotations psi and positions r are the unknowns,
r[k + 1] - r[k] = integral t ds is held by a stiff penalty, and each contact has the stiffness that its own
equations make: along the normal and where it sticks it is stiff, what slips resists only by the turn of its
friction. Such a matrix is positive definite if and only if the equilibrium is stable, and elimination without
row swaps tells. The band LU of the whole tangent cannot, and inverse iteration finds the eigenvalue next to
zero, which may be a positive one beside negative ones.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, LEAF, njit
from cable_ros.contact.nodal_state import Rows
from cable_ros.linalg import banded
from cable_ros.rod.rod_state import Tangents

OPTIONS = {"cache": True, "error_model": "numpy"}

PENALTY = 1e8
"""Stiffness of the penalty, EI / L^3: its effect is far below the stability margins that matter."""
ITERATIONS = 60
CHANGE = 1e-3
"""Relative change of the margin in one iteration that ends the search."""
RIGID = np.zeros((0, 3, 3))
"""The links of a cable that keeps its length: PENALTY holds them."""
UNSTABLE = -1.0
"""Margin of an unstable equilibrium."""


def softest(
    tangents: Tangents, rows: Rows, at: np.ndarray, contacts: np.ndarray, start: np.ndarray,
    iterations: int = ITERATIONS, links: np.ndarray = RIGID,
) -> float:  # fmt: skip
    """Smallest eigenvalue of the stiffness, relative to the elastic one; UNSTABLE if it is not positive.

    Args:
        tangents: `Tangents` of the rod.
        rows: numbers of the unknowns.
        at: (c, 6) numbers of the unknowns of each contact: position, normal force, friction.
        contacts: (c, 6, 6) the part of the tangent that each contact makes, in the order of `at`.
        start: (3n,) rotations to start the search from, zero at the clamps.
        iterations: maximum number; with fewer the eigenvalue is too large, its sign is right with 1.
        links: (m, 3, 3) stiffness against motion between the ends of the elements, if they stretch.
    """
    boundaries = np.searchsorted(rows.r, at[:, 0])
    K = condensed(contacts) if len(at) else np.zeros((0, 3, 3))
    elastic, geometric, dchord, _ = tangents
    return float(_softest(elastic, geometric, dchord, boundaries, K, start, iterations, links))


def condensed(contacts: np.ndarray) -> np.ndarray:
    """(c, 3, 3) symmetric stiffness of each contact by its position, its forces eliminated.

    That friction of what slips follows the normal force is left out: it makes the tangent unsymmetric, and
    does not change where the cable can move.
    """
    turn, out = contacts[:, :3, :3], contacts[:, :3, 3:]
    by_place, by_force = contacts[:, 3:, :3].copy(), contacts[:, 3:, 3:].copy()
    n = -out[:, :, 0]
    by_place[:, 1:] -= np.einsum("cia,ca,cb->cib", by_place[:, 1:], n, n)
    by_force[:, 1:, 0] = 0.0
    by_force -= by_place @ out / PENALTY  # in series with a spring of that stiffness
    K = turn - out @ np.linalg.solve(by_force, by_place)
    return 0.5 * (K + K.transpose(0, 2, 1))


@njit(**OPTIONS)
def _softest(elastic, geometric, dchord, boundaries, K, start, iterations, links):
    """See `softest`.

    Args:
        elastic, geometric, dchord: of `Tangents`.
        boundaries, K: boundaries (c,) at which contacts are, and their stiffness (c, 3, 3).
        start, iterations, links: as in `softest`.
    """
    m, nd = dchord.shape[0], dchord.shape[2]
    order = nd // 3 - 1
    block = 3 * (order + 1)
    # boundary by boundary: position, rotation, then the inner rotations of the element that begins there; the
    # clamps' are given, and have negative numbers or too large ones
    total = block * m - 6
    psi = np.empty(3 * (m * order + 1), np.int64)
    for i in range(m * order + 1):
        for c in range(3):
            psi[3 * i + c] = block * (i // order) - 3 + 3 * (i % order) + c
    psi[0] = psi[1] = psi[2] = -1
    width = block + 5
    a = np.zeros((total, width + 1))  # row i, column j <= i at [i, width + j - i]
    band = elastic.shape[1] - 1
    for i in range(psi.shape[0] - 3):
        row = psi[i]
        if row < 0:
            continue
        for k in range(band + 1):
            j = i - band + k
            if j >= 3:
                a[row, width + psi[j] - row] += elastic[i, k] + geometric[i, k]
    # r[e + 1] - r[e] - dchord psi = 0, as a penalty
    soft = links.shape[0] > 0
    if soft:
        _link(a, width, dchord, psi, links)
    numbers, values = np.empty(nd + 2, np.int64), np.empty(nd + 2)
    for e in range(0 if soft else m):
        for c in range(3):
            numbers[0], values[0] = (block * e - 6 + c if e > 0 else -1), -1.0
            numbers[1], values[1] = (block * (e + 1) - 6 + c if e + 1 < m else -1), 1.0
            for j in range(nd):
                i = 3 * e * order + j
                numbers[2 + j] = psi[i] if i < psi.shape[0] - 3 else -1
                values[2 + j] = -dchord[e, c, j]
            for i in range(nd + 2):
                for j in range(nd + 2):
                    if 0 <= numbers[j] <= numbers[i]:
                        a[numbers[i], width + numbers[j] - numbers[i]] += PENALTY * values[i] * values[j]
    for k in range(boundaries.shape[0]):
        first = block * boundaries[k] - 6
        for i in range(3):
            for j in range(i + 1):
                a[first + i, width + j - i] += K[k, i, j]
    if not _factor(a, width):
        return UNSTABLE
    v, y, x = start.copy(), np.empty(start.shape[0]), np.zeros(total)
    last = start.shape[0] - 3
    out = np.inf
    for _ in range(iterations):
        banded.multiply(elastic, v, y)
        x[:] = 0.0
        size, energy = 0.0, 0.0
        for i in range(3, last):
            x[psi[i]] = y[i]
            size += v[i] * y[i]
        _solve(a, width, x)
        for i in range(3, last):
            energy += x[psi[i]] * y[i]
            v[i] = x[psi[i]] / np.sqrt(size)
        before, out = out, size / energy
        if abs(out - before) <= CHANGE * out:
            break
    return out


@njit(**INNER)
def _link(a, width, dchord, psi, links):
    """Add the stiffness of elements that stretch, whose three directions are coupled.

    Args:
        a, width: the matrix, row i and column j <= i at [i, width + j - i].
        dchord: (m, 3, nd) of `Tangents`.
        psi: (3n,) numbers of the rotations.
        links: (m, 3, 3) as in `softest`.
    """
    m, nd = dchord.shape[0], dchord.shape[2]
    order = nd // 3 - 1
    block = 3 * (order + 1)
    numbers, values = np.empty(nd + 6, np.int64), np.zeros((3, nd + 6))
    for e in range(m):
        for c in range(3):
            numbers[c] = block * e - 6 + c if e > 0 else -1
            numbers[3 + c] = block * (e + 1) - 6 + c if e + 1 < m else -1
            values[c, c], values[c, 3 + c] = -1.0, 1.0
            for j in range(nd):
                values[c, 6 + j] = -dchord[e, c, j]
        for j in range(nd):
            i = 3 * e * order + j
            numbers[6 + j] = psi[i] if i < psi.shape[0] - 3 else -1
        for i in range(nd + 6):
            for j in range(nd + 6):
                if 0 <= numbers[j] <= numbers[i]:
                    v = 0.0
                    for c in range(3):
                        for d in range(3):
                            v += values[c, i] * links[e, c, d] * values[d, j]
                    a[numbers[i], width + numbers[j] - numbers[i]] += v


@njit(**LEAF)
def _factor(a, width):
    """Cholesky factor of a (n, width + 1) in place, row by row; whether it is positive definite."""
    for i in range(a.shape[0]):
        first = max(0, i - width)
        for j in range(first, i + 1):
            v = a[i, width + j - i]
            for k in range(max(first, j - width), j):
                v -= a[i, width + k - i] * a[j, width + k - j]
            if j < i:
                a[i, width + j - i] = v / a[j, width]
            elif v > 0.0:
                a[i, width] = np.sqrt(v)
            else:
                return False
    return True


@njit(**LEAF)
def _solve(a, width, x):
    """Solve in place, x (n,), with the factor a (n, width + 1) of `_factor`."""
    n = a.shape[0]
    for i in range(n):
        v = x[i]
        for j in range(max(0, i - width), i):
            v -= a[i, width + j - i] * x[j]
        x[i] = v / a[i, width]
    for i in range(n - 1, -1, -1):
        x[i] /= a[i, width]
        for j in range(max(0, i - width), i):
            x[j] -= a[i, width + j - i] * x[i]
