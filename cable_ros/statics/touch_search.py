"""Compiled: which places of the cable touch, and how they change as its shape does.

Where the gap has a distinct minimum a contact point sits there, at any arc length: a unilateral constraint
gap >= 0 with its multiplier, the normal force. It slides with the shape. Along a stretch that lies on the
surface the gap has no distinct minimum: there the samples that are inside are pushed out by stiff springs
("flat" points), so many that together they are a pressure. Units of the cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import njit
from cable_ros.mechanics.effects.contact_kernels import curve, find_element, gap, position
from cable_ros.statics.touch_places import gap_at, lowest
from cable_ros.statics.touch_points import (
    APART,
    FLAT,
    FORCE,
    HELD,
    LENGTH,
    OBSTACLE,
    PLACE,
    add,
    ends,
    lay,
    owned,
    remove,
    share,
)

OPTIONS = {"cache": True, "error_model": "numpy"}

FINE = 16
"""Samples about a stretch's ends for one elsewhere: where it lifts off decides the wrench."""
MOST_SAMPLES = 2400
LONG = 4.0
"""What is inside over so many samples is no point contact."""


@njit(**OPTIONS)
def scan(c, h, s0, samples, obstacles, phi):
    """Gaps phi (obstacles, samples) at the arc lengths `samples`; returns the smallest at the inner ones."""
    r, n = np.empty(3), np.empty(3)
    directions, bends = np.empty((2, 3)), np.empty(2)
    smallest = np.inf
    for k in range(samples.shape[0]):
        position(c, h, s0, samples[k], r)
        for o in range(obstacles.shape[0]):
            phi[o, k] = gap(obstacles[o], r, n, directions, bends)
            if 0 < k < samples.shape[0] - 1:
                smallest = min(smallest, phi[o, k])
    return smallest


@njit(**OPTIONS)
def grid(points, count, cells, samples):
    """Where contact is looked for: `cells` equal parts of the length, finer about the ends of stretches.

    Writes to `samples` (MOST_SAMPLES,), rising; returns their number.
    """
    spacing = 1.0 / cells
    fine = np.zeros(cells, np.bool_)
    for i in range(count):
        if points[i, FLAT] != 1.0:
            continue
        first, last = ends(points, count, i, spacing)
        at = int(points[i, PLACE] * cells + 1e-9)
        if first and at > 1:
            for k in range(max(0, at - 2), min(cells, at + 2)):
                fine[k] = True
        if last and at < cells - 1:
            for k in range(max(0, at - 1), min(cells, at + 3)):
                fine[k] = True
    m = 0
    for k in range(cells):
        parts = FINE if fine[k] and m + FINE + cells < samples.shape[0] else 1
        for j in range(parts):
            samples[m] = (k + j / parts) / cells
            m += 1
    samples[m] = 1.0
    return m + 1


@njit(**OPTIONS)
def within(points, count, samples, spacing):
    """Whether all ends of stretches lie where the samples are fine."""
    for i in range(count):
        if points[i, FLAT] != 1.0:
            continue
        s = points[i, PLACE]
        if s < 1.5 * spacing or s > 1.0 - 1.5 * spacing:
            continue
        first, last = ends(points, count, i, spacing)
        if not first and not last:
            continue
        k = find_sample(samples, s)
        if first and k > 0 and samples[k] - samples[k - 1] > 0.5 * spacing:
            return False
        if last and k + 1 < samples.shape[0] and samples[k + 1] - samples[k] > 0.5 * spacing:
            return False
    return True


@njit(**OPTIONS)
def find_sample(samples, s):
    """The index of the sample at s; -1: there is none."""
    k = np.searchsorted(samples, s - 1e-12)
    return k if k < samples.shape[0] and abs(samples[k] - s) < 1e-11 else -1


