# SPDX-License-Identifier: Apache-2.0
"""Compiled: internal force, moment and strain anywhere along a rod, and where they are largest.

The elements' own strain is a derivative of their frames and loses an order. Here the moment comes from the
balance with all loads beyond, and the strain from the moment by the rod's law. With the end force F and the
end moment M, the load f per length and point forces P_i at r_i, the sums over those beyond s,

    G(s) = F + (1 - s) f + sum P_i
    M(s) = M + r(1) x F + sum r_i x P_i - r(s) x G(s) + (integral of r from s to 1) x f

(equations 8 and 9 of Liu et al. 2018, integrated). Units of the cable, start clamp's frame.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cable_ros.compilation import INNER, LEAF, njit
from cable_ros.rod import quaternion
from cable_ros.rod.centreline import curve, lagrange, position
from cable_ros.rod.extensible_kernels import axes

OPTIONS = {"cache": True, "error_model": "numpy"}

CURVATURE, TENSION, TWIST = 0, 1, 2
"""Rows of `largest`."""
GOLDEN = 0.6180339887498949
"""Fraction of a bracket that a golden section leaves."""
SECTIONS = 20
"""Number of golden sections; they leave 7e-5 of a bracket, and 4e-9 of the value's rise there."""
EQUAL = 1e-12
"""Relative difference of two maxima that is rounding: the first one along the rod is taken."""
ROUGH = 1e-7
"""Fraction of the largest sample by which what may hold the maximum can seem to stay below it: a field that
is constant but for rounding is no parabola."""


class Shape(NamedTuple):
    """Frames and centreline; m elements of order p."""

    q: np.ndarray
    """(m p + 1, 4) nodal frames, scalar first."""
    h: np.ndarray
    """(m,) lengths of the elements, L."""
    s0: np.ndarray
    """(m,) arc lengths at which they start, L."""
    nodes: np.ndarray
    """(p + 1,) of the reference element."""
    c: np.ndarray
    """(m, g + 1, 3) coefficients of the centreline, L; see `centreline`."""


class Law(NamedTuple):
    """The rod's law of bending and torsion."""

    K: np.ndarray
    """(3,) stiffness about the section's axes, EI."""
    kappa0: np.ndarray
    """(3,) natural curvature and twist, 1 / L."""


class Loads(NamedTuple):
    """All that pulls at the rod."""

    F: np.ndarray
    """(3,) end force, EI / L^2."""
    M: np.ndarray
    """(3,) end moment along the end frame's axes, EI / L."""
    f: np.ndarray
    """(3,) load per length, EI / L^3."""
    arc_lengths: np.ndarray
    """(k,) rising arc lengths of point forces, L."""
    forces: np.ndarray
    """(k, 3) point forces, EI / L^2."""


class Balance(NamedTuple):
    """What acts beyond the point in question."""

    tails: np.ndarray
    """(m + 1, 3) integral of the centreline from each element's start to the rod's end, L^2."""
    lever: np.ndarray
    """(3,) moment of the end and of the point forces beyond about the start, EI / L."""
    force: np.ndarray
    """(3,) end force and point forces beyond, EI / L^2."""


@njit(**OPTIONS)
def centreline(q, F, f, compliance, h, s0, values, points, primitives, c):
    """`centreline.curve`, with the displacement by stretch and shear where `compliance` is not zero.

    Args:
        q: (n, 4) nodal frames.
        F, f: (3,) end force and load per length.
        compliance: (3,) of shear and axial strain.
        h, s0: (m,) lengths of the elements and the arc lengths at which they start.
        values, points, primitives: of `rod_state.Tables`.
        c: (m, g + 1, 3) overwritten.
    """
    if compliance[0] == 0.0 and compliance[1] == 0.0 and compliance[2] == 0.0:
        curve(q, h, values, primitives, c)
        return
    order = values.shape[1] - 1
    qs, d, u = np.empty(4), np.empty((3, 3)), np.empty(3)
    c[:] = 0.0
    for e in range(h.shape[0]):
        for k in range(values.shape[0]):
            qs[:] = 0.0
            for i in range(order + 1):
                for a in range(4):
                    qs[a] += values[k, i] * q[e * order + i, a]
            axes(qs, d)
            rest = 1.0 - s0[e] - h[e] * points[k]
            for a in range(3):
                u[a] = d[2, a]
            for b in range(3):
                strain = 0.0
                for a in range(3):
                    strain += compliance[b] * d[b, a] * (F[a] + rest * f[a])
                for a in range(3):
                    u[a] += strain * d[b, a]
            for m in range(values.shape[0]):
                for a in range(3):
                    c[e, m + 1, a] += h[e] * primitives[m, k] * u[a]
        if e + 1 < h.shape[0]:
            for a in range(3):
                c[e + 1, 0, a] = c[e, :, a].sum()


@njit(**LEAF)
def add_cross(a, b, sign, out):
    """Add sign (a x b) to out (3,)."""
    out[0] += sign * (a[1] * b[2] - a[2] * b[1])
    out[1] += sign * (a[2] * b[0] - a[0] * b[2])
    out[2] += sign * (a[0] * b[1] - a[1] * b[0])


