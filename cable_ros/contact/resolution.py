# SPDX-License-Identifier: Apache-2.0
"""Compiled: whether the elements are short enough for the contacts."""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import njit
from cable_ros.contact.distance import FRICTION_COEFFICIENT, gap
from cable_ros.contact.patches import NODES, SAMPLES, WEIGHTS, inside
from cable_ros.contact.points import ARC_LENGTH, FRICTION, KIND, LENGTH, NUMBER, OBSTACLE, POINT, SAMPLE
from cable_ros.rod.centreline import find_element, position, tangent

OPTIONS = {"cache": True, "error_model": "numpy"}

HIGHEST = np.polynomial.legendre.Legendre.basis(SAMPLES - 1)(2.0 * NODES - 1.0)
"""The Legendre polynomial of the highest order that an element's samples resolve, at these samples."""
BESIDE = 4
"""Number of places on either side of a contact point at which it is looked whether the cable is clear."""


@njit(**OPTIONS)
def misplaced(shape, fine, bare, obstacles, points, count, spacing, out):
    """Error of the position of each element in contact, L.

    That is the largest of three: the depth inside an obstacle between the samples that press on it, that
    beside a point, where the slopes show none, and the error of its end by the rule that integrates the
    tangents, from a comparison with a finer rule.

    Args:
        shape: nodal frames, coefficients of the centreline, lengths and starts of the elements, see `Shape`.
        fine: shape functions (g, p + 1) and weights (g,) of the finer rule.
        bare: (m, g + 1, 3) the centreline's coefficients without axial strain.
        obstacles: (o, WIDTH).
        points, count: (CAPACITY, COLUMNS) the contact points and their number.
        spacing: distance of the samples at which contact is looked for, L.
        out: (m,) receives the errors.
    """
    q, c, h, s0 = shape
    N, weights = fine
    order = N.shape[1] - 1
    qs, t, missed = np.empty(4), np.empty(3), np.empty(3)
    for e in range(h.shape[0]):
        for a in range(3):
            missed[a] = 0.0
            for m in range(1, c.shape[1]):
                missed[a] -= bare[e, m, a]
        for k in range(N.shape[0]):
            for a in range(4):
                qs[a] = 0.0
                for i in range(order + 1):
                    qs[a] += N[k, i] * q[e * order + i, a]
            tangent(qs, t)
            for a in range(3):
                missed[a] += h[e] * weights[k] * t[a]
        out[e] = np.sqrt(missed[0] ** 2 + missed[1] ** 2 + missed[2] ** 2)
    r, n = np.empty(3), np.empty(3)
    directions, bends = np.empty((2, 3)), np.empty(2)
    for i in range(count):
        obstacle = obstacles[int(points[i, OBSTACLE])]
        # on a rough one a patch so short stays a point, see `update_active_set`
        if points[i, KIND] != POINT or obstacle[FRICTION_COEFFICIENT] > 0.0:
            continue
        for k in range(-BESIDE, BESIDE + 1):
            s = points[i, ARC_LENGTH] + k * spacing / BESIDE
            if min(s, 1.0 - s) > spacing:  # beside a clamp it would not help
                e, _ = find_element(s, s0, h)
                position(c, h, s0, s, r)
                depth = -gap(obstacle, r, n, directions, bends)
                out[e] = max(out[e], depth)
    for o in range(obstacles.shape[0]):
        lies = False
        for i in range(count):
            lies = lies or (points[i, OBSTACLE] == o and points[i, KIND] == SAMPLE)
        if not lies:
            continue
        for e in range(h.shape[0]):
            for k in range(SAMPLES - 1):
                s = s0[e] + 0.5 * h[e] * (NODES[k] + NODES[k + 1])
                if inside(points, count, o, s):
                    position(c, h, s0, s, r)
                    out[e] = max(out[e], -gap(obstacles[o], r, n, directions, bends))


@njit(**OPTIONS)
def highest_mode(points, count, out):
    """The part of each sample's friction, out (count, 3), that is in the highest mode of its element.

    `points` (CAPACITY, COLUMNS) holds `count` contact points.
    """
    out[:] = 0.0
    for i in range(count):
        if points[i, LENGTH] == 0.0:
            continue
        g = int(points[i, NUMBER])
        mode = points[i, LENGTH] * (2 * SAMPLES - 1) * HIGHEST[g % SAMPLES]
        for k in range(count):
            other = int(points[k, NUMBER])
            near = points[k, OBSTACLE] == points[i, OBSTACLE] and other // SAMPLES == g // SAMPLES
            if near and points[k, LENGTH] > 0.0:
                share = mode * WEIGHTS[other % SAMPLES] * HIGHEST[other % SAMPLES] / points[k, LENGTH]
                for a in range(3):
                    out[i, a] += share * points[k, FRICTION + a]
