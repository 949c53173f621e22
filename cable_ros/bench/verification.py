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

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from scipy.integrate import DOP853
from scipy.spatial.transform import Rotation, Slerp

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
    """Whether it is a strict minimum (no conjugate point)."""
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


NEUTRAL_MARGIN = 1e-2
"""A claim with a smaller stability margin may be one of a family of equilibria, each beside the next."""


def verify(rod: Rod, claim: Equilibrium, *, iterations: int = 25) -> Verification:
    """Refine `claim` to the true equilibrium beside it and compare.

    Uses only `points`, `orientations` and `start_wrench` of the claim as the start of Newton's
    method; raises nothing: a claim with non-finite numbers is simply not converged.
    """
    claimed = (claim.points, claim.orientations, claim.start_wrench, claim.end_wrench)
    if not all(np.all(np.isfinite(a)) for a in claimed):
        return _failed(0)
    tries = [refine(rod, *claimed, iterations=iterations)]
    if claim.stability_margin < NEUTRAL_MARGIN:
        tries.append(refine(rod, *claimed, iterations=iterations, neutral=True))
    return min(tries, key=lambda one: one.wrench_error)


@np.errstate(all="ignore")
def refine(
    rod: Rod,
    points: np.ndarray,
    orientations: np.ndarray,
    start_wrench: np.ndarray,
    end_wrench: np.ndarray,
    *,
    iterations: int = 25,
    neutral: bool = False,
) -> Verification:
    """As `verify`, from bare arrays: centreline (n, 3), orientations (n, 4), both wrenches (6,).

    Where the claim is `neutral`, one of a family of equilibria, it is compared with the nearest of them.
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
    s, r, frames = _resample(
        (points - rod.start[:3]) / rod.length, orientations, force0, load, compliance, rod
    )
    r[0], frames[0] = 0.0, start_frame.as_matrix()
    r[-1], frames[-1] = (rod.end[:3] - rod.start[:3]) / rod.length, end_frame.as_matrix()
    force = force0 - s[:, None] * load
    moment = _moments(s, r, force, moment0)

    scale_f = max(1.0, float(np.abs(force).max()))
    scale = np.concatenate([np.ones(6), np.full(3, scale_f), np.full(3, max(1.0, scale_f**0.5))])
    h = np.diff(s)
    converged, done = False, 0
    maps = np.empty((len(h), 12, 12))
    for done in range(1, iterations + 1):  # noqa: B007
        end_state, maps = _propagate(r, frames, force, moment, h, load, compliance)
        gap = _gap(end_state, (r[1:], frames[1:], force[1:], moment[1:]))
        if not np.all(np.isfinite(gap)):
            break
        step = _newton_step(maps, gap, scale, neutral)
        if not np.all(np.isfinite(step)):
            break
        size = float(np.abs(step / scale).max())
        step *= min(1.0, 0.4 / max(size, 1e-300))
        r, force, moment = r + step[:, :3], force + step[:, 6:9], moment + step[:, 9:]
        frames = Rotation.from_rotvec(step[:, 3:6]).as_matrix() @ frames
        # Close to a fold rounding alone moves the step; closed gaps then say that it is done.
        if size < 1e-10 or (size < 1e-5 and np.abs(gap / scale).max() < 1e-12):
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
    shape = Shape(
        s * rod.length,
        rod.start[:3] + r * rod.length,
        frames,
        force * units[0],
        moment * units[3],
    )
    return Verification(
        converged=True,
        stable=_no_conjugate_point(maps[:-1] if neutral else maps, scale_f**-0.5),
        wrench_error=float(errors[1]),
        start_wrench_error=float(errors[0]),
        shape_error=_distance(points, orientations, shape, rod.length),
        end_wrench=true_end,
        start_wrench=true_start,
        iterations=done,
        shape=shape,
    )


def _failed(iterations: int) -> Verification:
    nan = np.full(6, np.nan)
    return Verification(False, False, np.inf, np.inf, np.inf, nan, nan, iterations, None)


def _resample(
    points: np.ndarray,
    orientations: np.ndarray,
    force0: np.ndarray,
    load: np.ndarray,
    compliance: np.ndarray,
    rod: Rod,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The claimed shape on a grid fine enough for one Runge-Kutta step a piece.

    The fastest scale of the solution is a boundary layer of thickness sqrt(EI / |F|) or the turning
    of the frame; a piece spans at most half of it, where one step is exact to about 1e-11.
    """
    claimed = Rotation.from_quat(orientations)
    turning = (claimed[:-1].inv() * claimed[1:]).magnitude() * (len(points) - 1)
    force = max(float(np.linalg.norm(force0)), float(np.linalg.norm(force0 - load)))
    rate = max(np.sqrt(force * compliance[:2].max()), float(turning.max()))
    pieces = int(np.clip(np.ceil(2.0 * rate), 40, 6000))
    s = np.linspace(0.0, 1.0, pieces + 1)
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


