# SPDX-License-Identifier: Apache-2.0
"""Compiled: what an equilibrium says in SI units and in the world: wrenches and polyline."""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import LEAF, njit
from cable_ros.rod import quaternion
from cable_ros.rod.centreline import curve, find_element, position

OPTIONS = {"cache": True, "error_model": "numpy"}


@njit(**LEAF)
def wrenches(F, f, held, qe, g, force, moment, end_wrench, start_wrench):
    """End and start wrench (6,) in SI: what the cable exerts on the bodies, in the clamps' frames.

    `held` (3,): as `Rod.held`; `g` (n, 3): the gradient at the equilibrium, whose end rows are the moments of
    the clamps on the cable.
    """
    Fb = quaternion.turned((qe[0], -qe[1], -qe[2], -qe[3]), F)
    last = g.shape[0] - 1
    for a in range(3):
        end_wrench[a] = -force * Fb[a]
        end_wrench[3 + a] = -moment * g[last, a]
        start_wrench[a] = force * (F[a] + f[a] + held[a])
        start_wrench[3 + a] = -moment * g[0, a]


@njit(**OPTIONS)
def read(
    q, F, f, held, qe, g, h, element, values, weights, quadrature, start, scale,
    end_wrench, start_wrench, out_r, out_q,
):  # fmt: skip
    """`wrenches` and `polyline`; `scale`: the cable's units of force and moment, and its length."""
    wrenches(F, f, held, qe, g, scale[0], scale[1], end_wrench, start_wrench)
    polyline(q, h, element, values, weights, quadrature, start, scale[2], out_r, out_q)


@njit(**OPTIONS)
def read_anywhere(
    q, F, f, held, qe, g, h, s0, tables, start, scale, end_wrench, start_wrench, out_r, out_q
):  # fmt: skip
    """`wrenches` and `polyline_anywhere`; `tables`: its values, primitives and powers."""
    wrenches(F, f, held, qe, g, scale[0], scale[1], end_wrench, start_wrench)
    polyline_anywhere(q, h, s0, tables[0], tables[1], tables[2], start, scale[2], out_r, out_q)


@njit(**LEAF)
def turn(start, q, out):
    """Nodal quaternions q (n, 4), turned from the start clamp at `start` (7,) into the world.

    Interpolation is linear in them: so is every quaternion between, turned once and for all.
    """
    w, x, y, z = start[6], start[3], start[4], start[5]
    for i in range(q.shape[0]):
        a, b, c, d = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        out[i, 0] = w * a - x * b - y * c - z * d
        out[i, 1] = w * b + x * a + y * d - z * c
        out[i, 2] = w * c - x * d + y * a + z * b
        out[i, 3] = w * d + x * c - y * b + z * a


@njit(**OPTIONS)
def polyline(q, h, element, values, weights, quadrature, start, length, out_r, out_q):
    """World points (m, 3) and frames (m, 4) x y z w at the arc lengths that `elements.Sampling` stands for.

    `quadrature` (g, order + 1): shape functions at the g points whose tangents `weights` (m, g) integrates
    from the element's start; `start` (7,): the start clamp in the world, position and quaternion x y z w;
    `length` in m.
    """
    order = values.shape[1] - 1
    points = quadrature.shape[0]
    count = element.shape[0]
    world = np.empty_like(q)
    turn(start, q, world)
    t = np.empty((3, points))
    r0, r1, r2 = start[0], start[1], start[2]
    at = 0
    for e in range(h.shape[0]):
        first = e * order
        step = length * h[e]
        for k in range(points):
            w, x, y, z = 0.0, 0.0, 0.0, 0.0
            for i in range(order + 1):
                v = quadrature[k, i]
                w += v * world[first + i, 0]
                x += v * world[first + i, 1]
                y += v * world[first + i, 2]
                z += v * world[first + i, 3]
            n = step / (w * w + x * x + y * y + z * z)
            t[0, k] = 2.0 * n * (x * z + w * y)
            t[1, k] = 2.0 * n * (y * z - w * x)
            t[2, k] = n * (w * w - x * x - y * y + z * z)
        while at < count and element[at] == e:
            p0, p1, p2 = r0, r1, r2
            for k in range(points):
                v = weights[at, k]
                p0 += v * t[0, k]
                p1 += v * t[1, k]
                p2 += v * t[2, k]
            out_r[at, 0], out_r[at, 1], out_r[at, 2] = p0, p1, p2
            w, x, y, z = 0.0, 0.0, 0.0, 0.0
            for i in range(order + 1):
                v = values[at, i]
                w += v * world[first + i, 0]
                x += v * world[first + i, 1]
                y += v * world[first + i, 2]
                z += v * world[first + i, 3]
            n = 1.0 / np.sqrt(w * w + x * x + y * y + z * z)
            out_q[at, 0], out_q[at, 1], out_q[at, 2], out_q[at, 3] = n * x, n * y, n * z, n * w
            at += 1
        # the last row of the weights is the whole element
        for k in range(points):
            v = weights[count, k]
            r0 += v * t[0, k]
            r1 += v * t[1, k]
            r2 += v * t[2, k]


@njit(**OPTIONS)
def polyline_anywhere(q, h, s0, values, primitives, powers, start, length, out_r, out_q):
    """`polyline` on elements whose lengths change from solve to solve; no tables of places.

    `values`, `primitives`, `powers`: see `elements.integrals`.
    """
    world = np.empty_like(q)
    turn(start, q, world)
    c = np.empty((h.shape[0], values.shape[0] + 1, 3))
    curve(world, h, values, primitives, c)
    order = powers.shape[0] - 1
    frames = np.zeros((h.shape[0], order + 1, 4))
    for e in range(h.shape[0]):
        for k in range(order + 1):
            for i in range(order + 1):
                for a in range(4):
                    frames[e, k, a] += powers[k, i] * world[e * order + i, a]
    r = np.empty(3)
    count = out_r.shape[0]
    for i in range(count):
        s = i / (count - 1)
        position(c, h, s0, s, r)
        for b in range(3):
            out_r[i, b] = start[b] + length * r[b]
        e, place = find_element(s, s0, h)
        w, x, y, z = 0.0, 0.0, 0.0, 0.0
        for k in range(order, -1, -1):
            w = w * place + frames[e, k, 0]
            x = x * place + frames[e, k, 1]
            y = y * place + frames[e, k, 2]
            z = z * place + frames[e, k, 3]
        n = 1.0 / np.sqrt(w * w + x * x + y * y + z * z)
        out_q[i, 0], out_q[i, 1], out_q[i, 2], out_q[i, 3] = n * x, n * y, n * z, n * w
