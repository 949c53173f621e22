# SPDX-License-Identifier: Apache-2.0
"""Compiled: points and tangents of a rod's centreline, from its nodal frames, and their derivatives."""

from __future__ import annotations

from cable_ros.compilation import LEAF, LEAF_ENTRY, njit
from cable_ros.rod import quaternion


@njit(**LEAF)
def shape(nodes, x, N, dN):
    """Values N and slopes dN (p + 1,) at x of the Lagrange polynomials through `nodes` (p + 1,)."""
    for i in range(nodes.shape[0]):
        N[i], dN[i] = lagrange(nodes, i, x)


@njit(**LEAF)
def lagrange(nodes, i, x):
    """Value and slope at x of the Lagrange polynomial through `nodes` (p + 1,) that is 1 at node i."""
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


@njit(**LEAF_ENTRY)
def curve(q, h, N, primitives, c):
    """Coefficients of the centreline: sum_k c[e, k] x^k at x in [0, 1] of element e.

    It integrates the polynomial through the tangents at the element's Gauss points, so that its ends are
    where the solver has them.

    Args:
        q: (n, 4) nodal frames.
        h: (m,) lengths of the elements.
        N, primitives: `values` (g, p + 1) and `primitives` (g, g) of `rod_state.Tables`.
        c: (m, g + 1, 3) overwritten.
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
def close_curve(q, h, bubbles, c, out):
    """The `curve` c with the tangents of the frames at the ends of elements, the most accurate ones.

    Args:
        q, h: as in `curve`.
        bubbles: (2, g + 2), see `elements.end_bubbles`.
        c: (m, g + 1, 3) the curve.
        out: (m, g + 3, 3) overwritten.
    """
    top = c.shape[1]
    order = top - 1
    for e in range(h.shape[0]):
        # what the tangents miss, in the space for the highest powers
        tangent(q[e * order], out[e, top])
        tangent(q[(e + 1) * order], out[e, top + 1])
        for a in range(3):
            start, end = h[e] * out[e, top, a] - c[e, 1, a], h[e] * out[e, top + 1, a]
            for k in range(top):
                out[e, k, a] = c[e, k, a]
                end -= k * c[e, k, a]
            out[e, top, a] = out[e, top + 1, a] = 0.0
            for k in range(top + 1):
                out[e, k + 1, a] += bubbles[0, k] * start + bubbles[1, k] * end


@njit(**LEAF)
def lengthen(curves, ratio, shift):
    """Tell where the cable was in units of another length, by the arc lengths that its material has now.

    Args:
        curves: coefficients of the centreline, c, and the same closed, lengths h and starts s0 of the
            elements, overwritten.
        ratio, shift: by which arc lengths grow, and what is added to them then.
    """
    c, closed, h, s0 = curves
    for e in range(h.shape[0]):
        h[e] *= ratio
        s0[e] = ratio * s0[e] + shift
        for k in range(c.shape[1]):
            for a in range(c.shape[2]):
                c[e, k, a] *= ratio
        for k in range(closed.shape[1]):
            for a in range(3):
                closed[e, k, a] *= ratio


@njit(**LEAF)
def find_element(s, s0, h):
    """Element of the arc length s and x in [0, 1] in it; the elements have lengths h (m,), starts s0 (m,)."""
    e = 0
    while e + 1 < s0.shape[0] and s >= s0[e + 1]:
        e += 1
    x = (s - s0[e]) / h[e]
    return e, min(max(x, 0.0), 1.0)


@njit(**LEAF_ENTRY)
def position(c, h, s0, s, r):
    """Position r (3,) at arc length s on a `curve` c, on elements of lengths h (m,) that start at s0 (m,)."""
    e, x = find_element(s, s0, h)
    top = c.shape[1] - 1
    for a in range(3):
        v = c[e, top, a]
        for k in range(top - 1, -1, -1):
            v = v * x + c[e, k, a]
        r[a] = v


@njit(**LEAF_ENTRY)
def place(c, h, s0, s, start, length, r):
    """`position` of a cable of this length, m, in the world: r (3,), m.

    `start` (7,): its start clamp there, m, quaternion x y z w.
    """
    position(c, h, s0, s, r)
    turn = start[6], start[3], start[4], start[5]
    x, y, z = quaternion.turned(turn, (length * r[0], length * r[1], length * r[2]))
    r[0], r[1], r[2] = start[0] + x, start[1] + y, start[2] + z


@njit(**LEAF)
def elongation(c, h, s0, s):
    """1 + axial strain at arc length s, of a centreline c (m, g + 1, 4) that has the stretched arc length."""
    e, x = find_element(s, s0, h)
    return rate(c, h, e, x)


@njit(**LEAF)
def elongation_before(c, h, s0, s):
    """As `elongation`, where it jumps that before s."""
    e, x = find_element(s, s0, h)
    return rate(c, h, e - 1, 1.0) if x == 0.0 and e > 0 else rate(c, h, e, x)


@njit(**LEAF)
def derivative(c, h, s0, s, out):
    """Derivative of `position` by the arc length s, out (3,)."""
    e, x = find_element(s, s0, h)
    top = c.shape[1] - 1
    for a in range(3):
        v = top * c[e, top, a]
        for k in range(top - 1, 0, -1):
            v = v * x + k * c[e, k, a]
        out[a] = v / h[e]


@njit(**LEAF)
def rate(c, h, e, x):
    """`elongation` at x in [0, 1] of the element e."""
    top = c.shape[1] - 1
    v = top * c[e, top, 3]
    for k in range(top - 1, 0, -1):
        v = v * x + k * c[e, k, 3]
    return v / h[e]


@njit(**LEAF_ENTRY)
def direction(q, h, s0, nodes, s, t, dt):
    """Tangent t (3,) and its derivative dt (3,) by the arc length, at s.

    Args:
        q: (n, 4) nodal frames.
        h, s0: (m,) lengths of the elements and the arc lengths at which they start.
        nodes: (p + 1,) of `rod_state.Tables`.
        s: arc length, L.
        t, dt: receive the results.
    """
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


@njit(**LEAF)
def tangent_derivative(q, t, weight, D, C, first, count):
    """Add the tangent's derivative along `count` columns of D to C (3, ...) from column `first` on.

    Component a is (2 / n) (S_a q - t_a q), with t_a = q.S_a q / n.

    Args:
        q, t: (4,), (3,) quaternion of any length and its tangent.
        weight: comes with the 2 / n.
        D: (4, ...) derivatives of q.
        C: receives the sum.
        first, count: columns.
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
    """Derivative (4, 3) of the quaternion q (4,) by its rotation vector, in `out` (4, ...) from column c."""
    w, x, y, z = 0.5 * q[0], 0.5 * q[1], 0.5 * q[2], 0.5 * q[3]
    out[0, c], out[1, c], out[2, c], out[3, c] = -x, w, z, -y
    out[0, c + 1], out[1, c + 1], out[2, c + 1], out[3, c + 1] = -y, -z, w, x
    out[0, c + 2], out[1, c + 2], out[2, c + 2], out[3, c + 2] = -z, y, -x, w


@njit(**LEAF)
def weight_up_to(primitives, k, x):
    """Weight w_k(x) of the tangent t_k at Gauss point k: r(x) - r(0) = h sum_k w_k(x) t_k on an element.

    It is the integral of the k-th Lagrange polynomial of the Gauss points from 0 to x.

    Args:
        primitives: (g, g) of `rod_state.Tables`.
        k: the Gauss point.
        x: in [0, 1].
    """
    v = 0.0
    for m in range(primitives.shape[0] - 1, -1, -1):
        v = (v + primitives[m, k]) * x
    return v


@njit(**LEAF)
def interpolate_frame(q, first, order, N, frame, qs, D):
    """Interpolated quaternion and its derivative by the nodal rotations of an element.

    Args:
        q, first, order: (n, 4) nodal frames, the element's first node and order p.
        N: (p + 1,) shape functions.
        frame: (4, 3 (p + 1)) derivatives of the nodal quaternions, see `increments`.
        qs, D: (4,), (4, 3 (p + 1)) receive the results.
    """
    for a in range(4):
        qs[a] = 0.0
        for j in range(order + 1):
            qs[a] += N[j] * q[first + j, a]
            for m in range(3 * j, 3 * j + 3):
                D[a, m] = N[j] * frame[a, m]
