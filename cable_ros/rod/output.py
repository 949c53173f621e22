# SPDX-License-Identifier: Apache-2.0
"""Compiled: what an equilibrium says in SI units and in the world: wrenches and polyline."""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, LEAF, LEAF_ENTRY, njit
from cable_ros.rod import quaternion
from cable_ros.rod.centreline import curve, find_element, position
from cable_ros.rod.rod_state import Sampling

OPTIONS = {"cache": True, "error_model": "numpy"}


@njit(**LEAF_ENTRY)
def wrenches(F, f, contact, qe, g, force, moment, end_wrench, start_wrench):
    """End and start wrench (6,) in SI: what the cable exerts on the bodies, in the clamps' frames.

    Args:
        F, f, contact: (3,) end force, load and the obstacles' force on the cable, EI / L^2.
        qe: (4,) end frame.
        g: (n, 3) gradient at the equilibrium, whose end rows are the moments of the clamps on the cable.
        force, moment: the cable's units, N and Nm.
        end_wrench, start_wrench: (6,) receive the wrenches, N and Nm.
    """
    Fb = quaternion.turned((qe[0], -qe[1], -qe[2], -qe[3]), F)
    last = g.shape[0] - 1
    for a in range(3):
        end_wrench[a] = -force * Fb[a]
        end_wrench[3 + a] = -moment * g[last, a]
        start_wrench[a] = force * (F[a] + f[a] + contact[a])
        start_wrench[3 + a] = -moment * g[0, a]


@njit(**OPTIONS)
def read(q, h, start, F, f, contact, qe, g, table, out):
    """`wrenches` and `polyline` in one call from Python.

    Args:
        q, h, start: as in `polyline`.
        F, f, contact, qe, g: as in `wrenches`.
        table: the cable's units of force, moment and length, N, Nm, m; the fields of `rod_state.Sampling`.
        out: end and start wrench (6,), points (c, 3) and frames (c, 4), overwritten.
    """
    scale, sampling = table
    end_wrench, start_wrench, out_r, out_q = out
    wrenches(F, f, contact, qe, g, scale[0], scale[1], end_wrench, start_wrench)
    polyline(q, h, Sampling(*sampling), start, scale[2], out_r, out_q)


@njit(**OPTIONS)
def read_anywhere(q, mesh, start, F, f, contact, qe, g, table, out):
    """`wrenches` and `polyline_anywhere` in one call from Python.

    Args:
        q, start, out: as in `read`.
        mesh: lengths of the elements and the arc lengths at which they start, (m,) each.
        F, f, contact, qe, g: as in `wrenches`.
        table: as in `read`, but then what `elements.integrals` returns, and the arc lengths (c,), L.
    """
    scale, tables, at = table
    end_wrench, start_wrench, out_r, out_q = out
    h, s0 = mesh
    values, primitives, powers = tables
    wrenches(F, f, contact, qe, g, scale[0], scale[1], end_wrench, start_wrench)
    polyline_anywhere(q, h, s0, values, primitives, powers, at, start, scale[2], out_r, out_q)


@njit(**LEAF)
def turn(start, q, out):
    """Nodal quaternions q (n, 4), turned from the start clamp at `start` (7,) into the world: `out` (n, 4).

    Interpolation is linear in them: so is every quaternion between, turned once and for all.
    """
    w, x, y, z = start[6], start[3], start[4], start[5]
    for i in range(q.shape[0]):
        a, b, c, d = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        out[i, 0] = w * a - x * b - y * c - z * d
        out[i, 1] = w * b + x * a + y * d - z * c
        out[i, 2] = w * c - x * d + y * a + z * b
        out[i, 3] = w * d + x * c - y * b + z * a


@njit(**INNER)
def polyline(q, h, sampling, start, length, out_r, out_q):
    """World points and frames x y z w at the arc lengths of a sampling.

    Args:
        q: (n, 4) nodal frames.
        h: (m,) lengths of the elements.
        sampling: `rod_state.Sampling` of c points.
        start: (7,) the start clamp in the world, m, quaternion x y z w.
        length: of the cable, m.
        out_r, out_q: (c, 3), (c, 4) receive points, m, and frames.
    """
    element, values, weights, quadrature, _ = sampling
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


@njit(**INNER)
def polyline_anywhere(q, h, s0, values, primitives, powers, at, start, length, out_r, out_q):
    """`polyline` at the arc lengths `at` (c,), L, on elements whose lengths change from solve to solve.

    Args:
        q, h, start, length, out_r, out_q: as in `polyline`.
        s0: (m,) arc lengths at which the elements start.
        values, primitives, powers: see `elements.integrals`.
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
    for i in range(at.shape[0]):
        s = at[i]
        position(c, h, s0, s, r)
        for b in range(3):
            out_r[i, b] = start[b] + length * r[b]
        e, fraction = find_element(s, s0, h)
        w, x, y, z = 0.0, 0.0, 0.0, 0.0
        for k in range(order, -1, -1):
            w = w * fraction + frames[e, k, 0]
            x = x * fraction + frames[e, k, 1]
            y = y * fraction + frames[e, k, 2]
            z = z * fraction + frames[e, k, 3]
        n = 1.0 / np.sqrt(w * w + x * x + y * y + z * z)
        out_q[i, 0], out_q[i, 1], out_q[i, 2], out_q[i, 3] = n * x, n * y, n * z, n * w
