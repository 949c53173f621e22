# SPDX-License-Identifier: Apache-2.0
"""How the wrenches on the mounts of a rod with pinned, free or sliding ends answer to their motions."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cable_ros.rod import entry_points, quaternion
from cable_ros.rod.kirchhoff import Rod
from cable_ros.rod.supports import Supports

Solve = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Nodal rotations (3n,) and change of the end force (3,) by a residual (3n,) and a gap (3,)."""


def response(rod: Rod, seen: Supports, solve: Solve, q: np.ndarray, F: np.ndarray) -> np.ndarray:
    """(12, 12) derivative of both mounts' wrenches on the cable by the mounts' motions, units of the cable.

    Rows and columns as in `clamp_stiffness.clamp_response`, moments about the mounts' origins. The rows of a
    free end are zero: its force and moment are given along its own axes. The rod must be factored without
    what is added for stability's sake.

    Args:
        rod, q, F: at an equilibrium, with its nodal frames (n, 4) and end force (3,).
        seen: what its mounts exert there.
        solve: of its factored tangent.
    """
    Re = _matrix(rod.qe)
    inner = np.stack([_column(rod, seen, solve, q, F, Re, k) for k in range(9)], axis=1)
    # in the frame of a start mount that moves, the end and the load move backwards
    out = np.empty((12, 12))
    out[:, 6:] = inner[:, :6]
    out[:, :3] = -inner[:, :3] @ Re.T
    for k, axis in enumerate(np.eye(3)):
        back = np.concatenate([Re.T @ np.cross(axis, rod.re), Re.T @ axis, np.cross(axis, rod.f)])
        out[:, 3 + k] = -inner @ back
    return out


def _column(
    rod: Rod, seen: Supports, solve: Solve, q: np.ndarray, F: np.ndarray, Re: np.ndarray, k: int
) -> np.ndarray:
    """(12,) change of the wrenches on the cable with a motion of the end or of the load, start's frame.

    `k`: 0 to 2 translation of the end along, 3 to 5 rotation about its own axes, 6 to 8 the load.
    """
    ends, n = seen.ends, rod.g.size
    free = np.ones(n)
    free[:3], free[-3:] = seen.free
    unit = np.eye(3)[k % 3]
    shift, turn, load = (unit if k // 3 == kind else np.zeros(3) for kind in range(3))
    dre, spin = Re @ shift, Re @ turn
    theta = _matrix(q[-1]).T @ spin * ~seen.free[1]
    right, given = np.zeros(n), np.zeros(3)
    if load.any():
        right += _by_load(rod, q, load)
    if not ends.end.placed:
        given = np.cross(spin, F)
        right[-3:] -= _matrix(q[-1]).T @ np.cross(spin, seen.given[1])
    elif not ends.start.placed:
        given = -load
    elif ends.end.axis is not None:
        axis = Re @ ends.end.axis
        dre = dre + np.cross(spin, seen.offsets[1])
        given = -float(F @ np.cross(spin, axis)) * axis
    elif ends.start.axis is not None:
        given = -float(load @ ends.start.axis) * ends.start.axis
    direct = right - given @ rod.C  # the gradient's own change, unknown rotations and force at rest
    pushed = np.zeros(n)
    pushed[-3:] = theta
    total = direct + rod.apply_hessian(pushed)
    # the chart's half turn, where a section is tilted about one axis and turns freely about another
    total[-3:] += 0.5 * np.cross(rod.g[-1], theta)
    s, dF = solve(total * free, rod.C @ pushed - dre)
    s += pushed
    dF += given
    dg = right + rod.apply_hessian(s) - dF @ rod.C
    moved = rod.C @ s - Re @ shift
    out = np.zeros(12)
    slides = ends.start.axis is not None, ends.end.axis is not None
    changes = (
        (-(dF + load), -moved * slides[0], (slice(0, 3), 0)),
        (dF, moved * slides[1], (slice(n - 3, n), -1)),
    )
    for i, (dforce, doffset, (at, node)) in enumerate(changes):
        if not (ends.start, ends.end)[i].placed:
            continue
        moment = np.where(seen.free[i], 0.0, rod.g[node])
        half = 0.5 * np.cross(s[at], moment)  # the gradient's chart turns half as far as the section
        own = np.where(seen.free[i], 0.0, dg[at] - half)
        turned = _matrix(q[node]) @ (own + 2.0 * half)
        dmoment = turned + np.cross(doffset, seen.forces[i]) + np.cross(seen.offsets[i], dforce)
        if i == 0:
            out[:6] = np.concatenate([dforce, dmoment])
        else:
            out[6:9] = Re.T @ (dforce - np.cross(spin, seen.forces[1]))
            out[9:] = Re.T @ (dmoment - np.cross(spin, seen.moment(1)))
    return out


def _by_load(rod: Rod, q: np.ndarray, load: np.ndarray) -> np.ndarray:
    """(3n,) derivative of the gradient along `load` (3,), in which it is linear."""
    (acc, g, radial, totals, lanes), tangents, factors = rod.saddle
    own = (np.empty_like(acc), np.empty_like(g), np.empty_like(radial), np.empty_like(totals), lanes)
    weak = np.zeros(3), np.zeros(3)
    entry_points.linearize(q, np.zeros(3), load, weak, rod.grid, (own, tangents, factors), False)
    return own[1].ravel()


def _matrix(q: np.ndarray) -> np.ndarray:
    """(3, 3) rotation matrix of the quaternion q (4,), scalar first."""
    return quaternion.matrix_from_ros(quaternion.to_ros(q))
