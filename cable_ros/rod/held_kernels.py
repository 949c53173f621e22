# SPDX-License-Identifier: Apache-2.0
"""Compiled: the linear system of a rod whose ends are not both clamped.

The unknown rotations are all nodal ones but those that an end holds. Of the end force F the components along
the first `held` rows of `Hold.rows` are multipliers of the end position, the others are given.

A given moment M0 on a free end keeps its direction: its work is no potential, and with m = R^T M0 the nodal
increments psi change the gradient by -1/2 m x psi, which makes the tangent unsymmetric in one 3 x 3 block. It
is added to the factors of the symmetric part by the Sherman-Morrison-Woodbury formula.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cable_ros.compilation import INNER, LEAF, njit
from cable_ros.linalg import banded
from cable_ros.linalg.bordered import NEUTRAL, SINGULAR, negative3, solve3
from cable_ros.rod import quaternion
from cable_ros.rod.energy_kernels import gradient, hessian
from cable_ros.rod.rod_state import ENERGY, Section, grid_of, system_of
from cable_ros.rod.warm_step import spread_into

OPTIONS = {"cache": True, "error_model": "numpy"}

SPRING = 1.0
"""Stiffness, EI / L, against turning of released ends that the metric D counts where both ends turn: a rigid
rotation has a length by it. The Hessian stays as it is."""


class Hold(NamedTuple):
    """How the ends are held under the present conditions; changes with every step."""

    free: np.ndarray
    """(3n,) 1 for the nodal rotations that are unknown, else 0."""
    rows: np.ndarray
    """(3, 3) orthonormal rows, the first `held` of which hold the end position."""
    given: np.ndarray
    """(3,) part of the end force along the other rows, EI / L^2."""
    moments: np.ndarray
    """(2, 3) given moments on the cable at start and end, start's frame, EI / L."""
    held: int
    springy: bool
    """Whether the metric has springs against turning, see `SPRING`."""


@njit(**LEAF)
def put_force(F, hold):
    """Replace the given components of the end force F (3,); `hold`: `Hold`."""
    a, b, c = hold.given[0], hold.given[1], hold.given[2]
    for i in range(hold.held):
        r = hold.rows[i]
        along = r[0] * F[0] + r[1] * F[1] + r[2] * F[2]
        a, b, c = a + along * r[0], b + along * r[1], c + along * r[2]
    F[0], F[1], F[2] = a, b, c


@njit(**LEAF)
def add_springs(tangents, hold):
    """Move a spring at every turning end from the geometric part to the metric, if `hold` is springy."""
    elastic, geometric = tangents.elastic, tangents.geometric
    n, band = elastic.shape[0], elastic.shape[1] - 1
    if hold.springy:
        for k in range(3):
            for i in (k, n - 3 + k):
                if hold.free[i] > 0.0:
                    elastic[i, band] += SPRING
                    geometric[i, band] -= SPRING


@njit(**INNER)
def evaluate(q, F, f, section, grid, system, hold, full):
    """Gradient and, if `full`, Hessian; the energy counts the potential of the given force, too.

    Args:
        q, F: (n, 4) nodal frames, (3,) end force.
        f: (3,) load per length.
        section, grid: `Section` and `Grid`.
        system: `System`; evaluation and tangents are overwritten.
        hold: `Hold`.
        full: whether to compute the Hessian.
    """
    evaluation = system.evaluation
    Fe = np.empty((grid.h.shape[0], 3))
    spread_into(F, Fe)
    evaluation.acc[:] = 0.0
    gradient(q, Fe, f, section, grid, evaluation)
    totals = evaluation.totals
    for a in range(3):
        totals[ENERGY] -= hold.given[a] * totals[a]
    if full:
        hessian(q, Fe, f, section, grid, evaluation.radial, system.tangents)
        add_springs(system.tangents, hold)


