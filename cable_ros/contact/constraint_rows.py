# SPDX-License-Identifier: Apache-2.0
"""Compiled: the constraint rows of contact points and ends of patches, which `assembly` borders the rod's
banded system with. Units of the cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, LEAF, njit
from cable_ros.contact.distance import FRICTION_COEFFICIENT, across, pull
from cable_ros.contact.friction_kernels import (
    ACROSS,
    DIRECTION,
    STIFFNESS,
    TANGENT,
    TURNS,
)
from cable_ros.contact.point_couples import has_arm, hold_rows
from cable_ros.contact.points import (
    ARC_LENGTH,
    AT_EDGE,
    FIRST,
    FORCE,
    FRICTION,
    KIND,
    LENGTH,
    OBSTACLE,
    POINT,
    SAMPLE,
    SLIP_ROW,
    SLOPE_ROW,
    STICK_ROW,
    YIELD,
)
from cable_ros.contact.stretched import row_reaches
from cable_ros.linalg.copies import copy
from cable_ros.linalg.vectors import cross
from cable_ros.rod.centreline import (
    find_element,
    increments,
    interpolate_frame,
    tangent,
    tangent_derivative,
    weight_up_to,
)
from cable_ros.rod.centreline import shape as shape_functions

STIFFER = 1.5
"""Maximum ratio, or its inverse, of friction's stiffness to that in the constraint rows that still serve."""
BESIDE_CLAMP = 0.02
"""Distance to a clamp, L, within which a point hardly rolls."""
LONG_PATCH = 0.05
"""Length of a patch, L, above which its friction moves with its ends: a shorter one is mostly a point."""
FAINT = 1e-9
"""EI / L^2; a point with less force than this turns no force by its motion."""


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
        if points[i, SLIP_ROW] > 0.0 and terms.tangents[i, STIFFNESS] > 0.0:
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
    V, W, delta, lines, upto, owners, movers, shifts = rows
    geometric, dchord, C = tangents.geometric, tangents.dchord, tangents.C
    N, primitives = tables.values, tables.primitives
    order = N.shape[1] - 1
    nd = 3 * (order + 1)
    columns = C.shape[1]
    for a in range(3):
        for j in range(columns):
            V[a, j] = C[a, j]
        delta[a] = 0.0
        owners[a], movers[a] = count, 0
    total = 3 + count
    same = True
    D, frame = np.empty((4, nd)), np.empty((4, nd))
    own, turn = np.empty((3, nd)), np.empty((3, nd))
    by_position = np.empty((3, columns))
    mu = 0.0
    Nx, dNx = np.empty(order + 1), np.empty(order + 1)
    qs, P, t = np.empty(4), np.empty(3), np.empty(3)
    sticking = np.empty((2, 3))
    soft = strain.reach.shape[0] > 0
    # the points of an element share what its shape is at the Gauss points
    slopes, pulls = np.empty((h.shape[0], N.shape[0], 3, nd)), np.zeros((h.shape[0], N.shape[0], 3))
    reached = np.zeros(h.shape[0], np.bool_)
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
        if x > 0.0:
            if not reached[e]:
                element_slopes(q, frame, e, N, strain, slopes[e])
                reached[e] = True
            for k in range(N.shape[0]):
                weight = h[e] * weight_up_to(primitives, k, x)
                for a in range(3):
                    pulls[e, k, a] += weight * P[a]
                    for j in range(nd):
                        own[a, j] += weight * slopes[e, k, a, j]
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
        upto[3 + i], owners[3 + i], movers[3 + i] = e, i, 0
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
                row(V, total, friction[TURNS:TANGENT], by_position)
                copy(friction[TURNS:TANGENT], lines[total])
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
            copy(V[b], W[b])
        if slip and friction[STIFFNESS] > 0.0:
            row(W, int(points[i, SLIP_ROW]), friction[ACROSS:STIFFNESS], by_position)
        turns = points[i, FORCE] >= FAINT and not soft
        rubs = turns and friction[STIFFNESS] > 0.0
        away = min(points[i, ARC_LENGTH], 1.0 - points[i, ARC_LENGTH]) > BESIDE_CLAMP
        rolls = rubs and away and points[i, KIND] != SAMPLE and points[i, SLOPE_ROW] > 0.0
        rolls = rolls and points[i, AT_EDGE] == 0.0  # no edge holds it there
        rolls = rolls and (not ends or extent(points, count, i) > LONG_PATCH)
        if rolls:
            same = False
            take_along(points[i], turn, W[int(points[i, SLOPE_ROW])], 3 * first)
        if rubs and not has_arm(points, i):
            same = not keep_across(points[i], terms.slopes[i], rows, 3 + i, (begin, total)) and same
        if slip and turns and friction[STIFFNESS] == 0.0:
            points[i, SLIP_ROW] = total
            turning_rows(
                (points[i], normals[i], terms, i, mu), by_position, turn, 3 * first, total, rows, gaps
            )
            total += 2
        for b in range(begin, total):
            upto[b], owners[b], movers[b] = e, i, 0
        if ends and rolls:
            begin = int(points[i, SLIP_ROW] if slip else points[i, STICK_ROW])
            for b in range(begin, begin + (1 if slip else 2)):
                movers[b], shifts[b] = int(points[i, SLOPE_ROW]), 0.0
                for a in range(3):
                    shifts[b] += lines[b, a] * terms.drift[i, a] / points[i, FORCE]
    for e in range(h.shape[0]):
        if reached[e]:
            stiffen(q, e, N, pulls[e], geometric)
    held = total
    total = hold_rows(shape, points, count, tangents, rows, total, gaps)
    for b in range(3):
        copy(V[b], W[b])
    for b in range(held, total):
        copy(V[b], W[b])
        movers[b] = 0
    for i in range(count):
        stick_constraints(points, i, terms.misfits, lines, gaps)
    if soft:
        same = not row_reaches(shape, obstacles, contacts, count, terms, rows, total, strain) and same
    return total, same


