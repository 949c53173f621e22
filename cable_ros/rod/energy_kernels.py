# SPDX-License-Identifier: Apache-2.0
"""Compiled arithmetic of the rod: energy, its gradient and its exact Hessian.

Everything is in units of the cable (length 1, see `units.py`) and in the start clamp's frame. Quaternions are
scalar first in here. `q` (n, 4) holds the nodal quaternions; a nodal increment `psi` (n, 3) is a rotation
vector in the section frame: q <- q exp(psi / 2). The Lagrangian is

    L = integral 1/2 (kappa - kappa0).K.(kappa - kappa0) - G(s).t ds,    G(s) = F + (1 - s) f

with the internal force G, whose constant part F is the end force, the multiplier of the end position, and the
load f per length (docs/method.md, equations 1 to 4).
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import LEAF, njit
from cable_ros.rod.elements import LANES

OPTIONS = {"cache": True, "error_model": "numpy"}


ROWS = 13
"""Numbers of a point in `lanes`: frame (4), slope (4) and force (3) at first, then what `sections` makes."""
NODES = 16
"""Most nodes of an element, in whole vectors."""


@njit(inline="always", **LEAF)
def section(q, dq, K, kappa0, G):
    """Strain, moment, tangent, the density's gradients by q and dq at a point; |q|^2, -G.t, m.kappa."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    dw, dx, dy, dz = dq[0], dq[1], dq[2], dq[3]
    n = w * w + x * x + y * y + z * z
    i = 1.0 / n
    u = 2.0 * i
    kappa = (
        u * (w * dx - dw * x - y * dz + z * dy),
        u * (w * dy - dw * y - z * dx + x * dz),
        u * (w * dz - dw * z - x * dy + y * dx),
    )
    a = K[0] * (kappa[0] - kappa0[0])
    b = K[1] * (kappa[1] - kappa0[1])
    c = K[2] * (kappa[2] - kappa0[2])
    t = u * (x * z + w * y), u * (y * z - w * x), i * (w * w - x * x - y * y + z * z)
    T = -(G[0] * t[0] + G[1] * t[1] + G[2] * t[2])
    mk = a * kappa[0] + b * kappa[1] + c * kappa[2]
    # J(m) q' and J(m) q with J antisymmetric: u = q.J q'; then - S(G) q
    gq = (
        u * (a * dx + b * dy + c * dz - mk * w) - u * (G[2] * w - G[1] * x + G[0] * y + T * w),
        u * (-a * dw + b * dz - c * dy - mk * x) - u * (-G[1] * w - G[2] * x + G[0] * z + T * x),
        u * (-a * dz - b * dw + c * dx - mk * y) - u * (G[0] * w - G[2] * y + G[1] * z + T * y),
        u * (a * dy - b * dx - c * dw - mk * z) - u * (G[0] * x + G[1] * y + G[2] * z + T * z),
    )
    gd = (
        -u * (a * x + b * y + c * z),
        -u * (-a * w + b * z - c * y),
        -u * (-a * z - b * w + c * x),
        -u * (a * y - b * x - c * w),
    )
    return kappa, (a, b, c), t, gq, gd, n, T, mk


@njit(**LEAF)
def interpolate(q, F, f, h, s0, points, by_point, lanes):
    """Frame, slope and force at all points, side by side: `lanes` (blocks + 1, ROWS * LANES).

    A block holds LANES points of one element, number by number.
    """
    blocks, order = by_point.shape[1], by_point.shape[2] - 1
    width = by_point.shape[3]
    for e in range(h.shape[0]):
        first = e * order
        ih = 1.0 / h[e]
        for b in range(blocks):
            v = lanes[e * blocks + b]
            v[:] = 0.0
            for i in range(order + 1):
                w, x, y, z = q[first + i, 0], q[first + i, 1], q[first + i, 2], q[first + i, 3]
                for k in range(width):
                    n, d = by_point[0, b, i, k], ih * by_point[1, b, i, k]
                    v[k] += n * w
                    v[LANES + k] += n * x
                    v[2 * LANES + k] += n * y
                    v[3 * LANES + k] += n * z
                    v[4 * LANES + k] += d * w
                    v[5 * LANES + k] += d * x
                    v[6 * LANES + k] += d * y
                    v[7 * LANES + k] += d * z
            for k in range(min(LANES, points.shape[0] - b * LANES)):
                rest = 1.0 - s0[e] - h[e] * points[b * LANES + k]
                for a in range(3):
                    v[(8 + a) * LANES + k] = F[e, a] + rest * f[a]


