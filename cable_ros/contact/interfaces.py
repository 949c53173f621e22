# SPDX-License-Identifier: Apache-2.0
"""Compiled: r-adaptation: the arc lengths of contact points, and the boundaries of elements that they own.

The curvature has a kink under a point force, and the shear force jumps at the ends of a contact patch: both
need a boundary between two elements. Units of the cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, LEAF, njit
from cable_ros.contact.contact_state import surface
from cable_ros.contact.distance import gap
from cable_ros.contact.points import (
    ARC_LENGTH,
    FORCE,
    INTERFACE,
    KIND,
    OBSTACLE,
    POINT,
    SAMPLE,
    SWINGS,
    space_at,
)
from cable_ros.contact.stretched import trace
from cable_ros.rod import quaternion
from cable_ros.rod.centreline import derivative, direction, elongation, find_element, position
from cable_ros.rod.centreline import shape as shape_functions

SHARPER = 1.5
"""Curvature of a surface over that beside it from which it is an edge."""
NARROWEST = 0.12
"""Least distance of a boundary to its neighbours, fraction of the distance between them; or half of how near
they are, if that is less."""
STRETCHED, LONG = 1.75, 0.25
"""Maximum length of an element beside a boundary that moves to a point: over the longer of the two before,
and L. The nearest boundary leaves less; a farther one may leave an element too long for its curvature."""
LEVEL = 1e-9
"""Maximum slope of a cable that lies along a surface, rad: rounding."""
SHORTEST = 1e-3
"""Least distance to a boundary that another contact point owns, L."""
TO_AND_FRO = 2.0
"""Number of times that a point beside a clamp swings before it is no longer sent to its gap's minimum."""


@njit(**LEAF)
def gap_at(shape, s, obstacle, at):
    """Gap g at arc length s, and g' = n.t, g'' = n.t' + sum_i bends_i (d_i.t) (d_i.r').

    Here n is the obstacle's normal, d_i and bends_i are its principal directions and curvatures there. The
    derivatives are those by the stretched arc length.

    Args:
        shape: `Shape`.
        s: arc length, L.
        obstacle: (WIDTH,).
        at: `Surface`, overwritten.
    """
    locate(shape, s, at)
    return gap_here(obstacle, at)


@njit(**LEAF)
def locate(shape, s, at):
    """Position, tangent and its derivative at arc length s; `shape`, `s`, `at`: as in `gap_at`."""
    q, c, (h, s0, tables) = shape
    position(c, h, s0, s, at.r)
    derivative(c, h, s0, s, at.dr)
    direction(q, h, s0, tables.nodes, s, at.t, at.dt)
    if c.shape[2] > 3:
        long = elongation(c, h, s0, s)
        for a in range(3):
            at.dr[a] /= long
            at.dt[a] /= long


@njit(**LEAF)
def gap_here(obstacle, at):
    """`gap_at` the position of `at`, with its tangent and that's derivative."""
    value = gap(obstacle, at.r, at.n, at.directions, at.bends)
    slope, curvature = 0.0, 0.0
    for a in range(3):
        slope += at.n[a] * at.t[a]
        curvature += at.n[a] * at.dt[a]
    for i in range(2):
        d, along, moves = at.directions, 0.0, 0.0
        for a in range(3):
            along += d[i, a] * at.t[a]
            moves += d[i, a] * at.dr[a]
        curvature += at.bends[i] * along * moves
    return value, slope, curvature


@njit(**INNER)
def lowest(shape, s, reach, obstacle):
    """The arc length of the gap's minimum near s, at most `reach` away, by safeguarded Newton steps.

    Args:
        shape: `Shape`.
        s, reach: arc length and distance along the cable, L.
        obstacle: (WIDTH,).
    """
    at = surface()
    low, high = max(s - reach, 0.0), min(s + reach, 1.0)
    for _ in range(30):
        _, slope, curvature = gap_at(shape, s, obstacle, at)
        if slope > 0.0:
            high = s
        else:
            low = s
        new = s - slope / curvature if curvature > 0.0 else 0.5 * (low + high)
        if not low <= new <= high:
            new = 0.5 * (low + high)
        if abs(new - s) < 1e-13:
            return new
        s = new
    return s


@njit(**INNER)
def sharpest_at(shape, s, obstacle):
    """The largest curvature, 1 / L, of an obstacle's surface where it is nearest to the cable at s.

    `shape`, `s`, `obstacle`: as in `lowest`.
    """
    at = surface()
    gap_at(shape, s, obstacle, at)
    return max(at.bends[0], at.bends[1])


@njit(**INNER)
def at_edge(shape, low, high, obstacle):
    """Whether an obstacle's surface is nearest at an edge at one of two arc lengths or both, at none between.

    A cable that bends over an edge stands off the face beside it: no patch reaches from an edge onto a face.
    `shape`, `obstacle`: as in `lowest`.
    """
    between = SHARPER * sharpest_at(shape, 0.5 * (low + high), obstacle)
    return max(sharpest_at(shape, low, obstacle), sharpest_at(shape, high, obstacle)) > between


