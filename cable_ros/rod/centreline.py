# SPDX-License-Identifier: Apache-2.0
"""Compiled: points and tangents of a rod's centreline, from its nodal frames."""

from __future__ import annotations

from cable_ros.compilation import LEAF, njit


@njit(**LEAF)
def shape(nodes, x, N, dN):
    """Values and slopes (order + 1,) of the Lagrange polynomials through `nodes` at x."""
    for i in range(nodes.shape[0]):
        N[i], dN[i] = lagrange(nodes, i, x)


@njit(**LEAF)
def lagrange(nodes, i, x):
    """Value and slope at x of the Lagrange polynomial that is 1 at node i."""
    v, d, size = 1.0, 0.0, 1.0
    for k in range(nodes.shape[0]):
        if k != i:
            d = d * (x - nodes[k]) + v
            v *= x - nodes[k]
            size *= nodes[i] - nodes[k]
    size = 1.0 / size
    return size * v, size * d


@njit(**LEAF)
def tangent(q, t):
    """Tangent t (3,) of the frame q (4,) of any length; returns its squared length."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    n = w * w + x * x + y * y + z * z
    i = 1.0 / n
    t[0] = 2.0 * i * (x * z + w * y)
    t[1] = 2.0 * i * (y * z - w * x)
    t[2] = i * (w * w - x * x - y * y + z * z)
    return n


@njit(**LEAF)
def curve(q, h, N, primitives, c):
    """Coefficients c (elements, p + 1, 3) of the centreline: sum_k c[e, k] x^k at the place x of element e.

    It integrates the polynomial through the tangents at the element's p Gauss points, so that its ends are
    where the solver has them. `primitives` (p, p): see `Mesh`, integrals of the Lagrange polynomials through
    those points.
    """
    count = N.shape[0]
    order = N.shape[1] - 1
    c[0, 0, 0], c[0, 0, 1], c[0, 0, 2] = 0.0, 0.0, 0.0
    for e in range(h.shape[0]):
        for k in range(count):
            for a in range(3):
                c[e, k + 1, a] = 0.0
        for k in range(count):
            w, x, y, z = 0.0, 0.0, 0.0, 0.0
            for i in range(order + 1):
                w += N[k, i] * q[e * order + i, 0]
                x += N[k, i] * q[e * order + i, 1]
                y += N[k, i] * q[e * order + i, 2]
                z += N[k, i] * q[e * order + i, 3]
            u = h[e] / (w * w + x * x + y * y + z * z)
            t0, t1 = 2.0 * u * (x * z + w * y), 2.0 * u * (y * z - w * x)
            t2 = u * (w * w - x * x - y * y + z * z)
            for m in range(count):
                c[e, m + 1, 0] += primitives[m, k] * t0
                c[e, m + 1, 1] += primitives[m, k] * t1
                c[e, m + 1, 2] += primitives[m, k] * t2
        if e + 1 < h.shape[0]:
            for a in range(3):
                v = 0.0
                for m in range(count + 1):
                    v += c[e, m, a]
                c[e + 1, 0, a] = v


@njit(**LEAF)
def find_element(s, s0, h):
    """Element of the arc length s and the place in it, 0 to 1."""
    e = 0
    while e + 1 < s0.shape[0] and s >= s0[e + 1]:
        e += 1
    x = (s - s0[e]) / h[e]
    return e, min(max(x, 0.0), 1.0)


@njit(**LEAF)
def position(c, h, s0, s, r):
    """Position r (3,) at arc length s on the curve with the coefficients c."""
    e, x = find_element(s, s0, h)
    top = c.shape[1] - 1
    for a in range(3):
        v = c[e, top, a]
        for k in range(top - 1, -1, -1):
            v = v * x + c[e, k, a]
        r[a] = v


@njit(**LEAF)
def direction(q, h, s0, nodes, s, t, dt):
    """Tangent t (3,) and its derivative dt (3,) at arc length s."""
    e, x = find_element(s, s0, h)
    first = e * (nodes.shape[0] - 1)
    a, b, c, d = 0.0, 0.0, 0.0, 0.0
    da, db, dc, dd = 0.0, 0.0, 0.0, 0.0
    for i in range(nodes.shape[0]):
        v, slope = lagrange(nodes, i, x)
        a += v * q[first + i, 0]
        b += v * q[first + i, 1]
        c += v * q[first + i, 2]
        d += v * q[first + i, 3]
        da += slope * q[first + i, 0]
        db += slope * q[first + i, 1]
        dc += slope * q[first + i, 2]
        dd += slope * q[first + i, 3]
    u = 2.0 / tangent((a, b, c, d), t)
    p = a * da + b * db + c * dc + d * dd
    u /= h[e]
    dt[0] = u * (c * da + d * db + a * dc + b * dd - t[0] * p)
    dt[1] = u * (-b * da - a * db + d * dc + c * dd - t[1] * p)
    dt[2] = u * (a * da - b * db - c * dc + d * dd - t[2] * p)
