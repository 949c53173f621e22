# SPDX-License-Identifier: Apache-2.0
"""The discrete rod of `coulomb_rod`: residual, Jacobian, banded elimination and the semismooth Newton loop.

Units of the cable (length 1, forces in EI / L^2). The vector along a segment, h R e_z with its frame R,
gives way to its force F by h R diag(1 / GAx, 1 / GAy, 1 / EA) R^T F: it shears and stretches. Segment j
(0..n-1) has the frame q_j (quaternion, scalar first) and the force F_j (3,) that the part beyond exerts on
the part before it; node i (0..n) has the position x_i (3,). The energy of a joint between two frames is h/2
kappa.K.kappa with kappa = (2/h) vec(q_a* q_b); at the clamps the spacing is h/2. Unknowns in the order
psi_0, F_0, x_1, psi_1, F_1, ..., F_{n-1}: nine per segment, bandwidth 11 on either side. Contact forces lam
(K, n + 1, 3), one per obstacle and node, are unknowns too and are eliminated node by node. Without the end
clamp x_n is an unknown, too, after F_{n-1}, and no moment is there.
"""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import njit
from references.coulomb_contact import divide, law, surface

BAND = 11
WIDTH = 3 * BAND + 1
LARGEST_TURN = 0.3
"""Of a section in one iteration, rad; longer steps are shortened."""
WORSE = 100.0
"""A step may multiply the merit by this: a change of what touches or sticks makes it rise for a while."""


