# SPDX-License-Identifier: Apache-2.0
"""Contact of one node of `coulomb_rod` with one obstacle: distance and Alart and Curnier's friction."""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import njit

PLANE, SPHERE, CAPSULE, CYLINDER, BOX = range(5)


@njit(cache=True)
def radial(v, n, H):
    """Distance from the point that v (3,) starts at: length, unit vector n and second derivative H."""
    d = max(np.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2), 1e-12)
    for a in range(3):
        n[a] = v[a] / d
    for a in range(3):
        for b in range(3):
            H[a, b] = ((1.0 if a == b else 0.0) - n[a] * n[b]) / d
    return d


@njit(cache=True)
def surface(kind, p, y, n, H):
    """Distance of y (3,) from the obstacle, both in its body's frame; outward normal n and Hessian H.

    p: PLANE point, normal; SPHERE centre, radius; CAPSULE and CYLINDER both ends of the axis, radius;
    BOX half edges (3,), centred at the origin.
    """
    H[:] = 0.0
    if kind == PLANE:
        n[:] = p[3:6]
        return (y[0] - p[0]) * n[0] + (y[1] - p[1]) * n[1] + (y[2] - p[2]) * n[2]
    if kind == SPHERE:
        return radial(y - p[:3], n, H) - p[3]
    if kind == BOX:
        v = np.zeros(3)
        out = False
        for a in range(3):
            if abs(y[a]) > p[a]:
                v[a] = y[a] - np.sign(y[a]) * p[a]
                out = True
        if out:
            d = radial(v, n, H)
            for a in range(3):
                if v[a] == 0.0:
                    H[a, a] = 0.0
            return d
        nearest = 0
        for a in range(1, 3):
            if abs(y[a]) - p[a] > abs(y[nearest]) - p[nearest]:
                nearest = a
        n[:] = 0.0
        n[nearest] = 1.0 if y[nearest] >= 0 else -1.0
        return abs(y[nearest]) - p[nearest]
    axis = p[3:6] - p[:3]
    size = np.sqrt(np.sum(axis**2))
    axis = axis / size
    v = y - p[:3]
    along = v[0] * axis[0] + v[1] * axis[1] + v[2] * axis[2]
    if kind == CAPSULE:
        nearest_along = min(max(along, 0.0), size)
        d = radial(v - nearest_along * axis, n, H)
        if 0.0 < along < size:
            for a in range(3):
                for b in range(3):
                    H[a, b] -= axis[a] * axis[b] / d
        return d - p[6]
    across = v - along * axis
    rho = radial(across, n, H)  # n is the radial direction
    for a in range(3):
        for b in range(3):
            H[a, b] -= axis[a] * axis[b] / rho  # leaves e e^T / rho, e around the axis
    beyond = abs(along - size / 2) - size / 2
    up = 1.0 if along > size / 2 else -1.0
    if beyond <= 0.0 and rho - p[6] >= beyond:
        return rho - p[6]
    if rho <= p[6]:
        n[:] = up * axis
        H[:] = 0.0
        return beyond
    d = np.sqrt((rho - p[6]) ** 2 + beyond**2)
    a1, a2 = (rho - p[6]) / d, beyond / d
    side = a1 * up * axis - a2 * n
    n[:] = a1 * n + a2 * up * axis
    for a in range(3):
        for b in range(3):
            H[a, b] = H[a, b] * a1 + side[a] * side[b] / d
    return d


@njit(cache=True)
def law(lam, gap, n, H, slip, old, mu, r, eps, C, A, B):
    """Alart-Curnier's equations C (3,) of one node and obstacle, A = dC/dlam, B = dC/dx (3, 3).

    slip: displacement over the obstacle in this step; old: traction before it, carried with the obstacle;
    eps: compliance of normal contact and of stick. Returns 0 apart, 1 stick, 2 slip.
    """
    C[:] = lam
    A[:] = 0.0
    B[:] = 0.0
    for a in range(3):
        A[a, a] = 1.0
    ln = lam[0] * n[0] + lam[1] * n[1] + lam[2] * n[2]
    off = r * (gap + eps * ln)
    if ln - off <= 0.0:
        return 0
    w = np.empty(3)
    wn = 0.0
    for a in range(3):
        w[a] = (1 - r * eps) * lam[a] - r * slip[a] + r * eps * old[a]
        wn += w[a] * n[a]
    s = w - wn * n
    size = np.sqrt(s[0] ** 2 + s[1] ** 2 + s[2] ** 2)
    bound = mu * max(ln, 0.0)
    Hl, Hw = np.zeros(3), np.zeros(3)
    for a in range(3):
        for b in range(3):
            Hl[a] += H[a, b] * lam[b]
            Hw[a] += H[a, b] * w[b]
    # ds = P dw - D(w) dx with D(v) = (n.v) H + n (H v)^T; minus a projection of it is added to d(P lam)
    sliding = size > bound
    share = bound / size if sliding else 1.0
    e = s / size if sliding else np.zeros(3)
    slope = mu if sliding and ln > 0 else 0.0
    for a in range(3):
        C[a] = lam[a] - ln * n[a] - share * s[a] + n[a] * off
        for b in range(3):
            P = (1.0 if a == b else 0.0) - n[a] * n[b]
            Q = P - e[a] * e[b]  # what a projection onto the circle lets through, times share
            A[a, b] = P - share * (1 - r * eps) * Q - slope * e[a] * n[b] + r * eps * n[a] * n[b]
            B[a, b] = -ln * H[a, b] - n[a] * Hl[b] + share * r * Q - slope * e[a] * Hl[b]
            B[a, b] += r * n[a] * (n[b] + eps * Hl[b]) + off * H[a, b]
            D = wn * H[a, b] + n[a] * Hw[b]
            for c in range(3):
                eD = e[a] * e[c] * (wn * H[c, b] + n[c] * Hw[b])
                D -= eD
            B[a, b] += share * D
    return 2 if sliding else 1


@njit(cache=True)
def divide(A, c, B):
    """Put A^-1 c into c (3,) and A^-1 B into B (3, 3), by cofactors."""
    inverse = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            a, b, d, e = (j + 1) % 3, (j + 2) % 3, (i + 1) % 3, (i + 2) % 3
            inverse[i, j] = A[a, d] * A[b, e] - A[a, e] * A[b, d]
    inverse /= A[0, 0] * inverse[0, 0] + A[0, 1] * inverse[1, 0] + A[0, 2] * inverse[2, 0]
    c[:] = inverse @ c
    B[:] = inverse @ B
