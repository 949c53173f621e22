"""Compiled: the equilibrium with contact points, solved by Newton's method on a changing active set.

A contact point is where the cable touches: a unilateral constraint gap >= 0 with its multiplier, the normal force.
Where the gap has a distinct minimum the point sits there, at any arc length (`flat` false): it slides with the shape,
and the wrench does not notice the mesh. Along a stretch that lies on the surface the gap has no distinct minimum:
there the points stand at fixed samples (`flat` true). Units of the cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from cable_ros.mechanics import quaternion
from cable_ros.mechanics.effects.contact_kernels import curve_point, gap, pull, shape, starts_of, tangent
from cable_ros.mechanics.kernels import gradient, hessian, tangent_derivative
from cable_ros.statics.compiled import (
    ADVANCED,
    NOT_CONTRACTING,
    NOT_CONVEX,
    TOO_FAR,
    border_factor,
    border_step,
    close,
    end_coupling,
    largest,
)

OPTIONS = {"cache": True, "error_model": "numpy"}

CAPACITY = 160
"""Contact points at once."""


@njit(**OPTIONS)
def find_element(s, s0, h):
    """Element of the arc length s and the place in it."""
    e = 0
    while e + 1 < s0.shape[0] and s >= s0[e + 1]:
        e += 1
    x = (s - s0[e]) / h[e]
    return e, min(max(x, 0.0), 1.0)


@njit(**OPTIONS)
def at(q, h, s0, s, nodes, points, weights, ends, obstacle, r, t, dt, n, directions, bends):
    """Gap at arc length s, its first and second derivative by s."""
    e, x = find_element(s, s0, h)
    curve_point(q, h, e, x, nodes, points, weights, ends[e], r, t, dt)
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
def settle_point(q, h, s0, s, reach, nodes, points, weights, ends, obstacle, r, t, dt, n, directions, bends):
    """The arc length of the gap's minimum near s, at most `reach` away, by safeguarded Newton steps."""
    low, high = max(s - reach, 0.0), min(s + reach, 1.0)
    for _ in range(25):
        _, slope, curvature = at(q, h, s0, s, nodes, points, weights, ends, obstacle, r, t, dt, n, directions, bends)
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
def system(
    q, F, f, K, kappa0, h, s0, tables, nodes, obstacles, spacing,
    count, which, place, flat, force, friction, gaps, normals,
    acc, g, radial, totals, elastic, geometric, parts, C, V, delta, full,
):  # fmt: skip
    """Gradient, and where `full` the Hessian with its borders, at (q, F) with `count` contact points.

    Point i touches obstacle which[i] at the arc length place[i] with the normal force force[i] and the dead friction
    friction[i] (3,). `V` (rows, 3n) receives the constraints' derivatives: end position (3), gaps (count), then a row
    for each direction in which a gap is curved, with its weight's inverse in `delta`. Returns the number of rows.
    """
    N, dN, N3, dN3, points, weights = tables
    order = N.shape[1] - 1
    nd = 3 * (order + 1)
    band = nd - 1
    elements = h.shape[0]
    ends = np.empty((elements + 1, 3))
    starts_of(q, h, N, weights, ends)
    Fe = np.empty((elements, 3))
    for e in range(elements):
        for a in range(3):
            Fe[e, a] = F[a]
    r, t, dt, n = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    directions, bends = np.empty((2, 3)), np.empty(2)
    frames = np.empty((max(count, 1), 2, 3))
    curved = np.empty((max(count, 1), 3))
    slopes = np.empty((max(count, 1), 3))
    P = np.empty((max(count, 1), 3))
    Nx, dNx = np.empty(order + 1), np.empty(order + 1)
    qs, gT, H = np.empty(4), np.empty(4), np.empty((4, 4))
    acc[:] = 0.0
    for i in range(count):
        ob = obstacles[which[i]]
        if not flat[i]:
            place[i] = settle_point(q, h, s0, place[i], spacing, nodes, points, weights, ends, ob, r, t, dt, n, directions, bends)
        gaps[i], _, curvature = at(q, h, s0, place[i], nodes, points, weights, ends, ob, r, t, dt, n, directions, bends)
        curved[i, 2] = 0.0 if flat[i] else max(curvature, 1e-9)
        e, x = find_element(place[i], s0, h)
        for a in range(3):
            normals[i, a] = n[a]
            P[i, a] = force[i] * n[a] + friction[i, a]
            slopes[i, a] = 0.0
        for k in range(2):
            curved[i, k] = bends[k]
            along = 0.0
            for a in range(3):
                frames[i, k, a] = directions[k, a]
                along += directions[k, a] * t[a]
            for a in range(3):
                slopes[i, a] += bends[k] * along * directions[k, a]
        for k in range(e):
            for a in range(3):
                Fe[k, a] += P[i, a]
        for k in range(points.shape[0]):
            shape(nodes, x * points[k], Nx, dNx)
            for a in range(4):
                qs[a] = 0.0
                for j in range(order + 1):
                    qs[a] += Nx[j] * q[e * order + j, a]
            pull(qs, P[i], h[e] * x * weights[k], gT, H)
            for j in range(order + 1):
                for a in range(4):
                    acc[e * order + j, a] += Nx[j] * gT[a]
    gradient(q, Fe, f, K, kappa0, h, s0, N, dN, points, weights, acc, g, radial, totals)
    if not full:
        return 3 + count
    hessian(q, Fe, f, K, kappa0, h, s0, N, dN, N3, dN3, points, weights, radial, elastic, geometric, parts, C)
    size = C.shape[1]
    for a in range(3):
        for j in range(size):
            V[a, j] = C[a, j]
        delta[a] = 0.0
    rows = 3 + count
    frame = np.empty((4, nd))
    D = np.empty((4, nd))
    Y = np.empty((4, nd))
    own = np.empty((3, nd))
    turn = np.empty((3, nd))
    way = np.empty((3, size))
    for i in range(count):
        e, x = find_element(place[i], s0, h)
        first = e * order
        for j in range(order + 1):
            w, b, y, z = 0.5 * q[first + j, 0], 0.5 * q[first + j, 1], 0.5 * q[first + j, 2], 0.5 * q[first + j, 3]
            c = 3 * j
            frame[0, c], frame[1, c], frame[2, c], frame[3, c] = -b, w, z, -y
            frame[0, c + 1], frame[1, c + 1], frame[2, c + 1], frame[3, c + 1] = -y, -z, w, b
            frame[0, c + 2], frame[1, c + 2], frame[2, c + 2], frame[3, c + 2] = -z, y, -b, w
        own[:] = 0.0
        turn[:] = 0.0
        for k in range(points.shape[0] + 1):
            last = k == points.shape[0]
            shape(nodes, x if last else x * points[k], Nx, dNx)
            for a in range(4):
                qs[a] = 0.0
                for j in range(order + 1):
                    qs[a] += Nx[j] * q[first + j, a]
                    for c in range(3 * j, 3 * j + 3):
                        D[a, c] = Nx[j] * frame[a, c]
            norm = tangent(qs, t)
            if last:
                tangent_derivative(qs, t, 2.0 / norm, D, turn, 0, nd)
                break
            weight = h[e] * x * weights[k]
            tangent_derivative(qs, t, 2.0 * weight / norm, D, own, 0, nd)
            pull(qs, P[i], weight, gT, H)
            for a in range(4):
                for j in range(nd):
                    Y[a, j] = H[a, 0] * D[0, j] + H[a, 1] * D[1, j] + H[a, 2] * D[2, j] + H[a, 3] * D[3, j]
            for j in range(nd):
                for c in range(j + 1):
                    geometric[3 * first + j, band + c - j] += (
                        D[0, j] * Y[0, c] + D[1, j] * Y[1, c] + D[2, j] * Y[2, c] + D[3, j] * Y[3, c]
                    )
        way[:] = 0.0
        for k in range(e):
            for a in range(3):
                for j in range(nd):
                    way[a, 3 * k * order + j] += parts[k, a, j]
        for a in range(3):
            for j in range(nd):
                way[a, 3 * first + j] += own[a, j]
        for j in range(size):
            V[3 + i, j] = normals[i, 0] * way[0, j] + normals[i, 1] * way[1, j] + normals[i, 2] * way[2, j]
        delta[3 + i] = 0.0
        if abs(force[i]) < 1e-9:
            continue
        for k in range(2):
            if curved[i, k] > 0.0:
                for j in range(size):
                    V[rows, j] = frames[i, k, 0] * way[0, j] + frames[i, k, 1] * way[1, j] + frames[i, k, 2] * way[2, j]
                delta[rows] = -1.0 / (force[i] * curved[i, k])
                rows += 1
        if curved[i, 2] > 0.0:
            for j in range(size):
                V[rows, j] = slopes[i, 0] * way[0, j] + slopes[i, 1] * way[1, j] + slopes[i, 2] * way[2, j]
            for j in range(nd):
                V[rows, 3 * first + j] += normals[i, 0] * turn[0, j] + normals[i, 1] * turn[1, j] + normals[i, 2] * turn[2, j]
            delta[rows] = curved[i, 2] / force[i]
            rows += 1
    return rows


