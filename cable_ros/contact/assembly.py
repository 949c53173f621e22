# SPDX-License-Identifier: Apache-2.0
"""Compiled: the bordered (KKT) system of a cable that touches.

The unknowns of a contact point are its normal force and its arc length, those of the end of a contact patch
the couple that holds its slope, too (see `patch_ends.move_ends`); they are eliminated as constraint rows of
the rod's banded system. Units of the cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, LEAF, LEAF_ENTRY, njit
from cable_ros.contact.contact_state import PointTerms, surface
from cable_ros.contact.distance import FRICTION_COEFFICIENT, across, pull
from cable_ros.contact.friction_kernels import (
    ACROSS,
    DIRECTION,
    FRICTIONLESS,
    STIFFNESS,
    TANGENT,
    stick_stiffness,
    update_friction,
)
from cable_ros.contact.interfaces import gap_here, locate
from cable_ros.contact.moving_obstacles import carry, obstacle_motion
from cable_ros.contact.point_couples import has_arm, hold_points, hold_rows
from cable_ros.contact.points import (
    ARC_LENGTH,
    BEFORE,
    FIRST,
    FORCE,
    FRICTION,
    INTERFACE,
    KIND,
    LENGTH,
    MOTION,
    OBSTACLE,
    POINT,
    SAMPLE,
    SLIP_ROW,
    SLOPE_ROW,
    STICK_ROW,
    WAS,
    YIELD,
)
from cable_ros.contact.stretched import internal_forces, row_reaches, trace
from cable_ros.linalg.copies import copy
from cable_ros.rod.centreline import (
    derivative,
    elongation_before,
    find_element,
    increments,
    interpolate_frame,
    position,
    tangent,
    tangent_derivative,
    weight_up_to,
)
from cable_ros.rod.centreline import shape as shape_functions
from cable_ros.rod.energy_kernels import gradient, hessian
from cable_ros.rod.extensible_kernels import stretch_gradient, stretch_hessian
from cable_ros.rod.rod_state import Stretch

STIFFER = 1.5
"""Maximum ratio, or its inverse, of friction's stiffness to that in the constraint rows that still serve."""
FAINT = 1e-9
"""EI / L^2; a point with less force than this turns no force by its motion."""


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
    at = surface()
    before, turned, old = np.empty(3), np.empty(3), np.empty(3)
    flips = 0
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
        terms.curvature[i] = max(curvature, 1e-9) if points[i, KIND] == POINT else 0.0
        for a in range(3):
            normals[i, a], terms.t[i, a] = at.n[a], at.t[a]
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
                turned[a] = points[i, BEFORE + a]
            carry(history.obstacles[o], obstacle, before, turned)
            for a in range(3):
                before[a] = 0.0 if initial else at.r[a] - before[a]
            if shape.c.shape[2] > 3:
                long = elongation_before(shape.c, shape.grid.h, shape.grid.s0, s)
                derivative(curve, history.h, history.s0, s, old)
                carry(history.obstacles[o], obstacle, np.zeros(3), old)
                for a in range(3):
                    terms.creep[i, a] = long * at.t[a] - old[a]
            elif not initial and points[i, WAS] > 0.0:
                # where contact moves along a cable that spins on the obstacle, slip is that half way
                derivative(curve, history.h, history.s0, s, old)
                carry(history.obstacles[o], obstacle, np.zeros(3), old)
                for a in range(3):
                    before[a] -= 0.5 * (s - points[i, WAS]) * (at.t[a] - old[a])
            stiffness = stick_stiffness(mu * points[i, FORCE], history.presliding)
            if not held:
                limit = terms.tangents[i]
                flips += update_friction(points, i, at, mu, history, before, turned, initial, limit)
            for a in range(3):
                terms.misfits[i, a] = before[a] + (points[i, FRICTION + a] - turned[a]) / stiffness
    return flips


@njit(**INNER)
def update_constraints(contacts, count, terms, rows):
    """The constraints after the gaps, for constraint rows that are kept.

    Args:
        contacts, count: as in `assemble_kkt`.
        terms: `PointTerms` of the contact points.
        rows: `ConstraintRows`.

    Returns:
        Whether friction is about as stiff as in those rows.
    """
    points, gaps, _ = contacts
    as_stiff = True
    for i in range(count):
        stick_constraints(points, i, terms.misfits, rows.lines, gaps)
        if points[i, SLIP_ROW] > 0.0:
            ratio = terms.tangents[i, STIFFNESS] * rows.delta[int(points[i, SLIP_ROW])]
            as_stiff = as_stiff and 1.0 / STIFFER < ratio < STIFFER
        if points[i, KIND] != SAMPLE and points[i, SLOPE_ROW] > 0.0:
            gaps[int(points[i, SLOPE_ROW]) - 3] = terms.tilts[i]
    return as_stiff


