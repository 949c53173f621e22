# SPDX-License-Identifier: Apache-2.0
"""Natural frequencies and modes of a cable about its equilibrium, with its contacts; SI units, world."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cable_ros.branch.contact_supports import contact_supports
from cable_ros.contact.friction_kernels import COULOMB
from cable_ros.contact.nodal_rod import NodalRod
from cable_ros.contact.touching_rod import TouchingRod
from cable_ros.equilibrium import Modes
from cable_ros.linalg.bordered import NEUTRAL
from cable_ros.rod import quaternion
from cable_ros.rod.held_rod import HeldRod
from cable_ros.rod.kirchhoff import Rod
from cable_ros.rod.units import Units
from cable_ros.rod.vibration import (
    Motion,
    dense,
    follow,
    kernel,
    lowest,
    mass,
    motion,
    strain_stiffness,
)

Found = tuple[np.ndarray, np.ndarray]
"""Angular frequencies (k,) and modes (N, k)."""


@dataclass(frozen=True, eq=False)
class Vibrating:
    """One rod about its equilibrium, what it touches included; units of the cable, start clamp's frame.

    Its N unknowns are those of a loose `Motion`.
    """

    moved: Motion
    H: np.ndarray
    """(N, N) Hessian, with the stiffness of what gives way under contacts."""
    neutral: np.ndarray
    """(N, N) what is added to it for a cable that turns freely."""
    rows: np.ndarray
    """(r, N) constraints of the ends, then of contacts."""
    by_mounts: np.ndarray
    """(r, 12) what the constraints are by motions of the mounts: translation and rotation of the start, then
    of the end, along the axes of the sections there."""


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
    if unknown(rod):
        return no_modes(count, points, np.nan)
    own = vibrating(rod, q, F)
    M, Z = mass(own.moved), kernel(own.rows)

    def solve(H: np.ndarray) -> Found:
        omega, vectors = lowest(Z.T @ H @ Z, Z.T @ M @ Z, count)
        return omega, Z @ vectors

    found = stiffened(solve, own)
    if found is None:
        return no_modes(count, points, np.nan)
    shapes = displacements(own.moved, found[1], np.linspace(0.0, 1.0, points), start)
    scale = np.sqrt(unit.stiffness / density) / unit.length**2
    return Modes(found[0] / (2.0 * np.pi) * scale, normalised(shapes))


def stiffened(solve: Callable[[np.ndarray], Found], own: Vibrating) -> Found | None:
    """`solve` of the Hessian; a cable that turns freely is stable with a little more stiffness. None: not."""
    for H in (own.H, own.H + own.neutral):
        try:
            return solve(H)
        except np.linalg.LinAlgError:
            continue
    return None


def no_modes(count: int, points: int, frequency: float) -> Modes:
    """Without shapes: for a cable without mass, or one that cannot vibrate."""
    return Modes(np.full(count, frequency), np.full((count, points, 3), np.nan))


def displacements(moved: Motion, vectors: np.ndarray, at: np.ndarray, start: np.ndarray) -> np.ndarray:
    """(k, m, 3) displacement along the world's axes by the unknowns (N, k) at the arc lengths `at` (m,), L.

    `start`: see `modes`.
    """
    turn = quaternion.matrix_from_ros(start[3:])
    return np.asarray(np.einsum("ab,sbn,nk->ksa", turn, moved.at(at), vectors))


def normalised(shapes: np.ndarray) -> np.ndarray:
    """The shapes (k, m, 3) so that the largest displacement of each mode is 1."""
    largest = np.linalg.norm(shapes, axis=2).max(axis=1, initial=0.0)
    return np.asarray(shapes / np.where(largest > 0.0, largest, 1.0)[:, None, None])


def unknown(rod: Rod) -> bool:
    """Whether a loaded contact is of a kind whose frequencies are not known.

    Where a cable that stretches rubs, what rolls along it creeps, to one side otherwise than back. A cable
    that shears touches with a kink, at no single point.
    """
    if not (rod.soft and rod.touches):
        return False
    if isinstance(rod, TouchingRod) and not rod.compliance[:2].any():
        return rod.model == COULOMB and bool(rod.rough().any())
    return not isinstance(rod, NodalRod) or bool(rod.compliance[:2].any() or rod.state.tau.any())


def vibrating(rod: Rod, q: np.ndarray, F: np.ndarray) -> Vibrating:
    """The rod at an equilibrium with the nodal frames q (n, 4) and the end force F (3,)."""
    rod.refactor(q, F)
    compliance = rod.compliance
    moved = motion(q, rod.mesh, compliance, _internal_forces(rod, F)).loose()
    n, size = len(rod.elastic), moved.starts.shape[2]
    H, neutral = np.zeros((size, size)), np.zeros((size, size))
    H[:n, :n] = dense(rod.elastic + rod.geometric)
    neutral[:n, :n] = NEUTRAL * dense(rod.elastic)
    strains = range(n, size - 3)
    H[strains, strains] = strain_stiffness(rod.mesh, compliance)
    contacts, stiffness = contact_supports(rod, moved)
    ends, by_mounts = _ends(rod, q, moved)
    rows = np.concatenate([ends, contacts])
    given = np.concatenate([by_mounts, np.zeros((len(contacts), 12))])
    return Vibrating(moved, H + stiffness, neutral, rows, given)


def followed(own: Vibrating, Z: np.ndarray, motions: np.ndarray) -> np.ndarray:
    """(N, k) how the rod follows slow motions (12, k) of its mounts; Z: `kernel` of its rows.

    Raises:
        LinAlgError: it cannot follow, as one that is straight cannot be pulled.
    """
    return follow(own.H, own.rows, own.by_mounts @ motions, Z)


def _internal_forces(rod: Rod, F: np.ndarray) -> np.ndarray:
    """(m, g, 3) at the Gauss points, under the end force F (3,)."""
    points = rod.mesh.element.points
    if rod.touches and isinstance(rod, NodalRod):
        return np.repeat(rod.state.F[:, None], len(points), axis=1)
    if rod.touches and rod.soft and isinstance(rod, TouchingRod):
        return rod.strain[1]
    gauss = rod.s0[:, None] + rod.h[:, None] * points
    return np.asarray(F + (1.0 - gauss)[:, :, None] * rod.f)


def _ends(rod: Rod, q: np.ndarray, moved: Motion) -> tuple[np.ndarray, np.ndarray]:
    """What the ends hold: rows (r, N), and what they are by motions of the mounts (r, 12)."""
    n, size = 3 * len(q), moved.starts.shape[2]
    turns = quaternion.matrices_from_ros(quaternion.to_ros(q[[0, -1]]))
    start, end = moved.starts[0], moved.starts[-1]
    at_start, at_end = np.zeros((3, 12)), np.zeros((3, 12))
    at_start[:, :3], at_end[:, 6:9] = turns
    held, projector, start_held = [*range(3), *range(n - 3, n)], np.eye(3), True
    if isinstance(rod, HeldRod):
        held = np.flatnonzero(rod.free_rotations == 0.0).tolist()
        projector, start_held = rod.projector, rod.ends.start.held
    rotations, given = np.zeros((len(held), size)), np.zeros((len(held), 12))
    rotations[range(len(held)), held] = 1.0
    given[range(len(held)), [3 + k if k < 3 else 12 - n + k for k in held]] = 1.0
    # an end that is not held across all directions is held along those of the projector
    pairs = [(start, at_start), (end, at_end)]
    (whole, by_whole), (part, by_part) = pairs if start_held else pairs[::-1]
    rows = np.concatenate([rotations, whole, projector @ part])
    return rows, np.concatenate([given, by_whole, projector @ by_part])