@njit(**OPTIONS)
def scan(q, h, s0, N, weights, nodes, points, samples, obstacles, ends, phi):
    """Gaps phi (obstacles, samples) at the arc lengths `samples`."""
    starts_of(q, h, N, weights, ends)
    r, t, dt, n = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    directions, bends = np.empty((2, 3)), np.empty(2)
    for k in range(samples.shape[0]):
        e, x = find_element(samples[k], s0, h)
        curve_point(q, h, e, x, nodes, points, weights, ends[e], r, t, dt)
        for o in range(obstacles.shape[0]):
            phi[o, k] = gap(obstacles[o], r, n, directions, bends)


@njit(**OPTIONS)
def add_point(count, which, place, flat, force, friction, o, s, is_flat, samples):
    """One more contact point, unless there is no room or it is there; returns the count."""
    for i in range(count):
        if which[i] == o and abs(place[i] - s) < 1e-9:
            return count
    if count < which.shape[0]:
        which[count], place[count], flat[count], force[count] = o, s, is_flat, 0.0
        friction[count, 0], friction[count, 1], friction[count, 2] = 0.0, 0.0, 0.0
        return count + 1
    return count


@njit(**OPTIONS)
def remove_point(count, i, which, place, flat, force, friction, gaps, normals):
    """Drop contact point i, keeping the others' order; returns the count."""
    for k in range(i, count - 1):
        which[k], place[k], flat[k], force[k] = which[k + 1], place[k + 1], flat[k + 1], force[k + 1]
        gaps[k] = gaps[k + 1]
        for a in range(3):
            friction[k, a] = friction[k + 1, a]
            normals[k, a] = normals[k + 1, a]
    return count - 1


