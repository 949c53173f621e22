# SPDX-License-Identifier: Apache-2.0
"""How the wrenches on clamps and obstacles answer to small motions of clamps and obstacles.

The equilibrium equations of a cable in contact, linearised: H x - W^T y = -b and V x + D y = -c, with the
nodal rotations x, the Hessian H of all forces as they stand, and in y the changes of the end force, of the
normal forces, and of what follows them. Each contact has these rows, as its kind asks for:

- the gap stays zero; its unknown is the change of the normal force;
- along a direction in which the surface is curved, the normal turns with the motion over the surface;
- a point slides along the cable to the gap's minimum, the end of a patch to where the cable lifts off;
- a sticking point does not move on the obstacle: two rows across the normal, with the unknown friction;
- what slips has friction mu times the normal force, in a direction that is fixed on the obstacle's surface.

So friction is that of a motion in which what sticks goes on sticking and what slips goes on slipping the same
way. It is nobody's derivative if the motion turns back, or turns aside, where something slips.

Units of the cable, start clamp's frame, which stands still here while the start clamp moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cable_ros.contact.dead_loads import BESIDE, LOADS, DeadLoads
from cable_ros.contact.response_kernels import columns, displacements, solve_inner, surfaces
from cable_ros.contact.stretched import elongations, reaches
from cable_ros.linalg.cross import cross, cross_matrix
from cable_ros.rod import quaternion

FAINT = 1e-9
"""EI / L^2; a point with less force than this turns no force by its motion."""
SINGULAR = 1e-11
"""A factorisation with a worse pivot has lost its digits; as in `bordered.factor`."""
CONDITION = 1e13
"""Nor has a system of a greater condition any left."""


NOTHING, UNSTRAINED = np.zeros(3), np.zeros((0, 0, 3))
"""A cable that keeps its length."""
HELD = np.zeros((3, 3))
"""An end that does not give way."""


class Contacts(NamedTuple):
    """The m contact points of an equilibrium."""

    arc_lengths: np.ndarray
    """(m,) arc lengths."""
    obstacles: np.ndarray
    """(m,) int, which each is on."""
    pressure: np.ndarray
    """(m,) normal forces."""
    friction: np.ndarray
    """(m, 3) forces across the normal."""
    at_minimum: np.ndarray
    """(m,) bool: its arc length is where the gap has its minimum."""
    lifts_off: np.ndarray
    """(m,) bool: its arc length is where the cable lifts off the surface."""
    sticks: np.ndarray
    """(m,) bool: its friction keeps it fixed to the obstacle."""
    across: bool
    """Whether friction is that of (53) of Liu et al. (2018): across the cable, slipping or not."""
    give: np.ndarray
    """(m,) tangential compliance of what sticks, L^3 / EI."""
    given: np.ndarray
    """(m,) bool: its friction is a load that stays as it is, see `dead_loads`."""


class Rows:
    """Rows of the constraints: V and W (rows, 3n), D (rows, rows), c (rows, motions), in blocks.

    `lines` (rows, points + 1, 3): what each reads of the positions of the contact points and of the end.
    """

    def __init__(self, size: int, unknowns: int, motions: int, points: int) -> None:
        self.lines = np.zeros((size, points + 1, 3))
        self.V, self.W = np.zeros((size, unknowns)), np.zeros((size, unknowns))
        self.D, self.c = np.zeros((size, size)), np.zeros((size, motions))
        self.count = 0

    def take(self, count: int) -> np.ndarray:
        """The next `count` rows' numbers."""
        self.count += count
        return np.arange(self.count - count, self.count)


