# SPDX-License-Identifier: Apache-2.0
"""A claimed equilibrium, checked by means that share nothing with the solver.

The solver works on strain modes in a weak form. Here the rod's differential equations (paper, eqs
8, 9, 14-16) are integrated by explicit eighth-order Runge-Kutta steps on many short pieces
(multiple shooting), and Newton's method closes the gaps between the pieces with both clamp poses
held. Started at a claim, it lands on the true equilibrium beside it, whose wrench, shape and
stability are then compared with what was claimed. Short pieces keep the integration well posed for
heavy cables, whose single shooting grows like exp(sqrt(w L^3 / EI)).

Stability is Jacobi's criterion: the variations that leave the start clamp in place span a
six-dimensional subspace, which is carried along the cable; the equilibrium is a strict minimum when
their pose part is regular at every arc length beyond 0 (no conjugate point).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from cable_ros.bench import shooting
from cable_ros.bench.shooting import Held, Surface, Touch
from cable_ros.equilibrium import Equilibrium


@dataclass(frozen=True)
class Rod:
    """What is between the clamps, and where those are; SI units."""

    length: float
    stiffness: np.ndarray
    """(3,) EIx, EIy, GJ about the section's axes, N m^2."""
    weight: np.ndarray
    """(3,) force per length, world axes, N/m."""
    start: np.ndarray
    """(7,) pose of the start clamp, x y z qx qy qz qw, world."""
    end: np.ndarray
    """(7,) pose of the end clamp."""

    @property
    def force_unit(self) -> float:
        """EI / L^2 with the mean EI, N: verification's unit of force."""
        return float(np.mean(self.stiffness[:2])) / self.length**2

    @property
    def gravity_number(self) -> float:
        """Weight against bending stiffness, w L^3 / EI with the smaller EI."""
        return float(np.linalg.norm(self.weight) * self.length**3 / np.min(self.stiffness[:2]))


@dataclass(frozen=True)
class Shape:
    """Frames and internal wrench on a grid of arc lengths; SI units, world axes."""

    arc_lengths: np.ndarray
    points: np.ndarray
    """(n, 3)"""
    frames: np.ndarray
    """(n, 3, 3) section frames, third column the tangent."""
    forces: np.ndarray
    """(n, 3) what the part beyond exerts on the part before."""
    moments: np.ndarray
    """(n, 3) the same."""


@dataclass(frozen=True)
class Verification:
    """The true equilibrium beside a claim, and how far the claim is from it."""

    converged: bool
    """Whether an equilibrium was found; the other numbers mean nothing otherwise."""
    stable: bool
    """Whether it is a strict minimum (no conjugate point); where it touches something, not looked into."""
    wrench_error: float
    """Difference of the claimed end wrench from the true one, relative; moments are divided by the
    length so that forces and moments count in the same unit."""
    start_wrench_error: float
    """The same at the start clamp."""
    shape_error: float
    """Largest distance between claimed and true centreline, relative to the length."""
    end_wrench: np.ndarray
    """(6,) true wrench on the body at the end clamp, in its frame, N and N m."""
    start_wrench: np.ndarray
    """(6,) the same at the start clamp."""
    iterations: int
    shape: Shape | None
    normal_forces: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """(m,) what keeps the rod on each of the surfaces that it is said to touch, N; negative: a pull."""


NEUTRAL_MARGIN = 1e-2
"""A claim with a smaller stability margin may be one of a family of equilibria, each beside the next."""


def bend_layer(rod: Rod, claim: Equilibrium) -> float:
    """Length within which the taut rod bends where it is pushed, sqrt(EI / F), m."""
    largest = max(float(np.linalg.norm(wrench[:3])) for wrench in (claim.start_wrench, claim.end_wrench))
    return math.sqrt(float(rod.stiffness[:2].min()) / max(largest, 1e-300))


def verify(
    rod: Rod, claim: Equilibrium, touches: Sequence[Touch] = (), *, iterations: int = 25, fineness: int = 1
) -> Verification:
    """Refine `claim` to the true equilibrium beside it and compare.

    Uses only `points`, `orientations` and `start_wrench` of the claim as the start of Newton's
    method; raises nothing: a claim with non-finite numbers is simply not converged.

    `fineness`: how many times as near to each other as mostly touches hold the rod.
    """
    claimed = (claim.points, claim.orientations, claim.start_wrench, claim.end_wrench)
    if not all(np.all(np.isfinite(a)) for a in claimed):
        return _failed(0)
    distance = float(np.clip(bend_layer(rod, claim) / rod.length, ENDS, ALONE)) / fineness
    reported, touches = touches, apart(touches, distance)
    tries = [refine(rod, *claimed, touches, iterations=iterations)]
    if any(touch.slides for touch in touches) and not tries[0].converged:
        sticking = [replace(touch, slides=False) for touch in touches]
        tries.append(refine(rod, *claimed, sticking, iterations=iterations))
    if not any(one.converged for one in tries):
        tries.append(refine(rod, *claimed, apart(reported, 0.5 * distance), iterations=iterations))
    if not touches and claim.stability_margin < NEUTRAL_MARGIN:
        tries.append(refine(rod, *claimed, iterations=iterations, neutral=True))
    return min(tries, key=lambda one: one.wrench_error)


