# SPDX-License-Identifier: Apache-2.0
"""Compiled: an iteration in which friction obeys Coulomb's law of the linearised rod.

Newton's method takes from the last iteration which contact points stick and which slip. Where two of them
slip by all but nothing these go round in turn. Here all points may slip, by what minimises the energy of the
linearised rod and the work against friction, a convex problem where the cable is stable: it says at once
which ones do. Units of the cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import INNER, LEAF, njit
from cable_ros.contact.distance import FRICTION_COEFFICIENT
from cable_ros.contact.friction_kernels import AT_REST, HELD, LEAD, ahead, lead_of
from cable_ros.contact.points import (
    BEFORE,
    FORCE,
    FRICTION,
    KIND,
    OBSTACLE,
    POINT,
    SLIP,
    SLIP_BEFORE,
    SLIPS,
    STEP_BEFORE,
    STICK_ROW,
)
from cable_ros.linalg import dense

MOST_POINTS = 12
"""Maximum number of contact points for which this is tried."""
FIRST, LAST, SHARPER = 1.0, 1e-13, 0.1
"""Slip in which friction grows to its limit: at first, over that in which stick gives way by as much; at
last, L; and the ratio of one and the next."""
SLIDES = 1e-12
"""Slip, L, of a point that does not stick."""
MOST_STEPS, HALVED, MOST_CONES = 40, 20, 30
"""Maximum number of Newton's steps for one sharpness, of times that one is halved, and of renewed cones."""
EXACT, SETTLED = 1e-11, 1e-8
"""Error of friction that ends the steps, and the rounds, over the largest cone."""
RELAXED = 2.0 / 3.0
"""Part of a change of the lead that is made in a round: the next one takes back half where slip is soft."""


@njit(**LEAF)
def may_hold(points, count):
    """Whether friction may be found so: few points touch, and nothing lies; arguments as of `hold`."""
    alone = 0 < count <= MOST_POINTS
    for i in range(count):
        alone = alone and points[i, KIND] == POINT
    return alone


@njit(**LEAF)
def hold(points, count, obstacles):
    """Let the rows of what rubs be those of stick.

    Args:
        points, count: (CAPACITY, COLUMNS) the contact points and their number.
        obstacles: (o, WIDTH).
    """
    for i in range(count):
        if obstacles[int(points[i, OBSTACLE]), FRICTION_COEFFICIENT] > 0.0:
            points[i, SLIPS] = HELD


@njit(**LEAF)
def let_go(points, count):
    """Of what is held let stick what has not slipped, and slip all else; arguments as of `hold`."""
    for i in range(count):
        square = 0.0
        for a in range(3):
            square += points[i, SLIP + a] ** 2
        if points[i, SLIPS] == HELD:
            points[i, SLIPS] = 1.0 if square > SLIDES**2 else 0.0


