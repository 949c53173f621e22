# SPDX-License-Identifier: Apache-2.0
"""Compiled arithmetic of the published finite differences: residual, analytic Jacobian, banded normal
matrix.

Per node seven unknowns: Euler parameters q (scalar first) and the internal force F in section axes. Part `p`
(from 0) between nodes `p` and `p + 1` has seven equations, which touch three nodes from `max(p - 1, 0)` on,
so J^T J is banded with 20 subdiagonals, but for four rows that see the whole cable: the end position
(34)-(36) and the length condition (37). Equation numbers are those of Liu et al. 2018,
doi:10.1007/s11071-018-4383-y.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import njit

SUBDIAGONALS = 20
NODE = 7
WHOLE_CABLE_ROWS = 4


@njit(cache=True, inline="always")
def _vector_part(q, d, out):  # type: ignore[no-untyped-def]
    """(21): bilinear and antisymmetric, (V1, V2, V3) = B(q) d."""
    out[0] = -q[1] * d[0] + q[0] * d[1] + q[3] * d[2] - q[2] * d[3]
    out[1] = -q[2] * d[0] - q[3] * d[1] + q[0] * d[2] + q[1] * d[3]
    out[2] = -q[3] * d[0] + q[2] * d[1] - q[1] * d[2] + q[0] * d[3]


@njit(cache=True, inline="always")
def _vector_part_matrix(q, out):  # type: ignore[no-untyped-def]
    """B(q), (3, 4)."""
    out[0, 0], out[0, 1], out[0, 2], out[0, 3] = -q[1], q[0], q[3], -q[2]
    out[1, 0], out[1, 1], out[1, 2], out[1, 3] = -q[2], -q[3], q[0], q[1]
    out[2, 0], out[2, 1], out[2, 2], out[2, 3] = -q[3], q[2], -q[1], q[0]


@njit(cache=True, inline="always")
def load_in_section(q, f, out):  # type: ignore[no-untyped-def]
    """(32), (33) for a load in any direction: R(q)^T f with R of (30)."""
    a, b, c, d = q[0], q[1], q[2], q[3]
    out[0] = (a * a + b * b - c * c - d * d) * f[0] + 2 * (b * c + a * d) * f[1] + 2 * (b * d - a * c) * f[2]
    out[1] = 2 * (b * c - a * d) * f[0] + (a * a - b * b + c * c - d * d) * f[1] + 2 * (c * d + a * b) * f[2]
    out[2] = 2 * (b * d + a * c) * f[0] + 2 * (c * d - a * b) * f[1] + (a * a - b * b - c * c + d * d) * f[2]


@njit(cache=True, inline="always")
def load_in_section_matrix(q, f, out):  # type: ignore[no-untyped-def]
    """Derivative of R(q)^T f by q, (3, 4)."""
    a, b, c, d = q[0], q[1], q[2], q[3]
    u = 2 * (a * f[0] + d * f[1] - c * f[2])
    v = 2 * (b * f[0] + c * f[1] + d * f[2])
    w = 2 * (-c * f[0] + b * f[1] - a * f[2])
    x = 2 * (-d * f[0] + a * f[1] + b * f[2])
    out[0, 0], out[0, 1], out[0, 2], out[0, 3] = u, v, w, x
    out[1, 0], out[1, 1], out[1, 2], out[1, 3] = x, -w, v, -u
    out[2, 0], out[2, 1], out[2, 2], out[2, 3] = -w, -x, u, v


@njit(cache=True, inline="always")
def _chord(p, q, h, out):  # type: ignore[no-untyped-def]
    """One summand of (34), (35): the tangent integrated over a part, q linear between its nodes p and q."""
    out[0] = (
        h
        / 3
        * (
            (2 * p[1] + q[1]) * p[3]
            + (2 * q[1] + p[1]) * q[3]
            + (2 * p[0] + q[0]) * p[2]
            + (2 * q[0] + p[0]) * q[2]
        )
    )
    out[1] = (
        h
        / 3
        * (
            (2 * p[2] + q[2]) * p[3]
            + (2 * q[2] + p[2]) * q[3]
            - (2 * p[0] + q[0]) * p[1]
            - (2 * q[0] + p[0]) * q[1]
        )
    )
    out[2] = (
        h / 3 * (2 * (p[0] * p[0] + p[0] * q[0] + q[0] * q[0] + p[3] * p[3] + p[3] * q[3] + q[3] * q[3]) - 3)
    )


@njit(cache=True, inline="always")
def _chord_matrix(p, q, h, out):  # type: ignore[no-untyped-def]
    """Derivative of `_chord` by its first argument, (3, 4); by its second it is the same with the two
    swapped.
    """
    g = h / 3
    e0, e1, e2, e3 = 2 * p[0] + q[0], 2 * p[1] + q[1], 2 * p[2] + q[2], 2 * p[3] + q[3]
    out[0, 0], out[0, 1], out[0, 2], out[0, 3] = g * e2, g * e3, g * e0, g * e1
    out[1, 0], out[1, 1], out[1, 2], out[1, 3] = -g * e1, -g * e0, g * e3, g * e2
    out[2, 0], out[2, 1], out[2, 2], out[2, 3] = 2 * g * e0, 0.0, 0.0, 2 * g * e3


@njit(cache=True)
def positions(x, h, out):  # type: ignore[no-untyped-def]
    """(34), (35): node positions (n + 1, 3) relative to the first."""
    out[0] = 0.0
    for p in range(x.shape[0] - 1):
        _chord(x[p, :4], x[p + 1, :4], h, out[p + 1])
        out[p + 1] += out[p]


@njit(cache=True)
def position_derivatives(x, h, out):  # type: ignore[no-untyped-def]
    """Derivative of `positions` by the unknowns: out (n + 1, 3, 7 (n + 1))."""
    by_first, by_second = np.empty((3, 4)), np.empty((3, 4))
    out[:] = 0.0
    for p in range(x.shape[0] - 1):
        out[p + 1] = out[p]
        _chord_matrix(x[p, :4], x[p + 1, :4], h, by_first)
        _chord_matrix(x[p + 1, :4], x[p, :4], h, by_second)
        for i in range(3):
            for k in range(4):
                out[p + 1, i, NODE * p + k] += by_first[i, k]
                out[p + 1, i, NODE * (p + 1) + k] += by_second[i, k]


@njit(cache=True)
def residual(x, h, stiffness, load, start, end_q, end_r, length, out):  # type: ignore[no-untyped-def]
    """v of (39): x (n + 1, 7) -> out (11 + 7 n): end position, both ends' q, then w_1 .. w_n; returns |v|^2
    / 2.
    """
    n = x.shape[0] - 1
    A, B, C = stiffness[0], stiffness[1], stiffness[2]
    slope, bend, V, W, f, chord, r = (
        np.empty(4),
        np.empty(4),
        np.empty(3),
        np.empty(3),
        np.empty(3),
        np.empty(3),
        np.zeros(3),
    )
    arc = 0.0
    for p in range(n):
        q, F, F0 = x[p + 1, :4], x[p + 1, 4:], x[p, 4:]
        first, weight = (p - 1, 1.0) if p > 0 else (0, 0.5)
        for k in range(4):
            slope[k] = (x[p + 1, k] - x[p, k]) / h
            bend[k] = weight * (x[first, k] - 2 * x[first + 1, k] + x[first + 2, k]) / (h * h)
        _vector_part(q, slope, V)
        _vector_part(q, bend, W)
        load_in_section(q, load, f)
        _chord(x[p, :4], q, h, chord)
        r += chord
        arc += np.sqrt(chord[0] ** 2 + chord[1] ** 2 + chord[2] ** 2)
        k = 11 + NODE * p
        out[k] = q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[3] ** 2 - 1.0
        out[k + 1] = F[0] - F0[0] + h * (2 * (V[1] * F[2] - V[2] * F[1]) + f[0])
        out[k + 2] = F[1] - F0[1] + h * (2 * (V[2] * F[0] - V[0] * F[2]) + f[1])
        out[k + 3] = F[2] - F0[2] + h * (2 * (V[0] * F[1] - V[1] * F[0]) + f[2])
        out[k + 4] = h * (W[0] + 2 * (C - B) / A * V[1] * V[2] - F[1] / (2 * A))
        out[k + 5] = h * (W[1] + 2 * (A - C) / B * V[2] * V[0] + F[0] / (2 * B))
        out[k + 6] = h * (W[2] + 2 * (B - A) / C * V[0] * V[1])
    out[11 + NODE * (n - 1)] = arc - length
    for k in range(3):
        out[k] = end_r[k] - r[k]
    for k in range(4):
        out[3 + k] = x[0, k] - start[k]
        out[7 + k] = x[n, k] - end_q[k]
    total = 0.0
    for k in range(out.size):
        total += out[k] * out[k]
    return total / 2


@njit(cache=True)
def jacobian(x, h, stiffness, load, local, whole):  # type: ignore[no-untyped-def]
    """Analytic derivative of v: local (n, 7, 21) blocks by the three nodes a part touches, and whole (4, 7
    (n + 1)).

    The last part's first row stays zero: (37) stands there and is the fourth of the whole-cable rows.
    """
    n = x.shape[0] - 1
    A, B, C = stiffness[0], stiffness[1], stiffness[2]
    slope, bend, V, unit = np.empty(4), np.empty(4), np.empty(3), np.empty(3)
    by_q, by_q0, by_bend, turn, fq = (
        np.empty((3, 4)),
        np.empty((3, 4)),
        np.empty((3, 4)),
        np.empty((3, 4)),
        np.empty((3, 4)),
    )
    chord, by_first, by_second = np.empty(3), np.empty((3, 4)), np.empty((3, 4))
    gyro = np.array([2 * (C - B) / A, 2 * (A - C) / B, 2 * (B - A) / C])
    local[:] = 0.0
    whole[:] = 0.0
    for p in range(n):
        q, q0, F = x[p + 1, :4], x[p, :4], x[p + 1, 4:]
        first, weight = (p - 1, 1.0) if p > 0 else (0, 0.5)
        here, before = NODE * (p + 1 - first), NODE * (p - first)
        for k in range(4):
            slope[k] = (q[k] - q0[k]) / h
            bend[k] = weight * (x[first, k] - 2 * x[first + 1, k] + x[first + 2, k]) / (h * h)
        _vector_part(q, slope, V)
        _vector_part_matrix(q0, by_q)  # V = B(q) (q - q0) / h = B(q0) q / h, for B(q) q = 0
        _vector_part_matrix(q, by_bend)
        _vector_part_matrix(bend, turn)
        load_in_section_matrix(q, load, fq)
        block = local[p]
        if p < n - 1:
            for k in range(4):
                block[0, here + k] = 2 * q[k]
        for k in range(4):
            for i in range(3):
                by_q0[i, k] = -by_bend[i, k]  # h dV / dq0
            for i in range(3):
                j, m = (i + 1) % 3, (i + 2) % 3
                block[1 + i, here + k] = 2 * (by_q[j, k] * F[m] - by_q[m, k] * F[j]) + h * fq[i, k]
                block[1 + i, before + k] = 2 * (by_q0[j, k] * F[m] - by_q0[m, k] * F[j])
                block[4 + i, here + k] = gyro[i] * (by_q[j, k] * V[m] + V[j] * by_q[m, k]) - h * turn[i, k]
                block[4 + i, before + k] = gyro[i] * (by_q0[j, k] * V[m] + V[j] * by_q0[m, k])
        for k in range(4):
            for i in range(3):
                second = weight * by_bend[i, k] / h
                block[4 + i, k] += second
                block[4 + i, NODE + k] -= 2 * second
                block[4 + i, 2 * NODE + k] += second
        for i in range(3):
            j, m = (i + 1) % 3, (i + 2) % 3
            block[1 + i, here + 4 + i] += 1.0
            block[1 + i, before + 4 + i] -= 1.0
            block[1 + i, here + 4 + m] += 2 * h * V[j]
            block[1 + i, here + 4 + j] -= 2 * h * V[m]
        block[4, here + 5] -= h / (2 * A)
        block[5, here + 4] += h / (2 * B)
        _chord(q0, q, h, chord)
        _chord_matrix(q0, q, h, by_first)
        _chord_matrix(q, q0, h, by_second)
        size = np.sqrt(chord[0] ** 2 + chord[1] ** 2 + chord[2] ** 2)
        for i in range(3):
            unit[i] = chord[i] / size if size > 0 else 0.0
        for k in range(4):
            for i in range(3):
                whole[i, NODE * p + k] -= by_first[i, k]
                whole[i, NODE * (p + 1) + k] -= by_second[i, k]
                whole[3, NODE * p + k] += unit[i] * by_first[i, k]
                whole[3, NODE * (p + 1) + k] += unit[i] * by_second[i, k]


@njit(cache=True)
def normal_equations(v, local, whole, band, gradient):  # type: ignore[no-untyped-def]
    """g = J^T v of (42), and J^T J without the whole-cable rows: band[j, k] is its entry (j + k, j)."""
    n = local.shape[0]
    band[:] = 0.0
    gradient[:] = 0.0
    for k in range(4):
        gradient[k] += v[3 + k]
        gradient[NODE * n + k] += v[7 + k]
        band[k, 0] += 1.0
        band[NODE * n + k, 0] += 1.0
    for p in range(n):
        first = NODE * max(p - 1, 0)
        for row in range(NODE):
            value = v[11 + NODE * p + row]
            for j in range(3 * NODE):
                a = local[p, row, j]
                if a != 0.0:
                    gradient[first + j] += a * value
                    for i in range(j, 3 * NODE):
                        band[first + j, i - j] += a * local[p, row, i]
    last = 11 + NODE * (n - 1)
    for j in range(gradient.size):
        gradient[j] += whole[0, j] * v[0] + whole[1, j] * v[1] + whole[2, j] * v[2] + whole[3, j] * v[last]


@njit(cache=True)
def normal_product(local, whole, d, out):  # type: ignore[no-untyped-def]
    """out = J^T J d without forming the whole-cable rows' product; returns |J d|^2."""
    n = local.shape[0]
    out[:] = 0.0
    total = 0.0
    for k in range(4):
        out[k] += d[k]
        out[NODE * n + k] += d[NODE * n + k]
        total += d[k] ** 2 + d[NODE * n + k] ** 2
    for p in range(n):
        first = NODE * max(p - 1, 0)
        for row in range(NODE):
            value = 0.0
            for j in range(3 * NODE):
                value += local[p, row, j] * d[first + j]
            total += value * value
            for j in range(3 * NODE):
                out[first + j] += local[p, row, j] * value
    for row in range(WHOLE_CABLE_ROWS):
        value = 0.0
        for j in range(d.size):
            value += whole[row, j] * d[j]
        total += value * value
        for j in range(d.size):
            out[j] += whole[row, j] * value
    return total


