"""Compiled: distance to an obstacle, points of the curve, and what a point force adds to the equations."""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import njit

OPTIONS = {"cache": True, "error_model": "numpy"}

SPHERE, PLANE, CAPSULE, CYLINDER, BOX = 0.0, 1.0, 2.0, 3.0, 4.0
WIDTH = 18
"""Numbers of an obstacle: kind, centre (3), rotation matrix (9, by rows), dimensions (3), offset, friction.

Dimensions: radius (sphere); radius, half length along z (capsule, cylinder); half edges (box); the solid is
below z = 0 (plane). The offset is the cable's radius where it counts.
"""


@njit(**OPTIONS)
def gap(obstacle, r, n, directions, bends):
    """Distance from r (3,) to the obstacle's surface, less the offset; negative inside.

    `n` (3,) receives its gradient; the Hessian is the sum of bends[i] directions[i] directions[i]^T,
    `directions` (2, 3) unit vectors across n.
    """
    kind = obstacle[0]
    scratch = np.zeros((4, 3))  # one allocation for all
    y, m, d = scratch[0], scratch[1], scratch[2:]
    for i in range(3):
        for j in range(3):
            y[i] += obstacle[4 + 3 * j + i] * (r[j] - obstacle[1 + j])
    a, b = obstacle[13], obstacle[14]
    bends[0] = 0.0
    bends[1] = 0.0
    distance = 0.0
    if kind == PLANE:
        m[2] = 1.0
        distance = y[2]
    elif kind == SPHERE or (kind == CAPSULE and abs(y[2]) > b):
        if kind == CAPSULE:
            y[2] -= b if y[2] > 0.0 else -b
        size = np.sqrt(y[0] * y[0] + y[1] * y[1] + y[2] * y[2])
        distance = size - a
        if size < 1e-12:
            m[2], size = 1.0, 1e-12
        else:
            m[0], m[1], m[2] = y[0] / size, y[1] / size, y[2] / size
        across(m, d)
        bends[0], bends[1] = 1.0 / size, 1.0 / size
    elif kind in (CAPSULE, CYLINDER):
        size = np.sqrt(y[0] * y[0] + y[1] * y[1])
        x0, x1 = 1.0, 0.0
        if size > 1e-12:
            x0, x1 = y[0] / size, y[1] / size
        side = size - a
        cap = abs(y[2]) - b if kind == CYLINDER else -1.0
        up = 1.0 if y[2] > 0.0 else -1.0
        d[0, 0], d[0, 1] = -x1, x0
        if kind == CAPSULE or (cap <= 0.0 and side >= cap):
            m[0], m[1] = x0, x1
            distance = side
            bends[0] = 1.0 / max(size, 1e-12)
        elif side <= 0.0:
            m[2] = up
            distance = cap
        else:
            distance = np.sqrt(side * side + cap * cap)
            m[0], m[1], m[2] = x0 * side / distance, x1 * side / distance, up * cap / distance
            bends[0] = side / distance / max(size, 1e-12)
            d[1, 0], d[1, 1], d[1, 2] = -x0 * cap / distance, -x1 * cap / distance, up * side / distance
            bends[1] = 1.0 / distance
    else:
        out = 0
        largest = -np.inf
        face = 0
        for i in range(3):
            over = abs(y[i]) - obstacle[13 + i]
            if over > 0.0:
                out += 1
                m[i] = over if y[i] > 0.0 else -over
                distance += over * over
            if over > largest:
                largest, face = over, i
        if out == 0:
            distance = largest
            m[face] = 1.0 if y[face] > 0.0 else -1.0
        else:
            distance = np.sqrt(distance)
            for i in range(3):
                m[i] /= distance
            if out == 3:
                across(m, d)
                bends[0], bends[1] = 1.0 / distance, 1.0 / distance
            elif out == 2:
                axis = 0
                for i in range(3):
                    if m[i] == 0.0:
                        axis = i
                i, j = (axis + 1) % 3, (axis + 2) % 3
                d[0, i], d[0, j] = -m[j], m[i]
                bends[0] = 1.0 / distance
    for i in range(3):
        n[i] = 0.0
        directions[0, i] = 0.0
        directions[1, i] = 0.0
        for j in range(3):
            R = obstacle[4 + 3 * i + j]
            n[i] += R * m[j]
            directions[0, i] += R * d[0, j]
            directions[1, i] += R * d[1, j]
    return distance - obstacle[16]


@njit(**OPTIONS)
def across(n, directions):
    """Two unit vectors (2, 3) across the unit vector n, continuous but at n = -z (Duff et al. 2017)."""
    sign = 1.0 if n[2] >= 0.0 else -1.0
    a = -1.0 / (sign + n[2])
    b = n[0] * n[1] * a
    directions[0, 0] = 1.0 + sign * n[0] * n[0] * a
    directions[0, 1], directions[0, 2] = sign * b, -sign * n[0]
    directions[1, 0], directions[1, 1], directions[1, 2] = b, sign + n[1] * n[1] * a, -n[1]


@njit(**OPTIONS)
def shape(nodes, x, N, dN):
    """Values and slopes (order + 1,) of the Lagrange polynomials through `nodes` at x."""
    count = nodes.shape[0]
    for i in range(count):
        v, d, size = 1.0, 0.0, 1.0
        for k in range(count):
            if k != i:
                d = d * (x - nodes[k]) + v
                v *= x - nodes[k]
                size *= nodes[i] - nodes[k]
        N[i] = v / size
        dN[i] = d / size


