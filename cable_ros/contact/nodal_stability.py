"""Whether an equilibrium with contacts at fixed material points is stable, and by how much.

The tangent's stiffness with all forces eliminated, symmetric: rotations psi and positions r are the unknowns,
r[k + 1] - r[k] = integral t ds is held by a stiff penalty, and each contact has the stiffness that its own
equations make: its normal force and what sticks are stiff, what slips resists only by the turn of its
friction. Such a matrix is positive definite if and only if the equilibrium is stable. Elimination without
row swaps tells, which the band LU of the whole tangent cannot.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded

from cable_ros.contact.nodal_state import Rows, Tangents
from cable_ros.solve import banded

PENALTY = 1e8
"""EI / L^3; what the positions and contacts give way by is far below the stability margins that matter."""
ITERATIONS = 60
CHANGE = 1e-3
"""Relative change of the margin in one iteration that ends the search."""


def softest(tangents: Tangents, rows: Rows, at: np.ndarray, contacts: np.ndarray, start: np.ndarray) -> float:
    """Smallest eigenvalue of the stiffness, relative to the elastic one; 0 if it is not positive.

    Args:
        tangents: the rod's.
        rows: numbers of the unknowns.
        at: (c, 6) numbers of the unknowns of each contact: position, normal force, friction.
        contacts: (c, 6, 6) the part of the tangent that each contact makes, in this order.
        start: (3n,) rotations to start the search from, zero at the clamps.
    """
    ab, psi = stiffness(tangents, rows, at, contacts)
    try:
        factor = cholesky_banded(ab, lower=True, check_finite=False)
    except LinAlgError:
        return 0.0
    v, y, right = start.copy(), np.empty_like(start), np.zeros(ab.shape[1])
    out = np.inf
    for _ in range(ITERATIONS):
        banded.multiply(tangents.elastic, v, y)
        size = v @ y
        right[psi] = y[3:-3]
        x = cho_solve_banded((factor, True), right, check_finite=False)[psi]
        before, out = out, size / float(x @ y[3:-3])
        v[3:-3] = x / np.sqrt(size)
        if abs(out - before) <= CHANGE * out:
            break
    return float(out)


def stiffness(
    tangents: Tangents, rows: Rows, at: np.ndarray, contacts: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The stiffness in LAPACK's lower band storage, and the numbers (3n - 6,) of the inner rotations in it.

    Arguments as for `softest`.
    """
    elastic, geometric, parts, _ = tangents
    m, nd = parts.shape[0], parts.shape[2]
    order = nd // 3 - 1
    block = 3 * (order + 1)
    # place by place: position, rotation, then the inner rotations of the element that begins there
    place = block * np.arange(m + 1) - 6
    r = place[:, None] + np.arange(3)
    node = np.arange(m * order + 1)
    psi = (place[node // order] + 3 + 3 * (node % order))[:, None] + np.arange(3)
    r[0], psi[0], r[-1], psi[-1] = -1, -1, -1, -1  # given
    total, width = block * m - 6, block + 5
    ab = np.zeros((width + 1, total))

    def add(row: np.ndarray, column: np.ndarray, values: np.ndarray) -> None:
        inside = (row >= 0) & (column >= 0) & (row >= column)
        row, column = row[inside], column[inside]
        np.add.at(ab, (row - column, column), values[inside])

    numbers, band = psi.ravel(), elastic.shape[1] - 1
    row = np.repeat(np.arange(len(numbers))[:, None], band + 1, axis=1)
    column = row - band + np.arange(band + 1)
    there = column >= 0
    add(numbers[row[there]], numbers[column[there]], (elastic + geometric)[there])
    # r[e + 1] - r[e] - parts psi = 0, as a penalty
    nodes = order * np.arange(m)[:, None] + np.arange(order + 1)
    local = np.concatenate((r[:-1], r[1:], psi[nodes].reshape(m, nd)), axis=1)
    eye = np.broadcast_to(np.eye(3), (m, 3, 3))
    way = np.concatenate((-eye, eye, -parts), axis=2)
    many = local.shape[1]
    add(
        np.repeat(local, many, axis=1).ravel(), np.tile(local, (1, many)).ravel(),
        PENALTY * np.einsum("eai,eaj->eij", way, way).ravel(),
    )  # fmt: skip
    if len(at):
        K = _condensed(contacts)
        where = r[np.searchsorted(rows.r, at[:, 0])]
        add(np.repeat(where, 3, axis=1).ravel(), np.tile(where, (1, 3)).ravel(), K.ravel())
    return ab, psi[1:-1].ravel()


def _condensed(contacts: np.ndarray) -> np.ndarray:
    """(c, 3, 3) symmetric stiffness of each contact by its position, its forces eliminated.

    That friction of what slips follows the normal force is left out: it makes the tangent unsymmetric, and
    changes nothing in where the cable can go.
    """
    turn, out = contacts[:, :3, :3], contacts[:, :3, 3:]
    by_place, by_force = contacts[:, 3:, :3].copy(), contacts[:, 3:, 3:].copy()
    n = -out[:, :, 0]
    by_place[:, 1:] -= np.einsum("cia,ca,cb->cib", by_place[:, 1:], n, n)
    by_force[:, 1:, 0] = 0.0
    by_force -= by_place @ out / PENALTY  # in series with a spring of that stiffness
    K = turn - out @ np.linalg.solve(by_force, by_place)
    return 0.5 * (K + K.transpose(0, 2, 1))
