# SPDX-License-Identifier: Apache-2.0
"""Natural frequencies and modes of a cable about its equilibrium, with its contacts; SI units, world."""

from __future__ import annotations

import numpy as np

from cable_ros.contact.distance import FRICTION_COEFFICIENT, across, gap
from cable_ros.contact.friction_kernels import COULOMB
from cable_ros.contact.nodal_rod import NodalRod
from cable_ros.contact.points import ARC_LENGTH, FORCE, OBSTACLE, SLIPS
from cable_ros.contact.touching_rod import TouchingRod
from cable_ros.equilibrium import Modes
from cable_ros.linalg.bordered import NEUTRAL
from cable_ros.rod import quaternion
from cable_ros.rod.held_rod import HeldRod
from cable_ros.rod.kirchhoff import Rod
from cable_ros.rod.units import Units
from cable_ros.rod.vibration import Motion, dense, lowest, mass, motion, strain_stiffness

RIGID = 1e6
"""Minimum stiffness, EI / L^3, of a contact that counts as rigid."""
PAIR = 2
"""Maximum number of neighbouring contacts on a grid that are one contact point; more are a patch."""
FLAT = 1e-9
"""Minimum curvature, 1 / L, of a gap along the cable."""
Support = tuple[np.ndarray, np.ndarray]
"""Constraint rows (r, N) of rigid contacts, and the stiffness (N, N) of the others."""


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
    if rod.touches and rod.compliance.any():
        return no_modes(count, points, np.nan)
    moved, H, rows = _problem(rod, q, F)
    M, n = mass(moved), len(rod.elastic)
    try:
        omega, vectors = lowest(H, M, rows, count)
    except np.linalg.LinAlgError:
        # a cable that turns freely is stable with a little more stiffness
        H[:n, :n] += NEUTRAL * dense(rod.elastic)
        try:
            omega, vectors = lowest(H, M, rows, count)
        except np.linalg.LinAlgError:
            return no_modes(count, points, np.nan)
    turn = quaternion.matrix_from_ros(start[3:])
    shapes = np.einsum("ab,sbn,nk->ksa", turn, moved.at(np.linspace(0.0, 1.0, points)), vectors)
    largest = np.linalg.norm(shapes, axis=2).max(axis=1)
    shapes /= np.where(largest > 0.0, largest, 1.0)[:, None, None]
    return Modes(omega / (2.0 * np.pi) * np.sqrt(unit.stiffness / density) / unit.length**2, shapes)


def no_modes(count: int, points: int, frequency: float) -> Modes:
    """Without shapes: for a cable without mass, or one that cannot vibrate."""
    return Modes(np.full(count, frequency), np.full((count, points, 3), np.nan))


def _problem(rod: Rod, q: np.ndarray, F: np.ndarray) -> tuple[Motion, np.ndarray, np.ndarray]:
    """The rod's kinematics, its Hessian (N, N), and the constraint rows (r, N) of clamps and contacts."""
    rod.refactor(q, F)
    compliance = rod.compliance
    gauss = rod.s0[:, None] + rod.h[:, None] * rod.mesh.element.points
    moved = motion(q, rod.mesh, compliance, F + (1.0 - gauss)[:, :, None] * rod.f)
    n, size = len(rod.elastic), moved.starts.shape[2]
    H = np.zeros((size, size))
    H[:n, :n] = dense(rod.elastic + rod.geometric)
    if size > n:
        H[range(n, size), range(n, size)] = strain_stiffness(rod.mesh, compliance)
    rows, stiffness = _contacts(rod, moved)
    H += stiffness
    if isinstance(rod, HeldRod):
        moved, clamps = _held(rod, moved)
    else:
        clamps = np.zeros((6, size))
        clamps[range(6), [*range(3), *range(n - 3, n)]] = 1.0
        clamps = np.concatenate([clamps, moved.starts[-1]])
    return moved, H, np.concatenate([clamps, rows])


def _held(rod: HeldRod, moved: Motion) -> tuple[Motion, np.ndarray]:
    """The kinematics in which a free or sliding start moves, and the rows of what the ends hold."""
    held, start = np.flatnonzero(rod.free_rotations == 0.0), rod.ends.start
    rotations = np.zeros((len(held), moved.starts.shape[2]))
    rotations[range(len(held)), held] = 1.0
    gap = moved.starts[-1]
    if not start.held:
        along = np.eye(3) - rod.projector
        moved = moved._replace(starts=moved.starts - along @ gap)
    return moved, np.concatenate([rotations, rod.projector @ gap])


def _contacts(rod: Rod, moved: Motion) -> Support:
    """The support by loaded contacts, in the rod's unknowns: they stay loaded, and sticking ones stick."""
    size = moved.starts.shape[2]
    if isinstance(rod, TouchingRod) and rod.count:
        return _active_set(rod, moved)
    if isinstance(rod, NodalRod) and rod.touches:
        return _grid(rod, moved)
    return np.zeros((0, size)), np.zeros((size, size))