@njit(**LEAF)
def room(points, count, boundary, h):
    """Distances, L, to which a boundary may approach the one before it and the one after it.

    Args:
        points, count: (CAPACITY, COLUMNS) the contact points and their number.
        boundary: its number.
        h: of `Grid`.
    """
    near = max(0.5 * min(h[boundary - 1], h[boundary]), SHORTEST)
    narrow = min(NARROWEST * (h[boundary - 1] + h[boundary]), near)
    before, after = narrow, narrow
    for i in range(count):
        if points[i, INTERFACE] == boundary - 1 and boundary > 1:
            before = min(narrow, SHORTEST)
        if points[i, INTERFACE] == boundary + 1:
            after = min(narrow, SHORTEST)
    return before, after


@njit(**INNER)
def move_interface(q, grid, boundary, s, before, after):
    """Move the boundary between two elements to an arc length; the shape stays, its nodes move.

    Args:
        q: (n, 4) nodal frames, overwritten.
        grid: `Grid`, overwritten.
        boundary: its number.
        s: arc length, L.
        before, after: least distances to the neighbouring boundaries, L.

    Returns:
        Whether it keeps those distances; it stays where it was otherwise.
    """
    h, s0, nodes = grid.h, grid.s0, grid.tables.nodes
    e = boundary - 1
    low, old = s0[e], s0[boundary]
    high = old + h[boundary]
    if s - low < before or high - s < after:
        return False
    if s == old:
        return True
    order = nodes.shape[0] - 1
    first = e * order
    N, dN = np.empty(order + 1), np.empty(order + 1)
    moved = np.empty((2 * order + 1, 4))
    for m in range(2 * order + 1):
        at = low + (s - low) * nodes[m] if m <= order else s + (high - s) * nodes[m - order]
        left = at < old
        shape_functions(nodes, (at - low) / (old - low) if left else (at - old) / (high - old), N, dN)
        base = first if left else first + order
        size = 0.0
        for a in range(4):
            v = 0.0
            for i in range(order + 1):
                v += N[i] * q[base + i, a]
            moved[m, a] = v
            size += v * v
        size = 1.0 / np.sqrt(size)
        for a in range(4):
            moved[m, a] *= size
    for m in range(1, 2 * order):
        for a in range(4):
            q[first + m, a] = moved[m, a]
    h[e], h[boundary] = s - low, high - s
    s0[boundary] = s
    return True


@njit(**INNER)
def turned_since(q_then, h_then, s0_then, q, grid, out):
    """Rotations of the cable's sections at the nodes, rad, since it was on other elements; (3n,) `out`.

    Of the sections, not of the nodes, which move along the cable with the boundaries.

    Args:
        q_then, h_then, s0_then: (n, 4) nodal frames then, and lengths and starts (m,) of as many elements.
        q, grid: (n, 4) the frames now, and `Grid`.
    """
    h, s0, tables = grid
    nodes = tables.nodes
    order = nodes.shape[0] - 1
    N, dN, then = np.empty(order + 1), np.empty(order + 1), np.empty(4)
    for e in range(h.shape[0]):
        for j in range(1, order + 1):
            node = e * order + j
            k, x = find_element(s0[e] + h[e] * nodes[j], s0_then, h_then)
            shape_functions(nodes, x, N, dN)
            for a in range(4):
                then[a] = 0.0
                for i in range(order + 1):
                    then[a] += N[i] * q_then[k * order + i, a]
            turn = quaternion.turn(quaternion.multiply(quaternion.conjugate(then), q[node]))
            for a in range(3):
                out[3 * node + a] = turn[a]


@njit(**INNER)
def own_interface(points, count, i, h, s0):
    """Give contact point i the nearest free boundary that can move to it, or none; whether it has one.

    `points`, `count`, `h`, `s0`: as in `room`.
    """
    s = points[i, ARC_LENGTH]
    best, distance = -1, np.inf
    points[i, INTERFACE] = -1.0
    for b in range(1, h.shape[0]):
        low, high = s0[b - 1], s0[b] + h[b]
        away = abs(s - s0[b])
        before, after = room(points, count, b, h)
        longest = max(STRETCHED * max(h[b - 1], h[b]), LONG)
        there = away < 1e-9 or (
            max(low + 1.5 * before, high - longest) < s < min(high - 1.5 * after, low + longest)
        )
        if not there or away >= distance:
            continue
        taken = False
        for k in range(count):
            taken = taken or points[k, INTERFACE] == b
        if not taken:
            best, distance = b, away
    points[i, INTERFACE] = best
    return best >= 0


