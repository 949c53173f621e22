# SPDX-License-Identifier: Apache-2.0
"""Compiled: what stretch and shear add to the rod's Lagrangian, its gradient and Hessian.

By complementary energy, so that there is no strain to solve for: with the internal force b = R^T G in the
section's frame and the compliance c (1 / GAx, 1 / GAy, 1 / EA) the Lagrangian of `rod.energy_kernels` gets

    - 1/2 integral sum_a c_a b_a^2 ds,    and the centreline    r' = t + u,    u = sum_a c_a b_a d_a,

with d_a the section's axes. It is concave in the end force F: the derivative of the end position by F is the
positive `reach`, which joins the Schur complement of the saddle system.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, LEAF, njit
from cable_ros.rod.centreline import increments
from cable_ros.rod.rod_state import ENERGY

OPTIONS = {"cache": True, "error_model": "numpy"}


@njit(**LEAF)
def axes(q, d):
    """The section's axes as rows d (3, 3), of a quaternion q (4,) of any length; its squared length."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    n = w * w + x * x + y * y + z * z
    i = 1.0 / n
    d[0, 0], d[0, 1], d[0, 2] = (
        i * (w * w + x * x - y * y - z * z),
        2 * i * (x * y + w * z),
        2 * i * (x * z - w * y),
    )
    d[1, 0], d[1, 1], d[1, 2] = (
        2 * i * (x * y - w * z),
        i * (w * w - x * x + y * y - z * z),
        2 * i * (y * z + w * x),
    )
    d[2, 0], d[2, 1], d[2, 2] = (
        2 * i * (x * z + w * y),
        2 * i * (y * z - w * x),
        i * (w * w - x * x - y * y + z * z),
    )
    return n


@njit(**LEAF)
def forms(G, S):
    """The symmetric matrices S (3, 4, 4) of the forces along the axes: b_a = q.S[a] q / |q|^2, with the force
    G (3,).
    """
    x, y, z = G[0], G[1], G[2]
    S[:] = 0.0
    S[0, 0, 0], S[0, 1, 1], S[0, 2, 2], S[0, 3, 3] = x, x, -x, -x
    S[0, 1, 2], S[0, 0, 3], S[0, 1, 3], S[0, 0, 2] = y, y, z, -z
    S[1, 0, 0], S[1, 1, 1], S[1, 2, 2], S[1, 3, 3] = y, -y, y, -y
    S[1, 1, 2], S[1, 0, 3], S[1, 2, 3], S[1, 0, 1] = x, -x, z, z
    S[2, 0, 0], S[2, 1, 1], S[2, 2, 2], S[2, 3, 3] = z, -z, -z, z
    S[2, 1, 3], S[2, 0, 2], S[2, 2, 3], S[2, 0, 1] = x, x, y, -y
    for a in range(3):
        for i in range(4):
            for j in range(i):
                S[a, i, j] = S[a, j, i]


@njit(**LEAF)
def local(q, G, S, d, b, slope):
    """Axes d (3, 3), forces along them b (3,) and their derivatives by q, slope (3, 4); returns |q|^2.

    Args:
        q: (4,) quaternion of any length.
        G, S: (3,) force, and its `forms`.
        d, b, slope: receive the results.
    """
    n = axes(q, d)
    for a in range(3):
        b[a] = d[a, 0] * G[0] + d[a, 1] * G[1] + d[a, 2] * G[2]
        for i in range(4):
            v = -b[a] * q[i]
            for j in range(4):
                v += S[a, i, j] * q[j]
            slope[a, i] = 2.0 / n * v
    return n


@njit(**INNER)
def internal_forces(F, f, grid):
    """(m, g, 3) internal force at the Gauss points; the arguments as in `energy_kernels.gradient`."""
    h, s0, tables = grid
    G = np.empty((h.shape[0], tables.points.shape[0], 3))
    for e in range(h.shape[0]):
        for k in range(G.shape[1]):
            rest = 1.0 - s0[e] - h[e] * tables.points[k]
            for a in range(3):
                G[e, k, a] = F[e, a] + rest * f[a]
    return G


