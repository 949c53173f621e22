# SPDX-License-Identifier: Apache-2.0
"""Compiled: what axial strain adds to the equations of a cable that touches.

As in `rod.extensible_kernels`, without shear, by complementary energy: with the internal force G and the
tangent t the centreline has the derivative (1 + c G.t) t by the arc length of the unloaded cable. A position
then answers to the forces beyond it. The sum over Gauss points that gives the position at s has the weights
h w_k(s) (`centreline.weight_up_to`), so a point force P at s adds w_k(s) / w_k P to the internal force at the
Gauss point k: the discrete energy stays one, and its tangent symmetric. The coefficients of such a centreline
have a fourth column, the stretched arc length. Units of the cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, LEAF, njit
from cable_ros.contact.contact_state import ContactSet, Strain, shape_of
from cable_ros.contact.distance import FRICTION_COEFFICIENT, gap
from cable_ros.contact.friction_kernels import ACROSS, DIRECTION
from cable_ros.contact.points import (
    ARC_LENGTH,
    FORCE,
    FRICTION,
    KIND,
    OBSTACLE,
    SAMPLE,
    SLIP_ROW,
    SLOPE_ROW,
    STICK_ROW,
)
from cable_ros.rod.centreline import curve, elongation, find_element, position, tangent, weight_up_to

OPTIONS = {"cache": True, "error_model": "numpy"}

MOST = 30
"""Maximum number of passes: the normals of the contact points are those at positions that depend on them."""
SETTLED = 1e-13
"""Change of the centreline, L, at which they agree: each pass leaves the part of the strain."""


@njit(**INNER)
def trace(shape, forces, contacts, count, obstacles, strain):
    """The centreline of the shape, `centreline.curve`, with the strain of its forces.

    Args:
        shape: `Shape`, whose centreline is overwritten.
        forces: end force (3,), load per length (3,).
        contacts, count: `ContactSet` and the number of its points; a cable that stretches gets new normals.
        obstacles: (o, WIDTH).
        strain: `Strain`, whose internal forces are overwritten if the cable stretches.
    """
    q, c, grid = shape
    if strain.reach.shape[0] == 0:
        curve(q, grid.h, grid.tables.values, grid.tables.primitives, c)
        return
    r, directions, bends = np.empty(3), np.empty((2, 3)), np.empty(2)
    for _ in range(MOST):
        internal_forces(grid, forces, contacts, count, strain.G)
        change = strained_curve(q, grid, strain, c)
        if change <= SETTLED:
            break
        for i in range(count):
            position(c, grid.h, grid.s0, contacts.points[i, ARC_LENGTH], r)
            gap(obstacles[int(contacts.points[i, OBSTACLE])], r, contacts.normals[i], directions, bends)


@njit(**INNER)
def internal_forces(grid, forces, contacts, count, G):
    """Internal forces at the Gauss points, G (m, g, 3); the other arguments as in `trace`."""
    F, f = forces
    h, s0, tables = grid
    points, normals = contacts.points, contacts.normals
    P = np.empty(3)
    for e in range(h.shape[0]):
        for k in range(G.shape[1]):
            rest = 1.0 - s0[e] - h[e] * tables.points[k]
            for a in range(3):
                G[e, k, a] = F[a] + rest * f[a]
    for i in range(count):
        e, x = find_element(points[i, ARC_LENGTH], s0, h)
        for a in range(3):
            P[a] = points[i, FORCE] * normals[i, a] + points[i, FRICTION + a]
        for k in range(G.shape[1]):
            for j in range(e):
                for a in range(3):
                    G[j, k, a] += P[a]
            share = weight_up_to(tables.primitives, k, x) / tables.weights[k]
            for a in range(3):
                G[e, k, a] += share * P[a]


@njit(**INNER)
def close_strained_curve(shape, forces, contacts, count, compliance, bubbles, out):
    """As `centreline.close_curve`, with the strain at the ends of the elements.

    Where a contact owns the boundary of two elements, friction makes the strain jump there.

    Args:
        shape, forces, contacts, count: as in `trace`, which has been called.
        compliance: (3,) of `Stretch`.
        bubbles: (2, g + 2), see `elements.end_bubbles`.
        out: (m, g + 3, 3) overwritten.
    """
    q, c, (h, s0, tables) = shape
    F, f = forces
    points, normals = contacts.points, contacts.normals
    order, top = tables.values.shape[1] - 1, c.shape[1]
    G, t, misses = np.empty(3), np.empty(3), np.empty((2, 3))
    for e in range(h.shape[0]):
        for side in range(2):
            s = s0[e] + side * h[e]
            for a in range(3):
                G[a] = F[a] + (1.0 - s) * f[a]
            for i in range(count):
                at = points[i, ARC_LENGTH]
                ahead = at > s0[e] if side == 0 else find_element(at, s0, h)[0] > e
                if ahead:
                    for a in range(3):
                        G[a] += points[i, FORCE] * normals[i, a] + points[i, FRICTION + a]
            tangent(q[(e + side) * order], t)
            long = h[e] * (1.0 + compliance[2] * (G[0] * t[0] + G[1] * t[1] + G[2] * t[2]))
            for a in range(3):
                misses[side, a] = long * t[a]
        for a in range(3):
            misses[0, a] -= c[e, 1, a]
            for k in range(top):
                out[e, k, a] = c[e, k, a]
                misses[1, a] -= k * c[e, k, a]
            out[e, top, a] = out[e, top + 1, a] = 0.0
            for k in range(top + 1):
                out[e, k + 1, a] += bubbles[0, k] * misses[0, a] + bubbles[1, k] * misses[1, a]


@njit(**LEAF)
def gauss_tangent(q, first, N, qs, t):
    """Tangent t (3,) at a Gauss point; see `centreline.tangent`.

    Args:
        q, first: (n, 4) nodal frames and the number of the element's first node.
        N: (p + 1,) shape functions there.
        qs, t: (4,), (3,) receive the frame and its tangent.
    """
    for a in range(4):
        qs[a] = 0.0
        for i in range(N.shape[0]):
            qs[a] += N[i] * q[first + i, a]
    tangent(qs, t)


@njit(**INNER)
def strained_curve(q, grid, strain, c):
    """As `centreline.curve`, with the strain; returns the largest change of a coefficient.

    Args:
        q: (n, 4) nodal frames.
        grid: `Grid`.
        strain: `Strain`.
        c: (m, g + 1, 4) overwritten.
    """
    h, _, tables = grid
    N, primitives, soft = tables.values, tables.primitives, strain.compliance[2]
    count, order = N.shape[0], N.shape[1] - 1
    qs, t, new, change = np.empty(4), np.empty(3), np.empty((count + 1, 4)), 0.0
    start = np.zeros(4)
    for e in range(h.shape[0]):
        new[:] = 0.0
        for a in range(4):
            new[0, a] = start[a]
        for k in range(count):
            gauss_tangent(q, e * order, N[k], qs, t)
            G = strain.G[e, k]
            long = h[e] * (1.0 + soft * (G[0] * t[0] + G[1] * t[1] + G[2] * t[2]))
            for m in range(count):
                for a in range(3):
                    new[m + 1, a] += primitives[m, k] * long * t[a]
                new[m + 1, 3] += primitives[m, k] * long
        start[:] = 0.0
        for m in range(count + 1):
            for a in range(4):
                # a centreline that has not been computed yet differs
                if not abs(new[m, a] - c[e, m, a]) <= change:
                    change = abs(new[m, a] - c[e, m, a])
                c[e, m, a] = new[m, a]
                start[a] += new[m, a]
    return change if change >= 0.0 else np.inf


@njit(**INNER)
def reach_blocks(q, grid, compliance, arc_lengths, out):
    """Derivatives of positions by forces: out[i, j] (3, 3) of that at point i by the force at point j.

    Args:
        q, grid: nodal frames (n, 4) and `Grid`.
        compliance: (3,) of `Stretch`.
        arc_lengths: (k,) of the points; the point k + 1 is the end.
        out: (k + 1, k + 1, 3, 3) overwritten.
    """
    h, s0, tables = grid
    N, weights, primitives = tables.values, tables.weights, tables.primitives
    elements, order, size = h.shape[0], N.shape[1] - 1, arc_lengths.shape[0]
    qs, t = np.empty(4), np.empty((elements, N.shape[0], 3))
    before = np.zeros((elements + 1, 3, 3))  # of the end of the elements before, by a force there
    for e in range(elements):
        before[e + 1] = before[e]
        for k in range(N.shape[0]):
            gauss_tangent(q, e * order, N[k], qs, t[e, k])
            for a in range(3):
                for b in range(3):
                    before[e + 1, a, b] += compliance[2] * weights[k] * h[e] * t[e, k, a] * t[e, k, b]
    which, share = np.empty(size + 1, np.int64), np.zeros((size + 1, N.shape[0]))
    which[size] = elements
    for i in range(size):
        e, x = find_element(arc_lengths[i], s0, h)
        which[i] = e
        for k in range(N.shape[0]):
            share[i, k] = weight_up_to(primitives, k, x)
    for i in range(size + 1):
        for j in range(i + 1):
            e = min(which[i], which[j])
            first, other = (i, j) if which[i] == e else (j, i)
            out[i, j] = before[e]
            if e < elements:
                for k in range(N.shape[0]):
                    v = compliance[2] * h[e] * share[first, k]
                    if which[other] == e:
                        v *= share[other, k] / weights[k]
                    for a in range(3):
                        for b in range(3):
                            out[i, j, a, b] += v * t[e, k, a] * t[e, k, b]
            out[j, i] = out[i, j]


@njit(**INNER)
def reach_rows(blocks, owners, lines, pushes, count, reach):
    """How far each row's constraint gives way to each row's multiplier by the strain: `Strain.reach`.

    Args:
        blocks: of `reach_blocks`.
        owners: (rows,) the point that each row reads the position of.
        lines: (rows, 3) directions along which rows read a position.
        pushes: (rows, 3) directions in which their multipliers act.
        count: number of rows.
        reach: (rows, rows) overwritten.
    """
    for a in range(count):
        for b in range(count):
            v = 0.0
            for i in range(3):
                for j in range(3):
                    v += lines[a, i] * blocks[owners[a], owners[b], i, j] * pushes[b, j]
            reach[a, b] = v


@njit(**INNER)
def row_reaches(shape, obstacles, contacts, count, terms, rows, total, strain):
    """`Strain.reach` of all constraint rows; `Strain.skew`, too, if there is friction, and whether there is.

    A friction P that goes along with its point by ds displaces all that is beyond by c (P.t) t ds; what
    sticks at that point is off by the difference of the strains, see `PointTerms.creep`.

    Args:
        shape, obstacles, contacts, count: as in `assembly.constraint_rows`.
        terms: `PointTerms`.
        rows: `ConstraintRows`, whose first three lines, those of the end position, are overwritten.
        total: number of rows.
        strain: `Strain`, overwritten.
    """
    points, lines = contacts.points, rows.lines
    for b in range(3):
        for a in range(3):
            lines[b, a] = 1.0 if a == b else 0.0
    blocks = np.empty((count + 1, count + 1, 3, 3))
    reach_blocks(shape.q, shape.grid, strain.compliance, points[:count, ARC_LENGTH].copy(), blocks)
    reach_rows(blocks, rows.owners, lines, lines, total, strain.reach)
    rough = False
    pushes = lines[:total].copy()
    for i in range(count):
        mu = obstacles[int(points[i, OBSTACLE]), FRICTION_COEFFICIENT]
        for a in range(3):
            rough = rough or points[i, FRICTION + a] != 0.0
            pushes[3 + i, a] += mu * terms.tangents[i, DIRECTION + a]
            if points[i, SLIP_ROW] > 0.0:
                pushes[int(points[i, SLIP_ROW]), a] = terms.tangents[i, ACROSS + a]
    if not rough:
        return False
    reach_rows(blocks, rows.owners, lines, pushes, total, strain.skew)
    for i in range(count):
        moves, t, at = int(points[i, SLOPE_ROW]), terms.t[i], points[i, ARC_LENGTH]
        if points[i, KIND] == SAMPLE or moves == 0 or points[i, FORCE] == 0.0:
            continue
        ds = 1.0 / (points[i, FORCE] * elongation(shape.c, shape.grid.h, shape.grid.s0, at))
        pull = points[i, FRICTION] * t[0] + points[i, FRICTION + 1] * t[1] + points[i, FRICTION + 2] * t[2]
        stick, slip = int(points[i, STICK_ROW]), int(points[i, SLIP_ROW])
        for b in range(total):
            j = rows.owners[b]
            if j == count or points[j, ARC_LENGTH] > at:
                shift, moved = ds * strain.compliance[2] * pull, t
            elif j == i and ((stick > 0 and stick <= b <= stick + 1) or (slip > 0 and b == slip)):
                shift, moved = ds, terms.creep[i]
            else:
                continue
            for a in range(3):
                strain.skew[b, moves] += shift * lines[b, a] * moved[a]
    return True


@njit(**OPTIONS)
def traced(shape, forces, contacts, count, obstacles, strain):
    """`trace` as Python calls it, with fields of groups as plain tuples."""
    trace(shape_of(shape), forces, ContactSet(*contacts), count, obstacles, Strain(*strain))


@njit(**OPTIONS)
def elongations(shape, arc_lengths):
    """(k,) `centreline.elongation` at k arc lengths, as Python calls it."""
    _, c, (h, s0, _) = shape_of(shape)
    out = np.empty(arc_lengths.shape[0])
    for i in range(arc_lengths.shape[0]):
        out[i] = elongation(c, h, s0, arc_lengths[i])
    return out


@njit(**OPTIONS)
def displaced(shape, forces, contacts, count, strain, boundaries):
    """Internal forces at the Gauss points of the grid, and the displacement of its elements' ends by strain.

    Args:
        shape, forces, contacts, count, strain: as in `trace`, as plain tuples; with any rule of integration.
        boundaries: (m + 1, 3) overwritten.
    """
    shape, strain = shape_of(shape), Strain(*strain)
    q, _, grid = shape
    internal_forces(grid, forces, ContactSet(*contacts), count, strain.G)
    N, weights = grid.tables.values, grid.tables.weights
    qs, t = np.empty(4), np.empty(3)
    boundaries[0] = 0.0
    for e in range(grid.h.shape[0]):
        boundaries[e + 1] = boundaries[e]
        for k in range(N.shape[0]):
            gauss_tangent(q, e * (N.shape[1] - 1), N[k], qs, t)
            G = strain.G[e, k]
            tension = G[0] * t[0] + G[1] * t[1] + G[2] * t[2]
            for a in range(3):
                boundaries[e + 1, a] += weights[k] * grid.h[e] * strain.compliance[2] * tension * t[a]


@njit(**OPTIONS)
def reaches(shape, compliance, arc_lengths):
    """`reach_blocks` as Python calls it: (k + 1, k + 1, 3, 3)."""
    q, _, grid = shape_of(shape)
    out = np.empty((arc_lengths.shape[0] + 1, arc_lengths.shape[0] + 1, 3, 3))
    reach_blocks(q, grid, compliance, arc_lengths, out)
    return out