def wrench_response(
    shape: tuple[Any, ...], clamps: tuple[np.ndarray, ...], tangents: tuple[np.ndarray, ...],
    bodies: np.ndarray, contacts: Contacts, moving: Sequence[int], compliance: np.ndarray = NOTHING,
    G: np.ndarray = UNSTRAINED, loads: DeadLoads | None = None, give: np.ndarray = HELD,
) -> np.ndarray:  # fmt: skip
    """Derivative (12 + 6 k, 12 + 6 k) of the wrenches on the cable by motions of clamps and obstacles.

    Rows: force and moment of the start clamp, of the end clamp, each in its clamp's own frame, then of each
    obstacle in `moving`, about the frame's origin, along its axes. Columns: translation along and rotation
    about the start clamp's own axes, the end clamp's, then of each of those obstacles the velocity of the
    point in the frame's origin and the rotation, along the frame's axes. NaN if the equations are singular.

    Args:
        shape: of `contact_state.Shape`, at an equilibrium.
        clamps: end frame (4,), end force (3,), internal force at the start clamp (3,), gradient at the
            equilibrium (n, 3).
        tangents: of `rod_state.Tangents`, contact forces and friction fixed.
        bodies: (obstacles, WIDTH) as `distance.gap` takes them.
        contacts: the contact points.
        moving: the obstacles that may move.
        compliance: (3,) of `rod_state.Stretch`, against tension only; not with friction.
        G: (m, g, 3) internal forces at the Gauss points, of a cable that stretches.
        loads: given friction of some contact points, not with a compliance: then `LOADS` more columns and
            `ANSWERS` more rows for each, see there, and the wrenches of its obstacle are without it.
        give: (3, 3) how far the end gives way to the end force, along the axes of the start clamp.
    """
    qe, F, start_force, g = clamps
    hessian, C = (tangents[0], tangents[1]), tangents[-1]
    m, n = len(contacts.arc_lengths), C.shape[1]
    order = hessian[0].shape[1] // 3 - 1
    displacement, turn = np.empty((m, 3, n)), np.empty((m, 3, n))
    displacements(shape, tangents[2], contacts.arc_lengths, float(compliance[2]), G, displacement, turn)
    r, t, dt, normals, directions, bends = surfaces(shape, contacts.arc_lengths, contacts.obstacles, bodies)
    pressure, friction = contacts.pressure, contacts.friction
    dead = contacts.given
    P = pressure[:, None] * normals + np.where(dead[:, None], 0.0, friction)
    if loads is not None:  # a couple bends the cable differently on its two sides
        sides = [surfaces(shape, contacts.arc_lengths + s, contacts.obstacles, bodies)[2] for s in BESIDE]
        dt[loads.points] = 0.5 * (sides[0] + sides[1])[loads.points]
    if compliance.any():  # arc lengths below are those of the stretched cable
        dt /= elongations(shape, contacts.arc_lengths)[:, None]

    # the motions: of the clamps' frames, of the start point, of the obstacle's points under each contact
    seen = 12 + 6 * len(moving)
    motions = seen + (0 if loads is None else LOADS * len(loads.points))
    clamps = np.r_[0:3, n - 3 : n]
    x_clamps = np.zeros((6, motions))
    x_clamps[0:3, 3:6] = x_clamps[3:6, 9:12] = np.eye(3)
    shift, end_shift = np.zeros((3, motions)), np.zeros((3, motions))
    shift[:, 0:3] = np.eye(3)
    end_shift[:, 6:9] = np.stack([quaternion.rotate(qe, axis) for axis in np.eye(3)], axis=1)
    body, spin = np.zeros((m, 3, motions)), np.zeros((m, 3, motions))
    for k, which in enumerate(moving):
        on, first = contacts.obstacles == which, 12 + 6 * k
        body[on, :, first : first + 3] = np.eye(3)
        body[on, :, first + 3 : first + 6] = _crossed(-r[on])
        spin[on, :, first + 3 : first + 6] = np.eye(3)
    relative = displacement[:, :, clamps] @ x_clamps + shift - body  # of the cable's point, over the obstacle

    # rows and unknowns
    strong = np.abs(pressure) >= FAINT
    bent = (bends > 0.0) & strong[:, None]
    tilted = contacts.lifts_off | (contacts.at_minimum & strong)
    rubs = friction.any(axis=1) & ~dead
    mobile = contacts.across & strong & rubs
    size = 3 + m + int(bent.sum() + tilted.sum() + 2 * contacts.sticks.sum() + 3 * mobile.sum())
    rows = Rows(size, n, motions, m)
    V, W, D, c, lines = rows.V, rows.W, rows.D, rows.c, rows.lines
    share = np.divide(1.0, pressure, out=np.zeros(m), where=strong)  # per force: a faint one moves nothing
    forces = np.zeros((m, 3, size))  # on each contact, by the unknowns
    ds = np.zeros((m, size))  # arc length of each contact, by the unknowns

    end = rows.take(3)
    V[end] = W[end] = C
    lines[end, m] = np.eye(3)
    c[end] = C[:, clamps] @ x_clamps + shift - end_shift
    D[np.ix_(end, end)] = give
    c[end] += give @ cross_matrix(F) @ x_clamps[:3]  # the force turns with the start clamp, and moves nothing

    gap = rows.take(m)
    V[gap] = np.einsum("ia,iaj->ij", normals, displacement)
    lines[gap, np.arange(m)] = normals
    c[gap] = np.einsum("ia,iak->ik", normals, relative)
    slips = ~contacts.sticks & rubs
    forces[np.arange(m), :, gap] = np.where(slips[:, None], normals + share[:, None] * friction, normals)

    lean = np.zeros((m, 3, size))  # of the normal over the surface, by the unknowns
    for k in range(2):
        i = np.flatnonzero(bent[:, k])
        d, at = directions[i, k], rows.take(len(i))
        V[at] = np.einsum("ia,iaj->ij", d, displacement[i])
        lines[at, i] = d
        c[at] = np.einsum("ia,iak->ik", d, relative[i])
        D[at, at] = -share[i] / bends[i, k]
        lean[i, :, at] = share[i, None] * d

    i = np.flatnonzero(tilted)
    at = rows.take(len(i))
    along = np.einsum("ik,ika,ia->ik", bends[i], directions[i], t[i])
    slope = np.einsum("ik,ika->ia", along, directions[i])
    V[at] = np.einsum("ia,iaj->ij", slope, displacement[i]) + np.einsum("ia,iaj->ij", normals[i], turn[i])
    lines[at, i] = slope
    c[at] = (
        np.einsum("ia,iak->ik", slope, relative[i])
        + np.einsum("ia,iak->ik", normals[i], turn[i][:, :, clamps] @ x_clamps)
        + np.einsum("ia,iak->ik", cross(normals[i], t[i]), spin[i])
    )
    # where the cable lifts off, the gap's curvature is zero
    curvature = np.einsum("ia,ia->i", normals[i], dt[i]) + np.einsum("ia,ia->i", slope, t[i])
    D[at, at] = np.where(contacts.lifts_off[i], 0.0, np.maximum(curvature, FAINT) * share[i])
    lean[i, :, at] = share[i, None] * slope
    ds[i, at] = share[i]
    W[at] = np.einsum("ia,iaj->ij", normals[i] + share[i, None] * friction[i], turn[i])
    if loads is not None:
        W[at] += share[i, None] * loads.dragged(m)[i]

    # the normal turns with all of its force, Coulomb friction so as to stay across it
    forces += pressure[:, None, None] * lean
    coulomb = np.flatnonzero(rubs & ~mobile)
    forces[coulomb] -= np.einsum("ia,ib,ibk->iak", normals[coulomb], friction[coulomb], lean[coulomb])

    i = np.flatnonzero(contacts.sticks)
    basis = _across(normals[i])
    for k in range(2):
        at = rows.take(len(i))
        V[at] = np.einsum("ia,iaj->ij", basis[:, k], displacement[i])
        c[at] = np.einsum("ia,iak->ik", basis[:, k], relative[i])
        D[at, at] = contacts.give[i]
        forces[i, :, at] = basis[:, k]

    explicit = -_crossed(P) @ spin  # turned with the obstacle
    i = np.flatnonzero(mobile)
    if len(i):
        motions_of = Motions(normals, t, dt, turn, lean, ds, spin, x_clamps)
        _mobilised(rows, i, contacts, motions_of, forces, explicit)

    given, stretch = np.zeros((0, motions)), np.zeros((0, 0))
    if compliance.any():
        blocks = reaches(shape, compliance, contacts.arc_lengths)
        at_end = np.zeros((1, 3, size))
        at_end[0, :, end] = np.eye(3)
        stretch = np.einsum("ijab,jbk->iak", blocks, np.concatenate([forces, at_end]))
        given = np.einsum("ijab,jbk->iak", blocks[:, :m], explicit)
        D += np.einsum("ria,iak->rk", lines, stretch)
        c += np.einsum("ria,iak->rk", lines, given)

    flat = displacement.reshape(3 * m, n)
    W += forces.reshape(3 * m, size).T @ flat
    b = columns(*hessian, 0, 3) @ x_clamps[:3] + columns(*hessian, n - 3, 3) @ x_clamps[3:]
    if loads is not None:
        explicit[loads.points] += loads.forces(motions)
        b -= loads.by_couples(motions)
    b -= flat.T @ explicit.reshape(3 * m, motions)

    try:
        x, y = _solve(hessian, order, rows, b)
    except np.linalg.LinAlgError:
        return np.full((motions, motions), np.nan)

    # the wrenches
    moments = b - W.T @ y  # of the clamps on the cable, at their nodes
    for first in (0, n - 3):
        moments[first : first + 3] += columns(*hessian, first, 3).T @ x
    x[clamps] = x_clamps
    dP = forces @ y + explicit
    dr = displacement @ x + shift + t[:, :, None] * (ds @ y)[:, None, :]
    if compliance.any():
        dr += stretch[:m] @ y + given[:m]
    dF = y[:3]
    back = quaternion.conjugate(qe)
    to_end = np.stack([quaternion.rotate(back, axis) for axis in np.eye(3)], axis=1)
    out = np.empty((seen, motions))
    # components along axes that turn with the clamp; the gradient's half turn is the chart's
    out[0:3] = -(dF + dP.sum(axis=0)) - cross_matrix(start_force) @ x_clamps[:3]
    out[3:6] = moments[:3] + 0.5 * cross_matrix(g[0]) @ x_clamps[:3]
    out[6:9] = to_end @ dF + cross_matrix(to_end @ F) @ x_clamps[3:]
    out[9:12] = moments[n - 3 :] + 0.5 * cross_matrix(g[-1]) @ x_clamps[3:]
    if loads is not None:
        dP[loads.points] -= loads.forces(motions)
    dM = _crossed(r) @ dP - _crossed(P) @ dr
    for k, which in enumerate(moving):
        on, first = contacts.obstacles == which, 12 + 6 * k
        out[first : first + 3] = dP[on].sum(axis=0)
        out[first + 3 : first + 6] = dM[on].sum(axis=0)
    return out if loads is None else np.concatenate([out, loads.answers(x, shift)])


