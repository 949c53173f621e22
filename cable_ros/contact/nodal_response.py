# SPDX-License-Identifier: Apache-2.0
"""How the wrenches on clamps and obstacles answer to small motions, for contacts at fixed material points.

The equations of `nodal_kernels` linearised at an equilibrium, J x = b, are solved once for each motion. What
sticks is carried by its obstacle. What slips goes on slipping in the direction that it has, which is fixed on
the obstacle's surface, so that the answer does not depend on how long the last step was. It is nobody's
derivative if the motion turns back, or turns aside, where something slips.

Units of the cable, start clamp's frame.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cable_ros.contact.nodal_kernels import residuals
from cable_ros.contact.nodal_state import Band, Model, Rows, State, Step, Work
from cable_ros.contact.nodal_tangent import jacobian, press_tangent
from cable_ros.contact.response_kernels import columns
from cable_ros.linalg.band_lu import band_factor, band_solve
from cable_ros.linalg.cross import cross_matrix
from cable_ros.rod import quaternion
from cable_ros.rod.rod_state import Tangents

SLID = 1e8
"""Lengths over which what slips counts as having slipped: no small motion turns its direction."""


def frozen_step(state: State, step: Step, forces: np.ndarray, frames: np.ndarray, slips: np.ndarray) -> Step:
    """The step that stays at the equilibrium to which `step` led.

    Args:
        state: the equilibrium.
        step: its conditions and scales are kept, its history is not.
        forces: (m + 1, o, 3) of the obstacles on the cable across their normals, EI / L^2.
        frames: (m + 1, o, 3) the first direction of each contact's frame.
        slips: (m + 1, o) bool, which contacts slip.
    """
    size = np.linalg.norm(forces, axis=2, keepdims=True)
    against = np.divide(forces, size, out=np.zeros_like(forces), where=size > 0.0)
    carried = state.r[:, None] + SLID * slips[:, :, None] * against  # friction opposes the motion
    return step._replace(carried=carried, turned=frames, tau=state.tau, q=state.q, r=state.r, drag=0.0)


def wrench_response(
    state: State, model: Model, step: Step, work: Work, tangents: Tangents, rows: Rows, band: Band,
    forces: np.ndarray, moving: Sequence[int],
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Derivative (12 + 6 k, 12 + 6 k) of the wrenches on the cable by motions of clamps and obstacles.

    Rows and columns as in `response.wrench_response`; NaN if the equations are singular. And the derivative
    of the unknowns, numbered by `rows`.

    Args:
        state: an equilibrium.
        model, step: of the rod; the step as `frozen_step` makes it.
        work, tangents, rows, band: the rod's, overwritten.
        forces: (m + 1, o, 3) of the obstacles on the cable, EI / L^2.
        moving: numbers of the k obstacles that may move.
    """
    residuals(state, model, step, work)
    total, low = jacobian(state, model, step, work, tangents, rows, band.a, band.b)
    at, touched, M = contact_tangents(state, step, rows, total, low)
    k, o = touched
    r, P = state.r[k], forces[k, o]
    qe, re, f = state.q[-1], state.r[-1], step.f
    turn = quaternion.matrices_from_ros(quaternion.to_ros(qe)[None])[0]

    motions = 12 + 6 * len(moving)
    shift, spin = obstacle_motions(len(step.obstacles), moving)
    end_shift, end_turn = np.zeros((3, motions)), np.zeros((3, motions))  # along its own axes the latter
    end_shift[:, 0:3], end_shift[:, 3:6], end_shift[:, 6:9] = -np.eye(3), cross_matrix(re), turn
    end_turn[:, 3:6], end_turn[:, 9:12] = -turn.T, np.eye(3)
    load = np.zeros((3, motions))
    load[:, 3:6] = cross_matrix(f)

    B = np.zeros((motions, total))
    inner = rows.r[1:-1]
    B[:, inner[:, None] + np.arange(3)] = load.T[:, None] / (len(model.grid.h) - 1)
    B[:, rows.r[-1] : rows.r[-1] + 3] = end_shift.T
    B[:, rows.psi[-1] : rows.psi[-1] + 3] = end_turn.T
    # an obstacle's motion is the cable's, the other way, but that the force turns with the obstacle
    moved = shift[o] + np.cross(spin[o], r[:, :, None], axis=1)  # (c, 3, motions)
    turned = np.cross(spin[o], P[:, :, None], axis=1)
    right = M[:, :, :3] @ moved
    right[:, :3] += turned
    np.add.at(B.T, at, right)

    if not band_factor(band.a, total, low, band.pivots):
        return np.full((motions, motions), np.nan), np.full((total, motions), np.nan)
    for b in B:
        band_solve(band.a, total, low, band.pivots, b)
    x = B.T

    # the wrenches
    change = x[at]
    dr = change[:, :3].copy()
    change[:, :3] -= moved
    dP = turned - M[:, :3] @ change
    dM = np.cross(dr, P[:, :, None], axis=1) + np.cross(r[:, :, None], dP, axis=1)
    psi = np.zeros((3 * len(state.q), motions))
    psi[3:] = x[(rows.psi[1:, None] + np.arange(3)).ravel()]
    dF = x[rows.F[0] : rows.F[0] + 3], x[rows.F[-1] : rows.F[-1] + 3]
    n = len(psi)
    hessian = tangents.elastic, tangents.geometric
    out = np.empty((motions, motions))
    out[0:3] = -dF[0]
    out[3:6] = columns(*hessian, 0, 3).T @ psi - tangents.dchord[0, :, :3].T @ dF[0]
    # components along axes that turn with the clamp; the gradient's half turn is the chart's
    out[6:9] = turn.T @ dF[1] + cross_matrix(turn.T @ state.F[-1]) @ end_turn
    out[9:12] = columns(*hessian, n - 3, 3).T @ psi - tangents.dchord[-1, :, -3:].T @ dF[1]
    out[9:12] += 0.5 * cross_matrix(work.evaluation.g[-1]) @ end_turn
    for i, which in enumerate(moving):
        on, first = o == which, 12 + 6 * i
        force, moment = P[on].sum(axis=0), np.cross(r[on], P[on]).sum(axis=0)
        out[first : first + 3] = dP[on].sum(axis=0)
        out[first + 3 : first + 6] = dM[on].sum(axis=0)
        # in the frame that stands still while the start clamp moves
        out[first : first + 3, 3:6] -= cross_matrix(force)
        out[first + 3 : first + 6, 0:3] -= cross_matrix(force)
        out[first + 3 : first + 6, 3:6] -= cross_matrix(moment)
    return (out if np.isfinite(out).all() else np.full((motions, motions), np.nan)), x


