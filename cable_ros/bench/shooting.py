# SPDX-License-Identifier: Apache-2.0
"""Multiple shooting of the rod's differential equations, in units of the cable and world axes.

The equations (paper, eqs 8, 9, 14-16) go through one step of an explicit eighth-order Runge-Kutta method on
each of many short pieces, all at once, and Newton's method closes the gaps between them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from scipy.integrate import DOP853
from scipy.spatial.transform import Rotation, Slerp

Surface = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]
"""Points (k, 3) to distances (k,), their gradients (k, 3) and Hessians (k, 3, 3)."""


@dataclass
class Touch:
    """A point of the rod that a force along the normal holds on a surface, with a given friction."""

    place: float
    """Arc length, inside (0, 1)."""
    surface: Surface
    force: float
    """Along the gradient."""
    friction: np.ndarray
    """(3,)"""
    holds: bool = True
    """Whether the force is whatever holds the point on the surface, or as it stands."""
    slides: bool = True
    """Whether the place is wherever the rod is tangent to the surface, or as it stands."""


@dataclass
class Held:
    """A touch that holds, at a node: what `newton_step` needs to know of it."""

    node: int
    distance: float
    normal: np.ndarray
    bend: np.ndarray
    """(3, 3) Hessian of the distance."""
    tangent: np.ndarray
    ways: tuple[np.ndarray, np.ndarray] | None = None
    """(12,), (12,): how the ends of the pieces before and after the node change with their lengths, where it
    slides."""


def resample(
    points: np.ndarray,
    orientations: np.ndarray,
    force0: np.ndarray,
    load: np.ndarray,
    compliance: np.ndarray,
    places: Sequence[float] = (),
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The claimed shape on a grid fine enough for one Runge-Kutta step a piece.

    The fastest scale of the solution is a boundary layer of thickness sqrt(EI / |F|) or the turning
    of the frame; a piece spans at most half of it, where one step is exact to about 1e-11. The `places` are
    among the grid's nodes.
    """
    claimed = Rotation.from_quat(orientations)
    turning = (claimed[:-1].inv() * claimed[1:]).magnitude() * (len(points) - 1)
    force = max(float(np.linalg.norm(force0)), float(np.linalg.norm(force0 - load)))
    rate = max(np.sqrt(force * compliance[:2].max()), float(turning.max()))
    pieces = int(np.clip(np.ceil(2.0 * rate), 40, 6000))
    s = np.linspace(0.0, 1.0, pieces + 1)
    away = np.abs(s[1:-1, None] - np.asarray(places)).min(axis=1, initial=np.inf)
    s = np.unique(np.concatenate([[0.0, 1.0], s[1:-1][away > 0.3 / pieces], places]))
    given = np.linspace(0.0, 1.0, len(points))
    frames = Slerp(given, claimed)(s).as_matrix()
    tangents = claimed.as_matrix()[:, :, 2]
    i = np.clip(np.searchsorted(given, s, side="right") - 1, 0, len(points) - 2)
    h = given[i + 1] - given[i]
    x = ((s - given[i]) / h)[:, None]
    h = h[:, None]
    r = (
        (1 + 2 * x) * (1 - x) ** 2 * points[i]
        + x * (1 - x) ** 2 * h * tangents[i]
        + x**2 * (3 - 2 * x) * points[i + 1]
        + x**2 * (x - 1) * h * tangents[i + 1]
    )
    return s, r, frames


def moments(
    s: np.ndarray, r: np.ndarray, force: np.ndarray, load: np.ndarray, moment0: np.ndarray
) -> np.ndarray:
    """Moments along the claimed shape by balance, M' = -r' x F; `force` is that just beyond each node."""
    mean = force[:-1] - 0.5 * np.diff(s)[:, None] * load
    rise = -np.cross(np.diff(r, axis=0), mean)
    return moment0 + np.vstack([np.zeros(3), np.cumsum(rise, axis=0)])