@njit(cache=True)
def rotation(q, R):
    """Matrix (3, 3) of the unit quaternion q (4,), scalar first, into R."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    R[0, 0], R[0, 1], R[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    R[1, 0], R[1, 1], R[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    R[2, 0], R[2, 1], R[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@njit(cache=True)
def relative(a, b, p):
    """a* b of quaternions into p, with the sign that makes its scalar part positive."""
    p[0] = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
    p[1] = a[0] * b[1] - a[1] * b[0] - a[2] * b[3] + a[3] * b[2]
    p[2] = a[0] * b[2] - a[2] * b[0] - a[3] * b[1] + a[1] * b[3]
    p[3] = a[0] * b[3] - a[3] * b[0] - a[1] * b[2] + a[2] * b[1]
    if p[0] < 0:
        p *= -1.0


@njit(cache=True)
def turn(q, psi, out):
    """q exp(psi / 2), rows of (n, 4) and (n, 3), into out."""
    for j in range(q.shape[0]):
        angle = np.sqrt(psi[j, 0] ** 2 + psi[j, 1] ** 2 + psi[j, 2] ** 2)
        s = 0.5 if angle < 1e-8 else np.sin(angle / 2) / angle
        w, x, y, z = np.cos(angle / 2), s * psi[j, 0], s * psi[j, 1], s * psi[j, 2]
        a, b, c, d = q[j, 0], q[j, 1], q[j, 2], q[j, 3]
        out[j, 0] = a * w - b * x - c * y - d * z
        out[j, 1] = a * x + b * w + c * z - d * y
        out[j, 2] = a * y + c * w + d * x - b * z
        out[j, 3] = a * z + d * w + b * y - c * x
        out[j] /= np.sqrt(np.sum(out[j] ** 2))


@njit(cache=True)
def joint(a, b, K, spacing, ga, gb, J):
    """Energy gradients ga, gb (3,) of a joint between frames a and b; J (2, 2, 3, 3): rows a, b by a, b."""
    p = np.empty(4)
    relative(a, b, p)
    v = p[1:]
    m = 2.0 * K * v / spacing
    cross = np.array([v[1] * m[2] - v[2] * m[1], v[2] * m[0] - v[0] * m[2], v[0] * m[1] - v[1] * m[0]])
    for i in range(3):
        gb[i] = p[0] * m[i] - cross[i]
        ga[i] = -(p[0] * m[i] + cross[i])
    V, M = np.zeros((3, 3)), np.zeros((3, 3))
    V[0, 1], V[0, 2], V[1, 0], V[1, 2], V[2, 0], V[2, 1] = -v[2], v[1], v[2], -v[0], -v[1], v[0]
    M[0, 1], M[0, 2], M[1, 0], M[1, 2], M[2, 0], M[2, 1] = -m[2], m[1], m[2], -m[0], -m[1], m[0]
    G = np.empty((2, 3, 3))
    for i in range(3):
        for j in range(3):
            one = p[0] if i == j else 0.0
            G[0, i, j] = -(one - V[i, j])
            G[1, i, j] = one + V[i, j]
    for row in range(2):
        sign = -1.0 if row == 0 else 1.0
        for col in range(2):
            side = 1.0 if col == 0 else -1.0
            for i in range(3):
                for j in range(3):
                    total = sign * m[i] * side * 0.5 * v[j]
                    for k in range(3):
                        total += G[row, k, i] * K[k] / spacing * G[col, k, j]
                        total += 0.5 * M[i, k] * G[col, k, j]
                    J[row, col, i, j] = total


@njit(cache=True)
def assemble(x, q, F, lam, rod, contact, state, ab, rhs, aic, aib, jacobian):
    """Residual (into rhs, negative) and its Jacobian (band storage ab). Returns the squared merit.

    rod: K (3,), w (3,), clamps' frames q0, q1 (4,), drag, 1 / GAx, 1 / GAy, 1 / EA (3,), force on a free end
    (3,; NaN: a clamp holds it). contact: kinds (K,), shapes (K, 7), frames (K, 3, 3), origins (K, 3),
    mu (K,), radius, r, eps. state: carried positions and old tractions (K, n + 1, 3), positions for the drag
    (n + 1, 3). aic, aib: what gives the contact forces' increments.
    """
    K, w, q0, q1, drag, give, pull = rod
    free = pull[0] == pull[0]
    soft = give[2]
    kinds, shapes, frames, origins, mu, radius, r, eps = contact
    carried, old, before = state
    n = q.shape[0]
    h = 1.0 / n
    scale = 1.0 / h**2
    ga, gb, J = np.empty(3), np.empty(3), np.empty((2, 2, 3, 3))
    R = np.empty((3, 3))
    C, A, B, nb, Hb = np.empty(3), np.empty((3, 3)), np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    H = np.empty((3, 3))
    rhs[:] = 0.0
    if jacobian:
        ab[:] = 0.0
    merit = 0.0
    for j in range(n if free else n + 1):
        a = q0 if j == 0 else q[j - 1]
        b = q1 if j == n else q[j]
        joint(a, b, K, h / 2 if j in (0, n) else h, ga, gb, J)
        for i in range(3):
            if j > 0:
                rhs[9 * (j - 1) + i] -= ga[i]
            if j < n:
                rhs[9 * j + i] -= gb[i]
        if jacobian:
            for row in range(2):
                for col in range(2):
                    jr, jc = j - 1 + row, j - 1 + col
                    if 0 <= jr < n and 0 <= jc < n:
                        for i in range(3):
                            for k in range(3):
                                ab[9 * jr + i, 9 * (jc - jr) + k - i + BAND] += J[row, col, i, k]
    for j in range(n):
        rotation(q[j], R)
        fb = R.T @ F[j]
        base = 9 * j
        la = h * (1.0 + soft * fb[2])  # length of the stretched chord
        rhs[base] -= la * fb[1]  # residual -la e3 x fb = la (fb_y, -fb_x, 0)
        rhs[base + 1] += la * fb[0]
        for i in range(3):
            rhs[base + 3 + i] = -scale * (x[j + 1, i] - x[j, i] - la * R[i, 2])
        if jacobian:
            for i in range(2):
                ab[base + i, BAND] += la * fb[2]
            for i in range(2):
                ab[base + i, 2 - i + BAND] -= la * fb[i]
            # by the change of the length: soft h (fb_x psi_y - fb_y psi_x + R_2 . dF)
            more = soft * h
            ab[base, BAND] -= more * fb[1] * fb[1]
            ab[base, 1 + BAND] += more * fb[1] * fb[0]
            ab[base + 1, -1 + BAND] += more * fb[0] * fb[1]
            ab[base + 1, BAND] -= more * fb[0] * fb[0]
            for i in range(3):
                # moment: la (R_1 . F, -R_0 . F, 0) with the columns of R; constraint: -la R (psi x e3)
                ab[base, 3 + i + BAND] += la * R[i, 1] + more * fb[1] * R[i, 2]
                ab[base + 1, 2 + i + BAND] -= la * R[i, 0] + more * fb[0] * R[i, 2]
                row = base + 3 + i
                ab[row, -3 - i + BAND] += scale * (la * R[i, 1] + more * fb[1] * R[i, 2])
                ab[row, -2 - i + BAND] -= scale * (la * R[i, 0] + more * fb[0] * R[i, 2])
                for k in range(3):
                    ab[row, k - i + BAND] -= scale * more * R[i, 2] * R[k, 2]
                if j < n - 1 or free:
                    ab[row, 3 + BAND] += scale
                if j > 0:
                    ab[row, -6 + BAND] -= scale
        if give[0] > 0.0 or give[1] > 0.0:
            tilt(h, scale, give, R, fb, base, ab, rhs, jacobian)
    for i in range(1, n + 1 if free else n):
        base = 9 * (i - 1) + 6
        for a in range(3):
            beyond = F[i, a] + h * w[a] if i < n else pull[a] + 0.5 * h * w[a]
            rhs[base + a] = -(beyond - F[i - 1, a] - drag * (x[i, a] - before[i, a]))
            if jacobian:
                ab[base + a, BAND] -= drag
                if i < n:
                    ab[base + a, 6 + BAND] += 1.0
                ab[base + a, -3 + BAND] -= 1.0
        for k in range(kinds.shape[0]):
            y = frames[k].T @ (x[i] - origins[k])
            gap = surface(kinds[k], shapes[k], y, nb, Hb) - radius
            nw = frames[k] @ nb
            if jacobian:
                H[:] = frames[k] @ Hb @ frames[k].T
            touches = law(lam[k, i], gap, nw, H, x[i] - carried[k, i], old[k, i], mu[k], r, eps, C, A, B)
            for a in range(3):
                rhs[base + a] -= lam[k, i, a]
            merit += np.sum(C**2)
            if jacobian:
                aic[k, i] = C
                aib[k, i] = B
                if touches:
                    divide(A, aic[k, i], aib[k, i])
                for a in range(3):
                    rhs[base + a] += aic[k, i, a]
                    for b in range(3):
                        ab[base + a, b - a + BAND] -= aib[k, i, a, b]
    if not jacobian:
        merit += np.sum(rhs**2)
    return merit


@njit(cache=True)
def skew(v):
    """The matrix of v x."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