@njit(**INNER)
def constraint_rows(shape, obstacles, contacts, count, terms, tangents, rows, strain):
    """Constraint rows of all contact points, and what their forces add to the geometric stiffness.

    Args:
        shape, obstacles, contacts, count: as in `assemble_kkt`.
        terms: `PointTerms` of the contact points.
        tangents: `Tangents`.
        rows: `ConstraintRows`, overwritten.
        strain: `Strain`; the reach is overwritten if the cable stretches.

    Returns:
        The number of rows, and whether V and W are the same.
    """
    q, _, (h, s0, tables) = shape
    points, gaps, normals = contacts
    V, W, delta, lines, upto, owners = rows
    geometric, dchord, C = tangents.geometric, tangents.dchord, tangents.C
    N, primitives = tables.values, tables.primitives
    order = N.shape[1] - 1
    nd = 3 * (order + 1)
    band = nd - 1
    columns = C.shape[1]
    for a in range(3):
        for j in range(columns):
            V[a, j] = C[a, j]
        delta[a] = 0.0
        owners[a] = count
    total = 3 + count
    same = True
    D, Y = np.empty((4, nd)), np.empty((4, nd))
    frame = np.empty((4, nd))
    own, turn = np.empty((3, nd)), np.empty((3, nd))
    by_position = np.empty((3, columns))
    Nx, dNx = np.empty(order + 1), np.empty(order + 1)
    qs, gT, H, P, t = np.empty(4), np.empty(4), np.empty((4, 4)), np.empty(3), np.empty(3)
    sticking = np.empty((2, 3))
    soft = strain.reach.shape[0] > 0
    tilt = np.empty((3, nd))
    for i in range(count):
        e, x = find_element(points[i, ARC_LENGTH], s0, h)
        first = e * order
        for j in range(order + 1):
            increments(q[first + j], 3 * j, frame)
        own[:] = 0.0
        turn[:] = 0.0
        for a in range(3):
            P[a] = points[i, FORCE] * normals[i, a]
            if not has_arm(points, i):
                P[a] += points[i, FRICTION + a]
        for k in range(N.shape[0]):
            if x == 0.0:
                break
            interpolate_frame(q, first, order, N[k], frame, qs, D)
            norm = tangent(qs, t)
            weight = h[e] * weight_up_to(primitives, k, x)
            if soft:
                tilt[:] = 0.0
                tangent_derivative(qs, t, 2.0 * weight / norm, D, tilt, 0, nd)
                strain_slopes(strain.compliance[2], strain.G[e, k], t, tilt, own)
            else:
                tangent_derivative(qs, t, 2.0 * weight / norm, D, own, 0, nd)
            pull(qs, P, weight, gT, H)
            for a in range(4):
                for j in range(nd):
                    Y[a, j] = H[a, 0] * D[0, j] + H[a, 1] * D[1, j] + H[a, 2] * D[2, j] + H[a, 3] * D[3, j]
            for j in range(nd):
                for m in range(j + 1):
                    geometric[3 * first + j, band + m - j] += (
                        D[0, j] * Y[0, m] + D[1, j] * Y[1, m] + D[2, j] * Y[2, m] + D[3, j] * Y[3, m]
                    )
        shape_functions(tables.nodes, x, Nx, dNx)
        interpolate_frame(q, first, order, Nx, frame, qs, D)
        norm = tangent(qs, t)
        tangent_derivative(qs, t, 2.0 / norm, D, turn, 0, nd)
        by_position[:] = 0.0
        for k in range(e):
            for a in range(3):
                for j in range(nd):
                    by_position[a, 3 * k * order + j] += dchord[k, a, j]
        for a in range(3):
            for j in range(nd):
                by_position[a, 3 * first + j] += own[a, j]
        row(V, 3 + i, normals[i], by_position)
        delta[3 + i] = YIELD * points[i, LENGTH] ** 3 if points[i, KIND] == SAMPLE else 0.0
        copy(normals[i], lines[3 + i])
        begin = total
        upto[3 + i], owners[3 + i] = e, i
        points[i, STICK_ROW] = points[i, SLIP_ROW] = 0.0
        friction = terms.tangents[i]
        slip = friction[DIRECTION] != 0.0 or friction[DIRECTION + 1] != 0.0 or friction[DIRECTION + 2] != 0.0
        if slip:
            same = False
            mu = obstacles[int(points[i, OBSTACLE]), FRICTION_COEFFICIENT]
            for a in range(3):
                P[a] = normals[i, a] + mu * friction[DIRECTION + a]
            row(W, 3 + i, P, by_position)
        else:
            copy(V[3 + i], W[3 + i])
        if friction[STIFFNESS] > 0.0:
            if slip:
                row(V, total, friction[ACROSS:STIFFNESS], by_position)
                copy(friction[ACROSS:STIFFNESS], lines[total])
                delta[total] = 1.0 / friction[STIFFNESS]
                gaps[total - 3] = 0.0
                points[i, SLIP_ROW] = total
                total += 1
            else:
                across(normals[i], sticking)
                points[i, STICK_ROW] = total
                for k in range(2):
                    row(V, total, sticking[k], by_position)
                    copy(sticking[k], lines[total])
                    delta[total] = 1.0 / friction[STIFFNESS]
                    gaps[total - 3] = 0.0
                    total += 1
        for k in range(2):
            if terms.bends[i, k] > 0.0 and abs(points[i, FORCE]) >= FAINT:
                row(V, total, terms.directions[i, k], by_position)
                copy(terms.directions[i, k], lines[total])
                delta[total] = -1.0 / (points[i, FORCE] * terms.bends[i, k])
                gaps[total - 3] = 0.0
                total += 1
        ends = points[i, KIND] >= FIRST
        if points[i, KIND] == POINT:
            points[i, SLOPE_ROW] = 0.0
        if ends or (terms.curvature[i] > 0.0 and abs(points[i, FORCE]) >= FAINT):
            row(V, total, terms.slopes[i], by_position)
            copy(terms.slopes[i], lines[total])
            for j in range(nd):
                for a in range(3):
                    V[total, 3 * first + j] += normals[i, a] * turn[a, j]
            delta[total] = 0.0 if ends else terms.curvature[i] / points[i, FORCE]
            gaps[total - 3] = terms.tilts[i]
            points[i, SLOPE_ROW] = total
            total += 1
        for b in range(begin, total):
            upto[b], owners[b] = e, i
    total = hold_rows(shape, points, count, tangents, rows, total, gaps)
    for b in range(3):
        copy(V[b], W[b])
    for b in range(3 + count, total):
        copy(V[b], W[b])
    for i in range(count):
        stick_constraints(points, i, terms.misfits, lines, gaps)
    if soft:
        same = not row_reaches(shape, obstacles, contacts, count, terms, rows, total, strain) and same
    return total, same