@njit(**OPTIONS)
def press(c, h, s0, samples, spacing, obstacles, points, count, phi, stiffness, anywhere):
    """Let the flat points be the samples that are inside an obstacle, on springs of `stiffness` per length.

    Those that were flat points before keep their friction. New ones come beside old ones, or `anywhere`.
    Returns (how many have come or gone, count).
    """
    scan(c, h, s0, samples, obstacles, phi)
    changes = 0
    m = samples.shape[0]
    # 0: nothing, 1: was a flat point, 2: is beside one
    known = np.zeros((obstacles.shape[0], m), np.int8)
    i = 0
    while i < count:
        if points[i, FLAT] == 1.0:
            o, k = int(points[i, OBSTACLE]), find_sample(samples, points[i, PLACE])
            if k < 0:
                k = min(np.searchsorted(samples, points[i, PLACE]), m - 1)
                if known[o, k] == 0:
                    known[o, k] = 2
                count = remove(points, count, i)
                continue
            length = 0.5 * (samples[k + 1] - samples[k - 1])
            force = -stiffness * length * phi[o, k]
            if force <= 0.0 or owned(points, count, o, samples[k], APART * spacing):
                known[o, k] = 2
                count = remove(points, count, i)
                changes += 1
                continue
            known[o, k] = 1
            points[i, LENGTH] = length
            points[i, FORCE] = force
        i += 1
    for o in range(obstacles.shape[0]):
        for backward in (False, True):
            last = -1
            for j in range(1, m - 1):
                k = m - 1 - j if backward else j
                if known[o, k] > 0:
                    last = k
                if phi[o, k] >= 0.0 or known[o, k] == 1:
                    continue
                beside = last >= 0 and abs(samples[k] - samples[last]) < 1.6 * spacing
                if not (anywhere or beside) or owned(points, count, o, samples[k], APART * spacing):
                    continue
                if count < points.shape[0]:
                    count = add(points, count, o, samples[k], True, 0.0)
                    points[count - 1, LENGTH] = 0.5 * (samples[k + 1] - samples[k - 1])
                    points[count - 1, FORCE] = -stiffness * points[count - 1, LENGTH] * phi[o, k]
                    share(points, count, 1.5 * spacing)
                    changes += 1
                    known[o, k] = 1
                    last = k
    return changes, count


@njit(**OPTIONS)
def flatten(q, h, s0, nodes, c, samples, spacing, obstacles, points, count):
    """Make stretches of the pressed sliding points whose gap is no minimum; returns (changed, count).

    The cable has become as curved as the surface there.
    """
    r, t, dt, n = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    directions, bends = np.empty((2, 3)), np.empty(2)
    changed = False
    i = 0
    while i < count:
        if points[i, FLAT] == 0.0 and points[i, FORCE] > 0.0:
            o, s = int(points[i, OBSTACLE]), points[i, PLACE]
            _, _, curvature = gap_at(q, h, s0, nodes, c, s, obstacles[o], r, t, dt, n, directions, bends)
            if curvature < 0.0:
                count = lay(points, count, o, s - 0.75 * spacing, s + 0.75 * spacing, samples, spacing)
                changed = True
                i = 0
                continue
        i += 1
    return changed, count