@njit(cache=True)
def tilt(h, scale, give, R, fb, base, ab, rhs, jacobian):
    """Add the shear of a segment with the frame R and the force fb along its axes: u = C fb, C by GA alone.

    Its moment is h u x fb and its chord longer by h R u. A turn R psi x changes fb by fb x psi.
    """
    C = np.diag(np.array([give[0], give[1], 0.0]))
    u = C @ fb
    rhs[base : base + 3] += h * (skew(u) @ fb)
    rhs[base + 3 : base + 6] += scale * h * (R @ u)
    if not jacobian:
        return
    by_fb = h * (skew(fb) @ C - skew(u))  # of - h u x fb
    by_turn, by_force = by_fb @ skew(fb), by_fb @ R.T
    chord_turn = scale * h * R @ (skew(u) - C @ skew(fb))  # of - scale h R u
    chord_force = -scale * h * R @ C @ R.T
    for i in range(3):
        for k in range(3):
            ab[base + i, k - i + BAND] += by_turn[i, k]
            ab[base + i, 3 + k - i + BAND] += by_force[i, k]
            ab[base + 3 + i, k - i - 3 + BAND] += chord_turn[i, k]
            ab[base + 3 + i, k - i + BAND] += chord_force[i, k]


@njit(cache=True)
def eliminate(ab, rhs):
    """Solve the banded system in place by Gaussian elimination with row pivots; the solution is in rhs."""
    n = rhs.shape[0]
    for k in range(n):
        last = min(n, k + BAND + 1)
        best, size = k, abs(ab[k, BAND])
        for i in range(k + 1, last):
            if abs(ab[i, k - i + BAND]) > size:
                best, size = i, abs(ab[i, k - i + BAND])
        width = min(n - k, 2 * BAND + 1)
        if best != k:
            shift = k - best
            for c in range(width):
                swap = ab[k, c + BAND]
                ab[k, c + BAND] = ab[best, c + shift + BAND]
                ab[best, c + shift + BAND] = swap
            swap = rhs[k]
            rhs[k] = rhs[best]
            rhs[best] = swap
        pivot = ab[k, BAND]
        if pivot == 0.0:
            return False
        for i in range(k + 1, last):
            start = k - i + BAND
            factor = ab[i, start] / pivot
            if factor != 0.0:
                for c in range(1, width):
                    ab[i, start + c] -= factor * ab[k, BAND + c]
                rhs[i] -= factor * rhs[k]
    for k in range(n - 1, -1, -1):
        total = rhs[k]
        for c in range(1, min(n - k, 2 * BAND + 1)):
            total -= ab[k, BAND + c] * rhs[k + c]
        rhs[k] = total / ab[k, BAND]
    return True