def _moments(s: np.ndarray, r: np.ndarray, force: np.ndarray, moment0: np.ndarray) -> np.ndarray:
    """Moments along the claimed shape by balance: M' = -r' x F."""
    rise = -np.cross(np.diff(r, axis=0), 0.5 * (force[1:] + force[:-1]))
    return moment0 + np.vstack([np.zeros(3), np.cumsum(rise, axis=0)])


def _cross_matrix(v: np.ndarray) -> np.ndarray:
    """(n, 3) -> (n, 3, 3) with (v x) as a matrix."""
    m = np.zeros((len(v), 3, 3))
    m[:, 0, 1], m[:, 0, 2], m[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    m[:, 1, 0], m[:, 2, 0], m[:, 2, 1] = v[:, 2], -v[:, 1], v[:, 0]
    return m


def _rates(
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
    tx, fx, mx = _cross_matrix(t), _cross_matrix(force), _cross_matrix(moment)
    a = np.zeros((len(t), 12, 12))
    a[:, 0:3, 3:6] = -tx
    a[:, 3:6, 3:6] = world_compliance @ mx
    a[:, 3:6, 9:12] = world_compliance
    a[:, 9:12, 3:6] = -fx @ tx
    a[:, 9:12, 6:9] = -tx
    return (
        t,
        _cross_matrix(turning) @ frame,
        np.broadcast_to(-load, t.shape),
        -np.cross(t, force),
        a @ variation,
    )


def _propagate(
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
        stages.append(_rates(state, load, compliance))
    last = [
        x + step * sum((b * k[j] for b, k in zip(DOP853.B, stages, strict=True) if b), np.zeros(1))
        for j, (x, step) in enumerate(zip(first, steps, strict=True))
    ]
    return last[:4], last[4]


def _gap(reached: list[np.ndarray], nodes: tuple[np.ndarray, ...]) -> np.ndarray:
    """(n, 12) what is missing between the end of each piece and the node there."""
    turn = reached[1] @ nodes[1].transpose(0, 2, 1)
    # A step too long for the integration leaves no rotation: the claim is far from anything.
    if not (np.all(np.isfinite(turn)) and np.all(np.linalg.det(turn) > 0.5)):
        return np.full((len(turn), 12), np.nan)
    rotation = Rotation.from_matrix(turn).as_rotvec()
    return np.hstack([reached[0] - nodes[0], rotation, reached[2] - nodes[2], reached[3] - nodes[3]])


def _newton_step(maps: np.ndarray, gap: np.ndarray, scale: np.ndarray, neutral: bool) -> np.ndarray:
    """(n + 1, 12) changes of the nodes that close the gaps, both end poses held.

    delta_{i+1} - Phi_i delta_i = gap_i is a banded system: 17 diagonals on either side. Where it is all but
    singular, its null vector is what it answers to anything, and is taken out.
    """
    n = len(maps)
    scaled = maps * (scale / scale[:, None])
    band = np.zeros((35, 12 * n))
    rows, cols = np.meshgrid(np.arange(12), np.arange(12), indexing="ij")
    for block, offset in ((-scaled, -6), (np.tile(np.eye(12), (n, 1, 1)), 6)):
        row = (12 * np.arange(n))[:, None, None] + rows
        col = (12 * np.arange(n))[:, None, None] + offset + cols
        # The two clamped nodes have no pose unknowns, only a wrench: six columns each.
        inside = col >= 0
        if offset > 0:
            col[-1] -= 6
            inside[-1] = cols >= 6
        row = np.broadcast_to(row, col.shape)
        band[17 + row[inside] - col[inside], col[inside]] = block[inside]

    def solve(right: np.ndarray) -> np.ndarray:
        return scipy.linalg.solve_banded((17, 17), band, right, check_finite=False)

    delta = solve((gap / scale).ravel())
    if neutral:
        null = np.ones(12 * n)
        for _ in range(2):
            null = solve(null / np.linalg.norm(null))
        null /= np.linalg.norm(null)
        delta -= (null @ delta) * null
    nodes = np.zeros((n + 1, 12))
    nodes[0, 6:] = delta[:6]
    nodes[1:-1] = delta[6:-6].reshape(n - 1, 12)
    nodes[-1, 6:] = delta[-6:]
    return nodes * scale


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
