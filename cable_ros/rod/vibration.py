# SPDX-License-Identifier: Apache-2.0
"""Small vibrations of a rod about an equilibrium, from the energy's Hessian and a consistent mass matrix.

The rod's second variation is 1/2 x.H x with the nodal rotations x, its kinetic energy the integral of
1/2 |dr/dt|^2 with the displacement dr = J x of the centreline, which is the integral of the tangents'
rotations: free vibrations x cos(omega t) have

    H x = omega^2 M x,    M = integral J^T J ds,

on what the end clamp and contacts leave free. Sections have no inertia of their own: turning with the curve
they add (d / 4)^2 beside L^2, and about the tangent a torsional wave runs along the cable in a time that is
short beside a swing. So M is singular, and the problem is solved for 1 / omega^2.

A rod that stretches has its strain's deviation y from that of the static forces as unknowns beside, at the
Gauss points: the Hessian of `extensible_kernels` has the static part eliminated, and what is added to the
energy is 1/2 y.y / c, with the compliance c.

Units of the cable: frequencies in (EI / (rho L^4))^1/2, rho its mass per length; start clamp's frame.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cable_ros.rod.elements import Mesh, primitives, reference_element
from cable_ros.rod.quaternion import matrices_from_ros, to_ros

DEPENDENT = 1e-9
"""Rows that hold the rod count as one if they differ by less than this fraction of their size."""
CONTRADICTION = 1e-6
"""What constraints may be missed by, as a fraction of what is given."""


class Motion(NamedTuple):
    """How the centreline of a rod of m elements moves with N unknowns.

    They are 3n nodal rotations, then strains, then, if it is `loose`, the displacement (3,) of the start.
    """

    mesh: Mesh
    tangents: np.ndarray
    """(m, g, 3, columns) derivative of r' at each Gauss point by the element's own unknowns."""
    columns: np.ndarray
    """(m, columns) numbers of these unknowns."""
    starts: np.ndarray
    """(m + 1, 3, N) displacement of the elements' boundaries, L."""

    def at(self, s: np.ndarray) -> np.ndarray:
        """(k, 3, N) displacement at the arc lengths s (k,), L."""
        element, x = self.mesh.locate(s)
        table = primitives(self.mesh.element)
        weights = np.vander(x, len(table) + 1, increasing=True)[:, 1:] @ table
        out = self.starts[element]
        inner = np.einsum("kg,kgaj->kaj", weights, self.tangents[element])
        inner *= self.mesh.lengths[element, None, None]
        row, axis = np.arange(len(s))[:, None, None], np.arange(3)[:, None]
        out[row, axis, self.columns[element][:, None, :]] += inner
        return out

    def loose(self) -> Motion:
        """The same with the displacement of the start as 3 more unknowns."""
        start = np.broadcast_to(np.eye(3), (len(self.starts), 3, 3))
        return self._replace(starts=np.concatenate([self.starts, start], axis=2))


def motion(q: np.ndarray, mesh: Mesh, compliance: np.ndarray, G: np.ndarray) -> Motion:
    """Of a rod with the nodal frames q (n, 4).

    Args:
        compliance: (3,) against shear and tension; zeros for a rod that keeps its length.
        G: (m, g, 3) internal force at the Gauss points; counts only with compliance.
    """
    element, lengths = mesh.element, mesh.lengths
    p, m, g = element.order, len(mesh.lengths), len(element.points)
    index = p * np.arange(m)[:, None] + np.arange(p + 1)
    w, x, y, z = (q[index] * 0.5).transpose(2, 0, 1)
    turns = np.stack([[-x, -y, -z], [w, -z, y], [z, w, -x], [-y, x, w]])  # of the nodes, (4, 3, m, p + 1)
    frames = np.einsum("gi,eia->ega", element.values, q[index])
    w, x, y, z = frames.transpose(2, 0, 1)
    left = np.stack([[-x, w, -z, y], [-y, z, w, -x], [-z, -y, x, w]]) * 2.0 / (frames**2).sum(axis=2)
    # rotation of the section at each Gauss point by those of the nodes
    spin = np.einsum("raeg,gi,acei->egric", left, element.values, turns).reshape(m, g, 3, 3 * (p + 1))
    axes = _axes(frames.reshape(-1, 4)).reshape(m, g, 3, 3)
    turned = -_crossed(axes[..., 2, :])
    soft = np.flatnonzero(compliance)
    for a in soft:
        d = axes[..., a, :]
        force = np.einsum("ega,ega->eg", G, d)[..., None, None]
        turned += compliance[a] * (d[..., :, None] * np.cross(d, G)[..., None, :] - force * _crossed(d))
    tangents = turned @ spin
    columns = (3 * index[:, :, None] + np.arange(3)).reshape(m, -1)
    size = 3 * len(q)
    if len(soft):
        own = np.zeros((m, g, 3, g, len(soft)))
        for k in range(g):
            own[:, k, :, k, :] = axes[:, k, soft, :].transpose(0, 2, 1)
        tangents = np.concatenate([tangents, own.reshape(m, g, 3, -1)], axis=3)
        strains = size + np.arange(m * g * len(soft)).reshape(m, -1)
        columns = np.concatenate([columns, strains], axis=1)
        size += strains.size
    displacements = np.zeros((m + 1, 3, size))
    own_displacement = lengths[:, None, None] * np.einsum("g,egaj->eaj", element.weights, tangents)
    for e in range(m):
        displacements[e + 1][:, columns[e]] = own_displacement[e]
    return Motion(mesh, tangents, columns, np.cumsum(displacements, axis=0))