@njit(**LEAF)
def strain_slopes(soft, G, t, tilt, own):
    """Add the derivative of (1 + c G.t) t to own (3, b), from that of t, tilt (3, b); c is `soft`."""
    tension = G[0] * t[0] + G[1] * t[1] + G[2] * t[2]
    for j in range(tilt.shape[1]):
        rise = soft * (G[0] * tilt[0, j] + G[1] * tilt[1, j] + G[2] * tilt[2, j])
        for a in range(3):
            own[a, j] += (1.0 + soft * tension) * tilt[a, j] + rise * t[a]


@njit(**LEAF)
def stick_constraints(points, i, misfits, lines, gaps):
    """Residuals of the two stick rows of point i, if it sticks: its `misfits` along the rows' directions.

    Args:
        points, gaps: of `ContactSet`.
        misfits: (count, 3) of `PointTerms`.
        lines: (rows, 3) of `ConstraintRows`.
    """
    b = int(points[i, STICK_ROW])
    if b > 0:
        for k in range(b, b + 2):
            gaps[k - 3] = (
                misfits[i, 0] * lines[k, 0] + misfits[i, 1] * lines[k, 1] + misfits[i, 2] * lines[k, 2]
            )


@njit(**LEAF)
def row(V, at, v, by_position):
    """V[at] = v times by_position, of V (rows, 3n), v (3,), by_position (3, 3n)."""
    for j in range(by_position.shape[1]):
        V[at, j] = v[0] * by_position[0, j] + v[1] * by_position[1, j] + v[2] * by_position[2, j]


@njit(**LEAF_ENTRY)
def nodal(q, acc, out):
    """The pull acc (n, 4) at the nodal quaternions q (n, 4) as moments out (3n,)."""
    for i in range(q.shape[0]):
        w, x, y, z = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
        a, b, c, d = acc[i, 0], acc[i, 1], acc[i, 2], acc[i, 3]
        out[3 * i] = 0.5 * (-x * a + w * b + z * c - y * d)
        out[3 * i + 1] = 0.5 * (-y * a - z * b + w * c + x * d)
        out[3 * i + 2] = 0.5 * (-z * a + y * b - x * c + w * d)
