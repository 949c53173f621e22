"""Compiled: how both clamps' wrenches answer to small motions of the clamps, from the factored tangent."""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import njit
from cable_ros.mechanics import quaternion
from cable_ros.mechanics.kernels import gradient, workspace
from cable_ros.statics.compiled import border_step, end_coupling, end_rows, saddle_step

OPTIONS = {"cache": True, "error_model": "numpy"}


@njit(**OPTIONS)
def clamp_response(q, F, qe, re, f, h, s0, tables, elastic, geometric, C, order, L, pivots, Y, S, g):
    """Derivative (12, 12) of both clamps' wrenches on the cable by their motions, in units of the cable.

    Rows: force and moment at the start, then at the end, each in its clamp's frame. Columns: translation
    along and rotation about the start clamp's own axes, then the end clamp's. Needs the factors at the
    equilibrium itself and its gradient `g` (n, 3). The load `f` is fixed in the world: it turns against a
    start clamp that turns.
    """
    nodes = q.shape[0]
    n = 3 * nodes
    band = elastic.shape[1] - 1
    # by motion of the end in the start's frame (6), then by the load in the start's frame (3)
    inner = np.empty((12, 9))
    right, s = np.empty(n), np.empty(n)
    c, dF, theta, unit = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    load, radial, totals = np.empty((nodes, 3)), np.empty(nodes), np.empty(5)
    nothing, lanes = np.zeros(3), workspace(h, tables)
    back = quaternion.conjugate(qe)
    Fb = quaternion.rotate(back, F)
    M = g[nodes - 1]
    for k in range(9):
        right[:], c[:], theta[:], unit[:] = 0.0, 0.0, 0.0, 0.0
        unit[k % 3] = 1.0
        if k < 3:
            c[:] = -quaternion.rotate(qe, unit)
        elif k < 6:
            theta[:] = unit
            end_coupling(elastic, geometric, C, 3, theta, right, c)
        else:
            # the gradient is linear in the load: that of a cable without stiffness and end force is its
            # derivative
            pull, force = np.zeros((nodes, 4)), np.zeros((h.shape[0], 3))
            gradient(q, force, unit, nothing, nothing, h, s0, tables, lanes, pull, load, radial, totals)
            right[:] = load.ravel()
        saddle_step(right, c, C, order, L, pivots, Y, S, s, dF)
        moment = end_rows(elastic, geometric, C, 3, s, dF)
        for i in range(3):
            moment[i] += right[n - 3 + i]
            for j in range(3):
                row, at = n - 3 + max(i, j), band - abs(i - j)
                moment[i] += (elastic[row, at] + geometric[row, at]) * theta[j]
        # components along axes that turn with the clamp; the gradient's half turn is the chart's
        turned = np.cross(theta, Fb)
        half = np.cross(theta, M)
        dFb = quaternion.rotate(back, dF)
        for i in range(3):
            inner[i, k] = -dF[i] - (unit[i] if k >= 6 else 0.0)
            inner[3 + i, k] = right[i]
            for j in range(3, min(band + 1 + i, n - 3)):
                inner[3 + i, k] += (elastic[j, band + i - j] + geometric[j, band + i - j]) * s[j]
            for a in range(3):
                inner[3 + i, k] -= C[a, i] * dF[a]
            inner[6 + i, k] = dFb[i] - turned[i]
            inner[9 + i, k] = moment[i] - 0.5 * half[i]
    # seen from the start clamp that moves, the end and the load move the other way
    out = np.empty((12, 12))
    out[:, 6:] = inner[:, :6]
    for k in range(3):
        unit[:] = 0.0
        unit[k] = 1.0
        along = quaternion.rotate(back, unit)
        across = quaternion.rotate(back, np.cross(unit, re))
        turned = np.cross(unit, f)
        for i in range(12):
            slide, turn = 0.0, 0.0
            for a in range(3):
                slide -= inner[i, a] * along[a]
                turn -= inner[i, a] * across[a] + inner[i, 3 + a] * along[a] + inner[i, 6 + a] * turned[a]
            out[i, k] = slide
            out[i, 3 + k] = turn
    return out


@njit(**OPTIONS)
def border_response(
    F, start, qe, elastic, geometric, V, rows, lines, order, L, pivots, Y, S, g
):  # fmt: skip
    """`clamp_response` of a rod that touches obstacles, which stay where they are in the world.

    The borders V (rows, 3n) read the position along `lines` (rows, 3), the end's first; `start` (3,) is the
    internal force at the start clamp. The start clamp moves by itself here, all else at rest.
    """
    n, band = elastic.shape[0], elastic.shape[1] - 1
    out = np.empty((12, 12))
    right, s = np.empty(n), np.empty(n)
    c, y = np.empty(rows), np.empty(rows)
    unit, turn0, turn1 = np.empty(3), np.empty(3), np.empty(3)
    back = quaternion.conjugate(qe)
    Fb = quaternion.rotate(back, F)
    first, last = g[0], g[g.shape[0] - 1]
    for k in range(12):
        right[:], c[:], unit[:], turn0[:], turn1[:] = 0.0, 0.0, 0.0, 0.0, 0.0
        unit[k % 3] = 1.0
        if k < 3:
            for a in range(rows):
                c[a] = unit[k] if a == k else (0.0 if a < 3 else lines[a, k])
        elif k < 6:
            turn0[:] = unit
            for i in range(3):
                for j in range(i, min(i + band + 1, n - 3)):
                    right[j] += (elastic[j, band + i - j] + geometric[j, band + i - j]) * unit[i]
                for j in range(i):
                    right[j] += (elastic[i, band + j - i] + geometric[i, band + j - i]) * unit[i]
                for a in range(rows):
                    c[a] += V[a, i] * unit[i]
        elif k < 9:
            c[:3] = -quaternion.rotate(qe, unit)
        else:
            turn1[:] = unit
            end_coupling(elastic, geometric, V, rows, turn1, right, c)
        border_step(right, c, V, rows, order, L, pivots, Y, S, s, y)
        moment = end_rows(elastic, geometric, V, rows, s, y)
        for i in range(3):
            moment[i] += right[n - 3 + i]
            for j in range(3):
                row, at = n - 3 + max(i, j), band - abs(i - j)
                moment[i] += (elastic[row, at] + geometric[row, at]) * turn1[j]
        dF = y[:3].copy()
        turned = np.cross(turn1, Fb)
        half = np.cross(turn1, last)
        dFb = quaternion.rotate(back, dF)
        turned0 = np.cross(turn0, start)
        half0 = np.cross(turn0, first)
        for i in range(3):
            total = dF[i]
            for a in range(3, rows):
                total += y[a] * lines[a, i]
            out[i, k] = -total + turned0[i]
            out[3 + i, k] = right[i] - 0.5 * half0[i]
            for j in range(3, min(band + 1 + i, n - 3)):
                out[3 + i, k] += (elastic[j, band + i - j] + geometric[j, band + i - j]) * s[j]
            for a in range(rows):
                out[3 + i, k] -= V[a, i] * y[a]
            out[6 + i, k] = dFb[i] - turned[i]
            out[9 + i, k] = moment[i] - 0.5 * half[i]
    return out
