# SPDX-License-Identifier: Apache-2.0
"""Compiled: the bordered (KKT) system of a cable that touches.

The unknowns of a contact point are its normal force and its arc length, those of the end of a contact patch
the couple that holds its slope, too (see `patch_ends.move_ends`); they are eliminated as constraint rows of
the rod's banded system. Units of the cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, LEAF_ENTRY, njit
from cable_ros.contact.constraint_rows import BESIDE_CLAMP, constraint_rows, update_constraints
from cable_ros.contact.contact_state import PointTerms, surface
from cable_ros.contact.distance import FRICTION_COEFFICIENT, pull
from cable_ros.contact.friction_kernels import (
    FRICTIONLESS,
    TANGENT,
    stick_stiffness,
    update_friction,
)
from cable_ros.contact.interfaces import gap_at, gap_here, locate
from cable_ros.contact.moving_obstacles import carry, obstacle_motion
from cable_ros.contact.point_couples import has_arm, hold_points
from cable_ros.contact.points import (
    ARC_LENGTH,
    BEFORE,
    FORCE,
    FRICTION,
    INTERFACE,
    KIND,
    MOTION,
    OBSTACLE,
    POINT,
    SAMPLE,
    SHIFT,
    SLIP_BEFORE,
    SWINGS,
    WAS,
)
from cable_ros.contact.stretched import internal_forces, trace
from cable_ros.rod.centreline import (
    derivative,
    elongation_before,
    find_element,
    position,
    weight_up_to,
)
from cable_ros.rod.energy_kernels import gradient, hessian
from cable_ros.rod.extensible_kernels import stretch_gradient, stretch_hessian
from cable_ros.rod.rod_state import Stretch

BESIDE = 1e-12
"""Distance, L, to the other side of a boundary between elements."""


@njit(**INNER)
def point_forces(shape, F, contacts, count, Fe, acc):
    """Internal force and moments of the contact points.

    Args:
        shape: `Shape`.
        F: (3,) end force.
        contacts, count: `ContactSet` and the number of its points.
        Fe: (m, 3) receives the constant part of the internal force, see `energy_kernels.gradient`.
        acc: (n, 4) receives the pull of the points inside elements.
    """
    q, (h, s0, tables) = shape.q, shape.grid
    points, normals = contacts.points, contacts.normals
    N = tables.values
    order = N.shape[1] - 1
    elements = h.shape[0]
    P, qs, gT, H = np.empty(3), np.empty(4), np.empty(4), np.empty((4, 4))
    acc[:] = 0.0
    for e in range(elements):
        for a in range(3):
            Fe[e, a] = F[a]
    for i in range(count):
        e, x = find_element(points[i, ARC_LENGTH], s0, h)
        for a in range(3):
            P[a] = points[i, FORCE] * normals[i, a]
            if not has_arm(points, i):
                P[a] += points[i, FRICTION + a]
            for k in range(e):
                Fe[k, a] += P[a]
        if x == 0.0:
            continue
        for k in range(N.shape[0]):
            for a in range(4):
                qs[a] = 0.0
                for j in range(order + 1):
                    qs[a] += N[k, j] * q[e * order + j, a]
            pull(qs, P, h[e] * weight_up_to(tables.primitives, k, x), gT, H)
            for j in range(order + 1):
                for a in range(4):
                    acc[e * order + j, a] += N[k, j] * gT[a]
    hold_points(shape, points, count, Fe, acc)


@njit(**INNER)
def assemble_kkt(shape, forces, section, obstacles, history, contacts, count, kkt, full, initial):
    """Right-hand side and, if `full`, matrix of the system with `count` contact points.

    The gaps of `contacts` receive the constraints: first the gaps (count), then zeros, but for the gap's
    slopes along the cable, which vanish at points and at the ends of patches, and for the misfits of the
    springs of what sticks. The constraint rows are those of the end position (3) and of the gaps (count),
    then one for each slope and for each direction in which a gap is curved or friction is stiff.

    Args:
        shape: `Shape`.
        forces: end force (3,), load per length (3,).
        section: `Section`.
        obstacles: (o, WIDTH).
        history: `History`.
        contacts, count: `ContactSet`, which receives gaps, normals and friction, and the number of points.
        kkt: `KKT`; the evaluation and, if `full`, tangents and rows are overwritten.
        full: whether to compute the matrix.
        initial: whether contact is that of the last equilibrium, carried along and turned by the obstacles:
            the shape has to follow their motion, which the contact points receive.

    Returns:
        The number of constraint rows, whether V and W are the same, and the number of points that began to
        stick or to slip. If not `full`, the second is whether friction is about as stiff as in the rows.
    """
    q, _, grid = shape
    F, f = forces
    evaluation, tangents, rows, _, strain = kkt
    soft = strain.reach.shape[0] > 0
    terms = point_terms(max(count, 1))
    flips = evaluate_points(shape, obstacles, history, contacts, count, terms, initial, False)
    if soft and flips > 0:
        # friction that begins to slip displaces the points, which says nothing about who sticks
        trace(shape, forces, contacts, count, obstacles, strain)
        evaluate_points(shape, obstacles, history, contacts, count, terms, initial, True)
    Fe = np.empty((grid.h.shape[0], 3))
    point_forces(shape, F, contacts, count, Fe, evaluation.acc)
    stretch = Stretch(strain.compliance, np.empty((3, 3)), np.zeros(4))
    if soft:
        internal_forces(grid, forces, contacts, count, strain.G)
        stretch_gradient(q, strain.G, f, grid, stretch, evaluation.acc)
    gradient(q, Fe, f, section, grid, evaluation)
    if soft:
        for a in range(4):
            evaluation.totals[a] += stretch.totals[a]
    if not full:
        return 3 + count, update_constraints(contacts, count, terms, rows), flips
    hessian(q, Fe, f, section, grid, evaluation.radial, tangents)
    if soft:
        stretch_hessian(q, strain.G, grid, stretch, tangents)
    total, same = constraint_rows(shape, obstacles, contacts, count, terms, tangents, rows, strain)
    return total, same, flips


@njit(**INNER)
def point_terms(size):
    """New `PointTerms` of `size` contact points, all zero."""
    return PointTerms(
        np.zeros((size, 2, 3)), np.zeros((size, 2)), np.zeros(size), np.zeros((size, 3)), np.zeros(size),
        np.zeros((size, TANGENT)), np.zeros((size, 3)), np.zeros((size, 3)), np.zeros((size, 3)),
        np.zeros((size, 3)), np.zeros((size, 3)),
    )  # fmt: skip


@njit(**INNER)
def evaluate_points(shape, obstacles, history, contacts, count, terms, initial, held):
    """Gaps, normals and friction of the contact points; the number of those that began to stick or to slip.

    Args:
        shape, obstacles, history, contacts, count, initial: as in `assemble_kkt`.
        terms: `PointTerms`, all zero unless `held`, overwritten.
        held: whether friction and its tangents stay as they are.
    """
    points, gaps, normals = contacts
    at, other = surface(), surface()
    before, turned, slid, old = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    flips, alone = 0, history.model == FRICTIONLESS
    for i in range(count):
        alone = alone and points[i, KIND] == POINT  # beside a patch a cable is curved as that asks for
    for i in range(count):
        o = int(points[i, OBSTACLE])
        obstacle = obstacles[o]
        s = points[i, ARC_LENGTH]
        locate(shape, s, at)
        if initial:
            motion = points[i, MOTION : MOTION + 3]
            obstacle_motion(history.obstacles[o], obstacle, at.r, motion)
            for a in range(3):
                at.r[a] += motion[a]
        gaps[i], terms.tilts[i], curvature = gap_here(obstacle, at)
        swings = alone and points[i, SWINGS] > 0.0 and min(s, 1.0 - s) > BESIDE_CLAMP
        if points[i, KIND] == POINT and (swings or np.signbit(points[i, SHIFT])):
            # on the mesh the curvature may jump at the point: that on the side to which it goes counts, or
            # the mean of both if it goes to and fro
            _, _, before_it = gap_at(shape, s - BESIDE, obstacle, other)
            curvature = 0.5 * (before_it + curvature) if swings else before_it
        terms.curvature[i] = max(curvature, 1e-9) if points[i, KIND] == POINT else 0.0
        for a in range(3):
            normals[i, a], terms.t[i, a], terms.dt[i, a] = at.n[a], at.t[a], at.dt[a]
        terms.slopes[i, 0] = terms.slopes[i, 1] = terms.slopes[i, 2] = 0.0
        for k in range(2):
            terms.bends[i, k] = at.bends[k]
            along = 0.0
            for a in range(3):
                terms.directions[i, k, a] = at.directions[k, a]
                along += at.directions[k, a] * at.t[a]
            for a in range(3):
                terms.slopes[i, a] += at.bends[k] * along * at.directions[k, a]
        mu = obstacle[FRICTION_COEFFICIENT]
        if history.model != FRICTIONLESS and mu > 0.0:
            # the boundary that goes with the point was a little beside: slip is short, its direction counts
            curve = history.closed if points[i, INTERFACE] >= 0.0 else history.c
            position(curve, history.h, history.s0, s, before)
            for a in range(3):
                turned[a], slid[a] = points[i, BEFORE + a], points[i, SLIP_BEFORE + a]
            carry(history.obstacles[o], obstacle, np.zeros(3), slid)
            carry(history.obstacles[o], obstacle, before, turned)
            for a in range(3):
                before[a] = 0.0 if initial else at.r[a] - before[a]
            if shape.c.shape[2] > 3:
                long = elongation_before(shape.c, shape.grid.h, shape.grid.s0, s)
                derivative(curve, history.h, history.s0, s, old)
                carry(history.obstacles[o], obstacle, np.zeros(3), old)
                for a in range(3):
                    terms.creep[i, a] = long * at.t[a] - old[a]
            elif not initial and points[i, KIND] != SAMPLE:
                # where contact moves along a cable that spins on the obstacle, slip is that half way
                derivative(curve, history.h, history.s0, s, old)
                carry(history.obstacles[o], obstacle, np.zeros(3), old)
                way, share = (s - points[i, WAS], 0.5) if points[i, WAS] > 0.0 else (0.0, 1.0)
                for a in range(3):
                    terms.drift[i, a] = share * (at.t[a] - old[a])
                    before[a] -= way * terms.drift[i, a]
            stiffness = stick_stiffness(points[i], mu * points[i, FORCE], history)
            if not held:
                increment, limit = (before, turned, slid, initial), terms.tangents[i]
                flips += update_friction(points, i, at, mu, history, stiffness, increment, limit)
            for a in range(3):
                terms.misfits[i, a] = before[a] + (points[i, FRICTION + a] - turned[a]) / stiffness
    return flips


@njit(**LEAF_ENTRY)
def nodal(q, acc, out):
    """The pull acc (n, 4) at the nodal quaternions q (n, 4) as moments out (3n,)."""
    for i in range(q.shape[0]):
        w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        a, b, c, d = acc[i, 0], acc[i, 1], acc[i, 2], acc[i, 3]
        out[3 * i] = 0.5 * (-x * a + w * b + z * c - y * d)
        out[3 * i + 1] = 0.5 * (-y * a - z * b + w * c + x * d)
        out[3 * i + 2] = 0.5 * (-z * a + y * b - x * c + w * d)
