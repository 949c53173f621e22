# SPDX-License-Identifier: Apache-2.0
"""Compiled: Newton's method on the equations of `nodal_kernels`."""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, njit
from cable_ros.contact.nodal_kernels import residuals
from cable_ros.contact.nodal_tangent import jacobian
from cable_ros.linalg.band_lu import band_factor, band_solve
from cable_ros.rod import quaternion

OPTIONS = {"cache": True, "error_model": "numpy"}

CONVERGED, STALLED, SINGULAR = 0, 1, 2
"""How `newton` ended."""
ITERATIONS, CLOSE, MOST = 30, 0.05, 45
"""Number of iterations after which the step must be this small, and the maximum number, both without drag:
beyond it the active set is assumed to cycle."""
LARGEST = 0.5
"""Maximum rotation of a section in one iteration, rad."""
FARTHER = 3.0
"""Maximum extrapolation, in lengths of the last step."""


@njit(**INNER)
def move(state, b, part, rows, new):
    """The `State` new = state + part * b, with the step b (unknowns,) numbered by `rows` (`Rows`)."""
    q, r, F, lam, tau = state
    q_new, r_new, F_new, lam_new, tau_new = new
    rows_r, rows_psi, rows_F, rows_c = rows
    psi = np.zeros(3 * q.shape[0])
    for i in range(1, q.shape[0]):
        for c in range(3):
            psi[3 * i + c] = part * b[rows_psi[i] + c]
    quaternion.retract(q, psi, q_new)
    for k in range(r.shape[0]):
        for c in range(3):
            r_new[k, c] = r[k, c] + (part * b[rows_r[k] + c] if k > 0 else 0.0)
    for e in range(F.shape[0]):
        for c in range(3):
            F_new[e, c] = F[e, c] + part * b[rows_F[e] + c]
        for o in range(lam.shape[1]):
            row = rows_c[e, o]
            lam_new[e, o] = lam[e, o]
            tau_new[e, o, 0], tau_new[e, o, 1] = tau[e, o, 0], tau[e, o, 1]
            if row >= 0:
                lam_new[e, o] += part * b[row]
                tau_new[e, o, 0] += part * b[row + 1]
                tau_new[e, o, 1] += part * b[row + 2]


@njit(**OPTIONS)
def state_moved(state, b, part, rows, new):
    """`move` as Python calls it."""
    move(state, b, part, rows, new)


@njit(**OPTIONS)
def extrapolate(state, before, re, drag):
    """Extrapolate `state` in place from the equilibrium `before`, as far as the end goes on along its path.

    Returns false, with the state unchanged, if the end (re (3,), L) does not go on or there is drag.
    """
    q, r = state.q, state.r
    end = r.shape[0] - 1
    along, size = 0.0, 0.0
    for c in range(3):
        went = r[end, c] - before.r[end, c]
        along += went * (re[c] - r[end, c])
        size += went * went
    if size < 1e-16 or drag > 0.0:
        return False
    part = along / size
    if not 0.0 < part < FARTHER:
        return False
    psi = np.zeros(3 * q.shape[0])
    for i in range(1, q.shape[0]):
        p = before.q[i]
        one = p[0], -p[1], -p[2], -p[3]
        psi[3 * i], psi[3 * i + 1], psi[3 * i + 2] = quaternion.turn(quaternion.product(one, q[i]))
    quaternion.retract(q, part * psi, q)
    for k in range(r.shape[0]):
        for c in range(3):
            r[k, c] += part * (r[k, c] - before.r[k, c])
    return True


@njit(**OPTIONS)
def newton(state, model, first, step, work, tangents, rows, band, trial, tolerance):
    """Solve for `state` in place, by full steps; returns (code, iterations).

    There is no line search: from one active set to the next the residuals may have to rise. The tangent of
    friction is changed so that it stays positive, which keeps the iteration from cycling, see `jacobian`.

    Args:
        state, model: `State` and `Model`.
        first: `Step` of the first iteration; with smaller scales, only what touched touches in it.
        step: `Step` of the others.
        work: `Work`.
        tangents, rows, band: `Tangents`, `Rows` and `Band`, overwritten.
        trial: `State`, overwritten.
        tolerance: of rotations, rad, positions, L, and forces, relative to the largest.
    """
    q, r, F, lam, tau = state
    a, b, pivots = band
    keeps = first.normal < step.normal
    for iteration in range(MOST):
        now = first if iteration == 0 else step
        residuals(state, model, now, work)
        if keeps and iteration == 0:
            # what touched moves along with its obstacle; what else touches shows then
            work.near[:] = lam != 0.0
        total, low = jacobian(state, model, now, work, tangents, rows, a, b)
        if not band_factor(a, total, low, pivots):
            return SINGULAR, iteration
        band_solve(a, total, low, pivots, b)
        turned, gone, force, scale = 0.0, 0.0, 0.0, 1e-3
        for i in range(1, q.shape[0]):
            for c in range(3):
                turned = max(turned, abs(b[rows.psi[i] + c]))
        for k in range(1, r.shape[0]):
            for c in range(3):
                gone = max(gone, abs(b[rows.r[k] + c]))
        for e in range(F.shape[0]):
            for c in range(3):
                force = max(force, abs(b[rows.F[e] + c]))
                scale = max(scale, abs(F[e, c]))
        size = max(turned, gone, force / scale)
        if not np.isfinite(size):
            return SINGULAR, iteration
        part = 1.0 if turned <= LARGEST else LARGEST / turned
        move(state, b, part, rows, trial)
        q[:], r[:], F[:], lam[:], tau[:] = trial[0], trial[1], trial[2], trial[3], trial[4]
        if size < tolerance and not (keeps and iteration == 0):
            residuals(state, model, step, work)
            return CONVERGED, iteration + 1
        if iteration + 1 >= ITERATIONS and (size > CLOSE or step.drag > 0.0):
            return STALLED, iteration + 1
    return STALLED, MOST
