# SPDX-License-Identifier: Apache-2.0
"""The discrete rod in plain NumPy, straight from its definition: the compiled kernels' plain twin.

Slow and short. Every function takes complex arrays too, so that derivatives come exact to rounding by
the complex step, Im f(x + i e) / e with e = 1e-30 (Squire & Trapp 1998). Quaternions scalar first, units
of the cable.
"""

from __future__ import annotations

import numpy as np

from cable_ros.rod.elements import Mesh, lagrange

STEP = 1e-30


def multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Quaternion product, rows of (n, 4)."""
    v, w = a[:, 1:], b[:, 1:]
    scalar = a[:, 0] * b[:, 0] - np.sum(v * w, axis=1)
    vector = a[:, :1] * w + b[:, :1] * v + np.cross(v, w)
    return np.concatenate([scalar[:, None], vector], axis=1)


def turned(q: np.ndarray, psi: np.ndarray) -> np.ndarray:
    """q exp(psi / 2), rows of (n, 4) and (n, 3); the exponential by its series, for small psi."""
    square = np.sum(psi * psi, axis=1, keepdims=True) / 4
    cosine = 1 - square / 2 + square**2 / 24 - square**3 / 720
    sine = 1 - square / 6 + square**2 / 120 - square**3 / 5040
    return multiply(q, np.concatenate([cosine, 0.5 * sine * psi], axis=1))


def integrals(
    q: np.ndarray, F: np.ndarray, f: np.ndarray, K: np.ndarray, kappa0: np.ndarray, mesh: Mesh
) -> tuple[complex, np.ndarray, complex, complex]:
    """Lagrangian, end position (3,), energy (elastic less weight's work), total twist of nodal q (n, 4)."""
    order = mesh.element.order
    lagrangian, energy, twist, position = 0.0, 0.0, 0.0, np.zeros(3, complex)
    values, slopes = lagrange(mesh.element.nodes, mesh.element.points)
    for e, (start, h) in enumerate(zip(mesh.starts, mesh.lengths, strict=True)):
        nodal = q[e * order : (e + 1) * order + 1]
        p, dp = values @ nodal, slopes @ nodal / h
        size = np.sum(p * p, axis=1)
        inverse = p * np.array([1.0, -1.0, -1.0, -1.0])
        # R' = R [kappa]x for R of p / |p|: kappa = 2 vec(p^-1 p'), whatever |p| does along the way
        kappa = 2 * multiply(inverse, dp)[:, 1:] / size[:, None]
        w, x, y, z = p.T
        t = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), w**2 - x**2 - y**2 + z**2]) / size
        weights = h * mesh.element.weights
        left = 1.0 - start - h * mesh.element.points
        elastic = 0.5 * np.sum(K * (kappa - kappa0) ** 2, axis=1)
        load = left * (f @ t)
        energy = energy + np.sum(weights * (elastic - load))
        lagrangian = lagrangian + np.sum(weights * (elastic - load - F[e] @ t))
        twist = twist + np.sum(weights * kappa[:, 2])
        position = position + t @ weights
    return lagrangian, position, energy, twist


def gradients(
    q: np.ndarray,
    psi: np.ndarray,
    F: np.ndarray,
    f: np.ndarray,
    K: np.ndarray,
    kappa0: np.ndarray,
    mesh: Mesh,
) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of the Lagrangian (3n,) and of the end position (3, 3n) by psi (n, 3), at psi."""
    count = psi.size
    gradient, position = np.empty(count), np.empty((3, count))
    for i in range(count):
        step = np.zeros(count, complex)
        step[i] = 1j * STEP
        value, place, _, _ = integrals(turned(q, psi + step.reshape(psi.shape)), F, f, K, kappa0, mesh)
        gradient[i], position[:, i] = np.imag(value) / STEP, np.imag(place) / STEP
    return gradient, position


def dense(banded: np.ndarray) -> np.ndarray:
    """The symmetric (n, n) of lower band storage (n, b + 1): row i, column j <= i at [i, b + j - i]."""
    n, band = banded.shape[0], banded.shape[1] - 1
    out = np.zeros((n, n))
    for i in range(n):
        for j in range(max(0, i - band), i + 1):
            out[i, j] = out[j, i] = banded[i, band + j - i]
    return out