def _solve(
    hessian: tuple[np.ndarray, np.ndarray], order: int, rows: Rows, b: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """x (3n, motions), y (rows, motions) with H x - W^T y = -b, V x + D y = -c; at the ends x = 0.

    Raises:
        LinAlgError: the equations are singular.
    """
    size, n = rows.V.shape
    X = np.concatenate([rows.W.T, b], axis=1)
    if solve_inner(*hessian, order, X) > SINGULAR:
        y = np.linalg.solve(rows.V @ X[:, :size] + rows.D, rows.V @ X[:, size:] - rows.c)
        return X[:, :size] @ y - X[:, size:], y
    # what holds the cable may make good what is singular without it, as a loop's turn on the ground
    inner = slice(3, n - 3)
    H = columns(*hessian, 0, n)[inner, inner]
    whole = np.block([[H, -rows.W.T[inner]], [rows.V[:, inner], rows.D]])
    if not np.linalg.cond(whole) < CONDITION:
        raise np.linalg.LinAlgError
    both = np.linalg.solve(whole, -np.concatenate([b[inner], rows.c]))
    x = np.zeros((n, b.shape[1]))
    x[inner] = both[: n - 6]
    return x, both[n - 6 :]


class Motions(NamedTuple):
    """How m contact points and the clamps move; the last axis is that of the motions, of the unknowns in
    `lean` and `ds`, and of the nodal rotations in `turn`.
    """

    normals: np.ndarray
    """(m, 3) of the obstacles."""
    t: np.ndarray
    """(m, 3) tangents of the cable."""
    dt: np.ndarray
    """(m, 3) curvature vectors."""
    turn: np.ndarray
    """(m, 3, 3n) derivative of the tangent."""
    lean: np.ndarray
    """(m, 3, size) of the normal over the surface."""
    ds: np.ndarray
    """(m, size) of the arc length."""
    spin: np.ndarray
    """(m, 3, motions) rotation of the obstacle."""
    clamps: np.ndarray
    """(6, motions) rotations of both clamps."""


def _mobilised(
    rows: Rows, i: np.ndarray, contacts: Contacts, motions: Motions, forces: np.ndarray, explicit: np.ndarray
) -> None:
    """Rows for contacts whose friction is across the cable, along t x n, and turns as these do.

    Args:
        rows: receive them.
        i: the contacts.
        contacts: all contact points.
        motions: of all of them.
        forces: (m, 3, size) on each contact, by the unknowns; overwritten for these contacts.
        explicit: (m, 3, motions) by the motions themselves, likewise.
    """
    normals, t, dt, turn, lean, ds, spin, x_clamps = motions
    n = turn.shape[2]
    friction, size = contacts.friction[i], np.linalg.norm(contacts.friction[i], axis=1)
    side = cross(t[i], normals[i])
    sine = np.einsum("ia,ia->i", side, friction) / size
    unit = friction / size[:, None]
    project = (size / sine)[:, None, None] * (np.eye(3) - unit[:, :, None] * unit[:, None, :])
    by_tangent = -project @ _crossed(normals[i])  # of the friction, by the tangent
    by_normal = project @ _crossed(t[i])
    clamps = np.r_[0:3, n - 3 : n]
    answer = by_tangent @ turn[i]
    answer_c = answer[:, :, clamps] @ x_clamps
    turned = -_crossed(normals[i]) @ spin[i]
    answer_c += by_normal @ turned
    answer_y = by_normal @ lean[i] + (by_tangent @ dt[i][:, :, None]) * ds[i][:, None, :]
    for a in range(3):
        at = rows.take(len(i))
        rows.V[at], rows.c[at], rows.D[at] = -answer[:, a], -answer_c[:, a], -answer_y[:, a]
        rows.D[at, at] += 1.0
        forces[i, a, at] = 1.0
    # its own rows turn it: with the obstacle turns only the normal
    explicit[i] = contacts.pressure[i, None, None] * turned


def _crossed(v: np.ndarray) -> np.ndarray:
    """(m, 3, 3) of the rows of v (m, 3); see `cross_matrix`."""
    return cross(v[:, None, :], np.eye(3)).transpose(0, 2, 1)


def _across(n: np.ndarray) -> np.ndarray:
    """(m, 2, 3) unit vectors across the unit vectors n (m, 3) and each other."""
    axis = np.eye(3)[np.abs(n).argmin(axis=1)]
    first = cross(n, axis)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, cross(n, first)], axis=1)