@njit(**OPTIONS)
def revise(
    q, h, s0, N, weights, nodes, points, samples, spacing, obstacles, tolerance,
    count, which, place, flat, force, friction, gaps, normals,
):  # fmt: skip
    """Change the active set at a solution of the last one: let go what pulls, take in what is penetrated.

    Returns (changed, count, deepest penetration that is not yet a contact).
    """
    changed = False
    i = 0
    while i < count:
        if force[i] < 0.0:
            count = remove_point(count, i, which, place, flat, force, friction, gaps, normals)
            changed = True
        else:
            i += 1
    m = samples.shape[0]
    ends = np.empty((h.shape[0] + 1, 3))
    phi = np.empty((obstacles.shape[0], m))
    scan(q, h, s0, N, weights, nodes, points, samples, obstacles, ends, phi)
    r, t, dt, n = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    directions, bends = np.empty((2, 3)), np.empty(2)
    deepest = 0.0
    for o in range(obstacles.shape[0]):
        k = 1
        while k < m - 1:
            # a minimum among the samples that could reach the surface: the curve has unit speed
            if phi[o, k] < spacing and phi[o, k] <= phi[o, k - 1] and phi[o, k] <= phi[o, k + 1]:
                s = settle_point(q, h, s0, samples[k], spacing, nodes, points, weights, ends, obstacles[o], r, t, dt, n, directions, bends)
                value, _, _ = at(q, h, s0, s, nodes, points, weights, ends, obstacles[o], r, t, dt, n, directions, bends)
                if value < -tolerance:
                    near, near_flat = -1, False
                    for i in range(count):
                        if which[i] == o and abs(place[i] - s) < 1.001 * spacing:
                            near = i
                            near_flat = near_flat or flat[i]
                    if near < 0:
                        deepest = min(deepest, value)
                        count = add_point(count, which, place, flat, force, friction, o, s, False, samples)
                        changed = True
                    elif near_flat:
                        # beside a stretch: only samples that are penetrated themselves join it
                        for b in range(k - 1, k + 2):
                            if phi[o, b] < -tolerance:
                                before = count
                                count = add_point(count, which, place, flat, force, friction, o, samples[b], True, samples)
                                changed = changed or count > before
                    else:
                        # two minima closer than the samples: the cable begins to lie on the surface
                        low, high = min(s, place[near]), max(s, place[near])
                        total = force[near]
                        count = remove_point(count, near, which, place, flat, force, friction, gaps, normals)
                        before = count
                        for b in range(m):
                            if low - spacing < samples[b] < high + spacing and 0 < b < m - 1:
                                count = add_point(count, which, place, flat, force, friction, o, samples[b], True, samples)
                        for b in range(before, count):
                            force[b] = total / (count - before)
                        changed = True
            k += 1
        # samples beside a stretch that have sunk in without a minimum of their own
        for k in range(1, m - 1):
            if phi[o, k] < -tolerance:
                beside, there = False, False
                for i in range(count):
                    if which[i] == o:
                        gap_s = abs(place[i] - samples[k])
                        there = there or gap_s < 1e-9
                        beside = beside or (flat[i] and gap_s < 1.5 * spacing)
                if beside and not there:
                    before = count
                    count = add_point(count, which, place, flat, force, friction, o, samples[k], True, samples)
                    changed = changed or count > before
    # a stretch of one sample is a point again
    for i in range(count):
        if flat[i]:
            alone = True
            for k in range(count):
                if k != i and which[k] == which[i] and abs(place[k] - place[i]) < 1.5 * spacing:
                    alone = False
            if alone:
                flat[i] = False
                changed = True
    return changed, count, deepest