@njit(**INNER)
def make_way(q, grid, points, count, i):
    """Move the nearest free boundary to contact point i, and a free one in its way further on.

    Args:
        q, grid: as in `move_interface`.
        points, count, i: as in `own_interface`.

    Returns:
        Whether the point has its boundary.
    """
    h, s0, _ = grid
    s = points[i, ARC_LENGTH]
    taken = np.zeros(h.shape[0] + 1, np.bool_)
    taken[0] = taken[h.shape[0]] = True
    for k in range(count):
        if points[k, INTERFACE] >= 0.0:
            taken[int(points[k, INTERFACE])] = True
    best = -1
    for b in range(1, h.shape[0]):
        if not taken[b] and (best < 0 or abs(s0[b] - s) < abs(s0[best] - s)):
            best = b
    if best < 0:
        return False
    step = 1 if s > s0[best] else -1
    between = best + step
    if taken[between] and 0 < between < h.shape[0] and (s - s0[between]) * step > 0.0:
        return hand_on(q, grid, points, count, i, between, best)
    before, after = room(points, count, best, h)
    if not taken[best - 1] and s - s0[best - 1] < before:
        move_interface(q, grid, best - 1, 0.5 * (s0[best - 2] + s), before, after)
    if not taken[best + 1] and s0[best + 1] - s < after:
        move_interface(q, grid, best + 1, 0.5 * (s + s0[best + 1] + h[best + 1]), before, after)
    if not move_interface(q, grid, best, s, before, after):
        return False
    points[i, INTERFACE] = best
    return True


@njit(**INNER)
def hand_on(q, grid, points, count, i, between, free):
    """Move the boundary of the point next to contact point i on to i, and a free one behind it to that point.

    So the two ends of a new patch get a boundary each where one stood at the point that it was.

    Args:
        q, grid: as in `move_interface`.
        points, count, i: as in `own_interface`.
        between, free: numbers of the two boundaries.

    Returns:
        Whether point i has its boundary.
    """
    for k in range(count):
        if points[k, INTERFACE] == between:
            points[k, INTERFACE], points[i, INTERFACE] = free, between
            before, after = room(points, count, between, grid.h)
            moved = move_interface(q, grid, between, points[i, ARC_LENGTH], before, after)
            before, after = room(points, count, free, grid.h)
            if moved and move_interface(q, grid, free, points[k, ARC_LENGTH], before, after):
                return True
            # too near for two: the end of a patch has it, as its element is flat up to there
            points[k, INTERFACE] = -1.0
            if not moved or points[k, KIND] != POINT:
                points[i, INTERFACE] = -1.0
            return points[i, INTERFACE] >= 0.0
    return False


@njit(**INNER)
def place_points(shape, obstacles, spacing, contacts, count, forces, strain):
    """Move the points to their gap's minimum, and boundaries to them and to the ends of patches.

    None goes across a patch: within one the gap has no minimum.

    Args:
        shape: `Shape`, which changes with the mesh.
        obstacles: (o, WIDTH).
        spacing: of the samples, L.
        contacts, count: `ContactSet` and the number of its points.
        forces, strain: as in `stretched.trace`.

    Returns:
        Whether each has its boundary.
    """
    q, _, grid = shape
    h, s0, _ = grid
    points = contacts.points
    at = surface()
    trace(shape, forces, contacts, count, obstacles, strain)
    owned = True
    for i in range(count):
        if points[i, KIND] == SAMPLE:
            continue
        if points[i, KIND] == POINT:
            ob, s = obstacles[int(points[i, OBSTACLE])], points[i, ARC_LENGTH]
            _, slope, curvature = gap_at(shape, s, ob, at)
            # where the cable is all but flat on the surface, rounding would send it to and fro
            level = curvature <= 0.0 and abs(slope) < LEVEL
            minimum = s if level else lowest(shape, s, spacing, ob)
            # the kink that its force makes moves with the point: the shape does not show it at the minimum
            kink = 0.25 * points[i, FORCE] * abs(minimum - s)
            sharpest = SHARPER * max(at.bends[0], at.bends[1])
            if kink > curvature and not level:
                # beside an edge the gap is curved as the face is, and at its minimum as the edge
                _, _, there = gap_at(shape, minimum, ob, at)
                curvature = there if max(at.bends[0], at.bends[1]) > sharpest else curvature
            # beside a clamp this and Newton's method may send it to and fro: then that alone places it
            swings = points[i, SWINGS] >= TO_AND_FRO and min(s, 1.0 - s) < spacing
            if kink <= curvature and not swings and space_at(points, count, i, minimum) > 0.0:
                points[i, ARC_LENGTH] = minimum
        for _ in range(2):
            if points[i, INTERFACE] < 0.0 and not own_interface(points, count, i, h, s0):
                break
            b = int(points[i, INTERFACE])
            before, after = room(points, count, b, h)
            if move_interface(q, grid, b, points[i, ARC_LENGTH], before, after):
                break
            points[i, INTERFACE] = -1.0
        if points[i, INTERFACE] >= 0.0 or (points[i, KIND] != POINT and make_way(q, grid, points, count, i)):
            trace(shape, forces, contacts, count, obstacles, strain)
        else:
            owned = False
    return owned