@njit(**LEAF)
def extent(points, count, i):
    """Length of the patch that ends at contact point i, L; 1 if it reaches a clamp."""
    length = 1.0
    for k in range(count):
        if points[k, OBSTACLE] == points[i, OBSTACLE] and points[k, KIND] >= FIRST and k != i:
            length = min(length, abs(points[k, ARC_LENGTH] - points[i, ARC_LENGTH]))
    return length


@njit(**LEAF)
def take_along(point, turn, own, first):
    """Add a point's friction to the row `own` (3n,) along which the force that holds its slope acts.

    Both move along the cable as it rolls.

    Args:
        point: (COLUMNS,).
        turn: (3, nd) derivative of the tangent at its arc length.
        first: column of the first node of its element.
    """
    for a in range(3):
        part = point[FRICTION + a] / point[FORCE]
        for j in range(turn.shape[1]):
            own[first + j] += part * turn[a, j]


@njit(**LEAF)
def keep_across(point, slopes, rows, own, turning):
    """Let a point's friction stay across the normal, in the rows that turn that: the motion over a curved
    surface, and along the cable.

    Args:
        point: (COLUMNS,).
        slopes: (3,) of `PointTerms`.
        rows: `ConstraintRows`, whose W is overwritten.
        own: number of the row of the point's normal force.
        turning: numbers of the first row after the gaps that is its own, and of the first that is not.

    Returns:
        Whether any row has changed.
    """
    changed = False
    for b in range(turning[0], turning[1]):
        normal = rows.delta[b] < 0.0
        if not normal and not (point[KIND] != SAMPLE and point[SLOPE_ROW] == b):
            continue
        leans = 0.0  # of the friction, along the normal
        for a in range(3):
            turns = rows.lines[b, a] if normal else slopes[a]
            leans -= point[FRICTION + a] * turns / point[FORCE]
            changed = changed or turns != 0.0
        for j in range(rows.W.shape[1]):
            rows.W[b, j] += leans * rows.V[own, j]
    return changed


@njit(**INNER)
def element_slopes(q, frame, e, N, strain, slopes):
    """Derivatives of the tangents, with axial strain if there is any, at the Gauss points of element e by the
    rotations of its nodes.

    Args:
        q: (n, 4) nodal frames.
        frame: (4, b) derivatives of the element's, see `increments`.
        e: the element.
        N: (g, p + 1) shape functions at the Gauss points.
        strain: `Strain`.
        slopes: (g, 3, b), overwritten.
    """
    order = N.shape[1] - 1
    nd = frame.shape[1]
    qs, t, D, tilt = np.empty(4), np.empty(3), np.empty(frame.shape), np.empty((3, nd))
    slopes[:] = 0.0
    for k in range(N.shape[0]):
        interpolate_frame(q, e * order, order, N[k], frame, qs, D)
        norm = tangent(qs, t)
        if strain.reach.shape[0] > 0:
            tilt[:] = 0.0
            tangent_derivative(qs, t, 2.0 / norm, D, tilt, 0, nd)
            strain_slopes(strain.compliance[2], strain.G[e, k], t, tilt, slopes[k])
        else:
            tangent_derivative(qs, t, 2.0 / norm, D, slopes[k], 0, nd)