@njit(**INNER)
def stretch_gradient(q, forces, f, grid, stretch, acc):
    """Add the derivative of the complementary energy by the nodal quaternions.

    `totals` receives the displacement of the end, integral u ds, and the energy: that of the strains less the
    work of the weight on u.

    Args:
        q, f, grid: as in `energy_kernels.gradient`.
        forces: (m, g, 3) internal forces at the Gauss points.
        stretch: `Stretch`; receives `totals`.
        acc: (n, 4) to which the derivative is added.
    """
    h, s0, tables = grid
    N, points, weights = tables.values, tables.points, tables.weights
    compliance, _, totals = stretch
    order = N.shape[1] - 1
    qs, b = np.empty(4), np.empty(3)
    S, d, slope = np.empty((3, 4, 4)), np.empty((3, 3)), np.empty((3, 4))
    totals[:] = 0.0
    for e in range(h.shape[0]):
        first = e * order
        for k in range(N.shape[0]):
            for i in range(4):
                qs[i] = 0.0
                for j in range(order + 1):
                    qs[i] += N[k, j] * q[first + j, i]
            rest = 1.0 - s0[e] - h[e] * points[k]
            G = forces[e, k]
            forms(G, S)
            local(qs, G, S, d, b, slope)
            wh = weights[k] * h[e]
            for a in range(3):
                pull = wh * compliance[a] * b[a]
                totals[ENERGY] += 0.5 * pull * b[a]
                for i in range(3):
                    totals[i] += pull * d[a, i]
                    totals[ENERGY] -= rest * f[i] * pull * d[a, i]
                for j in range(order + 1):
                    for i in range(4):
                        acc[first + j, i] -= N[k, j] * pull * slope[a, i]


