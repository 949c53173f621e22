# SPDX-License-Identifier: Apache-2.0
"""Compiled: the bordered (KKT) system of the rod's Hessian and its constraints, factored once, solved often.

The Hessian H is banded, the sum of the `elastic` part D and the `geometric` one of `tangents`, a
`rod_state.Tangents` of n nodes with bands of b numbers. The end position's derivative and what else holds the
rod are a few dense constraint rows. `order` is that of the elements.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cable_ros.compilation import INNER, LEAF, njit
from cable_ros.linalg import banded, dense

SINGULAR = 1e-11
"""Factors with a worse pivot have lost their digits."""
ROUNDING = 1e-13
"""Error of the complement's eigenvalues, relative to its largest entry."""
NEUTRAL = 1e-6
"""Part of the elastic stiffness that is always added to the Hessian: an equilibrium that may turn freely, as
that of a round weightless rod about the line of its clamps, then counts as stable, and can be followed."""


class Factors(NamedTuple):
    """Factors of a bordered system with r constraint rows; change with every refactorisation."""

    A: np.ndarray
    """(3n, b) workspace: the matrix that is factored."""
    U: np.ndarray
    """(3n, b) its factors, see `linalg.banded`."""
    pivots: np.ndarray
    """(3n,) their pivots."""
    Y: np.ndarray
    """(r or more, 3n) H^-1 times the constraint rows, transposed."""
    S: np.ndarray
    """(r or more, r or more) the Schur complement."""


@njit(**LEAF)
def solve3(S, b, x):
    """x = S^-1 b for the symmetric 3 x 3 matrix S, by elimination with the largest pivot."""
    r0 = S[0, 0], S[0, 1], S[0, 2], b[0]
    r1 = S[1, 0], S[1, 1], S[1, 2], b[1]
    r2 = S[2, 0], S[2, 1], S[2, 2], b[2]
    if abs(r1[0]) > abs(r0[0]):
        r0, r1 = r1, r0
    if abs(r2[0]) > abs(r0[0]):
        r0, r2 = r2, r0
    v = r1[0] / r0[0]
    s1 = r1[1] - v * r0[1], r1[2] - v * r0[2], r1[3] - v * r0[3]
    v = r2[0] / r0[0]
    s2 = r2[1] - v * r0[1], r2[2] - v * r0[2], r2[3] - v * r0[3]
    if abs(s2[0]) > abs(s1[0]):
        s1, s2 = s2, s1
    v = s2[0] / s1[0]
    x[2] = (s2[2] - v * s1[2]) / (s2[1] - v * s1[1])
    x[1] = (s1[2] - s1[1] * x[2]) / s1[0]
    x[0] = (r0[3] - r0[1] * x[1] - r0[2] * x[2]) / r0[0]


@njit(**LEAF)
def inner(v, s):
    """v.s at the inner nodes, of two vectors (3n,)."""
    out = 0.0
    for i in range(3, s.shape[0] - 3, 3):
        out += v[i] * s[i] + v[i + 1] * s[i + 1] + v[i + 2] * s[i + 2]
    return out


@njit(**LEAF)
def relax(g, order, U, pivots, s):
    """s = -H^-1 g, s and g (3n,), at the inner nodes, 0 at the ends; `order`, `U`, `pivots`: of H."""
    n = s.shape[0]
    for i in range(n):
        s[i] = -g[i] if 3 <= i < n - 3 else 0.0
    banded.solve(U, pivots, 3, n - 3, order, s)


@njit(**LEAF)
def missing(c, V, count, s, b):
    """b = -c - V s, b and c (count,), for the first `count` rows of V (rows, 3n), s (3n,)."""
    for a in range(count):
        b[a] = -c[a] - inner(V[a], s)


@njit(**LEAF)
def respond(Y, count, y, s):
    """Add Y^T y, y (count,), of the first `count` rows of Y (rows, 3n) to s (3n,) at the inner nodes."""
    n = s.shape[0]
    free = s[3 : n - 3]
    for a in range(count):
        v, row = y[a], Y[a, 3 : n - 3]
        for i in range(free.shape[0]):
            free[i] += row[i] * v


