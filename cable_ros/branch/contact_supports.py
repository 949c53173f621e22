# SPDX-License-Identifier: Apache-2.0
"""What contacts hold of a cable that vibrates: loaded ones stay loaded, what sticks sticks, what slips slips.

Units of the cable, start clamp's frame.
"""

from __future__ import annotations

import numpy as np

from cable_ros.contact.distance import across, gap
from cable_ros.contact.friction_kernels import COULOMB
from cable_ros.contact.nodal_rod import NodalRod
from cable_ros.contact.points import ARC_LENGTH, SLIPS
from cable_ros.contact.touching_rod import TouchingRod
from cable_ros.rod import quaternion
from cable_ros.rod.kirchhoff import Rod
from cable_ros.rod.vibration import Motion

RIGID = 1e6
"""Minimum stiffness, EI / L^3, of a contact that counts as rigid."""
PAIR = 2
"""Maximum number of neighbouring contacts on a grid that are one contact point; more are a patch."""
FLAT = 1e-9
"""Minimum curvature, 1 / L, of a gap along the cable."""
Support = tuple[np.ndarray, np.ndarray]
"""Constraint rows (r, N) of rigid contacts, and the stiffness (N, N) of the others."""


def contact_supports(rod: Rod, moved: Motion) -> Support:
    """The support by the loaded contacts of a rod, in the N unknowns of a loose motion.

    The rod is at an equilibrium, and its tangent is set up.
    """
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
    rows, n, size = slice(3, rod.rows), rod.V.shape[1], moved.starts.shape[2]
    points, delta = rod.points[: rod.count], rod.delta[rows]
    J = moved.at(points[:, ARC_LENGTH])
    # a row reads rotations itself, and strains and the start by the position of its point
    V = np.einsum("ra,ran->rn", rod.lines[rows], J[rod.owners[rows]])
    V[:, :n] = rod.V[rows]
    soft = np.abs(delta) > 1.0 / RIGID
    stiffness = (V[soft].T / delta[soft]) @ V[soft]
    sticks = np.flatnonzero(rod.rough() & (points[:, SLIPS] == 0.0))
    held = [V[~soft]]
    if rod.model == COULOMB and len(sticks):
        directions = np.empty((2, 3))
        for i in sticks:
            across(rod.normals[i], directions)
            held.append(directions @ J[i])
    return np.concatenate(held), stiffness if soft.any() else np.zeros((size, size))