@njit(**LEAF)
def sections(lanes, K, kappa0):
    """`section` at every point of `interpolate`, side by side; the last block is not one of them.

    The rows receive the density's gradient by q (4) and dq (4), tangent (3), elastic energy and twist.
    """
    K, kappa0 = (K[0], K[1], K[2]), (kappa0[0], kappa0[1], kappa0[2])
    for block in range(lanes.shape[0] - 1):
        v = lanes[block]
        for k in range(LANES):
            q = v[k], v[LANES + k], v[2 * LANES + k], v[3 * LANES + k]
            dq = v[4 * LANES + k], v[5 * LANES + k], v[6 * LANES + k], v[7 * LANES + k]
            G = v[8 * LANES + k], v[9 * LANES + k], v[10 * LANES + k]
            kappa, m, t, gq, gd, _, _, mk = section(q, dq, K, kappa0, G)
            v[k], v[LANES + k], v[2 * LANES + k], v[3 * LANES + k] = gq
            v[4 * LANES + k], v[5 * LANES + k], v[6 * LANES + k], v[7 * LANES + k] = gd
            v[8 * LANES + k], v[9 * LANES + k], v[10 * LANES + k] = t
            v[11 * LANES + k] = 0.5 * (mk - m[0] * kappa0[0] - m[1] * kappa0[1] - m[2] * kappa0[2])
            v[12 * LANES + k] = kappa[2]


