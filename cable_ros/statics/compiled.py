"""Compiled: the warm-started step; and, under one name, all that a rod's owner calls of the compiled statics.

The arrays that these functions share are those of `Rod` (rod.py); `tables` are `ReferenceElement.tables`.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import njit
from cable_ros.mechanics import quaternion
from cable_ros.mechanics.kernels import gradient, hessian
from cable_ros.statics.estimate import error, margin
from cable_ros.statics.readout import polyline, wrenches
from cable_ros.statics.saddle import (
    border_factor,
    border_step,
    end_coupling,
    end_rows,
    factor,
    negative3,
    saddle_step,
    solve3,
)

__all__ = [
    "ADVANCED",
    "NOT_CONTRACTING",
    "NOT_CONVEX",
    "TOO_FAR",
    "advance",
    "border_factor",
    "border_step",
    "close",
    "end_coupling",
    "end_rows",
    "error",
    "factor",
    "largest",
    "margin",
    "negative3",
    "polyline",
    "saddle_step",
    "solve3",
    "spread",
    "wrenches",
]

OPTIONS = {"cache": True, "error_model": "numpy"}

ADVANCED, TOO_FAR, NOT_CONTRACTING, NOT_CONVEX = 0, 1, 2, 3
"""How `advance` ended."""


@njit(**OPTIONS)
def advance(
    q, F, qe, re, f, K, kappa0, h, s0, tables,
    elastic, geometric, parts, C, A, L, pivots, Y, S, acc, g, radial, totals,
    tolerance, limit, drift, refresh, q_new, F_new,
):  # fmt: skip
    """From the equilibrium (q, F) to that with the end at (qe, re) and the load f, with the factors at hand.

    A tangent predictor, then corrections. The factors may be those of an equilibrium from which some section
    has turned by `drift` rad; once that is more than `refresh`, after a long step, and where they no longer
    contract, they are made anew. Stops TOO_FAR where the predictor turns a section by more than `limit`.
    `tolerance` bounds what is left of nodal rotation (rad) and relative end force. Returns (code, iterations,
    drift); drift 0: the factors are new.
    """
    N, dN, N3, dN3, points, weights = tables
    order = N.shape[1] - 1
    n = 3 * q.shape[0]
    gv = g.reshape(n)
    s = np.empty(n)
    dF = np.empty(3)
    c = np.empty(3)
    last = q.shape[0] - 1
    theta = quaternion.rotation_vector(quaternion.multiply(quaternion.conjugate(q[last]), qe))
    acc[:] = 0.0
    gradient(q, spread(F, h), f, K, kappa0, h, s0, N, dN, points, weights, acc, g, radial, totals)
    for a in range(3):
        c[a] = totals[a] - re[a]
    end_coupling(elastic, geometric, C, 3, theta, gv, c)
    saddle_step(gv, c, C, order, L, pivots, Y, S, s, dF)
    for k in range(3):
        s[n - 3 + k] = theta[k]
    moved = largest(s)
    if not moved <= limit:
        return TOO_FAR, 0, drift
    quaternion.retract(q, s, q_new)
    close(q_new, qe)
    for a in range(3):
        F_new[a] = F[a] + dF[a]
    drift += moved
    size, rate = moved, 0.0
    fresh = False
    iterations = 0
    for iteration in range(1, 13):
        acc[:] = 0.0
        Fe = spread(F_new, h)
        gradient(q_new, Fe, f, K, kappa0, h, s0, N, dN, points, weights, acc, g, radial, totals)
        if iteration > 1 and size * rate <= tolerance:
            return ADVANCED, iterations, drift
        iterations = iteration
        if (iteration == 1 and (drift > refresh or moved > 0.5 * refresh)) or rate > 0.15:
            hessian(
                q_new, Fe, f, K, kappa0, h, s0, N, dN, N3, dN3, points, weights, radial,
                elastic, geometric, parts, C,
            )  # fmt: skip
            if not factor(elastic, geometric, C, 0.0, order, A, L, pivots, Y, S):
                return NOT_CONVEX, iteration, drift
            fresh, drift = True, 0.0
        for a in range(3):
            c[a] = totals[a] - re[a]
        saddle_step(gv, c, C, order, L, pivots, Y, S, s, dF)
        quaternion.retract(q_new, s, q_new)
        close(q_new, qe)
        force, change = 1e-3, 0.0
        for a in range(3):
            F_new[a] += dF[a]
            force = max(force, abs(F_new[a]))
            change = max(change, abs(dF[a]))
        new = max(change / force, largest(s))
        # what the next correction would be: the ratio of the last two, no less than the factors' drift
        rate = max(min(new / size, 1.0) if iteration > 1 else 0.0, drift, 1e-3)
        if iteration > 1 and fresh and not new <= 0.5 * size:
            return NOT_CONTRACTING, iteration, drift
        size = new
    return NOT_CONTRACTING, iterations, drift


@njit(**OPTIONS)
def spread(F, h):
    """The same force F (3,) for every element: (elements, 3)."""
    out = np.empty((h.shape[0], 3))
    for e in range(h.shape[0]):
        out[e, 0], out[e, 1], out[e, 2] = F[0], F[1], F[2]
    return out


@njit(**OPTIONS)
def largest(s):
    """Largest absolute entry of s; NaN where one is."""
    out = 0.0
    for i in range(s.shape[0]):
        if not abs(s[i]) <= out:
            out = abs(s[i])
    return out


@njit(**OPTIONS)
def close(q, qe):
    """Put the last of q (n, 4) on the end frame qe or on its negative, whichever is nearer."""
    last = q.shape[0] - 1
    d = q[last, 0] * qe[0] + q[last, 1] * qe[1] + q[last, 2] * qe[2] + q[last, 3] * qe[3]
    for a in range(4):
        q[last, a] = qe[a] if d > 0.0 else -qe[a]