@njit(**LEAF)
def fields(shape, law, f, balance, e, x, work, out):
    """Squared bending curvature, tension and elastic twist, out (3,), at the fraction x of element e.

    Args:
        shape, law, balance: `Shape`, `Law` and `Balance`.
        f: (3,) load per length.
        e, x: the element, and the fraction of its length.
        work: (5, 4) workspace.
        out: (3,) overwritten.
    """
    q, h, s0, nodes, c = shape
    frame, r, G, M, tail = work[0], work[1], work[2], work[3], work[4]
    order, top = nodes.shape[0] - 1, c.shape[1] - 1
    frame[:] = 0.0
    for i in range(order + 1):
        v, _ = lagrange(nodes, i, x)
        for a in range(4):
            frame[a] += v * q[e * order + i, a]
    rest = 1.0 - s0[e] - h[e] * x
    for a in range(3):
        v, mean = (
            c[e, top, a],
            c[e, top, a] / (top + 1),
        )  # the centreline, and its mean from the element's start
        for k in range(top - 1, -1, -1):
            v = v * x + c[e, k, a]
            mean = mean * x + c[e, k, a] / (k + 1)
        r[a], tail[a] = v, balance.tails[e, a] - h[e] * x * mean
        G[a] = balance.force[a] + rest * f[a]
        M[a] = balance.lever[a]
    add_cross(r, G, -1.0, M)
    add_cross(tail, f, 1.0, M)
    w, x, y, z = frame[0], frame[1], frame[2], frame[3]
    i = 1.0 / (w * w + x * x + y * y + z * z)
    u = 2.0 * i
    t0, t1, t2 = u * (x * z + w * y), u * (y * z - w * x), i * (w * w - x * x - y * y + z * z)
    m0 = i * (w * w + x * x - y * y - z * z) * M[0] + u * (x * y + w * z) * M[1] + u * (x * z - w * y) * M[2]
    m1 = u * (x * y - w * z) * M[0] + i * (w * w - x * x + y * y - z * z) * M[1] + u * (y * z + w * x) * M[2]
    m2 = t0 * M[0] + t1 * M[1] + t2 * M[2]
    k0, k1 = m0 / law.K[0] + law.kappa0[0], m1 / law.K[1] + law.kappa0[1]
    out[CURVATURE] = k0 * k0 + k1 * k1
    out[TENSION] = t0 * G[0] + t1 * G[1] + t2 * G[2]
    out[TWIST] = abs(m2) / law.K[2]


@njit(**LEAF)
def refine(shape, law, f, balance, e, k, a, b, work, pair):
    """Maximum of field k between the fractions a and b of element e: value and fraction of the element.

    Args:
        shape, law, f, balance, e, work: as in `fields`.
        k: 0 curvature, 1 tension, 2 twist.
        a, b: where the golden sections begin.
        pair: (2, 3) workspace.
    """
    u, v = b - GOLDEN * (b - a), a + GOLDEN * (b - a)
    fields(shape, law, f, balance, e, u, work, pair[0])
    fields(shape, law, f, balance, e, v, work, pair[1])
    for _ in range(SECTIONS):
        if pair[0, k] >= pair[1, k]:
            b, v = v, u
            u = b - GOLDEN * (b - a)
            pair[1, k] = pair[0, k]
            fields(shape, law, f, balance, e, u, work, pair[0])
        else:
            a, u = u, v
            v = a + GOLDEN * (b - a)
            pair[0, k] = pair[1, k]
            fields(shape, law, f, balance, e, v, work, pair[1])
    return pair[0, k], u


@njit(**LEAF)
def rise(samples, i, k):
    """How much field k may rise beside sample i: a parabola by an eighth of its fall beside it, at most.

    `samples` (2 order + 3, 3): of `sample`.
    """
    last = samples.shape[0] - 3
    low = min(samples[max(i - 2, 0), k], samples[min(i + 2, last), k])
    return 0.5 * (samples[i, k] - low)


@njit(**LEAF)
def sample(shape, law, f, balance, e, begin, end, work, samples, bounds):
    """Evaluate the fields at equal steps between the fractions `begin` and `end` of element e.

    Args:
        shape, law, f, balance, e, work: as in `fields`.
        begin, end: fractions of the element.
        samples: (2 order + 3, 3) overwritten but for its last two rows.
        bounds: (2, 3) of `survey`, so far, updated.
    """
    count = samples.shape[0] - 2
    step = (end - begin) / (count - 1)
    for i in range(count):
        fields(shape, law, f, balance, e, begin + i * step, work, samples[i])
    for i in range(count):
        for k in range(3):
            value = samples[i, k]
            bounds[0, k] = max(bounds[0, k], value)
            if value >= max(samples[max(i - 1, 0), k], samples[min(i + 1, count - 1), k]):
                bounds[1, k] = max(bounds[1, k], value + rise(samples, i, k))