def mass(moved: Motion) -> np.ndarray:
    """(N, N) the consistent mass matrix, in rho L^3."""
    mesh, size = moved.mesh, moved.starts.shape[2]
    # positions within an element are polynomials of the order of its Gauss points: one more is exact
    fine = reference_element(mesh.element.order, len(mesh.element.points) + 1)
    J = moved.at((mesh.starts[:, None] + mesh.lengths[:, None] * fine.points).ravel())
    J *= np.sqrt(mesh.lengths[:, None] * fine.weights).ravel()[:, None, None]
    flat = J.reshape(-1, size)
    return flat.T @ flat


def strain_stiffness(mesh: Mesh, compliance: np.ndarray) -> np.ndarray:
    """(k,) stiffness of the strains among the unknowns, as `motion` numbers them."""
    soft = compliance[compliance != 0.0]
    weights = mesh.lengths[:, None] * mesh.element.weights
    return np.asarray((weights[:, :, None] / soft).ravel())


def lowest(H: np.ndarray, M: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The `count` lowest angular frequencies (k,) and their modes (N, k), fewer where there are not so many.

    Args:
        H: (N, N) Hessian.
        M: (N, N) mass.
        count: of modes.

    Raises:
        LinAlgError: H is not positive definite.
    """
    from scipy.linalg import eigh

    count = min(count, len(H))
    inverse, modes = eigh(M, H, subset_by_index=[len(H) - count, len(H) - 1], check_finite=False)
    with np.errstate(divide="ignore"):
        return 1.0 / np.sqrt(np.maximum(inverse[::-1], 0.0)), modes[:, ::-1]


def kernel(rows: np.ndarray) -> np.ndarray:
    """(N, k) orthonormal motions x with rows @ x = 0; rows (r, N) may depend on each other."""
    from scipy.linalg import qr

    size = np.linalg.norm(rows, axis=1)
    rows = rows[size > 0.0] / size[size > 0.0, None]
    Q, R, _ = qr(rows.T, pivoting=True)
    rank = int((np.abs(np.diagonal(R)) > DEPENDENT).sum())
    return np.asarray(Q[:, rank:])


def follow(H: np.ndarray, rows: np.ndarray, given: np.ndarray, Z: np.ndarray) -> np.ndarray:
    """(N, k) the motions of least energy with rows @ x = given.

    Args:
        H: (N, N) Hessian, positive definite on Z.
        rows: (r, N) constraints; they may depend on each other.
        given: (r, k).
        Z: (N, j) `kernel` of the rows.

    Raises:
        LinAlgError: the constraints contradict each other, or H is singular on Z.
    """
    some = np.linalg.lstsq(rows, given, rcond=DEPENDENT)[0]
    if np.abs(rows @ some - given).max(initial=0.0) > CONTRADICTION * np.abs(given).max(initial=0.0):
        raise np.linalg.LinAlgError
    return np.asarray(some - Z @ np.linalg.solve(Z.T @ H @ Z, Z.T @ (H @ some)))


def dense(banded: np.ndarray) -> np.ndarray:
    """(n, n) the symmetric matrix whose lower band (n, b + 1) has row i, column j at [i, b + j - i]."""
    n, band = banded.shape[0], banded.shape[1] - 1
    out = np.zeros((n, n))
    for k in range(min(band, n - 1) + 1):
        i = np.arange(k, n)
        out[i, i - k] = out[i - k, i] = banded[i, band - k]
    return out


def _axes(q: np.ndarray) -> np.ndarray:
    """(k, 3, 3): the sections' axes, row by row, of quaternions q (k, 4) of any length."""
    return matrices_from_ros(to_ros(q / np.linalg.norm(q, axis=1, keepdims=True))).transpose(0, 2, 1)


def _crossed(v: np.ndarray) -> np.ndarray:
    """(..., 3, 3): v x u is this times u."""
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return out - out.swapaxes(-1, -2)