def cross_matrix(v: np.ndarray) -> np.ndarray:
    """(n, 3) -> (n, 3, 3) with (v x) as a matrix."""
    m = np.zeros((len(v), 3, 3))
    m[:, 0, 1], m[:, 0, 2], m[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    m[:, 1, 0], m[:, 2, 0], m[:, 2, 1] = v[:, 2], -v[:, 1], v[:, 0]
    return m


def rates(
    state: list[np.ndarray], load: np.ndarray, compliance: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Derivatives along arc length of point, frame, force, moment and of their variations.

    Variations (dr, dtheta, dF, dM) in world axes, dR = [dtheta]x R:
    dr' = dtheta x t, dtheta' = R K^-1 R^T (dM - dtheta x M), dF' = 0, dM' = -(dtheta x t) x F - t x dF.
    """
    _, frame, force, moment, variation = state
    t = frame[:, :, 2]
    world_compliance = (frame * compliance) @ frame.transpose(0, 2, 1)
    turning = (world_compliance @ moment[:, :, None])[:, :, 0]
    tx, fx, mx = cross_matrix(t), cross_matrix(force), cross_matrix(moment)
    a = np.zeros((len(t), 12, 12))
    a[:, 0:3, 3:6] = -tx
    a[:, 3:6, 3:6] = world_compliance @ mx
    a[:, 3:6, 9:12] = world_compliance
    a[:, 9:12, 3:6] = -fx @ tx
    a[:, 9:12, 6:9] = -tx
    return (
        t,
        cross_matrix(turning) @ frame,
        np.broadcast_to(-load, t.shape),
        -np.cross(t, force),
        a @ variation,
    )


def propagate(
    r: np.ndarray,
    frames: np.ndarray,
    force: np.ndarray,
    moment: np.ndarray,
    h: np.ndarray,
    load: np.ndarray,
    compliance: np.ndarray,
) -> tuple[list[np.ndarray], np.ndarray]:
    """All pieces at once through one DOP853 step: end states, and (n, 12, 12) transition maps."""
    first = [r[:-1], frames[:-1], force[:-1], moment[:-1], np.tile(np.eye(12), (len(h), 1, 1))]
    steps = [h.reshape(-1, *[1] * (x.ndim - 1)) for x in first]
    stages: list[tuple[np.ndarray, ...]] = []
    for row in DOP853.A:
        state = [
            x + step * sum((c * k[j] for c, k in zip(row, stages, strict=False) if c), np.zeros(1))
            for j, (x, step) in enumerate(zip(first, steps, strict=True))
        ]
        stages.append(rates(state, load, compliance))
    last = [
        x + step * sum((b * k[j] for b, k in zip(DOP853.B, stages, strict=True) if b), np.zeros(1))
        for j, (x, step) in enumerate(zip(first, steps, strict=True))
    ]
    return last[:4], last[4]


def ways(ends: list[np.ndarray], pushed: np.ndarray, load: np.ndarray, compliance: np.ndarray) -> np.ndarray:
    """(n, 12) how the end of each piece changes with its length.

    `ends` (n, ...) are behind what is `pushed` (n, 3) there.
    """
    r, frame, force, moment = ends
    force = force + pushed
    t = frame[:, :, 2]
    turning = (((frame * compliance) @ frame.transpose(0, 2, 1)) @ moment[:, :, None])[:, :, 0]
    return np.hstack([t, turning, np.broadcast_to(-load, r.shape), -np.cross(t, force)])


def gap(reached: list[np.ndarray], nodes: tuple[np.ndarray, ...]) -> np.ndarray:
    """(n, 12) what is missing between the end of each piece and the node there."""
    turn = reached[1] @ nodes[1].transpose(0, 2, 1)
    # A step too long for the integration leaves no rotation: the claim is far from anything.
    if not (np.all(np.isfinite(turn)) and np.all(np.linalg.det(turn) > 0.5)):
        return np.full((len(turn), 12), np.nan)
    rotation = Rotation.from_matrix(turn).as_rotvec()
    return np.hstack([reached[0] - nodes[0], rotation, reached[2] - nodes[2], reached[3] - nodes[3]])


def newton_step(
    maps: np.ndarray,
    gaps: np.ndarray,
    scale: np.ndarray,
    turned: np.ndarray,
    touches: Sequence[Held] = (),
    neutral: bool = False,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Changes that close the gaps, both end poses held: of nodes (n + 1, 12), touches' forces, their places.

    `turned` (n, 3, 3): change of the force on each node but the first with its position, as normals turn.

    delta_{i+1} - Phi_i delta_i = gap_i is a banded system: 17 diagonals on either side. Where it is all but
    singular, its null vector is what it answers to anything, and is taken out. A touch adds its force to the
    gap before its node, and a border that puts the node on the surface; one that slides a second, which makes
    the rod tangent to the surface there, by a longer piece on one side of the node and a shorter one on the
    other.
    """
    n, sliding = len(maps), [touch for touch in touches if touch.ways is not None]
    m = len(touches) + len(sliding)
    scaled = maps * (scale / scale[:, None])
    corner = np.tile(np.eye(12), (n, 1, 1))
    corner[:, 6:9, 0:3] += turned * scale[0] / scale[6]
    columns, lines, misses = np.zeros((m, n, 12)), np.zeros((m, n + 1, 12)), np.zeros(m)
    for k, touch in enumerate(touches):
        columns[k, touch.node - 1, 6:9] = touch.normal / scale[6]
        lines[k, touch.node, 0:3] = touch.normal * scale[0]
        misses[k] = touch.distance
    for k, touch in enumerate(sliding, len(touches)):
        assert touch.ways is not None
        columns[k, touch.node - 1] = -touch.ways[0] / scale
        columns[k, touch.node] = touch.ways[1] / scale
        lines[k, touch.node, 0:3] = touch.bend @ touch.tangent * scale[0]
        lines[k, touch.node, 3:6] = np.cross(touch.tangent, touch.normal) * scale[3]
        misses[k] = touch.normal @ touch.tangent
    band = np.zeros((35, 12 * n))
    rows, cols = np.meshgrid(np.arange(12), np.arange(12), indexing="ij")
    for block, offset in ((-scaled, -6), (corner, 6)):
        row = (12 * np.arange(n))[:, None, None] + rows
        col = (12 * np.arange(n))[:, None, None] + offset + cols
        # The two clamped nodes have no pose unknowns, only a wrench: six columns each.
        inside = col >= 0
        if offset > 0:
            col[-1] -= 6
            inside[-1] = cols >= 6
        row = np.broadcast_to(row, col.shape)
        np.add.at(band, (17 + row[inside] - col[inside], col[inside]), block[inside])

    def solve(right: np.ndarray) -> np.ndarray:
        return scipy.linalg.solve_banded((17, 17), band, right, check_finite=False)

    def nodes(x: np.ndarray) -> np.ndarray:
        out = np.zeros((n + 1, 12))
        out[0, 6:], out[1:-1], out[-1, 6:] = x[:6], x[6:-6].reshape(n - 1, 12), x[-6:]
        return out

    # all at once: the band is factored for each call
    closed, *answers = solve(np.vstack([gaps[None] / scale, columns]).reshape(m + 1, -1).T).T
    if neutral:
        null = np.ones(12 * n)
        for _ in range(2):
            null = solve(null / np.linalg.norm(null))
        null /= np.linalg.norm(null)
        closed = closed - (null @ closed) * null
    delta = nodes(closed)
    pushes: np.ndarray = np.zeros(m)
    if m:
        answered = np.array([nodes(answer) for answer in answers])
        system = np.tensordot(lines, answered, ((1, 2), (1, 2)))
        # touches too close to each other, or a clamp's own: what cannot be told apart is shared
        pushes = np.linalg.lstsq(system, np.tensordot(lines, delta, 2) + misses, rcond=1e-12)[0]
        delta = delta - np.tensordot(pushes, answered, 1)
    slides = np.zeros(len(touches))
    slides[[touch.ways is not None for touch in touches]] = pushes[len(touches) :]
    return delta * scale, pushes[: len(touches)], slides