@njit(**LEAF)
def negative3(S):
    """Number of negative eigenvalues of the symmetric 3 x 3 matrix S, from its characteristic polynomial."""
    trace = S[0, 0] + S[1, 1] + S[2, 2]
    minors = (
        (S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0])
        + (S[0, 0] * S[2, 2] - S[0, 2] * S[2, 0])
        + (S[1, 1] * S[2, 2] - S[1, 2] * S[2, 1])
    )
    det = (
        S[0, 0] * (S[1, 1] * S[2, 2] - S[1, 2] * S[2, 1])
        - S[0, 1] * (S[1, 0] * S[2, 2] - S[1, 2] * S[2, 0])
        + S[0, 2] * (S[1, 0] * S[2, 1] - S[1, 1] * S[2, 0])
    )
    # all roots are real, so Descartes' rule counts the positive ones exactly
    count, last = 0, 1.0
    for v in (-trace, minors, -det):
        if v * last < 0.0:
            count += 1
        if v != 0.0:
            last = v
    return 3 - count


@njit(**LEAF)
def schur(tangents, mu, order, factors):
    """Factor H + mu D and form S = C (H + mu D)^-1 C^T, both in `factors`, of 3 rows.

    Returns the number of negative eigenvalues of H + mu D and the pivots' worst quality. `tangents`, `order`:
    see this file's first lines.
    """
    C = tangents.C
    negative, worst = shift(tangents, mu, order, factors)
    _, U, pivots, Y, S = factors
    n = U.shape[0]
    for a in range(3):
        for i in range(n):
            Y[a, i] = C[a, i] if 3 <= i < n - 3 else 0.0
        banded.solve(U, pivots, 3, n - 3, order, Y[a])
    for a in range(3):
        for b in range(a + 1):
            S[a, b] = inner(C[a], Y[b])
            S[b, a] = S[a, b]
    return negative, worst


@njit(**LEAF)
def shift(tangents, mu, order, factors):
    """Factor H + (NEUTRAL + mu) D, of `tangents` and `order`, in `factors`; returns as `schur`."""
    elastic, geometric = tangents.elastic, tangents.geometric
    A = factors.A
    n = A.shape[0]
    for i in range(n):
        for j in range(A.shape[1]):
            A[i, j] = (1.0 + NEUTRAL + mu) * elastic[i, j] + geometric[i, j]
    return banded.factor(A, 3, n - 3, order, factors.U, factors.pivots)


@njit(**LEAF)
def factor(tangents, mu, order, factors):
    """Factor the saddle system of H + mu D; whether that is positive on the end condition's tangent space.

    The matrix has the inertia of H + mu D and that of -S together; a strict minimum has three negative
    eigenvalues in all (Gould 1985).

    Args:
        tangents: `rod_state.Tangents`.
        mu: weight of D.
        order: of the elements.
        factors: `Factors` of 3 rows, overwritten.
    """
    negative, worst = schur(tangents, mu, order, factors)
    return worst > SINGULAR and negative3(factors.S) == negative


@njit(**LEAF)
def saddle_step(g, c, C, order, factors, s, dF):
    """s (3n,), dF (3,) with H s - C^T dF = -g, C s = -c at the inner nodes; s = 0 at the ends.

    Args:
        g, c: (3n,) gradient, (3,) how far the end is off.
        C: (3, 3n) of `rod_state.Tangents`.
        order: of the elements.
        factors: as `factor` leaves them.
        s, dF: receive the step.
    """
    relax(g, order, factors.U, factors.pivots, s)
    missing(c, C, 3, s, dF)
    solve3(factors.S, dF, dF)
    respond(factors.Y, 3, dF, s)


