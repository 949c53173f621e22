# SPDX-License-Identifier: Apache-2.0
"""Compiled: what axial strain and shear add to `nodal_kernels.residuals` and their tangent.

With the internal force F of an element, its components b_a = F.d_a along the section's axes d_a, the last of
which is the tangent t, and the compliance c, (1 / GAx, 1 / GAy, 1 / EA), the positions obey

    r[k + 1] - r[k] - integral t + sum_a c_a b_a d_a ds = 0

and the moments get the gradient of the complementary energy, -1/2 integral sum_a c_a b_a^2 ds, by the frames.
Units of the cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, LEAF, njit
from cable_ros.contact.stretched import gauss_tangent
from cable_ros.rod.extensible_kernels import axes, internal_forces, stretch_gradient, stretch_hessian
from cable_ros.rod.rod_state import ENERGY, Stretch

OPTIONS = {"cache": True, "error_model": "numpy"}


@njit(**LEAF)
def strains(compliance):
    """Whether a cable with the compliance (3,) of `Model` has any strain but bending and torsion."""
    return compliance[2] > 0.0 or shears(compliance)


@njit(**LEAF)
def shears(compliance):
    """Whether its sections tilt against the centreline."""
    return compliance[0] > 0.0 or compliance[1] > 0.0


@njit(**INNER)
def strain_moments(state, model, acc):
    """Add the strain's part to acc (n, 4), the gradient by the nodal quaternions; returns its energy, EI / L.

    `state`, `model`: `State` and `Model`.
    """
    stretch = Stretch(model.compliance, np.empty((3, 3)), np.zeros(4))
    G = internal_forces(state.F, model.f, model.grid)
    stretch_gradient(state.q, G, model.f, model.grid, stretch, acc)
    return stretch.totals[ENERGY]


@njit(**INNER)
def strain_positions(state, model, mismatch):
    """Take the displacement by the strain from the residuals `mismatch` (m, 3) of the positions, L.

    `state`, `model`: `State` and `Model`.
    """
    q, F, (h, _, tables) = state.q, state.F, model.grid
    N, weights = tables.values, tables.weights
    shear = shears(model.compliance)
    qs, t, d = np.empty(4), np.empty(3), np.empty((3, 3))
    for e in range(h.shape[0]):
        for k in range(N.shape[0]):
            gauss_tangent(q, e * (N.shape[1] - 1), N[k], qs, t)
            u = weights[k] * h[e] * model.compliance[2] * (F[e, 0] * t[0] + F[e, 1] * t[1] + F[e, 2] * t[2])
            for a in range(3):
                mismatch[e, a] -= u * t[a]
            if shear:
                axes(qs, d)
                for b in range(2):
                    tilt = d[b, 0] * F[e, 0] + d[b, 1] * F[e, 1] + d[b, 2] * F[e, 2]
                    tilt *= weights[k] * h[e] * model.compliance[b]
                    for a in range(3):
                        mismatch[e, a] -= tilt * d[b, a]


@njit(**INNER)
def strain_tangents(state, model, tangents):
    """Add the strain's part to the derivatives of moments and positions by the rotations.

    Args:
        state, model: `State` and `Model`.
        tangents: `Tangents`, as `energy_kernels.hessian` leaves them.
    """
    stretch = Stretch(model.compliance, np.empty((3, 3)), np.zeros(4))
    G = internal_forces(state.F, model.f, model.grid)
    stretch_hessian(state.q, G, model.grid, stretch, tangents)


@njit(**INNER)
def element_reach(q, grid, compliance, out):
    """Derivative of each element's displacement by its internal force, out (m, 3, 3), L^3 / EI.

    Args:
        q, grid: (n, 4) nodal frames and `Grid`.
        compliance: (3,) of `Model`.
    """
    h, _, tables = grid
    N, weights = tables.values, tables.weights
    shear = shears(compliance)
    qs, t, d = np.empty(4), np.empty(3), np.empty((3, 3))
    out[:] = 0.0
    for e in range(h.shape[0]):
        for k in range(N.shape[0]):
            gauss_tangent(q, e * (N.shape[1] - 1), N[k], qs, t)
            for a in range(3):
                for b in range(3):
                    out[e, a, b] += weights[k] * h[e] * compliance[2] * t[a] * t[b]
            if shear:
                axes(qs, d)
                for i in range(2):
                    for a in range(3):
                        for b in range(3):
                            out[e, a, b] += weights[k] * h[e] * compliance[i] * d[i, a] * d[i, b]


@njit(**OPTIONS)
def stiffness(q, model, penalty):
    """(m, 3, 3) stiffness of each element against its ends moving apart, in series with a spring `penalty`.

    Args:
        q: (n, 4) nodal frames.
        model: `Model`.
        penalty: EI / L^3.
    """
    out = np.empty((model.grid.h.shape[0], 3, 3))
    element_reach(q, model.grid, model.compliance, out)
    for e in range(out.shape[0]):
        for a in range(3):
            out[e, a, a] += 1.0 / penalty
        out[e] = np.linalg.inv(out[e])
    return out