@njit(**OPTIONS)
def advance_contact(
    q, F, qe, re, f, K, kappa0, h, s0, tables, nodes, obstacles, samples, spacing,
    count, which, place, flat, force, friction, gaps, normals,
    elastic, geometric, parts, C, A, U, pivots, V, delta, Y, S, acc, g, radial, totals,
    tolerance, depth, limit, q_new, F_new,
):  # fmt: skip
    """From the equilibrium (q, F) with its contact points to the one under new conditions; see `compiled.advance`.

    A tangent step from the old state, Newton's method on the active set, and revisions of the set until no point
    pulls and nothing is deeper inside than `depth`. Returns (code, iterations, count, rows).
    """
    N, dN, N3, dN3, points, weights = tables
    order = N.shape[1] - 1
    n = 3 * q.shape[0]
    gv = g.reshape(n)
    s = np.empty(n)
    c = np.zeros(V.shape[0])
    y = np.empty(V.shape[0])
    last = q.shape[0] - 1
    for i in range(q.shape[0]):
        for a in range(4):
            q_new[i, a] = q[i, a]
    for a in range(3):
        F_new[a] = F[a]
    theta = quaternion.rotation_vector(quaternion.multiply(quaternion.conjugate(q[last]), qe))
    total = 0
    size, rows = 0.0, 0
    lift = True
    for revision in range(40):
        converged = False
        for iteration in range(14):
            full = True
            rows = system(
                q_new, F_new, f, K, kappa0, h, s0, tables, nodes, obstacles, spacing,
                count, which, place, flat, force, friction, gaps, normals,
                acc, g, radial, totals, elastic, geometric, parts, C, V, delta, full,
            )  # fmt: skip
            convex = border_factor(elastic, geometric, 0.0, order, A, U, pivots, V, delta, rows, 3 + count, Y, S)
            if not convex and not lift:
                return NOT_CONVEX, total, count, rows
            c[:] = 0.0
            for a in range(3):
                c[a] = totals[a] - re[a]
            for i in range(count):
                c[3 + i] = gaps[i]
            if lift:
                end_coupling(elastic, geometric, V, rows, theta, gv, c)
            border_step(gv, c, V, rows, order, U, pivots, Y, S, s, y)
            if lift:
                for k in range(3):
                    s[n - 3 + k] = theta[k]
            new = largest(s)
            if not new <= limit:
                return TOO_FAR, total, count, rows
            quaternion.retract(q_new, s, q_new)
            close(q_new, qe)
            scale, change = 1e-3, 0.0
            for a in range(3):
                F_new[a] += y[a]
                scale = max(scale, abs(F_new[a]))
                change = max(change, abs(y[a]))
            for i in range(count):
                force[i] += y[3 + i]
                change = max(change, abs(y[3 + i]))
            new = max(new, change / scale)
            if not lift:
                total += 1
                rate = min(new / size, 1.0) if iteration > 0 and size > 0.0 else 0.1
                if new * rate <= tolerance or new < 1e-13:
                    converged = True
                    break
                if iteration > 5 and new > 0.5 * size:
                    return NOT_CONTRACTING, total, count, rows
            lift = False
            size = new
        if not converged:
            return NOT_CONTRACTING, total, count, rows
        changed, count, _ = revise(
            q_new, h, s0, N, weights, nodes, points, samples, spacing, obstacles, depth,
            count, which, place, flat, force, friction, gaps, normals,
        )  # fmt: skip
        if not changed:
            system(
                q_new, F_new, f, K, kappa0, h, s0, tables, nodes, obstacles, spacing,
                count, which, place, flat, force, friction, gaps, normals,
                acc, g, radial, totals, elastic, geometric, parts, C, V, delta, False,
            )  # fmt: skip
            return ADVANCED, total, count, rows
        size = 0.0
    return NOT_CONTRACTING, total, count, rows