@njit(**INNER)
def stretch_hessian(q, forces, grid, stretch, tangents):
    """Add the second derivatives of the complementary energy to those of `energy_kernels.hessian`.

    At each Gauss point, with the interpolated quaternion q: H (4, 4) is the derivative of the density by q,
    twice; X (3, 4) that of the strain u by q; `reach` sums that of u by F. The chain rule with D (4, nd), the
    derivative of q by the rotations of the element's nodes, adds D^T H D to `geometric` and X D to `dchord`
    and C.

    Args:
        q, forces, grid: as in `stretch_gradient`.
        stretch: `Stretch`; receives `reach`.
        tangents: `Tangents`, to which is added.
    """
    h, _, tables = grid
    N, weights = tables.values, tables.weights
    compliance, reach, _ = stretch
    _, geometric, dchord, C = tangents
    order = N.shape[1] - 1
    nd = 3 * (order + 1)
    band = nd - 1
    qs, unit, b = np.empty(4), np.empty(3), np.empty(3)
    S, d, slope = np.empty((3, 4, 4)), np.empty((3, 3)), np.empty((3, 4))
    units, axis = np.empty((3, 3, 4, 4)), np.empty((3, 3, 4))
    H, X = np.empty((4, 4)), np.empty((3, 4))
    frame, D, Y = np.zeros((4, nd)), np.empty((4, nd)), np.empty((4, nd))
    for i in range(3):
        for j in range(3):
            unit[j] = 1.0 if i == j else 0.0
        forms(unit, units[i])
    reach[:] = 0.0
    for e in range(h.shape[0]):
        first = e * order
        for i in range(order + 1):
            increments(q[first + i], 3 * i, frame)
        for k in range(N.shape[0]):
            for i in range(4):
                qs[i] = 0.0
                for j in range(order + 1):
                    qs[i] += N[k, j] * q[first + j, i]
                for j in range(nd):
                    D[i, j] = N[k, j // 3] * frame[i, j]
            G = forces[e, k]
            forms(G, S)
            n = local(qs, G, S, d, b, slope)
            for i in range(3):  # derivative by q of the component i of each axis
                for a in range(3):
                    for j in range(4):
                        v = -d[a, i] * qs[j]
                        for m in range(4):
                            v += units[i, a, j, m] * qs[m]
                        axis[a, i, j] = 2.0 / n * v
            wh = weights[k] * h[e]
            H[:] = 0.0
            X[:] = 0.0
            for a in range(3):
                c = wh * compliance[a]
                for i in range(4):
                    for j in range(4):
                        bend = (
                            S[a, i, j] - (b[a] if i == j else 0.0) - slope[a, i] * qs[j] - slope[a, j] * qs[i]
                        )
                        H[i, j] -= c * (slope[a, i] * slope[a, j] + b[a] * 2.0 / n * bend)
                for i in range(3):
                    for j in range(4):
                        X[i, j] += c * (d[a, i] * slope[a, j] + b[a] * axis[a, i, j])
                    for j in range(3):
                        reach[i, j] += c * d[a, i] * d[a, j]
            for i in range(4):
                for j in range(nd):
                    Y[i, j] = H[i, 0] * D[0, j] + H[i, 1] * D[1, j] + H[i, 2] * D[2, j] + H[i, 3] * D[3, j]
            for i in range(nd):
                row = 3 * first + i
                for j in range(i + 1):
                    geometric[row, band - i + j] += (
                        D[0, i] * Y[0, j] + D[1, i] * Y[1, j] + D[2, i] * Y[2, j] + D[3, i] * Y[3, j]
                    )
                for a in range(3):
                    v = X[a, 0] * D[0, i] + X[a, 1] * D[1, i] + X[a, 2] * D[2, i] + X[a, 3] * D[3, i]
                    dchord[e, a, i] += v
                    C[a, row] += v


@njit(**OPTIONS)
def stretch_polyline(q, forces, compliance, mesh, sampling, start, length, out_r):
    """Add the displacement by the stretch to the points of `output.polyline`.

    Args:
        q, start, length: as in `output.polyline`.
        forces: end force and load, (3,) each, EI / L^2 and EI / L^3.
        compliance: (3,) of `Stretch`.
        mesh: lengths of the elements and the arc lengths at which they start, (m,) each.
        sampling: tuple of the fields of `rod_state.Sampling` of c points.
        out_r: (c, 3) the points in the world, m.
    """
    F, f = forces
    h, s0 = mesh
    element, _, weights, quadrature, points = sampling
    order = quadrature.shape[1] - 1
    count = element.shape[0]
    qs, G, b = np.empty(4), np.empty(3), np.empty(3)
    d, world = np.empty((3, 3)), np.empty((3, 3))
    u = np.empty((quadrature.shape[0], 3))
    turn = np.empty(4)
    turn[0], turn[1], turn[2], turn[3] = start[6], start[3], start[4], start[5]
    axes(turn, world)
    shift = np.zeros(3)
    at = 0
    for e in range(h.shape[0]):
        for k in range(quadrature.shape[0]):
            for i in range(4):
                qs[i] = 0.0
                for j in range(order + 1):
                    qs[i] += quadrature[k, j] * q[e * order + j, i]
            axes(qs, d)
            rest = 1.0 - s0[e] - h[e] * points[k]
            for i in range(3):
                G[i] = F[i] + rest * f[i]
                u[k, i] = 0.0
            for a in range(3):
                b[a] = compliance[a] * (d[a, 0] * G[0] + d[a, 1] * G[1] + d[a, 2] * G[2])
                for i in range(3):
                    u[k, i] += length * h[e] * b[a] * d[a, i]
        while at < count and element[at] == e:
            for i in range(3):
                v = shift[i]
                for k in range(quadrature.shape[0]):
                    v += weights[at, k] * u[k, i]
                for j in range(3):
                    out_r[at, j] += world[i, j] * v
            at += 1
        for i in range(3):
            for k in range(quadrature.shape[0]):
                shift[i] += weights[count, k] * u[k, i]
