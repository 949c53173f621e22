# SPDX-License-Identifier: Apache-2.0
"""Compiled: distance to an obstacle, points of the curve, and what a point force adds to the equations."""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import LEAF, LEAF_ENTRY, njit
from cable_ros.rod import quaternion
from cable_ros.rod.centreline import tangent

SPHERE, PLANE, CAPSULE, CYLINDER, BOX = 0.0, 1.0, 2.0, 3.0, 4.0
SHAPE, CENTRE, AXES, DIMENSIONS, OFFSET, FRICTION_COEFFICIENT, WIDTH = 0, 1, 4, 13, 16, 17, 18
"""Columns of an obstacle: shape, centre (3), rotation matrix (9, by rows), dimensions (3), offset,
coefficient of friction; and their number.

Dimensions: radius (sphere); radius, half length along z (capsule, cylinder); half edges (box); the solid is
below z = 0 (plane). The offset is the cable's radius where it counts.
"""
POSE = slice(CENTRE, DIMENSIONS)
"""Columns of centre and rotation matrix."""


@njit(**LEAF_ENTRY)
def gap(obstacle, r, n, directions, bends):
    """Distance from a point to the obstacle's surface, less the offset; negative inside.

    Its Hessian by the point is the sum of bends[i] directions[i] directions[i]^T.

    Args:
        obstacle: (WIDTH,).
        r: (3,) the point.
        n: (3,) receives the gradient, the surface's normal.
        directions: (2, 3) receives unit vectors across n.
        bends: (2,) receives the curvatures along them.
    """
    kind = obstacle[SHAPE]
    # in the obstacle's own axes at first, turned in the end
    m, d = n, directions
    m[:] = 0.0
    d[:] = 0.0
    c0, c1, c2 = obstacle[CENTRE], obstacle[CENTRE + 1], obstacle[CENTRE + 2]
    v0, v1, v2 = r[0] - c0, r[1] - c1, r[2] - c2
    y = (
        obstacle[AXES] * v0 + obstacle[AXES + 3] * v1 + obstacle[AXES + 6] * v2,
        obstacle[AXES + 1] * v0 + obstacle[AXES + 4] * v1 + obstacle[AXES + 7] * v2,
        obstacle[AXES + 2] * v0 + obstacle[AXES + 5] * v1 + obstacle[AXES + 8] * v2,
    )
    a, b = obstacle[DIMENSIONS], obstacle[DIMENSIONS + 1]
    bends[0] = 0.0
    bends[1] = 0.0
    distance = 0.0
    if kind == PLANE:
        m[2] = 1.0
        distance = y[2]
    elif kind == SPHERE or (kind == CAPSULE and abs(y[2]) > b):
        z = y[2]
        if kind == CAPSULE:
            z -= b if z > 0.0 else -b
        size = np.sqrt(y[0] * y[0] + y[1] * y[1] + z * z)
        distance = size - a
        if size < 1e-12:
            m[2], size = 1.0, 1e-12
        else:
            m[0], m[1], m[2] = y[0] / size, y[1] / size, z / size
        across(m, d)
        bends[0], bends[1] = 1.0 / size, 1.0 / size
    elif kind in (CAPSULE, CYLINDER):
        size = np.sqrt(y[0] * y[0] + y[1] * y[1])
        x0, x1 = 1.0, 0.0
        if size > 1e-12:
            x0, x1 = y[0] / size, y[1] / size
        side = size - a
        cap = abs(y[2]) - b if kind == CYLINDER else -1.0
        up = 1.0 if y[2] > 0.0 else -1.0
        d[0, 0], d[0, 1] = -x1, x0
        if kind == CAPSULE or (cap <= 0.0 and side >= cap):
            m[0], m[1] = x0, x1
            distance = side
            bends[0] = 1.0 / max(size, 1e-12)
        elif side <= 0.0:
            m[2] = up
            distance = cap
        else:
            distance = np.sqrt(side * side + cap * cap)
            m[0], m[1], m[2] = x0 * side / distance, x1 * side / distance, up * cap / distance
            bends[0] = side / distance / max(size, 1e-12)
            d[1, 0], d[1, 1], d[1, 2] = -x0 * cap / distance, -x1 * cap / distance, up * side / distance
            bends[1] = 1.0 / distance
    else:
        out = 0
        largest = -np.inf
        face = 0
        for i in range(3):
            over = abs(y[i]) - obstacle[DIMENSIONS + i]
            if over > 0.0:
                out += 1
                m[i] = over if y[i] > 0.0 else -over
                distance += over * over
            if over > largest:
                largest, face = over, i
        if out == 0:
            distance = largest
            m[face] = 1.0 if y[face] > 0.0 else -1.0
        else:
            distance = np.sqrt(distance)
            for i in range(3):
                m[i] /= distance
            if out == 3:
                across(m, d)
                bends[0], bends[1] = 1.0 / distance, 1.0 / distance
            elif out == 2:
                axis = 0
                for i in range(3):
                    if m[i] == 0.0:
                        axis = i
                i, j = (axis + 1) % 3, (axis + 2) % 3
                d[0, i], d[0, j] = -m[j], m[i]
                bends[0] = 1.0 / distance
    for v in (n, directions[0], directions[1]):
        m0, m1, m2 = v[0], v[1], v[2]
        for i in range(3):
            row = AXES + 3 * i
            v[i] = obstacle[row] * m0 + obstacle[row + 1] * m1 + obstacle[row + 2] * m2
    return distance - obstacle[OFFSET]


