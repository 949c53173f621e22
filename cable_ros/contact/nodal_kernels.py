# SPDX-License-Identifier: Apache-2.0
"""Compiled: equilibrium, contact and Coulomb friction of a rod whose contacts sit at fixed material points.

The rod of `rod.energy_kernels` in a mixed formulation: positions and internal forces are unknowns beside the
frames. All unknowns of one arc length stand together, and the tangent is banded:

    g(q, F) = 0                               moments, the gradient of the Lagrangian by the frames
    F[k - 1] - F[k] - P[k] - f c = 0          forces at the boundary k of two elements, the middle of a cell c
    r[k + 1] - r[k] - integral t ds = 0       positions, from the tangents; with strain see `nodal_stretch`

The weight f c of each cell acts where its contact does, so that what lies on a plane lies flat. With
P = lambda n + tau1 d1 + tau2 d2 the force of an obstacle at a boundary, contact and friction are the
projections of Alart and Curnier (1991), solved with all else by Newton's method:

    lambda = max(0, lambda - rho (phi + c lambda)),    tau = T min(1, mu max(0, ...) / |T|),
    T = tau - rho (u + c (tau - tau0))

with the gap phi, the tangential motion u over the obstacle since the last equilibrium and the friction tau0
there. The compliance c is so small that it only decides how redundant contacts share a load. Units of the
cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, LEAF, LEAF_ENTRY, njit
from cable_ros.contact.distance import AXES, CENTRE, FRICTION_COEFFICIENT, across, gap
from cable_ros.contact.nodal_stretch import strain_moments, strain_positions, strains
from cable_ros.rod import quaternion
from cable_ros.rod.elements import LANES
from cable_ros.rod.energy_kernels import FORCE, gradient
from cable_ros.rod.rod_state import ENERGY

OPTIONS = {"cache": True, "error_model": "numpy"}

COMPLIANCE = 1e-6
"""L^3 / EI: what sticks moves by this per force, less than a grid resolves. With 1e-8 the boundaries
between stick and slip move point by point: Newton's method takes twice as long or does not converge."""
YIELD = 1e-14
"""Compliance of an obstacle's surface, L^3 / EI. Where a cable lies beside a clamp, the clamp carries its
weight over a length of about the fourth root, 3e-4 L."""
OPEN, STICK, SLIP = 0, 1, 2
"""States of a contact; without friction it slips."""
TURNING = 1e-3
"""Drag on rotations over that on positions, L^2: just enough to damp a free spin."""


@njit(**OPTIONS)
def carry_history(r, frames, old, new, carried, turned):
    """Positions and directions carried along by each obstacle.

    Args:
        r: (k, 3) positions, L.
        frames: (k, o, 3) directions.
        old, new: (o, WIDTH) the obstacles before and now.
        carried, turned: (k, o, 3) receive where position and direction are now.
    """
    y = np.empty(3)
    for o in range(old.shape[0]):
        a, b = old[o], new[o]
        for k in range(r.shape[0]):
            for i in range(3):
                y[i] = 0.0
                for j in range(3):
                    y[i] += a[AXES + 3 * j + i] * (r[k, j] - a[CENTRE + j])
            for i in range(3):
                v = b[CENTRE + i]
                for j in range(3):
                    v += b[AXES + 3 * i + j] * y[j]
                carried[k, o, i] = v
            for i in range(3):
                y[i] = 0.0
                for j in range(3):
                    y[i] += a[AXES + 3 * j + i] * frames[k, o, j]
            for i in range(3):
                v = 0.0
                for j in range(3):
                    v += b[AXES + 3 * i + j] * y[j]
                turned[k, o, i] = v


@njit(**LEAF_ENTRY)
def tangent_frame(n, reference, d):
    """d (2, 3) receives unit vectors across n (3,), the first along the part of `reference` (3,) across n."""
    along = reference[0] * n[0] + reference[1] * n[1] + reference[2] * n[2]
    size = 0.0
    for a in range(3):
        d[0, a] = reference[a] - along * n[a]
        size += d[0, a] * d[0, a]
    if size < 1e-12:
        across(n, d)
        return
    size = np.sqrt(size)
    for a in range(3):
        d[0, a] /= size
    d[1, 0] = n[1] * d[0, 2] - n[2] * d[0, 1]
    d[1, 1] = n[2] * d[0, 0] - n[0] * d[0, 2]
    d[1, 2] = n[0] * d[0, 1] - n[1] * d[0, 0]


@njit(**LEAF)
def project(lam, tau, tau0, phi, u, mu, scales, out):
    """Residuals of one contact's laws; returns its state, trial friction T (two numbers) and cone radius.

    Args:
        lam, tau: normal force and friction (2,), EI / L^2.
        tau0: (2,) friction at the last equilibrium.
        phi, u: gap and tangential motion (2,) since then, L.
        mu: coefficient of friction.
        scales: those of normal force and friction, and the compliance of stick; see `Step`.
        out: (3,) receives the residuals, EI / L^2.
    """
    rho, rho_t, give = scales
    push = lam - rho * (phi + YIELD * lam)
    if push <= 0.0:
        out[0], out[1], out[2] = lam, tau[0], tau[1]
        return OPEN, 0.0, 0.0, 0.0
    out[0] = lam - push
    if mu == 0.0:
        out[1], out[2] = tau[0], tau[1]
        return SLIP, 0.0, 0.0, 0.0
    t0 = tau[0] - rho_t * (u[0] + give * (tau[0] - tau0[0]))
    t1 = tau[1] - rho_t * (u[1] + give * (tau[1] - tau0[1]))
    size = np.sqrt(t0 * t0 + t1 * t1)
    radius = mu * push
    if size <= radius:
        out[1], out[2] = tau[0] - t0, tau[1] - t1
        return STICK, t0, t1, radius
    out[1], out[2] = tau[0] - radius * t0 / size, tau[1] - radius * t1 / size
    return SLIP, t0, t1, radius