ALONE, ENDS = 0.03, 0.004
"""Of touches on one surface nearer to each other than half of this, parts of the length, one holds; of points
and ends of patches, which bear most of the force and slide, nearer than this."""


def apart(touches: Sequence[Touch], distance: float = ALONE) -> list[Touch]:
    """Touches that hold the rod, at some distance from each other; those in between keep the reported forces.

    The rod can hardly tell apart the forces of points side by side on one surface, so they cannot be found
    one by one; those on two surfaces it can, and two that pinch it may only stand both. Points that stand
    alone, but for the pressure beside a lift-off, slide to where the gap is smallest: a soft rod, and one
    that is all but taut, answers to a place that is a little off by a shape that is much more so.

    `distance`: in the place of ALONE; of a taut rod the length within which it bends, beyond which it tells
    forces apart.
    """
    held: dict[object, list[float]] = {}
    out: list[Touch] = []
    for touch in sorted(touches, key=lambda touch: (not touch.slides, touch.place)):
        others = held.setdefault(touch.surface, [])
        least = ENDS if touch.slides else 0.5 * distance
        holds = touch.holds and all(abs(touch.place - other) > least for other in others)
        if holds:
            others.append(touch.place)
        near = [other for other in touches if abs(other.place - touch.place) < 0.25 * ALONE]
        alone = sum(other.surface is touch.surface and other.slides for other in near) == 1
        out.append(replace(touch, holds=holds, slides=touch.slides and holds and alone))
    return sorted(out, key=lambda touch: touch.place)