@njit(**LEAF_ENTRY)
def across(n, directions):
    """`directions` (2, 3): unit vectors across n (3,), continuous but at n = -z (Duff et al. 2017)."""
    sign = 1.0 if n[2] >= 0.0 else -1.0
    a = -1.0 / (sign + n[2])
    b = n[0] * n[1] * a
    directions[0, 0] = 1.0 + sign * n[0] * n[0] * a
    directions[0, 1], directions[0, 2] = sign * b, -sign * n[0]
    directions[1, 0], directions[1, 1], directions[1, 2] = b, sign + n[1] * n[1] * a, -n[1]


@njit(**LEAF)
def pull(qs, P, weight, gT, H):
    """Gradient gT (4,) and Hessian H (4, 4) of - weight P.t by the quaternion qs (4,), for a force P (3,)."""
    w, x, y, z = qs[0], qs[1], qs[2], qs[3]
    n = tangent(qs, gT)
    T = -(P[0] * gT[0] + P[1] * gT[1] + P[2] * gT[2])
    u = 2.0 * weight / n
    gT[0] = -u * (P[2] * w - P[1] * x + P[0] * y + T * w)
    gT[1] = -u * (-P[1] * w - P[2] * x + P[0] * z + T * x)
    gT[2] = -u * (P[0] * w - P[2] * y + P[1] * z + T * y)
    gT[3] = -u * (P[0] * x + P[1] * y + P[2] * z + T * z)
    a, b, c, d = u * P[0], u * P[1], u * P[2], u * T
    H[0, 0], H[1, 1], H[2, 2], H[3, 3] = -c - d, c - d, c - d, -c - d
    H[0, 1], H[0, 2], H[0, 3] = b, -a, 0.0
    H[1, 2], H[1, 3], H[2, 3] = 0.0, -a, -b
    for i in range(4):
        for j in range(i, 4):
            H[i, j] -= 2.0 / n * (gT[i] * qs[j] + gT[j] * qs[i])
            H[j, i] = H[i, j]


def placed(local: np.ndarray, links: np.ndarray, start: np.ndarray, length: float) -> np.ndarray:
    """Obstacles `local` (n, WIDTH) on links at `links` (n, 7), seen from the start clamp at `start` (7,).

    Poses in the world, x y z, quaternion x y z w; the result is in units of the cable's length.
    """
    out = local.copy()
    place_obstacles(local, links, start, length, out)
    return out


@njit(cache=True)
def place_obstacles(
    local: np.ndarray, links: np.ndarray, start: np.ndarray, length: float, out: np.ndarray
) -> None:
    """`placed` in a copy `out` of `local`: compiled code returns arrays more slowly than Python."""
    a = np.array([start[6], -start[3], -start[4], -start[5]])
    b = np.empty(4)
    v = np.empty(3)
    for i in range(local.shape[0]):
        b[0], b[1], b[2], b[3] = links[i, 6], links[i, 3], links[i, 4], links[i, 5]
        centre = quaternion.rotate(b, local[i, CENTRE:AXES])
        for k in range(3):
            v[k] = centre[k] + links[i, k] - start[k]
        x, y, z = quaternion.turned(a, v)
        out[i, CENTRE], out[i, CENTRE + 1], out[i, CENTRE + 2] = x / length, y / length, z / length
        both = quaternion.multiply(a, b)
        for j in range(3):
            for k in range(3):
                v[k] = local[i, AXES + 3 * k + j]
            axis = AXES + j
            out[i, axis], out[i, axis + 3], out[i, axis + 6] = quaternion.turned(both, v)
        for k in range(DIMENSIONS, FRICTION_COEFFICIENT):
            out[i, k] = local[i, k] / length


@njit(cache=True)
def gaps(obstacles: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Distances (n,) from the point r (3,) to the obstacles (n, WIDTH), negative inside."""
    out = np.empty(obstacles.shape[0])
    n, directions, bends = np.empty(3), np.empty((2, 3)), np.empty(2)
    for i in range(obstacles.shape[0]):
        out[i] = gap(obstacles[i], r, n, directions, bends)
    return out


@njit(cache=True)
def deepest(r: np.ndarray, t: np.ndarray, h: np.ndarray, obstacles: np.ndarray) -> float:
    """How deep the middles of m elements are inside an obstacle (o, WIDTH), lengths; negative outside.

    Args:
        r, t: (m + 1, 3) positions and unit tangents at their ends; a cubic leads from one to the next.
        h: (m,) their lengths.
    """
    n, directions, bends = np.empty(3), np.empty((2, 3)), np.empty(2)
    middle, out = np.empty(3), -np.inf
    for e in range(h.shape[0]):
        for a in range(3):
            middle[a] = 0.5 * (r[e, a] + r[e + 1, a]) + 0.125 * h[e] * (t[e, a] - t[e + 1, a])
        for i in range(obstacles.shape[0]):
            out = max(out, -gap(obstacles[i], middle, n, directions, bends))
    return out


@njit(cache=True)
def nearest(obstacles: np.ndarray, r: np.ndarray) -> tuple[float, int]:
    """The smallest of the `gaps` of the point r (3,) to the obstacles (n, WIDTH), and which obstacle's."""
    distances = gaps(obstacles, r)
    which = int(np.argmin(distances))
    return float(distances[which]), which
