# SPDX-License-Identifier: Apache-2.0
"""Compiled: points at which a cable, more curved than the surface, begins to lie on it become patches."""

from __future__ import annotations

from cable_ros.compilation import INNER, LEAF, njit
from cable_ros.contact.contact_state import surface
from cable_ros.contact.interfaces import SHARPER, gap_at, lowest, sharpest_at
from cable_ros.contact.patch_ends import ROOM
from cable_ros.contact.patches import make_patch
from cable_ros.contact.points import ARC_LENGTH, FORCE, KIND, OBSTACLE, POINT, SHIFT, SWINGS, space_at

MANY = 3.0
"""Swings in a row of a point that becomes a patch."""


@njit(**INNER)
def flatten(shape, spacing, obstacles, give, points, count):
    """Make patches of the points beside which the cable, more curved than the surface, dips too deep.

    Args:
        shape: `Shape`.
        spacing: of the samples, L.
        obstacles: (o, WIDTH).
        give: depth that is too deep, L.
        points, count: (CAPACITY, COLUMNS) the contact points and their number.

    Returns:
        Whether there are any, and the number of points.
    """
    at = surface()
    changed = False
    i = 0
    while i < count:
        if points[i, KIND] == POINT and points[i, FORCE] > 0.0:
            o, P = int(points[i, OBSTACLE]), points[i, FORCE]
            # at the minimum that it moves to: beside an edge the gap is curved as the face is
            s = lowest(shape, points[i, ARC_LENGTH], spacing, obstacles[o])
            _, _, curvature = gap_at(shape, s, obstacles[o], at)
            half = spacing
            if curvature >= 0.0:
                # or, if it alternates between two minima, at the maximum between them
                s, curvature, half = ridge(shape, points[i, ARC_LENGTH], spacing, obstacles[o])
            swings = points[i, SWINGS] >= MANY
            dips = curvature < 0.0 and -2.67 * curvature**3 > give * P**2
            if swings:
                # between the places where it swings to and fro the cable begins to lie on the surface
                half = min(0.5 * abs(points[i, SHIFT]), spacing)
                s = points[i, ARC_LENGTH] - (half if points[i, SHIFT] > 0.0 else -half)
            elif dips:
                half = half_patch(s, curvature, P, half)
            space = space_at(points, count, i, s) if swings or dips else 0.0
            if space > 0.0:
                half = min(half, ROOM * space)
                points[i, ARC_LENGTH] = s
                count = make_patch(points, count, o, max(s - half, 0.0), min(s + half, 1.0))
                changed = True
                i = 0
                continue
        i += 1
    return changed, count


@njit(**LEAF)
def half_patch(s, curvature, force, most):
    """Half the length of the patch that a contact point becomes, L, at most `most`.

    The gap's curvature, negative there, rises by half the force per length on both sides.

    Args:
        s: arc length of the point, L.
        curvature: of the gap there, 1 / L.
        force: EI / L^2.
        most: L.
    """
    return min(-2.0 * curvature / force, most, 0.45 * s, 0.45 * (1.0 - s))


@njit(**INNER)
def ridge(shape, s, spacing, obstacle):
    """Arc length of a maximum of the gap near s between two minima, its curvature, and the room beside it.

    The curvature is 0 if there is none, or if the minima are those of two edges.

    Args:
        shape: `Shape`.
        s, spacing: arc length, and that of the samples, L.
        obstacle: (WIDTH,).
    """
    at = surface()
    _, slope, curvature = gap_at(shape, s, obstacle, at)
    sharpest = max(at.bends[0], at.bends[1])
    if not curvature < 0.0 or abs(slope) > -0.5 * spacing * curvature:
        return s, 0.0, spacing
    top = s - slope / curvature
    if not spacing < top < 1.0 - spacing:
        return s, 0.0, spacing
    before = lowest(shape, top - 0.5 * spacing, 0.5 * spacing, obstacle)
    after = lowest(shape, top + 0.5 * spacing, 0.5 * spacing, obstacle)
    if sharpest_at(shape, before, obstacle) > SHARPER * sharpest:
        return s, 0.0, spacing
    if sharpest_at(shape, after, obstacle) > SHARPER * sharpest:
        return s, 0.0, spacing
    least, most = 1e-6 * spacing, (1.0 - 1e-6) * spacing
    if least < top - before < most and least < after - top < most:
        return top, curvature, 0.25 * (after - before)
    return s, 0.0, spacing
