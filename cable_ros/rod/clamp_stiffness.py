# SPDX-License-Identifier: Apache-2.0
"""Compiled: how both clamps' wrenches answer to small motions of the clamps, from the factored tangent."""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import njit
from cable_ros.linalg.bordered import end_coupling, end_rows, saddle_step
from cable_ros.linalg.vectors import cross
from cable_ros.rod import quaternion
from cable_ros.rod.energy_kernels import gradient
from cable_ros.rod.rod_state import Evaluation, Section, grid_of, system_of

OPTIONS = {"cache": True, "error_model": "numpy"}


@njit(**OPTIONS)
def clamp_response(q, F, conditions, grid, system):
    """Derivative (12, 12) of both clamps' wrenches on the cable by their motions, in units of the cable.

    Rows: force and moment at the start, then at the end, each in its clamp's frame. Columns: translation
    along and rotation about the start clamp's own axes, then the end clamp's. The load is fixed in the world:
    it turns against a start clamp that turns.

    Args:
        q, F: equilibrium: nodal frames (n, 4), end force (3,).
        conditions: fields of `Conditions`, as a plain tuple, see `entry_points`; so are the next ones.
        grid: of `Grid`.
        system: of `System` at that equilibrium, factored.
    """
    qe, re, f = conditions
    grid = grid_of(grid)
    evaluation, tangents, factors = system_of(system)
    elastic, geometric, _, C = tangents
    g = evaluation.g
    order = grid.tables.values.shape[1] - 1
    nodes = q.shape[0]
    n = 3 * nodes
    band = elastic.shape[1] - 1
    # by motion of the end in the start's frame (6), then by the load in the start's frame (3)
    inner = np.empty((12, 9))
    right, s = np.empty(n), np.empty(n)
    c, dF, theta, unit = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    load, radial, totals = np.empty((nodes, 3)), np.empty(nodes), np.empty(5)
    without = Section(np.zeros(3), np.zeros(3))
    back = quaternion.conjugate(qe)
    Fb = quaternion.rotate(back, F)
    M = g[nodes - 1]
    for k in range(9):
        for i in range(n):
            right[i] = 0.0
        for i in range(3):
            c[i], theta[i], unit[i] = 0.0, 0.0, 0.0
        unit[k % 3] = 1.0
        if k < 3:
            x, y, z = quaternion.turned(qe, unit)
            c[0], c[1], c[2] = -x, -y, -z
        elif k < 6:
            theta[k - 3] = 1.0
            end_coupling(tangents, C, 3, theta, right, c)
        else:
            # the gradient is linear in the load: that of a cable without stiffness and end force is its
            # derivative
            pull, force = np.zeros((nodes, 4)), np.zeros((grid.h.shape[0], 3))
            gradient(q, force, unit, without, grid, Evaluation(pull, load, radial, totals, evaluation.lanes))
            for i in range(nodes):
                for a in range(3):
                    right[3 * i + a] = load[i, a]
        saddle_step(right, c, C, order, factors, s, dF)
        moment = end_rows(tangents, C, 3, s, dF)
        for i in range(3):
            moment[i] += right[n - 3 + i]
            for j in range(3):
                row, at = n - 3 + max(i, j), band - abs(i - j)
                moment[i] += (elastic[row, at] + geometric[row, at]) * theta[j]
        # components along axes that turn with the clamp; the gradient's half turn is the chart's
        turned = cross(theta, Fb)
        half = cross(theta, M)
        dFb = quaternion.turned(back, dF)
        for i in range(3):
            inner[i, k] = -dF[i] - (unit[i] if k >= 6 else 0.0)
            inner[3 + i, k] = right[i]
            for j in range(3, min(band + 1 + i, n - 3)):
                inner[3 + i, k] += (elastic[j, band + i - j] + geometric[j, band + i - j]) * s[j]
            for a in range(3):
                inner[3 + i, k] -= C[a, i] * dF[a]
            inner[6 + i, k] = dFb[i] - turned[i]
            inner[9 + i, k] = moment[i] - 0.5 * half[i]
    # in the frame of a start clamp that moves, the end and the load move backwards
    out = np.empty((12, 12))
    for i in range(12):
        for k in range(6):
            out[i, 6 + k] = inner[i, k]
    for k in range(3):
        for i in range(3):
            unit[i] = 0.0
        unit[k] = 1.0
        along = quaternion.turned(back, unit)
        across = quaternion.turned(back, cross(unit, re))
        turned = cross(unit, f)
        for i in range(12):
            translation, turn = 0.0, 0.0
            for a in range(3):
                translation -= inner[i, a] * along[a]
                turn -= inner[i, a] * across[a] + inner[i, 3 + a] * along[a] + inner[i, 6 + a] * turned[a]
            out[i, k] = translation
            out[i, 3 + k] = turn
    return out