@njit(cache=True, error_model="numpy")
def damped_step(local, whole, band, gradient, mu, factor, spread, d, work):  # type: ignore[no-untyped-def]
    """d of (43): banded Cholesky, the whole-cable rows by Woodbury's formula, one refinement with the exact
    product.

    `factor` has the shape of `band`, `spread` that of `whole`, `d` and `work` that of `gradient`. Returns
    whether the factorisation went through.
    """
    factor[:] = band
    size = gradient.size
    for j in range(size):
        factor[j, 0] += mu
        if not factor[j, 0] > 0.0:
            return False
        scale = 1.0 / np.sqrt(factor[j, 0])
        reach = min(SUBDIAGONALS + 1, size - j)
        for k in range(reach):
            factor[j, k] *= scale
        for k in range(1, reach):
            a = factor[j, k]
            for i in range(k, reach):
                factor[j + k, i - k] -= a * factor[j, i]
    small = np.eye(WHOLE_CABLE_ROWS)
    for row in range(WHOLE_CABLE_ROWS):
        spread[row] = whole[row]
        _banded_solve(factor, spread[row])
    for row in range(WHOLE_CABLE_ROWS):
        for other in range(WHOLE_CABLE_ROWS):
            small[row, other] += np.dot(whole[row], spread[other])
    inverse = np.linalg.inv(small)
    d[:] = 0.0
    work[:] = -gradient
    for refinement in range(2):
        if refinement == 1:
            normal_product(local, whole, d, work)
            for j in range(size):
                work[j] = -(work[j] + mu * d[j] + gradient[j])
        _banded_solve(factor, work)
        weights = inverse @ (whole @ work)
        for j in range(size):
            d[j] += work[j]
            for row in range(WHOLE_CABLE_ROWS):
                d[j] -= spread[row, j] * weights[row]
    return True


@njit(cache=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})
def _banded_solve(factor, x):  # type: ignore[no-untyped-def]
    """x := (L L^T)^-1 x."""
    # a baseline shall be as fast as it can be, and need not repeat its last bit: sums in any order
    size = x.size
    for j in range(size):
        reach = min(SUBDIAGONALS + 1, size - j)
        x[j] /= factor[j, 0]
        for k in range(1, reach):
            x[j + k] -= factor[j, k] * x[j]
    for j in range(size - 1, -1, -1):
        value = x[j]
        for k in range(1, min(SUBDIAGONALS + 1, size - j)):
            value -= factor[j, k] * x[j + k]
        x[j] = value / factor[j, 0]
