"""Compiled: the places where the cable touches, and how they change as its shape does.

Where the gap has a distinct minimum a contact point sits there, at any arc length: a unilateral constraint
gap >= 0 with its multiplier, the normal force. It slides with the shape, and it takes a boundary between two
elements with it, because the curvature has a kink under a point force. Along a stretch that lies on the
surface the gap has no distinct minimum: there the samples that are inside are pushed out by stiff springs
("flat" points), so many that together they are a pressure. Units of the cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import njit
from cable_ros.mechanics.effects.contact_kernels import curve, direction, find_element, gap, position, shape

OPTIONS = {"cache": True, "error_model": "numpy"}

CAPACITY = 240
"""Contact points at once."""
FINE = 16
"""Samples about a stretch's ends for one elsewhere: where it lifts off decides the wrench."""
MOST_SAMPLES = 2400
FOUNDATION = 1e10
"""Stiffness of the springs under a stretch per length of the cable, EI / L^4.

A pressure of 100 EI / L^3 sinks in by 1e-8 of the length, and the force where the cable lifts off, spread
over about (EI / FOUNDATION)^1/4 = 0.003 of it, by some 1e-7.
"""
LYING = 6
"""So many samples has an element that lies on a surface at most."""
LONG = 4.0
"""What is inside over so many samples is no point contact."""
APART = 2.5
"""Around a sliding point so many samples are its own."""
OBSTACLE, PLACE, FLAT, FORCE, FRICTION, HELD, TIE, LENGTH = 0, 1, 2, 3, 4, 7, 10, 11
"""Columns of the contact points (CAPACITY, COLUMNS): obstacle, arc length, 1 for flat, normal force, friction
(3), the friction of the last equilibrium (3), the boundary between elements that goes with the point (-1:
none), and the length of cable that a flat point stands for."""
COLUMNS = 12
NARROWEST = 0.12
"""A boundary slides no nearer to its neighbours than this part of the way between them."""


@njit(**OPTIONS)
def gap_at(q, h, s0, nodes, c, s, obstacle, r, t, dt, n, directions, bends):
    """Gap at arc length s, its first and second derivative by s."""
    position(c, h, s0, s, r)
    direction(q, h, s0, nodes, s, t, dt)
    value = gap(obstacle, r, n, directions, bends)
    slope, curvature = 0.0, 0.0
    for a in range(3):
        slope += n[a] * t[a]
        curvature += n[a] * dt[a]
    for i in range(2):
        along = directions[i, 0] * t[0] + directions[i, 1] * t[1] + directions[i, 2] * t[2]
        curvature += bends[i] * along * along
    return value, slope, curvature


@njit(**OPTIONS)
def lowest(q, h, s0, nodes, c, s, reach, obstacle):
    """The arc length of the gap's minimum near s, at most `reach` away, by safeguarded Newton steps."""
    r, t, dt, n = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    directions, bends = np.empty((2, 3)), np.empty(2)
    low, high = max(s - reach, 0.0), min(s + reach, 1.0)
    for _ in range(30):
        _, slope, curvature = gap_at(q, h, s0, nodes, c, s, obstacle, r, t, dt, n, directions, bends)
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


@njit(**OPTIONS)
def slide(q, h, s0, nodes, boundary, s):
    """Move the boundary between two elements to the arc length s; the shape q (n, 4) stays, its nodes move.

    Returns whether it may: not too near to the neighbouring boundaries.
    """
    e = boundary - 1
    low, old = s0[e], s0[boundary]
    high = old + h[boundary]
    if s - low < NARROWEST * (high - low) or high - s < NARROWEST * (high - low):
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
        shape(nodes, (at - low) / (old - low) if left else (at - old) / (high - old), N, dN)
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


@njit(**OPTIONS)
def tie(points, count, i, h, s0):
    """Give contact point i the nearest free boundary that can come to it, or none; whether it has one."""
    s = points[i, PLACE]
    best, distance = -1, np.inf
    for b in range(1, h.shape[0]):
        low, high = s0[b - 1], s0[b] + h[b]
        margin = 1.5 * NARROWEST * (high - low)
        if not low + margin < s < high - margin or abs(s - s0[b]) >= distance:
            continue
        taken = False
        for k in range(count):
            taken = taken or points[k, TIE] == b
        if not taken:
            best, distance = b, abs(s - s0[b])
    points[i, TIE] = best
    return best >= 0


@njit(**OPTIONS)
def place_points(q, h, s0, N, nodes, primitives, c, obstacles, spacing, points, count):
    """Let the sliding points go to their gap's minimum, with their boundaries; whether all have one."""
    curve(q, h, N, primitives, c)
    tied = True
    for i in range(count):
        if points[i, FLAT] == 1.0:
            continue
        ob = obstacles[int(points[i, OBSTACLE])]
        points[i, PLACE] = lowest(q, h, s0, nodes, c, points[i, PLACE], spacing, ob)
        if points[i, TIE] < 0.0 and not tie(points, count, i, h, s0):
            tied = False
            continue
        slid = slide(q, h, s0, nodes, int(points[i, TIE]), points[i, PLACE])
        if not slid and tie(points, count, i, h, s0):
            slid = slide(q, h, s0, nodes, int(points[i, TIE]), points[i, PLACE])
        if slid:
            curve(q, h, N, primitives, c)
        else:
            points[i, TIE] = -1.0
            tied = False
    return tied


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
def add(points, count, o, s, flat, room):
    """One more contact point, unless there is no space or one nearer than `room`; returns the count."""
    for i in range(count):
        if points[i, OBSTACLE] == o and abs(points[i, PLACE] - s) < room:
            return count
    if count < points.shape[0]:
        points[count] = 0.0
        points[count, OBSTACLE], points[count, PLACE], points[count, TIE] = o, s, -1.0
        points[count, FLAT] = 1.0 if flat else 0.0
        return count + 1
    return count