@njit(**LEAF)
def slid(r, carried, d, u):
    """u (2,) receives the motion from `carried` (3,) to r (3,) along the directions d (2, 3), L."""
    for i in range(2):
        u[i] = d[i, 0] * (r[0] - carried[0]) + d[i, 1] * (r[1] - carried[1]) + d[i, 2] * (r[2] - carried[2])


@njit(**OPTIONS)
def contact_frames(state, obstacles, frames, normals, forces):
    """Normals and forces of the contacts that press; `frames` is turned along with the normals.

    Args:
        state: `State`.
        obstacles: (o, WIDTH).
        frames: (m + 1, o, 3) the first direction of each contact's frame; changed where a contact presses.
        normals, forces: (m + 1, o, 3) receive the normals and the obstacles' forces on the cable, EI / L^2;
            zero elsewhere.
    """
    n, d, directions, bends = np.empty(3), np.empty((2, 3)), np.empty((2, 3)), np.empty(2)
    normals[:], forces[:] = 0.0, 0.0
    for k in range(frames.shape[0]):
        for o in range(frames.shape[1]):
            push, tau = state.lam[k, o], state.tau[k, o]
            if push == 0.0:
                continue
            gap(obstacles[o], state.r[k], n, directions, bends)
            tangent_frame(n, frames[k, o], d)
            for a in range(3):
                frames[k, o, a] = d[0, a]
                normals[k, o, a] = n[a]
                forces[k, o, a] = push * n[a] + tau[0] * d[0, a] + tau[1] * d[1, a]


@njit(**OPTIONS)
def residuals(state, model, step, work):
    """Residuals of all equations.

    Args:
        state, model, step: `State`, `Model` and `Step`.
        work: `Work`, which receives the residuals.
    """
    q, r, F = state.q, state.r, state.F
    h, tables = model.grid.h, model.grid.tables
    evaluation = work.evaluation
    g, lanes = evaluation.g, evaluation.lanes
    elements = h.shape[0]
    soft, strained = strains(model.compliance), 0.0
    evaluation.acc[:] = 0.0
    if soft:
        strained = strain_moments(state, model, evaluation.acc)
    gradient(q, F, model.f, model.section, model.grid, evaluation)
    blocks = (lanes.shape[0] - 1) // elements
    weights = tables.weights
    for e in range(elements):
        for a in range(3):
            v = 0.0
            for k in range(weights.shape[0]):  # the tangents stand where the forces were
                v += weights[k] * lanes[e * blocks + k // LANES, (FORCE + a) * LANES + k % LANES]
            work.mismatch[e, a] = r[e + 1, a] - r[e, a] - h[e] * v
    if soft:
        strain_positions(state, model, work.mismatch)
        evaluation.totals[ENERGY] += strained
    cell = 1.0 / (elements - 1)
    for k in range(1, elements):
        for a in range(3):
            work.balance[k, a] = F[k - 1, a] - F[k, a] - cell * step.f[a]
    if step.drag > 0.0:
        for k in range(1, elements):
            for a in range(3):
                work.balance[k, a] += step.drag * cell * (r[k, a] - step.r[k, a])
        for i in range(1, q.shape[0] - 1):
            back = step.q[i, 0], -step.q[i, 1], -step.q[i, 2], -step.q[i, 3]
            theta = quaternion.turn(quaternion.product(back, q[i]))
            for a in range(3):
                g[i, a] += TURNING * step.drag * cell * theta[a]
    press(state, step, work)


@njit(**INNER)
def press(state, step, work):
    """The contacts' part of `residuals`; `state`, `step`, `work` as there."""
    r, lam, tau, obstacles = state.r, state.lam, state.tau, step.obstacles
    n, d, u, out = np.empty(3), np.empty((2, 3)), np.empty(2), np.empty(3)
    directions, bends = np.empty((2, 3)), np.empty(2)
    for k in range(1, r.shape[0] - 1):
        for o in range(obstacles.shape[0]):
            phi = gap(obstacles[o], r[k], n, directions, bends)
            push = lam[k, o] - step.normal * (phi + YIELD * lam[k, o])
            work.kinds[k, o] = OPEN
            work.near[k, o] = push > 0.0 or lam[k, o] != 0.0
            if not work.near[k, o]:
                continue
            tangent_frame(n, step.turned[k, o], d)
            slid(r[k], step.carried[k, o], d, u)
            mu, scales = obstacles[o, FRICTION_COEFFICIENT], (step.normal, step.tangential, step.give[k, o])
            work.kinds[k, o], _, _, _ = project(lam[k, o], tau[k, o], step.tau[k, o], phi, u, mu, scales, out)
            for a in range(3):
                work.contact[k, o, a] = out[a]
                work.balance[k, a] -= lam[k, o] * n[a] + tau[k, o, 0] * d[0, a] + tau[k, o, 1] * d[1, a]