@njit(**INNER)
def slip_on_cones(contact, obstacles, history, small, swaps, y):
    """Let what is held slip in a step as Coulomb's law asks for, in place of its rows of stick.

    Args:
        contact: the contact points (CAPACITY, COLUMNS), which receive their slip, their number, and `lines`
            of `ConstraintRows`.
        obstacles: (o, WIDTH).
        history: `History`.
        small, swaps, y: of `bordered.kkt_multipliers`, which has found y with all points held; overwritten.

    Returns:
        Whether it has been solved.
    """
    points, count, lines = contact
    rows = swaps.shape[0]
    if count == 0:
        return False  # it has left all that it touched
    which, n = np.empty(count, np.int64), 0
    for i in range(count):
        if points[i, STICK_ROW] > 0.0:
            which[n] = i
            n += 1
    # what each slip does to all multipliers
    X, tau = np.empty((2 * n, rows)), np.empty(2 * n)
    K, slip, unit = np.empty((2 * n, 2 * n)), np.empty(2 * n), np.zeros(rows)
    for j in range(2 * n):
        i = which[j // 2]
        k = int(points[i, STICK_ROW]) + j % 2
        unit[k] = 1.0
        dense.solve_factored(small, swaps, unit, X[j])
        unit[k] = 0.0
        tau[j], slip[j] = y[k], 0.0
        for a in range(3):
            tau[j] += points[i, FRICTION + a] * lines[k, a]
            slip[j] += points[i, SLIP + a] * lines[k, a]
    for j in range(2 * n):
        for m in range(2 * n):
            K[m, j] = X[j, int(points[which[m // 2], STICK_ROW]) + m % 2]
    cones, lead, sharp = np.zeros(n), np.zeros(2 * n), FIRST
    for _ in range(MOST_CONES):
        change, largest = 0.0, 0.0
        for m in range(n):
            i, own = which[m], slice(2 * m, 2 * m + 2)
            change = max(
                change, move_ahead(points[i], lines, history, slip[own], lead[own]) * K[2 * m, 2 * m]
            )
            force = points[i, FORCE] + y[3 + i]
            for j in range(2 * n):
                force += X[j, 3 + i] * slip[j]
            cone = obstacles[int(points[i, OBSTACLE]), FRICTION_COEFFICIENT] * max(force, 0.0)
            change = max(change, abs(cone - cones[m]))
            cones[m], largest = cone, max(largest, cone)
        if sharp < FIRST and change <= SETTLED * largest:
            break
        if not slide(K, tau, lead, cones, sharp, slip):
            return False
        sharp = SHARPER**3
    for j in range(2 * n):
        for k in range(rows):
            y[k] += X[j, k] * slip[j]
    for m in range(n):
        i = which[m]
        k = int(points[i, STICK_ROW])
        for a in range(3):
            points[i, SLIP + a] = slip[2 * m] * lines[k, a] + slip[2 * m + 1] * lines[k + 1, a]
    return True


@njit(**LEAF)
def move_ahead(point, lines, history, slip, lead):
    """From where friction opposes the slip (2,), see `ahead`; returns by how much that, `lead` (2,), changes.

    Both are along the rows of stick of the contact point (COLUMNS,). The turn of its obstacle in the step is
    left out: the iterations that come after have it.
    """
    k, x, y, square = int(point[STICK_ROW]), 0.0, 0.0, 0.0
    for a in range(3):
        square += point[SLIP_BEFORE + a] ** 2
    begins = square <= AT_REST**2
    for a in range(3):
        before = -point[BEFORE + a] if begins else point[SLIP_BEFORE + a]
        x += before * lines[k, a]
        y += before * lines[k + 1, a]
    long, size = np.sqrt(slip[0] ** 2 + slip[1] ** 2), np.sqrt(x * x + y * y)
    share = 0.0
    if long > 0.0 and size > 0.0 and history.step > 0.0 and not history.still:
        most = LEAD
        if not begins:
            ratio = history.step / point[STEP_BEFORE] if point[STEP_BEFORE] > 0.0 else 1.0
            most, _ = lead_of(long, size, ratio)
        share = ahead(long, size, (slip[0] * x + slip[1] * y) / (long * size), most)
    x, y = share * x - lead[0], share * y - lead[1]
    lead[0], lead[1] = lead[0] + RELAXED * x, lead[1] + RELAXED * y
    return max(abs(x), abs(y))


@njit(**INNER)
def slide(K, tau, lead, cones, first, slip):
    """Slip (2 n,), overwritten, that friction opposes from `lead` (2 n,) on: tau + K slip is its force.

    It minimises slip . (tau + K slip / 2) + sum of each cone times |slip - lead|. Newton's method on that
    with a rounded tip, ever sharper.

    Args:
        K: (2 n, 2 n) stiffness against slip, EI / L^3.
        tau: (2 n,) friction if all stick, EI / L^2.
        cones: (n,) largest friction, EI / L^2.
        first: FIRST, or the same over sharper tips if the slip is known roughly.

    Returns:
        Whether it was found.
    """
    n = tau.shape[0]
    largest, softest = 0.0, np.inf
    for m in range(cones.shape[0]):
        largest = max(largest, cones[m])
    for j in range(n):
        softest = min(softest, K[j, j])
    if not softest > 0.0:
        return False
    H, swaps = np.empty((n, n)), np.empty(n, np.int64)
    residual, trial, step, at = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    tip = max(first * largest / softest, LAST)
    while True:
        size = off(K, tau, lead, cones, tip, slip, residual)
        for _ in range(MOST_STEPS):
            if size <= EXACT * largest:
                break
            for j in range(n):
                for m in range(n):
                    H[j, m] = K[j, m]
            for m in range(cones.shape[0]):
                u, v = slip[2 * m] - lead[2 * m], slip[2 * m + 1] - lead[2 * m + 1]
                rho = np.sqrt(u * u + v * v + tip * tip)
                u, v, stiff = u / rho, v / rho, cones[m] / rho
                H[2 * m, 2 * m] += stiff * (1.0 - u * u)
                H[2 * m, 2 * m + 1] -= stiff * u * v
                H[2 * m + 1, 2 * m] -= stiff * u * v
                H[2 * m + 1, 2 * m + 1] += stiff * (1.0 - v * v)
            dense.factor(H, swaps)
            dense.solve_factored(H, swaps, residual, step)
            part, less = 1.0, size
            for _ in range(HALVED):
                for j in range(n):
                    at[j] = slip[j] - part * step[j]
                less = off(K, tau, lead, cones, tip, at, trial)
                if less <= (1.0 - 0.1 * part) * size:
                    break
                part *= 0.5
            if not less < size:
                break  # rounding
            size = less
            for j in range(n):
                slip[j], residual[j] = at[j], trial[j]
        if size > 1e-6 * largest:
            return False
        if tip <= LAST:
            return True
        tip = max(SHARPER * tip, LAST)


@njit(**LEAF)
def off(K, tau, lead, cones, tip, slip, residual):
    """Size of the `residual` (2 n,), overwritten, at the slip (2 n,); arguments as in `slide`; `tip`: L."""
    square = 0.0
    for m in range(cones.shape[0]):
        u, v = slip[2 * m] - lead[2 * m], slip[2 * m + 1] - lead[2 * m + 1]
        stiff = cones[m] / np.sqrt(u * u + v * v + tip * tip)
        residual[2 * m], residual[2 * m + 1] = tau[2 * m] + stiff * u, tau[2 * m + 1] + stiff * v
        for j in range(slip.shape[0]):
            residual[2 * m] += K[2 * m, j] * slip[j]
            residual[2 * m + 1] += K[2 * m + 1, j] * slip[j]
        square += residual[2 * m] ** 2 + residual[2 * m + 1] ** 2
    return np.sqrt(square)