@njit(**LEAF)
def residual(q, g, hold, out):
    """The gradient g (n, 3) less the given moments, 0 where a rotation is held: out (3n,)."""
    n = out.shape[0]
    for i in range(n):
        out[i] = g[i // 3, i % 3]
    for e in range(2):
        node = 0 if e == 0 else q.shape[0] - 1
        p = q[node]
        m = quaternion.turned((p[0], -p[1], -p[2], -p[3]), hold.moments[e])
        for k in range(3):
            out[3 * node + k] -= m[k]
    for i in range(n):
        out[i] *= hold.free[i]


@njit(**LEAF)
def moment_end(hold):
    """0 or 1: the end with a given moment; -1: neither."""
    for e in range(2):
        m = hold.moments[e]
        if m[0] != 0.0 or m[1] != 0.0 or m[2] != 0.0:
            return e
    return -1


@njit(**LEAF)
def held_shift(tangents, mu, order, factors, hold):
    """As `bordered.shift`, over all unknown rotations: held ones have a row of the unit matrix."""
    elastic, geometric = tangents.elastic, tangents.geometric
    A = factors.A
    n, band = A.shape[0], A.shape[1] - 1
    for i in range(n):
        for j in range(A.shape[1]):
            A[i, j] = (1.0 + NEUTRAL + mu) * elastic[i, j] + geometric[i, j]
    for k in range(3):
        if hold.free[k] == 0.0:
            for m in range(min(band + 1, n - k)):
                A[k + m, band - m] = 0.0
            for m in range(min(band, k) + 1):
                A[k, band - m] = 0.0
            A[k, band] = 1.0
        i = n - 3 + k
        if hold.free[i] == 0.0:
            for m in range(n - i):
                A[i + m, band - m] = 0.0
            for j in range(band + 1):
                A[i, j] = 0.0
            A[i, band] = 1.0
    return banded.factor(A, 0, n, order, factors.U, factors.pivots)


@njit(**LEAF)
def complement(S, hold, out):
    """The Schur complement of the held rows, rows S rows^T, filled up by the unit matrix: out (3, 3)."""
    for i in range(3):
        for j in range(3):
            out[i, j] = 1.0 if i == j else 0.0
    for i in range(hold.held):
        for j in range(hold.held):
            v = 0.0
            for a in range(3):
                for b in range(3):
                    v += hold.rows[i, a] * S[a, b] * hold.rows[j, b]
            out[i, j] = v


@njit(**INNER)
def factored(q, tangents, mu, order, factors, hold):
    """Factor the system of H + mu D; whether that is positive on the tangent space of what is held.

    With a given moment it is the symmetric part that is judged: enough for stability, and more than needed.

    Args:
        q: (n, 4) nodal frames, for a given moment.
        tangents, mu, order, factors: as in `bordered.factor`.
        hold: `Hold`.
    """
    negative, worst = held_shift(tangents, mu, order, factors, hold)
    _, U, pivots, Y, S = factors
    n = U.shape[0]
    small = np.empty((3, 3))
    e = moment_end(hold)
    if e < 0:
        C = tangents.C
        for a in range(3):
            for i in range(n):
                Y[a, i] = C[a, i] * hold.free[i]
            banded.solve(U, pivots, 0, n, order, Y[a])
        for a in range(3):
            for b in range(3):
                v = 0.0
                for i in range(n):
                    v += C[a, i] * Y[b, i]
                S[a, b] = v
        complement(S, hold, small)
        return worst > SINGULAR and negative3(small) == negative
    at = 0 if e == 0 else n - 3
    for a in range(3):
        Y[a, :] = 0.0
        Y[a, at + a] = 1.0
        banded.solve(U, pivots, 0, n, order, Y[a])
    p = q[0 if e == 0 else q.shape[0] - 1]
    m = quaternion.turned((p[0], -p[1], -p[2], -p[3]), hold.moments[e])
    for b in range(3):
        x, y, z = Y[b, at], Y[b, at + 1], Y[b, at + 2]
        # I - 1/2 [m]x H^-1, by columns
        S[0, b] = -0.5 * (m[1] * z - m[2] * y)
        S[1, b] = -0.5 * (m[2] * x - m[0] * z)
        S[2, b] = -0.5 * (m[0] * y - m[1] * x)
        S[b, b] += 1.0
    return worst > SINGULAR and negative == 0


@njit(**INNER)
def held_solve(q, g, c, C, order, factors, hold, s, dF):
    """s (3n,), dF (3,) with H s - C^T dF = -g at the unknown rotations and C s = -c along the held rows.

    dF has no component along the other rows; s is 0 at held rotations.

    Args:
        q: (n, 4) nodal frames, as in `factored`.
        g, c: (3n,) residual, (3,) how far the end is off.
        C: (3, 3n) of `rod_state.Tangents`.
        order: of the elements.
        factors: as `factored` leaves them.
        hold: `Hold`.
        s, dF: receive the step.
    """
    _, U, pivots, Y, S = factors
    n = s.shape[0]
    for i in range(n):
        s[i] = -g[i] * hold.free[i]
    banded.solve(U, pivots, 0, n, order, s)
    b = np.zeros(3)
    dF[:] = 0.0
    if hold.held > 0:
        off = np.empty(3)
        for a in range(3):
            v = -c[a]
            for i in range(n):
                v -= C[a, i] * s[i]
            off[a] = v
        small = np.empty((3, 3))
        complement(S, hold, small)
        for i in range(hold.held):
            for a in range(3):
                b[i] += hold.rows[i, a] * off[a]
        solve3(small, b, b)
        for i in range(hold.held):
            for a in range(3):
                dF[a] += hold.rows[i, a] * b[i]
        for a in range(3):
            for i in range(n):
                s[i] += Y[a, i] * dF[a]
        return
    e = moment_end(hold)
    if e < 0:
        return
    node = 0 if e == 0 else q.shape[0] - 1
    p = q[node]
    m = quaternion.turned((p[0], -p[1], -p[2], -p[3]), hold.moments[e])
    x, y, z = s[3 * node], s[3 * node + 1], s[3 * node + 2]
    b[0] = -0.5 * (m[1] * z - m[2] * y)
    b[1] = -0.5 * (m[2] * x - m[0] * z)
    b[2] = -0.5 * (m[0] * y - m[1] * x)
    solve3(S, b, b)
    for a in range(3):
        for i in range(n):
            s[i] -= Y[a, i] * b[a]


@njit(**OPTIONS)
def held_linearize(q, F, f, section, grid, system, hold, full):
    """`evaluate` with groups as plain tuples, see `entry_points`; so in the next ones."""
    evaluate(q, F, f, Section(*section), grid_of(grid), system_of(system), Hold(*hold), full)


@njit(**OPTIONS)
def held_factor(q, mu, order, system, hold):
    """See `factored`."""
    system = system_of(system)
    return factored(q, system.tangents, mu, order, system.factors, Hold(*hold))


@njit(**OPTIONS)
def held_solution(q, g, c, order, system, hold, s, dF):
    """See `held_solve`."""
    system = system_of(system)
    held_solve(q, g, c, system.tangents.C, order, system.factors, Hold(*hold), s, dF)