@njit(**LEAF)
def integrate(lanes, f, h, s0, points, weights, totals):
    """Sum over the points of `sections`: end position (3), energy and twist in `totals`."""
    blocks = lanes.shape[0] // h.shape[0]
    t0, t1, t2, energy, twist = 0.0, 0.0, 0.0, 0.0, 0.0
    for e in range(h.shape[0]):
        for k in range(points.shape[0]):
            v = lanes[e * blocks + k // LANES, k % LANES :]
            wh = weights[k] * h[e]
            rest = 1.0 - s0[e] - h[e] * points[k]
            x, y, z = wh * v[8 * LANES], wh * v[9 * LANES], wh * v[10 * LANES]
            t0 += x
            t1 += y
            t2 += z
            energy += wh * v[11 * LANES] - rest * (f[0] * x + f[1] * y + f[2] * z)
            twist += wh * v[12 * LANES]
    totals[0], totals[1], totals[2], totals[3], totals[4] = t0, t1, t2, energy, twist


@njit(**LEAF)
def assemble(lanes, h, by_node, acc):
    """Add the gradient by the nodal quaternions, acc (n, 4), from those at the points of `sections`."""
    blocks = lanes.shape[0] // h.shape[0]
    sums = lanes[lanes.shape[0] - 1]
    count, width = by_node.shape[1], by_node.shape[2]
    order = (acc.shape[0] - 1) // h.shape[0]
    for e in range(h.shape[0]):
        sums[: 4 * NODES] = 0.0
        for k in range(count):
            v = lanes[e * blocks + k // LANES, k % LANES :]
            w, x, y, z = h[e] * v[0], h[e] * v[LANES], h[e] * v[2 * LANES], h[e] * v[3 * LANES]
            dw, dx, dy, dz = v[4 * LANES], v[5 * LANES], v[6 * LANES], v[7 * LANES]
            for i in range(width):
                n, d = by_node[0, k, i], by_node[1, k, i]
                sums[i] += n * w + d * dw
                sums[NODES + i] += n * x + d * dx
                sums[2 * NODES + i] += n * y + d * dy
                sums[3 * NODES + i] += n * z + d * dz
        for i in range(order + 1):
            for a in range(4):
                acc[e * order + i, a] += sums[a * NODES + i]


@njit(**LEAF)
def second(q, dq, K, G, kappa, moment, gq, gd, n, T, mk, weight, k8, H):
    """Second derivative of the density by (q, q'), times the weight: k8^T K k8 + H.

    `k8` (3, 8): derivative of the strain, times the weight's root; `H` (8, 8): all else.
    """
    w, x, y, z = q[0], q[1], q[2], q[3]
    dw, dx, dy, dz = dq[0], dq[1], dq[2], dq[3]
    i2 = 2.0 / n
    k8[0, 0], k8[0, 1], k8[0, 2], k8[0, 3] = dx, -dw, -dz, dy
    k8[1, 0], k8[1, 1], k8[1, 2], k8[1, 3] = dy, dz, -dw, -dx
    k8[2, 0], k8[2, 1], k8[2, 2], k8[2, 3] = dz, -dy, dx, -dw
    k8[0, 4], k8[0, 5], k8[0, 6], k8[0, 7] = -x, w, z, -y
    k8[1, 4], k8[1, 5], k8[1, 6], k8[1, 7] = -y, -z, w, x
    k8[2, 4], k8[2, 5], k8[2, 6], k8[2, 7] = -z, y, -x, w
    root = i2 * np.sqrt(weight)
    for c in range(3):
        for a in range(4):
            k8[c, a] = root * (k8[c, a] - kappa[c] * q[a])
            k8[c, 4 + a] *= root
    i2 *= weight
    a, b, c = i2 * moment[0], i2 * moment[1], i2 * moment[2]
    u, v, s = i2 * G[0], i2 * G[1], i2 * G[2]
    r = -i2 * (mk + T)
    H[:] = 0.0
    H[0, 0], H[1, 1], H[2, 2], H[3, 3] = r - s, r + s, r + s, r - s
    H[0, 1], H[0, 2] = v, -u
    H[1, 3], H[2, 3] = -u, -v
    H[0, 5], H[0, 6], H[0, 7] = a, b, c
    H[1, 4], H[1, 6], H[1, 7] = -a, -c, b
    H[2, 4], H[2, 5], H[2, 7] = -b, c, -a
    H[3, 4], H[3, 5], H[3, 6] = -c, -b, a
    for i in range(4):
        for j in range(i, 4):
            H[i, j] -= i2 * (gq[i] * q[j] + gq[j] * q[i])
        for j in range(4):
            H[i, 4 + j] -= i2 * q[i] * gd[j]
    for i in range(8):
        for j in range(i):
            H[i, j] = H[j, i]


@njit(**LEAF)
def tangent_derivative(q, t, weight, D, C, first, count):
    """Add the tangent's derivative along `count` columns of D to C (3, ...) from column `first` on.

    Component a is (2 / n) (S_a q - t_a q), with t_a = q.S_a q / n; `weight` comes with the 2 / n.
    """
    w, x, y, z = weight * q[0], weight * q[1], weight * q[2], weight * q[3]
    for j in range(count):
        p0, p1, p2, p3 = D[0, j], D[1, j], D[2, j], D[3, j]
        pq = p0 * w + p1 * x + p2 * y + p3 * z
        C[0, first + j] += p0 * y + p1 * z + p2 * w + p3 * x - t[0] * pq
        C[1, first + j] += -p0 * x - p1 * w + p2 * z + p3 * y - t[1] * pq
        C[2, first + j] += p0 * w - p1 * x - p2 * y + p3 * z - t[2] * pq


@njit(**LEAF)
def increments(q, c, out):
    """Derivative (4, 3) of the quaternion q by its rotation vector, into the columns from c on of `out`."""
    w, x, y, z = 0.5 * q[0], 0.5 * q[1], 0.5 * q[2], 0.5 * q[3]
    out[0, c], out[1, c], out[2, c], out[3, c] = -x, w, z, -y
    out[0, c + 1], out[1, c + 1], out[2, c + 1], out[3, c + 1] = -y, -z, w, x
    out[0, c + 2], out[1, c + 2], out[2, c + 2], out[3, c + 2] = -z, y, -x, w


@njit(**OPTIONS)
def workspace(h, tables):
    """The `lanes` that `gradient` works in: a block for every LANES points of an element, and one more."""
    return np.empty((h.shape[0] * tables[6].shape[1] + 1, ROWS * LANES))


@njit(**LEAF)
def gradient(q, F, f, K, kappa0, h, s0, tables, lanes, acc, g, radial, totals):
    """Gradient g (n, 3) of the Lagrangian at the nodes and, in `totals`, end position (3), energy, twist.

    `F` (elements, 3): the constant part of the internal force, the end force plus the point forces on later
    elements. `acc` (n, 4) comes with what else pulls at the nodal quaternions, zero without, and is used up.
    `radial` (n,) receives a quarter of the derivative along each nodal quaternion itself, the curvature of
    the unit sphere that the Hessian needs. Energy is that of the free cable: elastic minus weight.
    """
    points, weights, by_point, by_node = tables[4:]
    interpolate(q, F, f, h, s0, points, by_point, lanes)
    sections(lanes, K, kappa0)
    integrate(lanes, f, h, s0, points, weights, totals)
    assemble(lanes, h, by_node, acc)
    for i in range(q.shape[0]):
        w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        a, b, c, d = acc[i, 0], acc[i, 1], acc[i, 2], acc[i, 3]
        g[i, 0] = 0.5 * (-x * a + w * b + z * c - y * d)
        g[i, 1] = 0.5 * (-y * a - z * b + w * c + x * d)
        g[i, 2] = 0.5 * (-z * a + y * b - x * c + w * d)
        radial[i] = 0.25 * (w * a + x * b + y * c + z * d)


@njit(**OPTIONS)
def hessian(q, F, f, K, kappa0, h, s0, tables, radial, elastic, geometric, parts, C):
    """Hessian of the Lagrangian in lower band storage, in two parts, and the end position's derivative.

    `elastic` and `geometric` (3n, b + 1) hold row i, column j at [i, b + j - i], b = 3 (order + 1) - 1; the
    Hessian is their sum. `parts` (elements, 3, 3 (order + 1)) is the derivative of the way that each element
    goes, `C` (3, 3n) that of the end position, their sum. `F` and `radial` are `gradient`'s.
    """
    N, dN, N3, dN3, points, weights = tables[:6]
    order = N.shape[1] - 1
    nd = 3 * (order + 1)
    wide = (nd + 7) // 8 * 8  # whole vectors: the inner loops run over zeros rather than remainders
    band = nd - 1
    qs, ds, G = np.empty(4), np.empty(4), np.empty(3)
    frame = np.zeros((4, wide))
    D = np.zeros((8, wide))
    Y = np.zeros((8, wide))
    B = np.zeros((3, wide))
    E = np.zeros((nd, wide))
    S = np.zeros((nd, wide))
    H = np.empty((8, 8))
    k8 = np.empty((3, 8))
    elastic[:] = 0.0
    geometric[:] = 0.0
    parts[:] = 0.0
    C[:] = 0.0
    for e in range(h.shape[0]):
        first = e * order
        ih = 1.0 / h[e]
        E[:] = 0.0
        S[:] = 0.0
        for i in range(order + 1):
            increments(q[first + i], 3 * i, frame)
        for k in range(N.shape[0]):
            for a in range(4):
                qs[a] = 0.0
                ds[a] = 0.0
            for i in range(order + 1):
                v = N[k, i]
                d = dN[k, i] * ih
                for a in range(4):
                    qs[a] += v * q[first + i, a]
                    ds[a] += d * q[first + i, a]
            for a in range(4):
                for j in range(nd):
                    D[a, j] = N3[k, j] * frame[a, j]
                    D[4 + a, j] = ih * dN3[k, j] * frame[a, j]
            rest = 1.0 - s0[e] - h[e] * points[k]
            for a in range(3):
                G[a] = F[e, a] + rest * f[a]
            kappa, moment, t, gq, gd, n, T, mk = section(qs, ds, K, kappa0, G)
            wh = weights[k] * h[e]
            second(qs, ds, K, G, kappa, moment, gq, gd, n, T, mk, wh, k8, H)
            for c in range(3):
                b0, b1, b2, b3 = k8[c, 0], k8[c, 1], k8[c, 2], k8[c, 3]
                b4, b5, b6, b7 = k8[c, 4], k8[c, 5], k8[c, 6], k8[c, 7]
                for j in range(wide):
                    B[c, j] = (b0 * D[0, j] + b1 * D[1, j] + b2 * D[2, j] + b3 * D[3, j]) + (
                        b4 * D[4, j] + b5 * D[5, j] + b6 * D[6, j] + b7 * D[7, j]
                    )
            for a in range(8):
                b0, b1, b2, b3 = H[a, 0], H[a, 1], H[a, 2], H[a, 3]
                b4, b5, b6, b7 = H[a, 4], H[a, 5], H[a, 6], H[a, 7]
                for j in range(wide):
                    Y[a, j] = (b0 * D[0, j] + b1 * D[1, j] + b2 * D[2, j] + b3 * D[3, j]) + (
                        b4 * D[4, j] + b5 * D[5, j] + b6 * D[6, j] + b7 * D[7, j]
                    )
            for i in range(nd):
                e0, e1, e2 = K[0] * B[0, i], K[1] * B[1, i], K[2] * B[2, i]
                b0, b1, b2, b3 = D[0, i], D[1, i], D[2, i], D[3, i]
                b4, b5, b6, b7 = D[4, i], D[5, i], D[6, i], D[7, i]
                for j in range((i // 8 + 1) * 8):
                    E[i, j] += e0 * B[0, j] + e1 * B[1, j] + e2 * B[2, j]
                    S[i, j] += (b0 * Y[0, j] + b1 * Y[1, j] + b2 * Y[2, j] + b3 * Y[3, j]) + (
                        b4 * Y[4, j] + b5 * Y[5, j] + b6 * Y[6, j] + b7 * Y[7, j]
                    )
            tangent_derivative(qs, t, 2.0 * wh / n, D, parts[e], 0, nd)
        for i in range(nd):
            row = 3 * first + i
            shift = band - i
            for j in range(i + 1):
                elastic[row, shift + j] += E[i, j]
                geometric[row, shift + j] += S[i, j]
            for a in range(3):
                C[a, row] += parts[e, a, i]
    for i in range(q.shape[0]):
        for c in range(3):
            geometric[3 * i + c, band] -= radial[i]
