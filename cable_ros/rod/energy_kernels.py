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

from cable_ros.compilation import INNER, LEAF, njit
from cable_ros.rod.centreline import increments, tangent_derivative
from cable_ros.rod.elements import LANES
from cable_ros.rod.rod_state import ENERGY, TWIST

OPTIONS = {"cache": True, "error_model": "numpy"}


SLOPE, FORCE, ELASTIC, TURN, ROWS = 4, 8, 11, 12, 13
"""Rows of a point in `lanes`: frame (4), slope (4) and force (3) at first, then what `sections` makes of
them: the tangent where the force was, elastic energy and twist."""
NODES = 16
"""Most nodes of an element, in whole vectors."""


@njit(inline="always", **LEAF)
def strain(q, dq, K, natural, G):
    """Strain, moment, tangent, the density's gradients by q and dq at a point; |q|^2, -G.t, m.kappa.

    Args:
        q, dq: (4,) quaternion of any length and its derivative by the arc length.
        K, natural: (3,) of `Section`.
        G: (3,) internal force, EI / L^2.
    """
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
    a = K[0] * (kappa[0] - natural[0])
    b = K[1] * (kappa[1] - natural[1])
    c = K[2] * (kappa[2] - natural[2])
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
    """Frame, slope and force at all points, side by side, in `lanes` (blocks + 1, ROWS * LANES).

    A block holds LANES points of one element, number by number.

    Args:
        q, F, f: as in `gradient`.
        h, s0: of `Grid`.
        points, by_point: of `Tables`.
        lanes: see `workspace`.
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
                    v[SLOPE * LANES + k] += d * w
                    v[(SLOPE + 1) * LANES + k] += d * x
                    v[(SLOPE + 2) * LANES + k] += d * y
                    v[(SLOPE + 3) * LANES + k] += d * z
            for k in range(min(LANES, points.shape[0] - b * LANES)):
                rest = 1.0 - s0[e] - h[e] * points[b * LANES + k]
                for a in range(3):
                    v[(FORCE + a) * LANES + k] = F[e, a] + rest * f[a]


@njit(**LEAF)
def sections(lanes, K, natural):
    """`strain` at every point of `interpolate`, side by side; the last block is not one of them.

    In `lanes` the gradient of the density by q and by dq takes the place of frame and slope, the tangent that
    of the force, then follow elastic energy and twist. `K`, `natural`: of `Section`.
    """
    K, natural = (K[0], K[1], K[2]), (natural[0], natural[1], natural[2])
    for block in range(lanes.shape[0] - 1):
        v = lanes[block]
        for k in range(LANES):
            q = v[k], v[LANES + k], v[2 * LANES + k], v[3 * LANES + k]
            s = SLOPE * LANES + k
            dq = v[s], v[s + LANES], v[s + 2 * LANES], v[s + 3 * LANES]
            r = FORCE * LANES + k
            G = v[r], v[r + LANES], v[r + 2 * LANES]
            kappa, m, t, gq, gd, _, _, mk = strain(q, dq, K, natural, G)
            v[k], v[LANES + k], v[2 * LANES + k], v[3 * LANES + k] = gq
            v[s], v[s + LANES], v[s + 2 * LANES], v[s + 3 * LANES] = gd
            v[r], v[r + LANES], v[r + 2 * LANES] = t
            v[ELASTIC * LANES + k] = 0.5 * (mk - m[0] * natural[0] - m[1] * natural[1] - m[2] * natural[2])
            v[TURN * LANES + k] = kappa[2]


@njit(**LEAF)
def integrate(lanes, f, h, s0, points, weights, totals):
    """Sum over the points of `sections`: end position (3), energy and twist in `totals` (5,).

    Args:
        lanes: as `sections` leaves them.
        f: (3,) load per length.
        h, s0: of `Grid`.
        points, weights: of `Tables`.
        totals: of `Evaluation`, overwritten.
    """
    blocks = lanes.shape[0] // h.shape[0]
    t0, t1, t2, energy, twist = 0.0, 0.0, 0.0, 0.0, 0.0
    for e in range(h.shape[0]):
        for k in range(points.shape[0]):
            v = lanes[e * blocks + k // LANES, k % LANES :]
            wh = weights[k] * h[e]
            rest = 1.0 - s0[e] - h[e] * points[k]
            x, y, z = wh * v[FORCE * LANES], wh * v[(FORCE + 1) * LANES], wh * v[(FORCE + 2) * LANES]
            t0 += x
            t1 += y
            t2 += z
            energy += wh * v[ELASTIC * LANES] - rest * (f[0] * x + f[1] * y + f[2] * z)
            twist += wh * v[TURN * LANES]
    totals[0], totals[1], totals[2], totals[ENERGY], totals[TWIST] = t0, t1, t2, energy, twist


@njit(**LEAF)
def assemble(lanes, h, by_node, acc):
    """Add the gradient by the nodal quaternions, acc (n, 4), from those at the points of `sections`.

    Args:
        lanes: as `sections` leaves them; the last block is used up.
        h: (m,) lengths of the elements.
        by_node: of `Tables`.
        acc: (n, 4), see `Evaluation`.
    """
    blocks = lanes.shape[0] // h.shape[0]
    sums = lanes[lanes.shape[0] - 1]
    count, width = by_node.shape[1], by_node.shape[2]
    order = (acc.shape[0] - 1) // h.shape[0]
    for e in range(h.shape[0]):
        sums[: 4 * NODES] = 0.0
        for k in range(count):
            v = lanes[e * blocks + k // LANES, k % LANES :]
            w, x, y, z = h[e] * v[0], h[e] * v[LANES], h[e] * v[2 * LANES], h[e] * v[3 * LANES]
            dw, dx = v[SLOPE * LANES], v[(SLOPE + 1) * LANES]
            dy, dz = v[(SLOPE + 2) * LANES], v[(SLOPE + 3) * LANES]
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
def second(q, dq, G, density, weight, k8, H):
    """Second derivative of the density by (q, q'), times the weight: k8^T K k8 + H.

    Args:
        q, dq, G: `strain`'s.
        density: what `strain` returns there.
        weight: of the quadrature.
        k8: (3, 8) receives the derivative of the strain, times the weight's root.
        H: (8, 8) receives all else.
    """
    kappa, moment, _, gq, gd, n, T, mk = density
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
def workspace(h, by_point):
    """The `lanes` that `gradient` works in: a block for every LANES points of an element, and one more.

    Args:
        h: (m,) lengths of the elements.
        by_point: of `Tables`.
    """
    return np.empty((h.shape[0] * by_point.shape[1] + 1, ROWS * LANES))


@njit(**LEAF)
def gradient(q, F, f, section, grid, evaluation):
    """Gradient of the Lagrangian at the nodes, end position, energy and twist, all in `evaluation`.

    Energy is that of the free cable: elastic minus weight.

    Args:
        q: (n, 4) nodal frames.
        F: (m, 3) the constant part of the internal force: the end force plus the point forces on later
            elements, EI / L^2.
        f: (3,) load per length, EI / L^3.
        section, grid: `Section` and `Grid`.
        evaluation: `Evaluation`; `acc` comes with what else pulls at the nodal quaternions, zero without.
    """
    acc, g, radial, totals, lanes = evaluation
    h, s0, tables = grid
    interpolate(q, F, f, h, s0, tables.points, tables.by_point, lanes)
    sections(lanes, section.K, section.natural)
    integrate(lanes, f, h, s0, tables.points, tables.weights, totals)
    assemble(lanes, h, tables.by_node, acc)
    for i in range(q.shape[0]):
        w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        a, b, c, d = acc[i, 0], acc[i, 1], acc[i, 2], acc[i, 3]
        g[i, 0] = 0.5 * (-x * a + w * b + z * c - y * d)
        g[i, 1] = 0.5 * (-y * a - z * b + w * c + x * d)
        g[i, 2] = 0.5 * (-z * a + y * b - x * c + w * d)
        radial[i] = 0.25 * (w * a + x * b + y * c + z * d)


@njit(**INNER)
def hessian(q, F, f, section, grid, radial, tangents):
    """Hessian of the Lagrangian in lower band storage, in two parts, and the end position's derivative.

    `elastic` and `geometric` hold row i, column j at [i, b - 1 + j - i]; the Hessian is their sum.

    Args:
        q, F, f, section, grid: as in `gradient`.
        radial: (n,) of the `Evaluation` at q.
        tangents: `Tangents`, overwritten.
    """
    K, natural = section
    h, s0, tables = grid
    N, dN, N3, dN3 = tables.values, tables.slopes, tables.values3, tables.slopes3
    points, weights = tables.points, tables.weights
    elastic, geometric, dchord, C = tangents
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
    dchord[:] = 0.0
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
            density = strain(qs, ds, K, natural, G)
            t, n = density[2], density[5]
            wh = weights[k] * h[e]
            # derivatives by (q, q'): k8 of the strain, H the second one's part without k8
            second(qs, ds, G, density, wh, k8, H)
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
            tangent_derivative(qs, t, 2.0 * wh / n, D, dchord[e], 0, nd)
        for i in range(nd):
            row = 3 * first + i
            shift = band - i
            for j in range(i + 1):
                elastic[row, shift + j] += E[i, j]
                geometric[row, shift + j] += S[i, j]
            for a in range(3):
                C[a, row] += dchord[e, a, i]
    for i in range(q.shape[0]):
        for c in range(3):
            geometric[3 * i + c, band] -= radial[i]