@njit(**INNER)
def kkt_factor(tangents, mu, order, factors, V, W, skew, delta, reach, give, count, equalities):
    """`factor` with more constraint rows; whether the whole is a strict minimum.

    With H' = H + mu D + sum v v^T / delta over the rows of V beyond the equalities, the bordered matrix has
    as many negative eigenvalues as there are equalities and positive deltas exactly where H' is positive on
    the equalities' tangent space. A row with delta 0 is an equality, too.

    Where multipliers act along other rows W there is no energy, and the cable is stable if no eigenvalue is
    negative. Each that is turns the determinant's sign: where that differs from the sign with W = V, one that
    was negative is not any more, or the first one is.

    Args:
        tangents, mu, order: as in `factor`.
        factors: `Factors` of `count` rows or more, overwritten.
        V, delta: (rows, 3n) constraint rows, (rows,) their compliances.
        W, skew: (rows, 3n) the directions in which the multipliers act, and whether these differ from V.
        reach: (rows, rows) how far the constraints give way to the multipliers by axial strain, or (0, 0).
        give: (3, 3) how far the end position gives way to the end force.
        count: number of rows.
        equalities: number of the first rows that are equalities.
    """
    least, worst = kkt_matrix(tangents, mu, order, factors, V, delta, reach, give, count, equalities)
    S = factors.S
    if not skew or worst <= SINGULAR:
        return is_minimum(S, delta, count, least, worst)
    positive = dense.positive(S[:count, :count])
    unstable = positive - least
    complement(V, W, False, count, order, factors)
    give_way(S, reach, give, delta, count)
    small, swaps = complement_factors(S, count)
    # signs of the determinants of S and of what it was with W = V, together
    odd = (count - positive) % 2 == 1
    for a in range(count):
        odd = odd ^ (swaps[a] != a) ^ (small[a, a] < 0.0)
    return unstable == (1 if odd else 0)


@njit(**INNER)
def kkt_matrix(tangents, mu, order, factors, V, delta, reach, give, count, equalities):
    """`kkt_factor` where multipliers act along V, without its verdict, which may cost more than all else.

    Returns the number of positive eigenvalues that the complement S has at a strict minimum, at others more,
    and the pivots' worst quality.
    """
    negative, worst = shift(tangents, mu, order, factors)
    complement(V, V, True, count, order, factors)
    S = factors.S
    give_way(S, reach, give, delta, count)
    least = equalities - negative
    for a in range(count):
        for b in range(a):
            S[b, a] = S[a, b]
        if a >= equalities and delta[a] >= 0.0:
            least += 1
    return least, worst


@njit(**INNER)
def is_minimum(S, delta, count, least, worst):
    """Whether an equilibrium is a strict minimum by its complement S of `count` rows and `kkt_matrix`.

    Constraints that nearly depend on each other, as of contact along a patch beside a clamp, make eigenvalues
    below the rounding of others. So those that give way, by `delta`, may do so by that: what is stable then
    is so with firmer ones. Of two points at one place none gives way, and what they bear is not known.
    """
    if worst <= SINGULAR:
        return False
    if dense.positive(S[:count, :count]) == least:
        return True
    yielding = S[:count, :count].copy()
    give = ROUNDING * np.abs(yielding).max()
    for a in range(count):
        if delta[a] > 0.0:
            yielding[a, a] += give
    return dense.positive(yielding) == least


@njit(**LEAF)
def give_way(S, reach, give, delta, count):
    """Add to the complement S of `count` rows how far the constraints give way, see `kkt_factor`."""
    add_reach(reach, count, S)
    add_reach(give, 3, S)
    for a in range(count):
        S[a, a] += delta[a]


@njit(**LEAF)
def add_reach(reach, count, S):
    """Add `reach`, see `kkt_factor`, to the complement S of `count` rows."""
    if reach.shape[0] > 0:
        for a in range(count):
            for b in range(count):
                S[a, b] += reach[a, b]


@njit(**INNER)
def complement(V, W, half, count, order, factors):
    """Y = H^-1 W^T and S = V H^-1 W^T at the inner nodes, in `factors`, from the factors U of H.

    Args:
        V, W: (rows, 3n) constraint rows, and the directions in which their multipliers act.
        half: whether the lower half of S is enough, as it is where V is W.
        count: number of rows.
        order: of the elements.
        factors: `Factors` of `count` rows or more.
    """
    _, U, pivots, Y, S = factors
    n = U.shape[0]
    X = np.empty((n, count))
    for i in range(n):
        for a in range(count):
            X[i, a] = W[a, i]
    banded.solve_all(U, pivots, 3, n - 3, order, X)
    S[:count, :count] = 0.0
    for i in range(3, n - 3, 6):
        # two nodes at a time, so that S is read and written half as often; of an odd number the last is alone
        alone = i + 3 == n - 3
        j = i if alone else i + 3
        x0, x1, x2, x3, x4, x5 = X[i], X[i + 1], X[i + 2], X[j], X[j + 1], X[j + 2]
        for a in range(count):
            v0, v1, v2, v3, v4, v5 = V[a, i], V[a, i + 1], V[a, i + 2], V[a, j], V[a, j + 1], V[a, j + 2]
            if alone:
                v3 = v4 = v5 = 0.0
            # a row for a point near the start clamp reads nothing of what comes later
            if v0 != 0.0 or v1 != 0.0 or v2 != 0.0 or v3 != 0.0 or v4 != 0.0 or v5 != 0.0:
                out = S[a, : a + 1] if half else S[a, :count]
                for b in range(out.shape[0]):
                    first = ((out[b] + v0 * x0[b]) + v1 * x1[b]) + v2 * x2[b]
                    out[b] = ((first + v3 * x3[b]) + v4 * x4[b]) + v5 * x5[b]
    for a in range(count):
        for i in range(n):
            Y[a, i] = X[i, a] if 3 <= i < n - 3 else 0.0


