# SPDX-License-Identifier: Apache-2.0
"""Compiled: Coulomb friction of a contact point.

An elastic-plastic law for the increment since the last equilibrium: stick is a stiff spring, slip a force of
the cone's size against the increment. The force of what sticks is an unknown: that force, not an increment
times the spring's stiffness, decides whether it stays in the cone. Units of the cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, LEAF, LEAF_ENTRY, njit
from cable_ros.contact.points import (
    FORCE,
    FRICTION,
    KIND,
    LENGTH,
    POINT,
    SLIP,
    SLIPS,
    STEP_BEFORE,
    STICK_ROW,
    WAS,
)
from cable_ros.linalg.vectors import cross

DIRECTION, ACROSS, STIFFNESS, TURNS, TANGENT = 0, 3, 6, 7, 10
"""Slots of a tangent of friction: direction of the slip force (3), direction across it (3), stiffness across,
direction in which slip turns the force by it (3); and their number."""
ROUNDING = 1e-10
"""Fraction of the cone by which friction must leave its edge to change from stick to slip or back."""
LEAD, STRAIGHT = 0.5, 8
"""How far slip turns on in a step beyond its mean direction, over the turn from the friction before; and
the power of that turn's cosine with which this fades: to nothing at 60 degrees."""
FRICTIONLESS, COULOMB, SLIDING = 0, 1, 2
"""Models: none; with a history; as (53) of Liu et al. (2018), against the motion of the end."""
HELD = 2.0
"""SLIPS of a point whose rows are those of stick, whatever its friction: see `coulomb_cones`."""
AT_REST = 1e-6
"""Motion over the obstacle, L, whose direction may be rounding."""
STICK = 1e8
"""Largest stiffness of stick, EI / L^3: what sticks moves by at least 1e-8 L per unit of force."""


@njit(**LEAF)
def stick(point, bedding):
    """Stiffness of stick without presliding, EI / L^3, see `stick_stiffness`; `bedding` is `History`'s."""
    return min(STICK, bedding * point[LENGTH]) if point[LENGTH] > 0.0 else STICK


@njit(**LEAF)
def stick_stiffness(point, cone, history):
    """Stiffness of a contact point's stick, EI / L^3: STICK at most, for samples `History.bedding`.

    Args:
        point: (COLUMNS,) of the contact points.
        cone: its largest possible friction, EI / L^2.
        history: `History`.
    """
    stiffness = stick(point, history.bedding)
    if 0.0 < cone < history.presliding * stiffness:
        stiffness = cone / history.presliding
    return stiffness


