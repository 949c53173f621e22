# SPDX-License-Identifier: Apache-2.0
"""Compiled: the minimum of a quadratic function of k points of the plane, each in the unit disc.

x.A x / 2 - b.x has it where the force z = A x - b, (k, 2), vanishes, or pushes a point on its circle inward:
z = -m x with the multiplier m >= 0. A primal-dual interior point finds it: (1, x) and (m, z) are kept in the
second-order cone, and their product goes to zero, by Mehrotra's predictor and corrector in the scaling of
Nesterov and Todd, as Vandenberghe (2010), "The CVXOPT linear and quadratic cone program solvers", has it.
What a point pushes against never jumps, as an active set does. Arrays of pairs are flat, (2 k,).
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, LEAF, njit
from cable_ros.linalg import dense
from cable_ros.linalg.copies import copy_rows

OPTIONS = {"cache": True, "error_model": "numpy"}

CLOSED = 1e-8
"""Mean product of slack and multiplier at which it ends, over the mean force at the beginning."""
MOST = 30
"""Maximum number of iterations; one takes about ten."""
INSIDE, ABOVE = 0.1, 0.1
"""Maximum radius of a point at the beginning, and what its multiplier is above the force there, over the mean
force: away from the edges of the cones."""
SHORT = 0.99
"""Part of the way to the edge of a cone that a step goes."""
FLAT = 1e-30
"""Least square of a slack: rounding."""


@njit(**OPTIONS)
def minimum(A, b, x, m):
    """Look for the minimum.

    Args:
        A: (2 k, 2 k), symmetric.
        b: (2 k,).
        x: (2 k,) where to begin, overwritten by the points.
        m: (k,) receives the multipliers.

    Returns:
        Whether it was found; False if A is not positive definite: there may be several then, and saddles.

    Raises:
        LinAlgError: what has no digits left.
    """
    k, n = m.shape[0], x.shape[0]
    if dense.positive(A) < n:
        return False
    z, size = np.empty(n), np.empty(k)
    for i in range(k):
        outside = max(np.hypot(x[2 * i], x[2 * i + 1]) / INSIDE, 1.0)
        x[2 * i] /= outside
        x[2 * i + 1] /= outside
    forces(A, b, x, z, size)
    scale = size.mean()
    for i in range(k):
        m[i] = size[i] + ABOVE * scale
    M, swaps = np.empty((n, n)), np.empty(n, np.int64)
    scaling, scaled = np.empty((k, 4)), np.empty((k, 3))
    right, dx, dual, primal = np.empty((k, 3)), np.empty(n), np.empty((k, 3)), np.empty((k, 3))
    for _ in range(MOST):
        gap = 0.0
        for i in range(k):
            m[i] = max(m[i], (1.0 + 1e-12) * size[i])  # z is computed anew
            gap += (m[i] + x[2 * i] * z[2 * i] + x[2 * i + 1] * z[2 * i + 1]) / k
        if gap <= CLOSED * scale:
            return True
        copy_rows(A, M)
        scale_cones(x, m, z, size, M, scaling, scaled)
        dense.factor(M, swaps)
        for i in range(k):
            s0, s1, s2 = scaled[i, 0], scaled[i, 1], scaled[i, 2]
            right[i, 0] = -(s0 * s0 + s1 * s1 + s2 * s2)
            right[i, 1], right[i, 2] = -2.0 * s0 * s1, -2.0 * s0 * s2
        direction(M, swaps, scaling, scaled, right, dx, dual, primal)
        centring = (1.0 - min(1.0, reach(x, m, z, dx, dual))) ** 3
        for i in range(k):
            p0, p1, p2 = primal[i, 0], primal[i, 1], primal[i, 2]
            d0, d1, d2 = times(scaling[i], dual[i, 0], dual[i, 1], dual[i, 2])
            right[i, 0] += centring * gap - (p0 * d0 + p1 * d1 + p2 * d2)
            right[i, 1] -= p0 * d1 + d0 * p1
            right[i, 2] -= p0 * d2 + d0 * p2
        direction(M, swaps, scaling, scaled, right, dx, dual, primal)
        length = min(1.0, SHORT * reach(x, m, z, dx, dual))
        for i in range(n):
            x[i] += length * dx[i]
        for i in range(k):
            m[i] += length * dual[i, 0]
        forces(A, b, x, z, size)
    return False


@njit(**LEAF)
def forces(A, b, x, z, size):
    """z = A x - b, and its size (k,) at each point."""
    for i in range(x.shape[0]):
        v = -b[i]
        for j in range(x.shape[0]):
            v += A[i, j] * x[j]
        z[i] = v
    for i in range(size.shape[0]):
        size[i] = np.hypot(z[2 * i], z[2 * i + 1])


@njit(**INNER)
def scale_cones(x, m, z, size, M, scaling, scaled):
    """The scaling W of each pair of cones, with W (m, z) = W^-1 (1, x).

    W = (2 v v^T - J) / r with J = diag(1, -1, -1).

    Args:
        x, m, z, size: points, multipliers, forces and their sizes.
        M: (2 k, 2 k) receives the lower block of W^-2 at each point, added.
        scaling: (k, 4) receives r and v.
        scaled: (k, 3) receives W (m, z).
    """
    for i in range(m.shape[0]):
        p, q = 2 * i, 2 * i + 1
        a = np.sqrt(max(1.0 - x[p] ** 2 - x[q] ** 2, FLAT))
        c = np.sqrt((m[i] - size[i]) * (m[i] + size[i]))
        half = 2.0 * np.sqrt(0.5 * (1.0 + (m[i] + x[p] * z[p] + x[q] * z[q]) / (a * c)))
        w0 = (1.0 / a + m[i] / c) / half
        w1, w2 = (x[p] / a - z[p] / c) / half, (x[q] / a - z[q] / c) / half
        ratio, norm = c / a, np.sqrt(2.0 * (w0 + 1.0))
        M[p, p] += ratio * (2.0 * w1 * w1 + 1.0)
        M[q, q] += ratio * (2.0 * w2 * w2 + 1.0)
        M[p, q] += ratio * 2.0 * w1 * w2
        M[q, p] += ratio * 2.0 * w1 * w2
        scaling[i, 0], scaling[i, 1] = np.sqrt(ratio), (w0 + 1.0) / norm
        scaling[i, 2], scaling[i, 3] = w1 / norm, w2 / norm
        scaled[i, 0], scaled[i, 1], scaled[i, 2] = times(scaling[i], m[i], z[p], z[q])


@njit(**LEAF)
def times(scaling, y0, y1, y2):
    """W y, of the row (4,) of `scale_cones`."""
    r, v0, v1, v2 = scaling[0], scaling[1], scaling[2], scaling[3]
    d = 2.0 * (v0 * y0 + v1 * y1 + v2 * y2)
    return (d * v0 - y0) / r, (d * v1 + y1) / r, (d * v2 + y2) / r


@njit(**LEAF)
def over(scaling, y0, y1, y2):
    """W^-1 y, of the row (4,) of `scale_cones`."""
    r, v0, v1, v2 = scaling[0], scaling[1], scaling[2], scaling[3]
    d = 2.0 * (v0 * y0 - v1 * y1 - v2 * y2)
    return r * (d * v0 - y0), r * (y1 - d * v1), r * (y2 - d * v2)


@njit(**INNER)
def direction(M, swaps, scaling, scaled, right, dx, dual, primal):
    """A step that changes the scaled product of slacks and multipliers by `right`, and leaves z = A x - b.

    Args:
        M, swaps: factors of A and the cones' scaling.
        scaling, scaled: of `scale_cones`.
        right: (k, 3).
        dx: (2 k,) receives the change of the points.
        dual: (k, 3) receives that of multipliers and forces.
        primal: (k, 3) receives W^-1 (0, dx).
    """
    k = right.shape[0]
    quotients, g = np.empty((k, 3)), np.empty(2 * k)
    for i in range(k):
        s0, s1, s2 = scaled[i, 0], scaled[i, 1], scaled[i, 2]
        q0 = (s0 * right[i, 0] - s1 * right[i, 1] - s2 * right[i, 2]) / ((s0 * s0 - s1 * s1) - s2 * s2)
        q1, q2 = (right[i, 1] - s1 * q0) / s0, (right[i, 2] - s2 * q0) / s0
        quotients[i, 0], quotients[i, 1], quotients[i, 2] = q0, q1, q2
        _, g[2 * i], g[2 * i + 1] = over(scaling[i], q0, q1, q2)
    dense.solve_factored(M, swaps, g, dx)
    for i in range(k):
        p0, p1, p2 = over(scaling[i], 0.0, dx[2 * i], dx[2 * i + 1])
        primal[i, 0], primal[i, 1], primal[i, 2] = p0, p1, p2
        dual[i, 0], dual[i, 1], dual[i, 2] = over(
            scaling[i], quotients[i, 0] - p0, quotients[i, 1] - p1, quotients[i, 2] - p2
        )


@njit(**LEAF)
def reach(x, m, z, dx, dual):
    """How far the step (dx, dual) may go until it is at the edge of a cone."""
    out = np.inf
    for i in range(m.shape[0]):
        p, q = 2 * i, 2 * i + 1
        a = dx[p] ** 2 + dx[q] ** 2
        b = x[p] * dx[p] + x[q] * dx[q]
        c = 1.0 - x[p] ** 2 - x[q] ** 2
        if a > 0.0:
            out = min(out, c / (b + np.sqrt(b * b + a * c)))
        d0, d1, d2 = dual[i, 0], dual[i, 1], dual[i, 2]
        a = d0 * d0 - d1 * d1 - d2 * d2
        b = m[i] * d0 - z[p] * d1 - z[q] * d2
        c = m[i] ** 2 - z[p] ** 2 - z[q] ** 2
        if b * b >= a * c:
            root = np.sqrt(b * b - a * c)
            for below in (root - b, -root - b):
                if c * below > 0.0:
                    out = min(out, c / below)
    return out