@njit(cache=True)
def newton(x, q, F, lam, rod, contact, state, tolerance, most):
    """Semismooth Newton with a line search on the merit; x, q, F, lam are changed in place.

    Returns the number of iterations, or -1 where the residual stays above the tolerance.
    """
    n, obstacles = q.shape[0], lam.shape[0]
    free = rod[-1][0] == rod[-1][0]
    size = 9 * n if free else 9 * n - 3
    ab, rhs = np.empty((size, WIDTH)), np.empty(size)
    step = np.empty(size)
    aic, aib = np.zeros((obstacles, n + 1, 3)), np.zeros((obstacles, n + 1, 3, 3))
    x1, q1, F1, lam1 = x.copy(), q.copy(), F.copy(), lam.copy()
    bx, bq, bF, blam = x.copy(), q.copy(), F.copy(), lam.copy()
    psi = np.empty((n, 3))
    merit = assemble(x, q, F, lam, rod, contact, state, ab, rhs, aic, aib, False)
    for count in range(most):
        if np.sqrt(merit) < tolerance:
            return count
        assemble(x, q, F, lam, rod, contact, state, ab, rhs, aic, aib, True)
        # the constraint's scale makes rows of one size; pivoting does the rest
        step[:] = rhs
        if not eliminate(ab, step):
            return -1
        longest = 0.0
        for j in range(n):
            longest = max(longest, np.max(np.abs(step[9 * j : 9 * j + 3])))
        part = min(1.0, LARGEST_TURN / max(longest, 1e-300))
        lowest, found = np.inf, False
        for _ in range(7):
            for j in range(n):
                psi[j] = part * step[9 * j : 9 * j + 3]
                F1[j] = F[j] + part * step[9 * j + 3 : 9 * j + 6]
                if j < n - 1 or free:
                    x1[j + 1] = x[j + 1] + part * step[9 * j + 6 : 9 * j + 9]
                    for k in range(obstacles):
                        change = aic[k, j + 1] + aib[k, j + 1] @ step[9 * j + 6 : 9 * j + 9]
                        lam1[k, j + 1] = lam[k, j + 1] - part * change
            turn(q, psi, q1)
            new = assemble(x1, q1, F1, lam1, rod, contact, state, ab, rhs, aic, aib, False)
            if new < lowest:
                lowest = new
                bx[:], bq[:], bF[:], blam[:] = x1, q1, F1, lam1
            if new < (1 - 0.2 * part) * merit:
                found = True
                break
            part *= 0.5
        if not np.isfinite(lowest):
            return -1
        if not found and lowest > WORSE * merit:
            return -1
        x[:], q[:], F[:], lam[:], merit = bx, bq, bF, blam, lowest
    return -1
