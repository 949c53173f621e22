"""Compiled: the factored saddle system, the warm-started step, stability, error estimate, polyline.

The arrays that these functions share are those of `Rod` (rod.py); `tables` and `fine` are
`ReferenceElement.tables` for the solve and for the estimate.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from cable_ros.mechanics import quaternion
from cable_ros.mechanics.kernels import gradient, hessian, second, section, tangent_derivative
from cable_ros.solve import banded

OPTIONS = {"cache": True, "error_model": "numpy"}

ADVANCED, TOO_FAR, NOT_CONTRACTING, NOT_CONVEX = 0, 1, 2, 3


@njit(**OPTIONS)
def solve3(S, b, x):
    """x = S^-1 b for the symmetric 3 x 3 matrix S, by elimination with the largest pivot."""
    M = np.empty((3, 4))
    for i in range(3):
        for j in range(3):
            M[i, j] = S[i, j]
        M[i, 3] = b[i]
    for k in range(3):
        p = k
        for i in range(k + 1, 3):
            if abs(M[i, k]) > abs(M[p, k]):
                p = i
        for j in range(4):
            M[k, j], M[p, j] = M[p, j], M[k, j]
        for i in range(k + 1, 3):
            v = M[i, k] / M[k, k]
            for j in range(k, 4):
                M[i, j] -= v * M[k, j]
    for k in range(2, -1, -1):
        v = M[k, 3]
        for j in range(k + 1, 3):
            v -= M[k, j] * x[j]
        x[k] = v / M[k, k]


@njit(**OPTIONS)
def negative3(S):
    """Number of negative eigenvalues of the symmetric 3 x 3 matrix S, by the signs of its characteristic polynomial."""
    trace = S[0, 0] + S[1, 1] + S[2, 2]
    minors = (
        (S[0, 0] * S[1, 1] - S[0, 1] * S[1, 0])
        + (S[0, 0] * S[2, 2] - S[0, 2] * S[2, 0])
        + (S[1, 1] * S[2, 2] - S[1, 2] * S[2, 1])
    )
    det = (
        S[0, 0] * (S[1, 1] * S[2, 2] - S[1, 2] * S[2, 1])
        - S[0, 1] * (S[1, 0] * S[2, 2] - S[1, 2] * S[2, 0])
        + S[0, 2] * (S[1, 0] * S[2, 1] - S[1, 1] * S[2, 0])
    )
    # all roots are real, so Descartes' rule counts the positive ones exactly
    count, last = 0, 1.0
    for v in (-trace, minors, -det):
        if v * last < 0.0:
            count += 1
        if v != 0.0:
            last = v
    return 3 - count


@njit(**OPTIONS)
def factor(elastic, geometric, C, mu, order, A, L, pivots, Y, S):
    """Factor the saddle system of H + mu D; whether H + mu D is positive on the end condition's tangent space.

    The matrix has the inertia of H + mu D and that of -S, S = C H^-1 C^T, together; a strict minimum has three
    negative eigenvalues in all (Gould 1985).
    """
    n = A.shape[0]
    for i in range(n):
        for j in range(A.shape[1]):
            A[i, j] = (1.0 + mu) * elastic[i, j] + geometric[i, j]
    negative, worst = banded.factor(A, 3, n - 3, order, L, pivots)
    for a in range(3):
        for i in range(n):
            Y[a, i] = C[a, i] if 3 <= i < n - 3 else 0.0
        banded.solve(L, pivots, 3, n - 3, order, Y[a])
    for a in range(3):
        for b in range(a + 1):
            s = 0.0
            for i in range(3, n - 3):
                s += C[a, i] * Y[b, i]
            S[a, b] = s
            S[b, a] = s
    return worst > 1e-11 and negative3(S) == negative


@njit(**OPTIONS)
def saddle_step(g, c, C, order, L, pivots, Y, S, s, dF):
    """s (3n,), dF (3,) with H s - C^T dF = -g, C s = -c at the inner nodes; s = 0 at the ends."""
    n = s.shape[0]
    for i in range(n):
        s[i] = -g[i] if 3 <= i < n - 3 else 0.0
    banded.solve(L, pivots, 3, n - 3, order, s)
    b = np.empty(3)
    for a in range(3):
        v = -c[a]
        for i in range(3, n - 3):
            v -= C[a, i] * s[i]
        b[a] = v
    solve3(S, b, dF)
    for i in range(3, n - 3):
        s[i] += Y[0, i] * dF[0] + Y[1, i] * dF[1] + Y[2, i] * dF[2]


@njit(**OPTIONS)
def border_factor(elastic, geometric, mu, order, A, U, pivots, V, delta, rows, equalities, Y, S):
    """`factor` with more borders: form their Schur complement S; whether the whole is a strict minimum.

    With H' = H + mu D + sum v v^T / delta over the rows of V beyond the equalities, the bordered matrix has as many
    negative eigenvalues as there are equalities and positive deltas exactly where H' is positive on the equalities'
    tangent space.
    """
    n = elastic.shape[0]
    for i in range(n):
        for j in range(A.shape[1]):
            A[i, j] = (1.0 + mu) * elastic[i, j] + geometric[i, j]
    negative, worst = banded.factor(A, 3, n - 3, order, U, pivots)
    expected = equalities
    for a in range(rows):
        for i in range(n):
            Y[a, i] = V[a, i] if 3 <= i < n - 3 else 0.0
        banded.solve(U, pivots, 3, n - 3, order, Y[a])
    for a in range(rows):
        for b in range(a + 1):
            s = 0.0
            for i in range(3, n - 3):
                s += V[a, i] * Y[b, i]
            S[a, b] = s
            S[b, a] = s
        S[a, a] += delta[a]
        if a >= equalities and delta[a] > 0.0:
            expected += 1
    positive = 0
    for v in np.linalg.eigvalsh(S[:rows, :rows]):
        if v > 0.0:
            positive += 1
    return worst > 1e-11 and negative + positive == expected


@njit(**OPTIONS)
def border_step(g, c, V, rows, order, U, pivots, Y, S, s, y):
    """s (3n,), y (rows,) with H s - V^T y = -g, V s + delta y = -c; s = 0 at the ends."""
    n = s.shape[0]
    for i in range(n):
        s[i] = -g[i] if 3 <= i < n - 3 else 0.0
    banded.solve(U, pivots, 3, n - 3, order, s)
    b = np.empty(rows)
    for a in range(rows):
        v = -c[a]
        for i in range(3, n - 3):
            v -= V[a, i] * s[i]
        b[a] = v
    if rows == 3:
        solve3(S, b, y)
    else:
        y[:rows] = np.linalg.solve(S[:rows, :rows], b)
    for a in range(rows):
        for i in range(3, n - 3):
            s[i] += Y[a, i] * y[a]


@njit(**OPTIONS)
def end_coupling(elastic, geometric, V, rows, theta, g, c):
    """Add to g (3n,) and c (rows,) what turning the end section by theta (3,) does to them."""
    n, band = elastic.shape[0], elastic.shape[1] - 1
    for k in range(3):
        row = n - 3 + k
        for j in range(row - band, n - 3):
            at = band + j - row
            g[j] += (elastic[row, at] + geometric[row, at]) * theta[k]
        for a in range(rows):
            c[a] += V[a, row] * theta[k]


@njit(**OPTIONS)
def end_rows(elastic, geometric, V, rows, s, dF):
    """What the step (s, dF), s = 0 at the end, adds to the gradient at the end node: (3,)."""
    n, band = elastic.shape[0], elastic.shape[1] - 1
    out = np.zeros(3)
    for k in range(3):
        row = n - 3 + k
        for j in range(row - band, n - 3):
            at = band + j - row
            out[k] += (elastic[row, at] + geometric[row, at]) * s[j]
        for a in range(rows):
            out[k] -= V[a, row] * dF[a]
    return out


@njit(**OPTIONS)
def advance(
    q, F, qe, re, f, K, kappa0, h, s0, tables,
    elastic, geometric, parts, C, A, L, pivots, Y, S, acc, g, radial, totals,
    tolerance, limit, drift, refresh, q_new, F_new,
):  # fmt: skip
    """From the equilibrium (q, F) to the one whose end is at (qe, re) under the load f, with the factors at hand.

    A tangent predictor, then corrections. The factors may be those of an equilibrium from which some section has
    turned by `drift` rad; once that is more than `refresh`, after a long step, and where they no longer contract, they
    are made anew.
    Stops TOO_FAR where the predictor turns a section by more than `limit`. `tolerance` bounds what is left of nodal
    rotation (rad) and relative end force. Returns (code, iterations, drift); drift 0: the factors are new.
    """
    N, dN, N3, dN3, points, weights = tables
    order = N.shape[1] - 1
    n = 3 * q.shape[0]
    gv = g.reshape(n)
    s = np.empty(n)
    dF = np.empty(3)
    c = np.empty(3)
    last = q.shape[0] - 1
    theta = quaternion.rotation_vector(quaternion.multiply(quaternion.conjugate(q[last]), qe))
    acc[:] = 0.0
    gradient(q, spread(F, h), f, K, kappa0, h, s0, N, dN, points, weights, acc, g, radial, totals)
    for a in range(3):
        c[a] = totals[a] - re[a]
    end_coupling(elastic, geometric, C, 3, theta, gv, c)
    saddle_step(gv, c, C, order, L, pivots, Y, S, s, dF)
    for k in range(3):
        s[n - 3 + k] = theta[k]
    moved = largest(s)
    if not moved <= limit:
        return TOO_FAR, 0, drift
    quaternion.retract(q, s, q_new)
    close(q_new, qe)
    for a in range(3):
        F_new[a] = F[a] + dF[a]
    drift += moved
    size, rate = moved, 0.0
    fresh = False
    iterations = 0
    for iteration in range(1, 13):
        acc[:] = 0.0
        Fe = spread(F_new, h)
        gradient(q_new, Fe, f, K, kappa0, h, s0, N, dN, points, weights, acc, g, radial, totals)
        if iteration > 1 and size * rate <= tolerance:
            return ADVANCED, iterations, drift
        iterations = iteration
        if (iteration == 1 and (drift > refresh or moved > 0.5 * refresh)) or rate > 0.15:
            hessian(q_new, Fe, f, K, kappa0, h, s0, N, dN, N3, dN3, points, weights, radial, elastic, geometric, parts, C)
            if not factor(elastic, geometric, C, 0.0, order, A, L, pivots, Y, S):
                return NOT_CONVEX, iteration, drift
            fresh, drift = True, 0.0
        for a in range(3):
            c[a] = totals[a] - re[a]
        saddle_step(gv, c, C, order, L, pivots, Y, S, s, dF)
        quaternion.retract(q_new, s, q_new)
        close(q_new, qe)
        force, change = 1e-3, 0.0
        for a in range(3):
            F_new[a] += dF[a]
            force = max(force, abs(F_new[a]))
            change = max(change, abs(dF[a]))
        new = max(change / force, largest(s))
        # what the next correction would be: the ratio of the last two, and no less than the drift of the factors
        rate = max(min(new / size, 1.0) if iteration > 1 else 0.0, drift, 1e-3)
        if iteration > 1 and fresh and not new <= 0.5 * size:
            return NOT_CONTRACTING, iteration, drift
        size = new
    return NOT_CONTRACTING, iterations, drift


@njit(**OPTIONS)
def spread(F, h):
    """The same force F (3,) for every element: (elements, 3)."""
    out = np.empty((h.shape[0], 3))
    for e in range(h.shape[0]):
        out[e, 0], out[e, 1], out[e, 2] = F[0], F[1], F[2]
    return out


@njit(**OPTIONS)
def largest(s):
    """Largest absolute entry of s; NaN where one is."""
    out = 0.0
    for i in range(s.shape[0]):
        if not abs(s[i]) <= out:
            out = abs(s[i])
    return out


@njit(**OPTIONS)
def close(q, qe):
    """Put the last of q (n, 4) on the end frame qe or on its negative, whichever is nearer."""
    last = q.shape[0] - 1
    d = q[last, 0] * qe[0] + q[last, 1] * qe[1] + q[last, 2] * qe[2] + q[last, 3] * qe[3]
    for a in range(4):
        q[last, a] = qe[a] if d > 0.0 else -qe[a]


@njit(**OPTIONS)
def wrenches(F, f, qe, g, force, moment, end_wrench, start_wrench):
    """End and start wrench (6,) in SI: what the cable exerts on the bodies, in the clamps' frames.

    `g` (n, 3): the gradient at the equilibrium; its end rows are the moments of the clamps on the cable.
    """
    Fb = quaternion.rotate(quaternion.conjugate(qe), F)
    last = g.shape[0] - 1
    for a in range(3):
        end_wrench[a] = -force * Fb[a]
        end_wrench[3 + a] = -moment * g[last, a]
        start_wrench[a] = force * (F[a] + f[a])
        start_wrench[3 + a] = -moment * g[0, a]


@njit(**OPTIONS)
def margin(elastic, V, rows, order, L, pivots, Y, S, mode, repeats):
    """Smallest eigenvalue of H v = lambda D v on the tangent space, D the elastic stiffness, by inverse iteration.

    `mode` (3n,) is the start and receives the eigenvector; ends when the value changes by less than 1e-4 of itself.
    Only for a factored strict minimum.
    """
    n = mode.shape[0]
    x = np.empty(n)
    y = np.empty(n)
    zero = np.zeros(rows)
    dF = np.empty(rows)
    value = np.inf
    for _ in range(repeats):
        banded.multiply(elastic, mode, y)
        for i in range(n):
            y[i] = -y[i]
        border_step(y, zero, V, rows, order, L, pivots, Y, S, x, dF)
        top = 0.0
        for i in range(n):
            top -= x[i] * y[i]
        banded.multiply(elastic, x, y)
        norm2 = 0.0
        for i in range(n):
            norm2 += x[i] * y[i]
        before, value = value, top / norm2
        scale = 1.0 / np.sqrt(norm2)
        for i in range(n):
            mode[i] = scale * x[i]
        if abs(before - value) <= 1e-4 * abs(value):
            break
    return value


@njit(**OPTIONS)
def error(
    q, Fe, re, f, K, kappa0, h, s0, fine, bubble,
    elastic, geometric, V, rows, L, pivots, Y, S, g, residual, shares,
):  # fmt: skip
    """First-order change (6,) of end force and end moment when every element gets one order more.

    The enriched space adds one polynomial an element (`bubble`: its values and slopes at the points of `fine`),
    which is eliminated there; the rest is one solve with the factors at hand. `g` (n, 3) is the solution's own
    gradient, `Fe` as in `gradient`, `residual` (3n,) comes with what point forces inside elements pull. `shares` (elements,) receives each element's part in energy norm squared, for refinement.
    """
    N, dN, N3, dN3, points, weights = fine
    order = N.shape[1] - 1
    nd = 3 * (order + 1)
    n = 3 * q.shape[0]
    kappa, moment, t, G = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    qs, ds, gq, gd = np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    D = np.empty((8, nd))
    Db = np.empty((8, 3))
    frame = np.empty((4, nd))
    middle = np.empty((4, 3))
    H = np.empty((8, 8))
    k8 = np.empty((3, 8))
    Z = np.empty((3, 8))
    Hbb = np.empty((3, 3))
    Hbc = np.empty((3, nd))
    Cb = np.zeros((3, 3))
    rb = np.empty(3)
    x = np.empty(3)
    c = np.zeros(rows)
    for a in range(3):
        c[a] = -re[a]
    for e in range(h.shape[0]):
        first = e * order
        for i in range(order + 1):
            w, qx, y, z = 0.5 * q[first + i, 0], 0.5 * q[first + i, 1], 0.5 * q[first + i, 2], 0.5 * q[first + i, 3]
            j = 3 * i
            frame[0, j], frame[1, j], frame[2, j], frame[3, j] = -qx, w, z, -y
            frame[0, j + 1], frame[1, j + 1], frame[2, j + 1], frame[3, j + 1] = -y, -z, w, qx
            frame[0, j + 2], frame[1, j + 2], frame[2, j + 2], frame[3, j + 2] = -z, y, -qx, w
        j = 3 * (order // 2)
        for a in range(4):
            for b in range(3):
                middle[a, b] = frame[a, j + b]
        Hbb[:] = 0.0
        Hbc[:] = 0.0
        Cb[:] = 0.0
        rb[:] = 0.0
        for k in range(N.shape[0]):
            for a in range(4):
                qs[a] = 0.0
                ds[a] = 0.0
            for i in range(order + 1):
                for a in range(4):
                    qs[a] += N[k, i] * q[first + i, a]
                    ds[a] += dN[k, i] / h[e] * q[first + i, a]
            for a in range(4):
                for j in range(nd):
                    D[a, j] = N3[k, j] * frame[a, j]
                    D[4 + a, j] = dN3[k, j] / h[e] * frame[a, j]
                for b in range(3):
                    Db[a, b] = bubble[0, k] * middle[a, b]
                    Db[4 + a, b] = bubble[1, k] / h[e] * middle[a, b]
            rest = 1.0 - s0[e] - h[e] * points[k]
            for a in range(3):
                G[a] = Fe[e, a] + rest * f[a]
            norm, T, mk = section(qs, ds, K, kappa0, G, kappa, moment, t, gq, gd)
            wh = weights[k] * h[e]
            second(qs, ds, K, G, kappa, moment, gq, gd, norm, T, mk, wh, k8, H)
            for a in range(8):
                for b in range(8):
                    H[a, b] += K[0] * k8[0, a] * k8[0, b] + K[1] * k8[1, a] * k8[1, b] + K[2] * k8[2, a] * k8[2, b]
            for b in range(3):
                for a in range(8):
                    v = 0.0
                    for i in range(8):
                        v += Db[i, b] * H[i, a]
                    Z[b, a] = v
                for a in range(8):
                    v = Z[b, a]
                    for j in range(nd):
                        Hbc[b, j] += v * D[a, j]
                for b2 in range(3):
                    v = 0.0
                    for a in range(8):
                        v += Z[b, a] * Db[a, b2]
                    Hbb[b, b2] += v
                v = 0.0
                for a in range(4):
                    v += Db[a, b] * gq[a] + Db[4 + a, b] * gd[a]
                rb[b] += wh * v
            tangent_derivative(qs, t, 2.0 * wh / norm, Db, Cb, 0, 3)
            for a in range(3):
                c[a] += wh * t[a]
            for j in range(nd):
                v = 0.0
                for a in range(4):
                    v += D[a, j] * gq[a] + D[4 + a, j] * gd[a]
                residual[3 * first + j] += wh * v
        solve3(Hbb, rb, x)
        shares[e] = abs(rb[0] * x[0] + rb[1] * x[1] + rb[2] * x[2])
        for b in range(3):
            for j in range(nd):
                residual[3 * first + j] -= Hbc[b, j] * x[b]
            for a in range(3):
                c[a] -= Cb[a, b] * x[b]
    s = np.empty(n)
    dF = np.empty(rows)
    border_step(residual, c, V, rows, order, L, pivots, Y, S, s, dF)
    change = end_rows(elastic, geometric, V, rows, s, dF)
    out = np.empty(6)
    for a in range(3):
        out[a] = dF[a]
        out[3 + a] = residual[n - 3 + a] + change[a] - g[q.shape[0] - 1, a]
    return out


@njit(**OPTIONS)
def polyline(q, h, element, values, weights, quadrature, start, length, out_r, out_q):
    """World points (m, 3) and frames (m, 4) x y z w at the arc lengths of `element`, `values`, `weights` (see Mesh).

    `quadrature` (g, order + 1): shape functions at the g points whose tangents `weights` (m, g) integrates from the
    element's start; `start` (7,): the start clamp in the world, position and quaternion x y z w; `length` in m.
    """
    order = values.shape[1] - 1
    points = quadrature.shape[0]
    qs = np.empty(4)
    r0 = np.zeros(3)
    t = np.empty((points, 3))
    at = 0
    orientation = np.empty(4)
    orientation[0], orientation[1], orientation[2], orientation[3] = start[6], start[3], start[4], start[5]
    for e in range(h.shape[0]):
        first = e * order
        for k in range(points):
            for a in range(4):
                v = 0.0
                for i in range(order + 1):
                    v += quadrature[k, i] * q[first + i, a]
                qs[a] = v
            w, x, y, z = qs[0], qs[1], qs[2], qs[3]
            n = 1.0 / (w * w + x * x + y * y + z * z)
            t[k, 0] = 2.0 * n * (x * z + w * y)
            t[k, 1] = 2.0 * n * (y * z - w * x)
            t[k, 2] = n * (w * w - x * x - y * y + z * z)
        while at < element.shape[0] and element[at] == e:
            p = r0.copy()
            for k in range(points):
                for a in range(3):
                    p[a] += h[e] * weights[at, k] * t[k, a]
            for a in range(4):
                v = 0.0
                for i in range(order + 1):
                    v += values[at, i] * q[first + i, a]
                qs[a] = v
            scale = 1.0 / np.sqrt(qs[0] * qs[0] + qs[1] * qs[1] + qs[2] * qs[2] + qs[3] * qs[3])
            p = quaternion.rotate(orientation, p)
            o = quaternion.multiply(orientation, qs)
            for a in range(3):
                out_r[at, a] = start[a] + length * p[a]
                out_q[at, a] = scale * o[a + 1]
            out_q[at, 3] = scale * o[0]
            at += 1
        # the last row of the weights is the whole element
        for k in range(points):
            for a in range(3):
                r0[a] += h[e] * weights[element.shape[0], k] * t[k, a]