def _grid(rod: NodalRod, moved: Motion) -> Support:
    """The support by contacts at fixed material points: patches, and short runs that are one point each."""
    boundaries, obstacles, springs = rod.contact_stiffness()
    values, axes = np.linalg.eigh(springs)
    number = {pair: i for i, pair in enumerate(zip(boundaries.tolist(), obstacles.tolist(), strict=True))}
    pressure, J = rod.state.lam, moved.starts
    rows, stiffness = [np.zeros((0, J.shape[2]))], [np.zeros(0)]
    for o in range(pressure.shape[1]):
        for run in _runs(np.flatnonzero(pressure[:, o] > 0.0)):
            if len(run) <= PAIR:
                i = number[int(run[np.argmax(pressure[run, o])]), o]
                more = _one_point(rod, moved, run, o, values[i], axes[i])
                rows += more[0]
                stiffness += more[1]
                continue
            for k in run.tolist():
                i = number[k, o]
                rows.append(axes[i].T @ J[k])
                stiffness.append(values[i])
    every, values = np.concatenate(rows), np.concatenate(stiffness)
    rigid = values > RIGID
    soft = every[~rigid]
    return every[rigid], (soft.T * values[~rigid]) @ soft


def _one_point(
    rod: NodalRod, moved: Motion, run: np.ndarray, o: int, values: np.ndarray, axes: np.ndarray
) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Rows (r, N) and stiffnesses (r,) of neighbouring contacts that are one contact point between them.

    The point moves along the cable to the gap's minimum, which gives the slope there a finite stiffness. Two
    separate constraints would fix the slope.

    Args:
        rod, moved: see `modes`.
        run: (1 or 2,) the boundaries with these contacts.
        o: the obstacle.
        values, axes: (3,), (3, 3) stiffnesses, and axes in columns, of the contact with the larger force.
    """
    force = rod.state.lam[run, o]
    whole = float(force.sum())
    share = force / whole
    across = axes.T @ np.einsum("k,kan->an", share, moved.starts[run])
    slopes, curvatures = zip(*(_slope(rod, moved, int(k), o) for k in run), strict=True)
    # the spring of one contact carries its own force only
    springs = np.where(values > RIGID, values, values * whole / force.max())
    tilt = np.array([whole / max(float(share @ np.array(curvatures)), FLAT)])
    return [across, (share @ np.array(slopes))[None]], [springs, tilt]


def _runs(at: np.ndarray) -> list[np.ndarray]:
    """The runs of consecutive numbers in `at` (k,), which is sorted."""
    return [run for run in np.split(at, np.flatnonzero(np.diff(at) > 1) + 1) if len(run)]


def _slope(rod: NodalRod, moved: Motion, k: int, o: int) -> tuple[np.ndarray, float]:
    """Of the gap to obstacle o along the cable at boundary k: its slope's derivative (N,), its curvature."""
    assert rod.obstacles is not None
    n, directions, bends = np.empty(3), np.empty((2, 3)), np.empty(2)
    gap(rod.obstacles[o], rod.state.r[k], n, directions, bends)
    node = k * rod.mesh.element.order
    before, t, after = quaternion.tangents(rod.state.q[node - 1 : node + 2])
    turned = (after - before) / float(rod.mesh.nodes[node + 1] - rod.mesh.nodes[node - 1])
    along = (bends * (directions @ t)) @ directions
    first = quaternion.rotate(rod.state.q[node], np.array([1.0, 0.0, 0.0]))
    row = along @ moved.starts[k]
    row[3 * node : 3 * node + 2] += np.cross(first, t) @ n, first @ n
    return row, float(n @ turned + along @ t)


def _active_set(rod: TouchingRod, moved: Motion) -> Support:
    """The support by contact points: `assembly.assemble_kkt` without the end position, and stick."""
    size = moved.starts.shape[2]
    V, delta = rod.V[3 : rod.rows], rod.delta[3 : rod.rows]
    soft = np.abs(delta) > 1.0 / RIGID
    stiffness = (V[soft].T / delta[soft]) @ V[soft]
    points = rod.points[: rod.count]
    assert rod.obstacles is not None
    rough = rod.obstacles[points[:, OBSTACLE].astype(int), FRICTION_COEFFICIENT] > 0.0
    sticks = np.flatnonzero(rough & (points[:, FORCE] > 0.0) & (points[:, SLIPS] == 0.0))
    rows = [V[~soft]]
    if rod.model == COULOMB and len(sticks):
        directions = np.empty((2, 3))
        for i, J in zip(sticks, moved.at(points[sticks, ARC_LENGTH]), strict=True):
            across(rod.normals[i], directions)
            rows.append(directions @ J)
    return np.concatenate(rows), stiffness if soft.any() else np.zeros((size, size))