@np.errstate(all="ignore")
def refine(
    rod: Rod,
    points: np.ndarray,
    orientations: np.ndarray,
    start_wrench: np.ndarray,
    end_wrench: np.ndarray,
    touches: Sequence[Touch] = (),
    *,
    iterations: int = 25,
    neutral: bool = False,
) -> Verification:
    """As `verify`, from bare arrays: centreline (n, 3), orientations (n, 4), both wrenches (6,).

    Where the claim is `neutral`, one of a family of equilibria, it is compared with the nearest of them. With
    `touches` (in units of the cable, seen from the start clamp's point along world axes) the true
    equilibrium is that which touches just there, or near by where they slide; whether it is stable is not
    found out then.
    """
    # Units of the cable: length 1, bending stiffness 1.
    stiff = float(np.mean(rod.stiffness[:2]))
    units = np.array([stiff / rod.length**2] * 3 + [stiff / rod.length] * 3)
    compliance = stiff / rod.stiffness
    load = rod.weight * rod.length**3 / stiff
    start_frame = Rotation.from_quat(rod.start[3:])
    end_frame = Rotation.from_quat(rod.end[3:])
    wrench = start_wrench / units

    force0, moment0 = start_frame.apply(wrench[:3]), start_frame.apply(wrench[3:])
    s, r, frames = shooting.resample(
        (points - rod.start[:3]) / rod.length,
        orientations,
        force0,
        load,
        compliance,
        [touch.place for touch in touches],
    )
    r[0], frames[0] = 0.0, start_frame.as_matrix()
    r[-1], frames[-1] = (rod.end[:3] - rod.start[:3]) / rod.length, end_frame.as_matrix()
    at = np.searchsorted(s, [touch.place - 1e-12 for touch in touches])
    normal_forces = np.array([touch.force for touch in touches])
    holding = [k for k, touch in enumerate(touches) if touch.holds]

    frictions = np.array([touch.friction for touch in touches]).reshape(-1, 3)
    on: dict[Surface, list[int]] = {}
    for k, touch in enumerate(touches):
        on.setdefault(touch.surface, []).append(k)

    def surfaces(r: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(k,) distances of the touches, (k, 3) their gradients and (k, 3, 3) Hessians."""
        met = np.empty(len(touches)), np.empty((len(touches), 3)), np.empty((len(touches), 3, 3))
        for surface, which in on.items():
            for out, values in zip(met, surface(r[at[which]]), strict=True):
                out[which] = values
        return met

    def jumps(normals: np.ndarray) -> np.ndarray:
        """(n + 1, 3) what is pushed at each node."""
        out = np.zeros_like(r)
        np.add.at(out, at, normal_forces[:, None] * normals + frictions)
        return out

    force = force0 - s[:, None] * load - np.cumsum(jumps(surfaces(r)[1]), axis=0)
    moment = shooting.moments(s, r, force, load, moment0)

    scale_f = max(1.0, float(np.abs(force).max()))
    scale = np.concatenate([np.ones(6), np.full(3, scale_f), np.full(3, max(1.0, scale_f**0.5))])
    h = np.diff(s)
    converged, done = False, 0
    maps = np.empty((len(h), 12, 12))
    for done in range(1, iterations + 1):  # noqa: B007
        end_state, maps = shooting.propagate(r, frames, force, moment, h, load, compliance)
        distances, normals, bends = surfaces(r)
        pushed = jumps(normals)[1:]
        end_state[2] = end_state[2] - pushed
        gap = shooting.gap(end_state, (r[1:], frames[1:], force[1:], moment[1:]))
        if not np.all(np.isfinite(gap)):
            break
        ways = shooting.ways(end_state, pushed, load, compliance)
        held = [
            Held(
                int(at[k]),
                float(distances[k]),
                normals[k],
                bends[k],
                frames[at[k]][:, 2],
                (ways[at[k] - 1], ways[at[k]]) if touches[k].slides else None,
            )
            for k in holding
        ]
        turned = np.zeros((len(r), 3, 3))
        np.add.at(turned, at, normal_forces[:, None, None] * bends)
        step, found, slid = shooting.newton_step(maps, gap, scale, turned[1:], held, neutral)
        pushes = np.zeros(len(touches))
        pushes[holding] = found
        if not np.all(np.isfinite(step)):
            break
        size = float(np.abs(step / scale).max())
        part = min(1.0, 0.4 / max(size, 1e-300))
        for one, way in zip(held, slid, strict=True):
            part = min(part, 0.3 * float(h[one.node - 1 : one.node + 1].min()) / max(abs(way), 1e-300))
        for one, way in zip(held, slid, strict=True):
            h[one.node - 1] += part * way
            h[one.node] -= part * way
        step, normal_forces = part * step, normal_forces + part * pushes
        r, force, moment = r + step[:, :3], force + step[:, 6:9], moment + step[:, 9:]
        frames = Rotation.from_rotvec(step[:, 3:6]).as_matrix() @ frames
        # Normals of surfaces are known to 1e-9. Close to a fold rounding alone moves the step; closed gaps
        # then say that it is done.
        if size < (1e-8 if touches else 1e-10) or (size < 1e-5 and np.abs(gap / scale).max() < 1e-12):
            converged = True
            break
    if not converged:
        return _failed(done)

    true_start = np.concatenate([frames[0].T @ force[0], frames[0].T @ moment[0]]) * units
    true_end = -np.concatenate([frames[-1].T @ force[-1], frames[-1].T @ moment[-1]]) * units
    count = np.array([1.0] * 3 + [1.0 / rod.length] * 3)
    errors = [
        np.linalg.norm((claimed - true) * count) / max(np.linalg.norm(true * count), 1e-9 * units[0])
        for claimed, true in ((start_wrench, true_start), (end_wrench, true_end))
    ]
    s = np.concatenate([[0.0], np.cumsum(h)])
    shape = Shape(
        s * rod.length,
        rod.start[:3] + r * rod.length,
        frames,
        force * units[0],
        moment * units[3],
    )
    return Verification(
        converged=True,
        stable=bool(touches) or _no_conjugate_point(maps[:-1] if neutral else maps, scale_f**-0.5),
        wrench_error=float(errors[1]),
        start_wrench_error=float(errors[0]),
        shape_error=_distance(points, orientations, shape, rod.length),
        end_wrench=true_end,
        start_wrench=true_start,
        iterations=done,
        shape=shape,
        normal_forces=normal_forces * units[0],
    )


def _failed(iterations: int) -> Verification:
    nan = np.full(6, np.nan)
    return Verification(False, False, np.inf, np.inf, np.inf, nan, nan, iterations, None)


def _no_conjugate_point(maps: np.ndarray, layer: float) -> bool:
    """Jacobi's criterion: the determinant of the pose part starts positive and must stay so.

    The basis of the subspace is made orthonormal at every node (a change of basis with positive
    determinant), so growth along a heavy cable cannot drown it. A part that is straight so far
    leaves the determinant at rounding level, where its sign says nothing. Measured by the thickness
    `layer` of the bends, all parts of a variation are of one size.
    """
    scale = np.repeat([layer, 1.0, layer**-2, 1.0 / layer], 3)
    maps = maps * (scale / scale[:, None])
    basis = np.vstack([np.zeros((6, 6)), np.eye(6)])
    for phi in maps:
        basis, upper = np.linalg.qr(phi @ basis)
        basis = basis * np.sign(np.diag(upper))
        pose = basis[:6] / np.maximum(np.linalg.norm(basis[:6], axis=1, keepdims=True), 1e-300)
        sigma = np.linalg.svd(pose, compute_uv=False)
        if sigma[-1] > 1e-9 * sigma[0] and np.linalg.det(pose) < 0.0:
            return False
    return True


def _distance(points: np.ndarray, orientations: np.ndarray, shape: Shape, length: float) -> float:
    """Largest distance between the claimed points and the true ones nearest in arc length."""
    given = np.linspace(0.0, length, len(points))
    tangents = Rotation.from_quat(orientations).as_matrix()[:, :, 2]
    i = np.clip(np.rint(shape.arc_lengths / given[1]).astype(int), 0, len(points) - 1)
    # Only nodes close to a claimed point, moved there along the tangent, so no interpolation error.
    ahead = shape.arc_lengths - given[i]
    near = np.abs(ahead) <= 1e-9 * length
    moved = points[i] + ahead[:, None] * tangents[i]
    return float(np.linalg.norm(moved - shape.points, axis=1)[near].max() / length)