@njit(**OPTIONS)
def tangent(q, t):
    """Tangent t (3,) of the frame q (4,) of any length; returns its squared length."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    n = w * w + x * x + y * y + z * z
    t[0] = 2.0 * (x * z + w * y) / n
    t[1] = 2.0 * (y * z - w * x) / n
    t[2] = (w * w - x * x - y * y + z * z) / n
    return n


@njit(**OPTIONS)
def curve(q, h, N, primitives, c):
    """Coefficients c (elements, p + 1, 3) of the centreline: sum_k c[e, k] x^k at the place x of element e.

    It integrates the polynomial through the tangents at the element's p Gauss points, so that its ends are
    where the solver has them. `primitives` (p, p): see `Mesh`, integrals of the Lagrange polynomials through
    those points.
    """
    count = N.shape[0]
    order = N.shape[1] - 1
    qs, t = np.empty(4), np.empty(3)
    c[0, 0, 0], c[0, 0, 1], c[0, 0, 2] = 0.0, 0.0, 0.0
    for e in range(h.shape[0]):
        for k in range(count):
            for a in range(3):
                c[e, k + 1, a] = 0.0
        for k in range(count):
            for a in range(4):
                qs[a] = 0.0
                for i in range(order + 1):
                    qs[a] += N[k, i] * q[e * order + i, a]
            tangent(qs, t)
            for m in range(count):
                v = h[e] * primitives[m, k]
                for a in range(3):
                    c[e, m + 1, a] += v * t[a]
        if e + 1 < h.shape[0]:
            for a in range(3):
                v = 0.0
                for m in range(count + 1):
                    v += c[e, m, a]
                c[e + 1, 0, a] = v


@njit(**OPTIONS)
def find_element(s, s0, h):
    """Element of the arc length s and the place in it, 0 to 1."""
    e = 0
    while e + 1 < s0.shape[0] and s >= s0[e + 1]:
        e += 1
    x = (s - s0[e]) / h[e]
    return e, min(max(x, 0.0), 1.0)


@njit(**OPTIONS)
def position(c, h, s0, s, r):
    """Position r (3,) at arc length s on the curve with the coefficients c."""
    e, x = find_element(s, s0, h)
    top = c.shape[1] - 1
    for a in range(3):
        v = c[e, top, a]
        for k in range(top - 1, -1, -1):
            v = v * x + c[e, k, a]
        r[a] = v


@njit(**OPTIONS)
def direction(q, h, s0, nodes, s, t, dt):
    """Tangent t (3,) and its derivative dt (3,) at arc length s."""
    e, x = find_element(s, s0, h)
    order = nodes.shape[0] - 1
    N, dN = np.empty(order + 1), np.empty(order + 1)
    qs, ds = np.empty(4), np.empty(4)
    shape(nodes, x, N, dN)
    for a in range(4):
        qs[a] = 0.0
        ds[a] = 0.0
        for i in range(order + 1):
            qs[a] += N[i] * q[e * order + i, a]
            ds[a] += dN[i] / h[e] * q[e * order + i, a]
    n = tangent(qs, t)
    w, x1, y, z = qs[0], qs[1], qs[2], qs[3]
    p = w * ds[0] + x1 * ds[1] + y * ds[2] + z * ds[3]
    dt[0] = 2.0 / n * (y * ds[0] + z * ds[1] + w * ds[2] + x1 * ds[3] - t[0] * p)
    dt[1] = 2.0 / n * (-x1 * ds[0] - w * ds[1] + z * ds[2] + y * ds[3] - t[1] * p)
    dt[2] = 2.0 / n * (w * ds[0] - x1 * ds[1] - y * ds[2] + z * ds[3] - t[2] * p)


@njit(**OPTIONS)
def pull(qs, P, weight, gT, H):
    """Gradient (4,) and Hessian (4, 4) by q of - weight P.t(q)."""
    w, x, y, z = qs[0], qs[1], qs[2], qs[3]
    t = np.empty(3)
    n = tangent(qs, t)
    T = -(P[0] * t[0] + P[1] * t[1] + P[2] * t[2])
    u = 2.0 * weight / n
    gT[0] = -u * (P[2] * w - P[1] * x + P[0] * y + T * w)
    gT[1] = -u * (-P[1] * w - P[2] * x + P[0] * z + T * x)
    gT[2] = -u * (P[0] * w - P[2] * y + P[1] * z + T * y)
    gT[3] = -u * (P[0] * x + P[1] * y + P[2] * z + T * z)
    a, b, c, d = u * P[0], u * P[1], u * P[2], u * T
    H[0, 0], H[1, 1], H[2, 2], H[3, 3] = -c - d, c - d, c - d, -c - d
    H[0, 1], H[0, 2], H[0, 3] = b, -a, 0.0
    H[1, 2], H[1, 3], H[2, 3] = 0.0, -a, -b
    for i in range(4):
        for j in range(i, 4):
            H[i, j] -= 2.0 / n * (gT[i] * qs[j] + gT[j] * qs[i])
            H[j, i] = H[i, j]