@njit(**INNER)
def stiffen(q, e, N, pulls, geometric):
    """Add to the geometric stiffness what contact forces do as element e turns under them.

    Args:
        q: (n, 4) nodal frames.
        e: the element.
        N: (g, p + 1) shape functions at the Gauss points.
        pulls: (g, 3) forces there, by the length that is before each contact point, EI / L.
        geometric: (3n, b) of `Tangents`.
    """
    order = N.shape[1] - 1
    nd = 3 * (order + 1)
    band = nd - 1
    frame, D, Y = np.empty((4, nd)), np.empty((4, nd)), np.empty((4, nd))
    qs, gT, H = np.empty(4), np.empty(4), np.empty((4, 4))
    first = e * order
    for j in range(order + 1):
        increments(q[first + j], 3 * j, frame)
    for k in range(N.shape[0]):
        interpolate_frame(q, first, order, N[k], frame, qs, D)
        pull(qs, pulls[k], 1.0, gT, H)
        for a in range(4):
            for j in range(nd):
                Y[a, j] = H[a, 0] * D[0, j] + H[a, 1] * D[1, j] + H[a, 2] * D[2, j] + H[a, 3] * D[3, j]
        for j in range(nd):
            for m in range(j + 1):
                geometric[3 * first + j, band + m - j] += (
                    D[0, j] * Y[0, m] + D[1, j] * Y[1, m] + D[2, j] * Y[2, m] + D[3, j] * Y[3, m]
                )


@njit(**INNER)
def turning_rows(at, by_position, turn, first, b, rows, gaps):
    """Two rows by which friction across the cable turns with the cable and with the normal.

    Their unknowns are the changes of the friction along the normal and across both, at the same normal force.
    A cable that hangs loose turns its own friction, which turns it on.

    Args:
        at: the point (COLUMNS,), the normal there (3,), `PointTerms`, the point's number, its coefficient.
        by_position, turn: (3, 3n), (3, nd) derivatives of position and tangent at the point's arc length.
        first: column of the first node of its element.
        b: number of the first of both rows.
        rows: `ConstraintRows`, whose V, W, delta and lines receive them.
        gaps: of `ContactSet`.
    """
    point, n, terms, i, mu = at
    V, W, delta, lines = rows.V, rows.W, rows.delta, rows.lines
    t, d = terms.t[i], terms.tangents[i, DIRECTION:ACROSS]
    side, unit, other = cross(t, n), np.empty(3), np.empty(3)
    size = np.sqrt(side[0] ** 2 + side[1] ** 2 + side[2] ** 2)
    signed, tilted = 0.0, 0.0
    for a in range(3):
        unit[a] = side[a] / size
        signed += d[a] * unit[a]
        tilted += n[a] * t[a]
    other[0], other[1], other[2] = cross(unit, n)
    force = mu * point[FORCE] * signed / size
    # the point moves along the cable as its gap's slope asks for
    slides = point[KIND] == POINT and point[SLOPE_ROW] > 0.0
    per_slope, bent, leans = 0.0, 0.0, np.zeros(3)
    if slides:
        per_slope = -1.0 / terms.curvature[i]
    for k in range(2):
        u, v = 0.0, 0.0
        for a in range(3):
            u += unit[a] * terms.directions[i, k, a]
            v += t[a] * terms.directions[i, k, a]
        bent += terms.bends[i, k] * u * v
        for a in range(3):
            leans[a] += terms.bends[i, k] * u * terms.directions[i, k, a]
    curved = unit[0] * terms.dt[i, 0] + unit[1] * terms.dt[i, 1] + unit[2] * terms.dt[i, 2]
    # friction's change along n is -force size (u . dn), across both force (u . dt - (n . t) u . dn)
    for k in range(2):
        by_lean, by_turn = (-force * size, 0.0) if k == 0 else (-force * tilted, force)
        shift = by_lean * bent + by_turn * curved
        for j in range(by_position.shape[1]):
            V[b + k, j] = 0.0
            for a in range(3):
                line = by_lean * leans[a] + shift * per_slope * terms.slopes[i, a]
                V[b + k, j] -= line * by_position[a, j]
        for j in range(turn.shape[1]):
            for a in range(3):
                V[b + k, first + j] -= (by_turn * unit[a] + shift * per_slope * n[a]) * turn[a, j]
        delta[b + k] = 1.0
        gaps[b + k - 3] = -shift * per_slope * terms.tilts[i]
        for a in range(3):
            lines[b + k, a] = 0.0
    row(W, b, n, by_position)
    row(W, b + 1, other, by_position)
    if slides:
        take_along(point, turn, W[int(point[SLOPE_ROW])], first)


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