@njit(**INNER)
def update_friction(points, i, at, mu, history, stiffness, increment, limit):
    """Friction on contact point i after an increment over the obstacle, written to `points`.

    Args:
        points: (CAPACITY, COLUMNS) of `ContactSet`.
        i: the contact point.
        at: `Surface` there.
        mu: coefficient of friction.
        history: `History`.
        stiffness: of its stick, EI / L^3.
        increment: (3,) the increment since the last equilibrium, L; (3,) the friction then, EI / L^2, and
            (3,) the slip of the step before, L, both turned with the obstacle; whether to take that friction,
            sticking or slipping as then.
        limit: (TANGENT,) receives the tangent: direction of the slip force (zero: it sticks), direction
            across it, stiffness across, EI / L^3.

    Returns:
        Whether it began to stick or to slip.
    """
    step, turned, slid, initial = increment
    n, t, direction = at.n, at.t, history.direction
    for a in range(TANGENT):
        limit[a] = 0.0
    cone = mu * max(points[i, FORCE], 0.0)
    if history.model == SLIDING:
        side = cross(t, n)
        size = np.sqrt(side[0] ** 2 + side[1] ** 2 + side[2] ** 2)
        along = side[0] * direction[0] + side[1] * direction[1] + side[2] * direction[2]
        share = np.sqrt(direction[0] ** 2 + direction[1] ** 2 + direction[2] ** 2)
        share *= -1.0 if along > 0.0 else 1.0
        for a in range(3):
            limit[DIRECTION + a] = 0.0 if size == 0.0 else share * side[a] / size
            points[i, FRICTION + a] = cone * limit[DIRECTION + a]
        return False
    if cone == 0.0:
        # about to lift off: it slips without a force, in a direction that shows when it presses again; a new
        # point is taken to stick if that direction is rounding, or its own slip has lifted it
        slid, off, moved = False, 0.0, 0.0
        for a in range(3):
            slid = slid or (points[i, SLIPS] == 1.0 and points[i, FRICTION + a] != 0.0)
            points[i, FRICTION + a] = 0.0
            off += step[a] * n[a]
        for a in range(3):
            moved += (step[a] - off * n[a]) ** 2
        new = points[i, KIND] == POINT and points[i, WAS] == 0.0
        points[i, SLIPS] = 0.0 if new and (slid or moved < AT_REST**2) else 1.0
        if new and points[i, SLIPS] == 1.0 and points[i, FORCE] == 0.0:
            # it begins to press with its friction: without, another contact's may make it seem to pull
            for a in range(3):
                limit[DIRECTION + a] = -(step[a] - off * n[a]) / np.sqrt(moved)
        return False
    force, trial = np.empty(3), np.empty(3)
    off, normal = 0.0, 0.0
    for a in range(3):
        force[a] = turned[a] if initial else points[i, FRICTION + a]
        trial[a] = turned[a] - stiffness * step[a]
        off += force[a] * n[a]
        normal += trial[a] * n[a]
    norm, size, along = 0.0, 0.0, 0.0
    for a in range(3):
        force[a] -= off * n[a]
        trial[a] -= normal * n[a]
        norm += force[a] * force[a]
        size += trial[a] * trial[a]
        along += force[a] * trial[a]
    norm, size = np.sqrt(norm), np.sqrt(size)
    if points[i, SLIPS] == HELD:
        limit[STIFFNESS] = stiffness
        for a in range(3):
            points[i, FRICTION + a] = force[a]
        return False
    slips = points[i, SLIPS] == 1.0
    onward = initial or history.still
    if not slips and norm > (1.0 + ROUNDING) * cone and norm > 0.0 and not initial:
        points[i, SLIPS] = 1.0
        trial = force
        size = norm
    elif slips and not onward and (size < (1.0 - ROUNDING) * cone or along < 0.0):
        points[i, SLIPS] = 0.0
        if points[i, KIND] == POINT and norm > cone:
            # its cone has shrunk meanwhile: beyond it, it would slip on as before at once
            for a in range(3):
                force[a] *= cone / norm
    elif slips and onward:
        trial = force
        size = norm
    if points[i, SLIPS] == 0.0 or size == 0.0:
        points[i, SLIPS] = 0.0
        limit[STIFFNESS] = stiffness
        for a in range(3):
            points[i, FRICTION + a] = force[a]
        # what has begun to press has no rows yet that hold it
        return slips or points[i, STICK_ROW] == 0.0
    for a in range(3):
        limit[DIRECTION + a] = trial[a] / size
    slip = points[i, SLIP : SLIP + 3]
    for a in range(3):
        slip[a] = step[a]
    turns = limit[TURNS:TANGENT]
    turns[0], turns[1], turns[2] = cross(n, limit[DIRECTION:ACROSS])
    by_turn, by_length = 1.0, 0.0
    # what slips along a patch turns on only where it did: as it begins to slip its direction swings
    if history.step > 0.0 and not onward and (points[i, KIND] == POINT or across(slid, n) > AT_REST):
        ratio = history.step / points[i, STEP_BEFORE] if points[i, STEP_BEFORE] > 0.0 else 1.0
        by_turn, by_length = lead(limit[DIRECTION:ACROSS], turned, (slid, slip), n, cone, ratio)
    for a in range(3):
        points[i, FRICTION + a] = cone * limit[DIRECTION + a]
    if history.still:
        return not slips
    limit[ACROSS], limit[ACROSS + 1], limit[ACROSS + 2] = cross(n, limit[DIRECTION:ACROSS])
    # the increment turns the mean direction, and that the force; its length turns the force, too
    square = 0.0
    for a in range(3):
        turns[a] = by_turn * stiffness / size * turns[a] - by_length * slip[a]
        square += turns[a] * turns[a]
    rate = np.sqrt(square)
    for a in range(3):
        turns[a] /= rate
    limit[STIFFNESS] = cone * rate
    return not slips


