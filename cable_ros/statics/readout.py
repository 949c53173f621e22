"""Compiled: what an equilibrium says in SI units and in the world: wrenches and polyline."""

from __future__ import annotations

import numpy as np
from numba import njit

from cable_ros.mechanics import quaternion

OPTIONS = {"cache": True, "error_model": "numpy"}


@njit(**OPTIONS)
def wrenches(F, f, qe, g, force, moment, end_wrench, start_wrench):
    """End and start wrench (6,) in SI: what the cable exerts on the bodies, in the clamps' frames.

    `g` (n, 3): the gradient at the equilibrium; its end rows are the moments of the clamps on the cable.
    """
    Fb = quaternion.rotate(quaternion.conjugate(qe), F)
    last = g.shape[0] - 1
    for a in range(3):
        end_wrench[a] = -force * Fb[a]
        end_wrench[3 + a] = -moment * g[last, a]
        start_wrench[a] = force * (F[a] + f[a])
        start_wrench[3 + a] = -moment * g[0, a]


@njit(**OPTIONS)
def polyline(q, h, element, values, weights, quadrature, start, length, out_r, out_q):
    """World points (m, 3) and frames (m, 4) x y z w at the arc lengths that `elements.Sampling` stands for.

    `quadrature` (g, order + 1): shape functions at the g points whose tangents `weights` (m, g) integrates
    from the element's start; `start` (7,): the start clamp in the world, position and quaternion x y z w;
    `length` in m.
    """
    order = values.shape[1] - 1
    points = quadrature.shape[0]
    qs = np.empty(4)
    r0 = np.zeros(3)
    t = np.empty((points, 3))
    at = 0
    orientation = np.empty(4)
    orientation[0], orientation[1], orientation[2], orientation[3] = start[6], start[3], start[4], start[5]
    for e in range(h.shape[0]):
        first = e * order
        for k in range(points):
            for a in range(4):
                v = 0.0
                for i in range(order + 1):
                    v += quadrature[k, i] * q[first + i, a]
                qs[a] = v
            w, x, y, z = qs[0], qs[1], qs[2], qs[3]
            n = 1.0 / (w * w + x * x + y * y + z * z)
            t[k, 0] = 2.0 * n * (x * z + w * y)
            t[k, 1] = 2.0 * n * (y * z - w * x)
            t[k, 2] = n * (w * w - x * x - y * y + z * z)
        while at < element.shape[0] and element[at] == e:
            p = r0.copy()
            for k in range(points):
                for a in range(3):
                    p[a] += h[e] * weights[at, k] * t[k, a]
            for a in range(4):
                v = 0.0
                for i in range(order + 1):
                    v += values[at, i] * q[first + i, a]
                qs[a] = v
            scale = 1.0 / np.sqrt(qs[0] * qs[0] + qs[1] * qs[1] + qs[2] * qs[2] + qs[3] * qs[3])
            p = quaternion.rotate(orientation, p)
            o = quaternion.multiply(orientation, qs)
            for a in range(3):
                out_r[at, a] = start[a] + length * p[a]
                out_q[at, a] = scale * o[a + 1]
            out_q[at, 3] = scale * o[0]
            at += 1
        # the last row of the weights is the whole element
        for k in range(points):
            for a in range(3):
                r0[a] += h[e] * weights[element.shape[0], k] * t[k, a]
