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

from cable_ros.compilation import njit

OPTIONS = {"cache": True, "error_model": "numpy"}


@njit(**OPTIONS)
def section(q, dq, K, kappa0, G, kappa, moment, t, gq, gd):
    """Strain, moment, tangent, the density's gradient by (q, dq) at a point; returns |q|^2, -G.t, m.kappa."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    dw, dx, dy, dz = dq[0], dq[1], dq[2], dq[3]
    n = w * w + x * x + y * y + z * z
    i = 1.0 / n
    kappa[0] = 2.0 * i * (w * dx - dw * x - y * dz + z * dy)
    kappa[1] = 2.0 * i * (w * dy - dw * y - z * dx + x * dz)
    kappa[2] = 2.0 * i * (w * dz - dw * z - x * dy + y * dx)
    a = K[0] * (kappa[0] - kappa0[0])
    b = K[1] * (kappa[1] - kappa0[1])
    c = K[2] * (kappa[2] - kappa0[2])
    moment[0], moment[1], moment[2] = a, b, c
    t[0] = 2.0 * i * (x * z + w * y)
    t[1] = 2.0 * i * (y * z - w * x)
    t[2] = i * (w * w - x * x - y * y + z * z)
    T = -(G[0] * t[0] + G[1] * t[1] + G[2] * t[2])
    mk = a * kappa[0] + b * kappa[1] + c * kappa[2]
    # J(m) q' and J(m) q with J antisymmetric: u = q.J q'
    u = 2.0 * i
    gq[0] = u * (a * dx + b * dy + c * dz - mk * w)
    gq[1] = u * (-a * dw + b * dz - c * dy - mk * x)
    gq[2] = u * (-a * dz - b * dw + c * dx - mk * y)
    gq[3] = u * (a * dy - b * dx - c * dw - mk * z)
    gd[0] = -u * (a * x + b * y + c * z)
    gd[1] = -u * (-a * w + b * z - c * y)
    gd[2] = -u * (-a * z - b * w + c * x)
    gd[3] = -u * (a * y - b * x - c * w)
    # - S(G) q
    gq[0] -= u * (G[2] * w - G[1] * x + G[0] * y + T * w)
    gq[1] -= u * (-G[1] * w - G[2] * x + G[0] * z + T * x)
    gq[2] -= u * (G[0] * w - G[2] * y + G[1] * z + T * y)
    gq[3] -= u * (G[0] * x + G[1] * y + G[2] * z + T * z)
    return n, T, mk


@njit(**OPTIONS)
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


@njit(**OPTIONS)
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


@njit(**OPTIONS)
def increments(q, c, out):
    """Derivative (4, 3) of the quaternion q by its rotation vector, into the columns from c on of `out`."""
    w, x, y, z = 0.5 * q[0], 0.5 * q[1], 0.5 * q[2], 0.5 * q[3]
    out[0, c], out[1, c], out[2, c], out[3, c] = -x, w, z, -y
    out[0, c + 1], out[1, c + 1], out[2, c + 1], out[3, c + 1] = -y, -z, w, x
    out[0, c + 2], out[1, c + 2], out[2, c + 2], out[3, c + 2] = -z, y, -x, w


@njit(**OPTIONS)
def gradient(q, F, f, K, kappa0, h, s0, N, dN, points, weights, acc, g, radial, totals):
    """Gradient g (n, 3) of the Lagrangian at the nodes and, in `totals`, end position (3), energy, twist.

    `F` (elements, 3): the constant part of the internal force, the end force plus the point forces on later
    elements. `acc` (n, 4) comes with what else pulls at the nodal quaternions, zero without, and is used up.
    `radial` (n,) receives a quarter of the derivative along each nodal quaternion itself, the curvature of
    the unit sphere that the Hessian needs. Energy is that of the free cable: elastic minus weight.
    """
    order = N.shape[1] - 1
    kappa, moment, t, G = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    qs, ds, gq, gd = np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    totals[:] = 0.0
    for e in range(h.shape[0]):
        first = e * order
        for k in range(N.shape[0]):
            for a in range(4):
                qs[a] = 0.0
                ds[a] = 0.0
            for i in range(order + 1):
                v = N[k, i]
                d = dN[k, i] / h[e]
                for a in range(4):
                    qs[a] += v * q[first + i, a]
                    ds[a] += d * q[first + i, a]
            rest = 1.0 - s0[e] - h[e] * points[k]
            for a in range(3):
                G[a] = F[e, a] + rest * f[a]
            section(qs, ds, K, kappa0, G, kappa, moment, t, gq, gd)
            wh = weights[k] * h[e]
            for a in range(3):
                totals[a] += wh * t[a]
                totals[3] += wh * (0.5 * moment[a] * (kappa[a] - kappa0[a]) - rest * f[a] * t[a])
            totals[4] += wh * kappa[2]
            for i in range(order + 1):
                v = wh * N[k, i]
                d = weights[k] * dN[k, i]
                for a in range(4):
                    acc[first + i, a] += v * gq[a] + d * gd[a]
    for i in range(q.shape[0]):
        w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        a, b, c, d = acc[i, 0], acc[i, 1], acc[i, 2], acc[i, 3]
        g[i, 0] = 0.5 * (-x * a + w * b + z * c - y * d)
        g[i, 1] = 0.5 * (-y * a - z * b + w * c + x * d)
        g[i, 2] = 0.5 * (-z * a + y * b - x * c + w * d)
        radial[i] = 0.25 * (w * a + x * b + y * c + z * d)


@njit(**OPTIONS)
def hessian(q, F, f, K, kappa0, h, s0, N, dN, N3, dN3, points, weights, radial, elastic, geometric, parts, C):
    """Hessian of the Lagrangian in lower band storage, in two parts, and the end position's derivative.

    `elastic` and `geometric` (3n, b + 1) hold row i, column j at [i, b + j - i], b = 3 (order + 1) - 1; the
    Hessian is their sum. `parts` (elements, 3, 3 (order + 1)) is the derivative of the way that each element
    goes, `C` (3, 3n) that of the end position, their sum. `F` and `radial` are `gradient`'s.
    """
    order = N.shape[1] - 1
    nd = 3 * (order + 1)
    wide = (nd + 7) // 8 * 8  # whole vectors: the inner loops run over zeros rather than remainders
    band = nd - 1
    kappa, moment, t, G = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    qs, ds, gq, gd = np.empty(4), np.empty(4), np.empty(4), np.empty(4)
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
            n, T, mk = section(qs, ds, K, kappa0, G, kappa, moment, t, gq, gd)
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