@njit(**LEAF)
def lead(direction, before, slips, n, cone, ratio):
    """Turn the mean direction of friction in a step, (3,), on to that at its end.

    As a backward difference of second order in the length of slip: the mean is the direction half way, the
    step before tells that half way there, and the way goes on turning. Of what stuck then, the friction
    `before` tells where slip began: half of the turn since is added, a quarter of a step's is left. It is
    less where slip is faster or slower than before, by that factor, for a short slip says little of a long
    one's way. Not where the way has a corner.

    Args:
        direction: is overwritten.
        before: (3,) friction at the last equilibrium, EI / L^2.
        slips: (3,) slip in the step before and (3,) in this one, L. The former is overwritten, the latter
            loses what is along n.
        n: (3,) the normal.
        cone: largest possible friction, EI / L^2.
        ratio: length of this step over that of the step before.

    Returns:
        The derivatives of the turn about n: by that of the mean direction, and by the length of slip, over
        that length, 1 / L^2.
    """
    slid, slip = slips
    size, long = across(slid, n), across(slip, n)
    if size > AT_REST:
        most, grows = lead_of(long, size, ratio)
    else:
        for a in range(3):
            slid[a] = -before[a]
        size, most, grows = max(across(slid, n), cone), LEAD, 0.0
    along, beside, square, side = 0.0, 0.0, 0.0, cross(n, direction)
    for a in range(3):
        along -= direction[a] * slid[a] / size
        beside -= side[a] * slid[a] / size
    fades = max(along, 0.0) ** STRAIGHT
    part = most * fades
    for a in range(3):
        direction[a] = (1.0 + part) * direction[a] + part * slid[a] / size
        square += direction[a] * direction[a]
    norm = np.sqrt(square)
    for a in range(3):
        direction[a] /= norm
    by_turn = (1.0 + part) * (1.0 + part - part * along)
    if along > 0.0:
        by_turn -= STRAIGHT * part / along * beside * beside
    by_length = 0.0 if long == 0.0 else -beside * fades * grows / long
    return by_turn / square, by_length / square


@njit(**LEAF_ENTRY)
def lead_of(long, size, ratio):
    """The part of the mean direction's turn that `lead` adds, and its derivative by the length of slip.

    Args:
        long, size: slip in this step, and, not 0, in the one before, of the same unit.
        ratio: as in `lead`.
    """
    even = ratio * size  # as fast as before
    if long > even:
        return even / (size + long), -even / (size + long) ** 2
    grows = long * (long + 2.0 * size) / ((size + long) ** 2 * even)
    return long * long / ((size + long) * even), grows


@njit(**LEAF_ENTRY)
def ahead(long, size, along, most):
    """From how far ahead of where slip began friction opposes it, over the slip before: `lead` as a place.

    Args:
        long, size: slip in this step, and, not 0, in the one before, of the same unit.
        along: cosine of the angle between both.
        most: of `lead_of`, or LEAD.
    """
    part = most * max(along, 0.0) ** STRAIGHT
    return part / (1.0 + part) * long / size


@njit(**LEAF)
def across(vector, n):
    """Take the part along the normal n (3,) off the vector (3,); returns the size of the rest."""
    off, size = 0.0, 0.0
    for a in range(3):
        off += vector[a] * n[a]
    for a in range(3):
        vector[a] -= off * n[a]
        size += vector[a] * vector[a]
    return np.sqrt(size)