@njit(**OPTIONS)
def revise(
    q, h, s0, N, nodes, primitives, c, samples, spacing, obstacles, depth, points, count, phi, contract
):
    """Change the sliding points at a solution with the last ones: let go what pulls, take in what is inside.

    One beside which the curve dips deeper than `depth` becomes a stretch; where `contract` says so, a stretch
    of one or two samples becomes a sliding point. Returns (changed, count).
    """
    changed = False
    i = 0
    while i < count:
        if points[i, FLAT] == 0.0 and points[i, FORCE] < 0.0:
            count = remove(points, count, i)
            changed = True
        else:
            i += 1
    m = samples.shape[0]
    curve(q, h, N, primitives, c)
    scan(c, h, s0, samples, obstacles, phi)
    r, t, dt, n = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    directions, bends = np.empty((2, 3)), np.empty(2)
    for o in range(obstacles.shape[0]):
        for k in range(1, m - 1):
            # a minimum among the samples that could reach the surface: the curve has unit speed
            if not (phi[o, k] < spacing and phi[o, k] <= phi[o, k - 1] and phi[o, k] <= phi[o, k + 1]):
                continue
            s = lowest(q, h, s0, nodes, c, samples[k], spacing, obstacles[o])
            value, _, _ = gap_at(q, h, s0, nodes, c, s, obstacles[o], r, t, dt, n, directions, bends)
            if value >= -depth:
                continue
            # a coarse element that lies on the surface touches it here and there: that is no point contact
            pressed, total = 0, np.zeros(HELD + 3 - FORCE)
            e, _ = find_element(s, s0, h)
            reach = max(2.0 * APART * spacing, h[e])
            for i in range(count):
                if points[i, OBSTACLE] == o and points[i, FLAT] == 1.0 and abs(points[i, PLACE] - s) < reach:
                    pressed += 1
                    total += points[i, FORCE : HELD + 3]
            if owned(points, count, o, s, APART * spacing):
                # two minima closer than the samples can tell: the cable begins to lie on the surface
                count = lay(points, count, o, s, s, samples, spacing)
                changed = True
            elif pressed == 0 or (contract and pressed <= 2):
                first, last = k, k
                while first > 1 and phi[o, first - 1] < -depth:
                    first -= 1
                while last < m - 2 and phi[o, last + 1] < -depth:
                    last += 1
                if samples[last] - samples[first] > LONG * spacing:
                    count = lay(points, count, o, samples[first], samples[last], samples, spacing)
                else:
                    count = add(points, count, o, s, False, 0.0)
                    points[count - 1, FORCE : HELD + 3] = total
                changed = True
    return changed, count


@njit(**OPTIONS)
def passage(q_old, q, h, s0, N, primitives, c, samples, old_obstacles, obstacles, phi):
    """From one shape to the next on the same mesh: how near it is now, and whether it may have gone through.

    Returns the smallest gap at the inner samples (phi receives all) and whether some sample has moved so far
    beside an obstacle that it could have passed it within the step.
    """
    old_c = np.empty_like(c)
    curve(q_old, h, N, primitives, old_c)
    curve(q, h, N, primitives, c)
    smallest = scan(c, h, s0, samples, obstacles, phi)
    crossed = False
    r, r_old = np.empty(3), np.empty(3)
    for o in range(obstacles.shape[0]):
        new, old = obstacles[o], old_obstacles[o]
        width = np.inf
        for k in range(13, 16):
            if new[k] > 0.0:
                width = min(width, new[k])
        if width == np.inf:
            continue
        for k in range(1, samples.shape[0] - 1):
            position(c, h, s0, samples[k], r)
            position(old_c, h, s0, samples[k], r_old)
            way = 0.0
            for i in range(3):
                v = 0.0
                for j in range(3):
                    v += new[4 + 3 * j + i] * (r[j] - new[1 + j])
                    v -= old[4 + 3 * j + i] * (r_old[j] - old[1 + j])
                way += v * v
            way = np.sqrt(way)
            crossed = crossed or (way > width + new[16] and phi[o, k] < way)
    return smallest, crossed


@njit(**OPTIONS)
def dips(q, h, s0, nodes, c, samples, spacing, obstacles, phi, depth):
    """Whether the curve between the samples is deeper than `depth` in some obstacle."""
    r, t, dt, n = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    directions, bends = np.empty((2, 3)), np.empty(2)
    for o in range(obstacles.shape[0]):
        for k in range(1, samples.shape[0] - 1):
            if phi[o, k] < spacing and phi[o, k] <= phi[o, k - 1] and phi[o, k] <= phi[o, k + 1]:
                s = lowest(q, h, s0, nodes, c, samples[k], spacing, obstacles[o])
                value, _, _ = gap_at(q, h, s0, nodes, c, s, obstacles[o], r, t, dt, n, directions, bends)
                if value < -depth:
                    return True
    return False