@njit(**LEAF)
def search(shape, law, f, balance, e, begin, end, work, samples, least, out):
    """Update the maxima `out` of `largest` by those between the fractions `begin` and `end` of element e.

    Args:
        shape, law, f, balance, e, work: as in `fields`.
        begin, end: fractions of the element.
        samples: (2 order + 3, 3) of `sample`; its last two rows are `refine`'s workspace.
        least: (3,) largest values of all samples: what cannot exceed them is left out.
        out: (3, 2) values and arc lengths.
    """
    count = samples.shape[0] - 2
    step = (end - begin) / (count - 1)
    for k in range(3):
        for i in range(count):
            before, after = max(i - 1, 0), min(i + 1, count - 1)
            value = samples[i, k]
            if value < max(samples[before, k], samples[after, k]):
                continue
            if value + rise(samples, i, k) < max(out[k, 0], least[k] - ROUGH * abs(least[k])):
                continue
            x = begin + i * step
            inner, found = refine(
                shape,
                law,
                f,
                balance,
                e,
                k,
                begin + before * step,
                begin + after * step,
                work,
                samples[count:],
            )
            if inner > value:
                value, x = inner, found
            if not value <= out[k, 0] + EQUAL * abs(out[k, 0]):
                out[k, 0], out[k, 1] = value, shape.s0[e] + shape.h[e] * x


@njit(**OPTIONS)
def survey(shape, law, loads, stretch, samples, bounds):
    """Sample the fields along the rod, for `largest`.

    Between two point forces of an element they are smooth: there are 2 order + 1 samples of each such part.

    Args:
        shape, law, loads: fields of `Shape`, `Law` and `Loads`, as plain tuples.
        stretch: compliance, values, points and primitives of `centreline`, by which the curve of the shape is
            computed; without values it is there already.
        samples: (m + k, 2 order + 3, 3) receives squared bending curvature, tension and elastic twist.
        bounds: (2, 3) receives the largest of them, and what their maxima do not exceed.
    """
    q, h, s0, _, c = shape
    compliance, values, points, primitives = stretch
    if values.shape[0] > 0:
        centreline(q, loads[0], loads[2], compliance, h, s0, values, points, primitives, c)
    bounds[:] = -np.inf
    sweep(Shape(*shape), Law(*law), Loads(*loads), samples, bounds[0], bounds, False)


@njit(**OPTIONS)
def largest(shape, law, loads, samples, least, out):
    """Largest bending curvature, tension, and twist beyond the natural one.

    Of the samples those that may hold a value above `least` are refined by golden sections. Both sides of a
    point force count.

    Args:
        shape, law, loads, samples: as in `survey`, which has been called.
        least: (3,) that of `survey`; or of several rods', where only what is largest of all is asked for.
        out: (3, 2) receives values and arc lengths; without any that may exceed `least`, 0 and for the
            tension minus infinity.
    """
    out[:] = 0.0
    out[TENSION, 0] = -np.inf
    sweep(Shape(*shape), Law(*law), Loads(*loads), samples, least, out, True)
    out[CURVATURE, 0] = np.sqrt(out[CURVATURE, 0])


@njit(**INNER)
def sweep(shape, law, loads, samples, least, out, refining):
    """Go along the rod, from one point force or end of an element to the next: `sample`, or `search`.

    Args:
        shape, law, loads: `Shape`, `Law` and `Loads`.
        samples, least: as in `largest`.
        out: the bounds of `survey`, or as in `largest`.
        refining: whether to `search`.
    """
    q, h, s0, _, c = shape
    F, M, f, arc_lengths, forces = loads
    elements, top = h.shape[0], c.shape[1]
    balance = Balance(np.zeros((elements + 1, 3)), quaternion.rotate(q[q.shape[0] - 1], M), F.copy())
    tails, lever, force = balance
    for e in range(elements - 1, -1, -1):
        for a in range(3):
            tails[e, a] = tails[e + 1, a]
            for k in range(top):
                tails[e, a] += h[e] * c[e, k, a] / (k + 1)
    r, work = np.empty(3), np.empty((5, 4))
    position(c, h, s0, 1.0, r)
    add_cross(r, F, 1.0, lever)
    for i in range(arc_lengths.shape[0]):
        position(c, h, s0, arc_lengths[i], r)
        add_cross(r, forces[i], 1.0, lever)
        for a in range(3):
            force[a] += forces[i, a]
    at = 0
    for e in range(elements):
        begin, last = 0.0, False
        while not last:
            last = at == arc_lengths.shape[0] or arc_lengths[at] >= s0[e] + h[e]
            end = 1.0 if last else min(max((arc_lengths[at] - s0[e]) / h[e], begin), 1.0)
            if end > begin and refining:
                search(shape, law, f, balance, e, begin, end, work, samples[e + at], least, out)
            elif end > begin:
                sample(shape, law, f, balance, e, begin, end, work, samples[e + at], out)
            if not last:
                position(c, h, s0, arc_lengths[at], r)
                add_cross(r, forces[at], -1.0, lever)
                for a in range(3):
                    force[a] -= forces[at, a]
                begin = end
                at += 1
