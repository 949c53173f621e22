# SPDX-License-Identifier: Apache-2.0
"""Natural frequencies and modes of a cable about its equilibrium, whatever holds it; SI units, world."""

from __future__ import annotations

import numpy as np

from cable_ros.contact.distance import across
from cable_ros.contact.friction_kernels import COULOMB
from cable_ros.contact.nodal_rod import NodalRod
from cable_ros.contact.points import FORCE, OBSTACLE, PLACE, SLIPS
from cable_ros.contact.touching_rod import TouchingRod
from cable_ros.equilibrium import Modes
from cable_ros.rod import quaternion
from cable_ros.rod.extensible import StretchingRod
from cable_ros.rod.kirchhoff import Rod
from cable_ros.rod.units import Units
from cable_ros.rod.vibration import Motion, dense, lowest, mass, motion, strain_stiffness

RIGID = 1e6
"""EI / L^3; what holds the cable more stiffly than this holds it as if it were rigid."""
Held = tuple[np.ndarray, np.ndarray]
"""Rows (r, N) that do not move, and the stiffness (N, N) of all else that contacts do."""


def modes(
    rod: Rod, q: np.ndarray, F: np.ndarray, start: np.ndarray, unit: Units, density: float, count: int,
    points: int,
) -> Modes:  # fmt: skip
    """The `count` lowest modes, their shapes at `points` equal arc lengths; see `Equilibrium.modes`.

    Args:
        rod, q, F: at an equilibrium, with its nodal frames (n, 4) and end force (3,); its tangent is set up.
        start: (7,) the start clamp in the world, m, quaternion x y z w.
        unit: of the cable.
        density: mass per length, kg/m.
        count: of modes.
        points: 2 or more.
    """
    if not density:
        return no_modes(count, points, np.inf)
    moved, H, held = _problem(rod, q, F)
    try:
        omega, vectors = lowest(H, mass(moved), held, count)
    except np.linalg.LinAlgError:
        return no_modes(count, points, np.nan)
    turn = quaternion.matrix_from_ros(start[3:])
    shapes = np.einsum("ab,sbn,nk->ksa", turn, moved.at(np.linspace(0.0, 1.0, points)), vectors)
    largest = np.linalg.norm(shapes, axis=2).max(axis=1)
    shapes /= np.where(largest > 0.0, largest, 1.0)[:, None, None]
    return Modes(omega / (2.0 * np.pi) * np.sqrt(unit.stiffness / density) / unit.length**2, shapes)


def no_modes(count: int, points: int, frequency: float) -> Modes:
    """Without shapes: a cable without mass, or what has no vibrations."""
    return Modes(np.full(count, frequency), np.full((count, points, 3), np.nan))


def _problem(rod: Rod, q: np.ndarray, F: np.ndarray) -> tuple[Motion, np.ndarray, np.ndarray]:
    """How the rod moves, its Hessian (N, N), and the rows (r, N) that do not move."""
    rod.refactor(q, F)
    compliance = rod.compliance if isinstance(rod, StretchingRod) else np.zeros(3)
    gauss = rod.s0[:, None] + rod.h[:, None] * rod.mesh.element.points
    moved = motion(q, rod.mesh, compliance, F + (1.0 - gauss)[:, :, None] * rod.f)
    n, size = len(rod.elastic), moved.starts.shape[2]
    H = np.zeros((size, size))
    H[:n, :n] = dense(rod.elastic + rod.geometric)
    if size > n:
        H[range(n, size), range(n, size)] = strain_stiffness(rod.mesh, compliance)
    rows, stiffness = _contacts(rod, moved)
    H += stiffness
    clamps = np.zeros((6, size))
    clamps[range(6), [*range(3), *range(n - 3, n)]] = 1.0
    return moved, H, np.concatenate([clamps, moved.starts[-1], rows])


def _contacts(rod: Rod, moved: Motion) -> Held:
    """What contacts that press hold, in the rod's unknowns: they go on pressing, and what sticks sticks."""
    size = moved.starts.shape[2]
    nothing = np.zeros((0, size)), np.zeros((size, size))
    if isinstance(rod, TouchingRod) and rod.count:
        return _active_set(rod, moved)
    if isinstance(rod, NodalRod) and rod.touches:
        places, springs = rod.contact_stiffness()
        J = moved.starts[places]
        values, axes = np.linalg.eigh(springs)
        rigid = values > RIGID
        rows = np.einsum("cia,can->cin", axes.transpose(0, 2, 1), J)
        soft = np.where(rigid, 0.0, values)
        return rows[rigid], np.einsum("cin,ci,cim->nm", rows, soft, rows, optimize=True)
    return nothing


def _active_set(rod: TouchingRod, moved: Motion) -> Held:
    """Of contact points: the rows of `assembly.system` beside the end position's, and those of stick."""
    size = moved.starts.shape[2]
    V, delta = rod.V[3 : rod.rows], rod.delta[3 : rod.rows]
    soft = np.abs(delta) > 1.0 / RIGID
    stiffness = (V[soft].T / delta[soft]) @ V[soft]
    points = rod.points[: rod.count]
    assert rod.obstacles is not None
    rough = rod.obstacles[points[:, OBSTACLE].astype(int), 17] > 0.0
    sticks = np.flatnonzero(rough & (points[:, FORCE] > 0.0) & (points[:, SLIPS] == 0.0))
    rows = [V[~soft]]
    if rod.model == COULOMB and len(sticks):
        directions = np.empty((2, 3))
        for i, J in zip(sticks, moved.at(points[sticks, PLACE]), strict=True):
            across(rod.normals[i], directions)
            rows.append(directions @ J)
    return np.concatenate(rows), stiffness if soft.any() else np.zeros((size, size))