@njit(**INNER)
def complement_factors(S, count):
    """What `kkt_solve` needs of the complement S of `count` rows: its factors and their swaps, of 3 S
    itself.
    """
    swaps = np.empty(count, np.int64)
    if count == 3:
        return S, swaps
    factors = S[:count, :count].copy()
    dense.factor(factors, swaps)
    return factors, swaps


@njit(**INNER)
def kkt_solve(g, c, V, order, factors, small, swaps, s, y):
    """`kkt_step` with factors of the complement.

    Args:
        g, c, V, order, factors, s, y: as in `kkt_step`.
        small, swaps: (count, count), (count,) what `complement_factors` made of the complement.
    """
    kkt_multipliers(g, c, V, order, factors, small, swaps, s, y)
    respond(factors.Y, swaps.shape[0], y, s)


@njit(**INNER)
def kkt_multipliers(g, c, V, order, factors, small, swaps, s, y):
    """`kkt_solve` up to the multipliers y; s is what there would be without, for `respond`."""
    count = swaps.shape[0]
    b = np.empty(count)
    relax(g, order, factors.U, factors.pivots, s)
    missing(c, V, count, s, b)
    if count == 3:
        solve3(small, b, y)
    else:
        dense.solve_factored(small, swaps, b, y)


@njit(**INNER)
def kkt_step(g, c, V, count, order, factors, s, y):
    """s (3n,), y (count,) with H s - V^T y = -g, V s + delta y = -c; s = 0 at the ends.

    Args:
        g, c: (3n,) gradient, (count,) what the constraints are off.
        V: (rows, 3n) constraint rows, of which the first `count` count.
        order: of the elements.
        factors: as `kkt_factor` leaves them.
        s, y: receive the step.
    """
    small, swaps = complement_factors(factors.S, count)
    kkt_solve(g, c, V, order, factors, small, swaps, s, y)


@njit(**LEAF)
def end_coupling(tangents, V, count, theta, g, c):
    """Add to g (3n,) and c (count,) what turning the end section by theta (3,) does to them.

    V (rows, 3n) holds `count` constraint rows, `tangents` is a `rod_state.Tangents`.
    """
    elastic, geometric = tangents.elastic, tangents.geometric
    n, band = elastic.shape[0], elastic.shape[1] - 1
    for k in range(3):
        row = n - 3 + k
        for j in range(row - band, n - 3):
            at = band + j - row
            g[j] += (elastic[row, at] + geometric[row, at]) * theta[k]
        for a in range(count):
            c[a] += V[a, row] * theta[k]


@njit(**INNER)
def end_rows(tangents, V, count, s, y):
    """(3,) what the step s (3n,), y (count,), s = 0 at the end, adds to the gradient at the end node.

    V (rows, 3n) holds `count` constraint rows, `tangents` is a `rod_state.Tangents`.
    """
    elastic, geometric = tangents.elastic, tangents.geometric
    n, band = elastic.shape[0], elastic.shape[1] - 1
    out = np.zeros(3)
    for k in range(3):
        row = n - 3 + k
        for j in range(row - band, n - 3):
            at = band + j - row
            out[k] += (elastic[row, at] + geometric[row, at]) * s[j]
        for a in range(count):
            out[k] -= V[a, row] * y[a]
    return out