def obstacle_motions(count: int, moving: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Translations and rotations (count, 3, 12 + 6 k) of all obstacles in the motions of `wrench_response`.

    Seen from the start clamp: where that moves, all else moves the other way.
    """
    motions = 12 + 6 * len(moving)
    shift, spin = np.zeros((count, 3, motions)), np.zeros((count, 3, motions))
    shift[:, :, 0:3] = spin[:, :, 3:6] = -np.eye(3)
    for i, which in enumerate(moving):
        first = 12 + 6 * i
        shift[which, :, first : first + 3] = spin[which, :, first + 3 : first + 6] = np.eye(3)
    return shift, spin


def contact_tangents(
    state: State, step: Step, rows: Rows, total: int, low: int
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray], np.ndarray]:
    """Of the c contacts among the unknowns, what their equations and forces are by their own unknowns.

    Returns the numbers (c, 6) of their unknowns (position, normal force, friction), boundaries (c,) and
    obstacles (c,), and the parts (c, 6, 6) of the tangent that each alone makes.
    """
    k, o = np.nonzero(rows.contact >= 0)
    at = np.concatenate((rows.r[k, None] + np.arange(3), rows.contact[k, o][:, None] + np.arange(3)), axis=1)
    M = np.zeros((len(k), 6, 6))
    for which in np.unique(o):
        a = np.zeros((total, 3 * low + 1))
        alone = rows._replace(contact=np.where(np.arange(len(step.obstacles)) == which, rows.contact, -1))
        press_tangent(state, step, alone, a, np.zeros(total), low)
        i = at[o == which]
        M[o == which] = a[i[:, :, None], low + i[:, None, :] - i[:, :, None]]
    return at, (k, o), M