@njit(**OPTIONS)
def remove(points, count, i):
    """Drop contact point i, keeping the others' order; returns the count."""
    for k in range(i, count - 1):
        points[k] = points[k + 1]
    return count - 1


@njit(**OPTIONS)
def owned(points, count, o, s, reach):
    """Whether a sliding point on obstacle o is within `reach` of s."""
    for i in range(count):
        if points[i, OBSTACLE] == o and points[i, FLAT] == 0.0 and abs(points[i, PLACE] - s) < reach:
            return True
    return False


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
        first, last = True, True
        for k in range(count):
            if k != i and points[k, FLAT] == 1.0 and points[k, OBSTACLE] == points[i, OBSTACLE]:
                d = points[k, PLACE] - points[i, PLACE]
                first = first and not -1.5 * spacing < d < 0.0
                last = last and not 0.0 < d < 1.5 * spacing
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
        first, last = True, True
        for k in range(count):
            if k != i and points[k, FLAT] == 1.0 and points[k, OBSTACLE] == points[i, OBSTACLE]:
                d = points[k, PLACE] - s
                first = first and not -1.5 * spacing < d < 0.0
                last = last and not 0.0 < d < 1.5 * spacing
        if not first and not last:
            continue
        k = find_sample(samples, s)
        if first and k > 0 and samples[k] - samples[k - 1] > 0.5 * spacing:
            return False
        if last and k + 1 < samples.shape[0] and samples[k + 1] - samples[k] > 0.5 * spacing:
            return False
    return True


@njit(**OPTIONS)
def hold_ends(q, h, s0, nodes, spacing, points, count):
    """Slide a boundary between elements to each end of a stretch: there the shear force jumps."""
    for i in range(count):
        points[i, TIE] = points[i, TIE] if points[i, FLAT] == 0.0 else -1.0
    for i in range(count):
        s = points[i, PLACE]
        if points[i, FLAT] != 1.0 or s < 1.5 * spacing or s > 1.0 - 1.5 * spacing:
            continue
        first, last = True, True
        for k in range(count):
            if k != i and points[k, FLAT] == 1.0 and points[k, OBSTACLE] == points[i, OBSTACLE]:
                d = points[k, PLACE] - s
                first = first and not -1.5 * spacing < d < 0.0
                last = last and not 0.0 < d < 1.5 * spacing
        if (first or last) and tie(points, count, i, h, s0):
            slide(q, h, s0, nodes, int(points[i, TIE]), s)


@njit(**OPTIONS)
def find_sample(samples, s):
    """The index of the sample at s; -1: there is none."""
    k = np.searchsorted(samples, s - 1e-12)
    return k if k < samples.shape[0] and abs(samples[k] - s) < 1e-11 else -1


@njit(**OPTIONS)
def share(points, count, reach):
    """Let the newest flat point rub, for its force, as its nearest neighbour within `reach` does."""
    new = count - 1
    best, distance = -1, reach
    for i in range(new):
        d = abs(points[i, PLACE] - points[new, PLACE])
        if points[i, OBSTACLE] == points[new, OBSTACLE] and points[i, FLAT] == 1.0 and d < distance:
            best, distance = i, d
    if best >= 0 and points[best, FORCE] > 0.0:
        for a in range(FRICTION, HELD + 3):
            points[new, a] = points[best, a] * points[new, FORCE] / points[best, FORCE]


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
def lay(points, count, o, low, high, samples, spacing):
    """Make low..high on obstacle o a stretch, with the sliding points about it, which give it their force."""
    total = np.zeros(HELD + 3 - FORCE)
    i = 0
    while i < count:
        s = points[i, PLACE]
        near = low - APART * spacing < s < high + APART * spacing
        if points[i, OBSTACLE] == o and points[i, FLAT] == 0.0 and near:
            total += points[i, FORCE : HELD + 3]
            low, high = min(low, points[i, PLACE]), max(high, points[i, PLACE])
            count = remove(points, count, i)
        else:
            i += 1
    before = count
    for k in range(1, samples.shape[0] - 1):
        if low - 0.75 * spacing < samples[k] < high + 0.75 * spacing:
            count = add(points, count, o, samples[k], True, 1e-9)
    for i in range(before, count):
        points[i, FORCE : HELD + 3] = total / (count - before)
        points[i, LENGTH] = spacing
    return count


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
def coarse(points, count, h, s0, spacing):
    """Whether an element on which a stretch lies is too long to follow the surface between its ends."""
    for i in range(count):
        if points[i, FLAT] == 1.0:
            e, _ = find_element(points[i, PLACE], s0, h)
            if h[e] > 1.1 * LYING * spacing:
                return True
    return False


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
