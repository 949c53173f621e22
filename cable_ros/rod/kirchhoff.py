# SPDX-License-Identifier: Apache-2.0
"""One cable between two clamps, discretised: the problem that the trust region solves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import chain

import numpy as np

from cable_ros.linalg import banded, bordered
from cable_ros.rod import entry_points, error_estimate, quaternion, warm_step
from cable_ros.rod.clamp_stiffness import clamp_response
from cable_ros.rod.elements import Mesh, enrichment
from cable_ros.rod.energy_kernels import workspace
from cable_ros.rod.rod_state import ENERGY
from cable_ros.rod.units import norm
from cable_ros.rod.without_contact import NOTHING, WithoutContact
from cable_ros.solve.trust_region import Options, minimize

ALGEBRAIC = 1e-3
"""Fraction of the tolerance at which Newton's method stops: negligible beside the discretisation error."""
ORDER = 6
"""Order of the elements: at 1e-4 to 1e-8 the cheapest of 3 to 8 (docs/precision.md)."""

REFACTOR, OFF = 0.05, 0.1
"""Rotation of a section, rad, after which factors, stability margin and error estimate are renewed; and the
relative error of the margin, extrapolated from its last change, at which they are renewed earlier."""
FREE_TO_TURN = 10.0 * bordered.NEUTRAL
"""Maximum margin of an equilibrium that belongs to a continuous family (neutral stability)."""
NO_LINES, NO_ELEMENTS, NO_DELTA = np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros(0)
"""For `error_estimate.error`: no contact."""


class Rod(WithoutContact):
    """A Kirchhoff rod in units of the cable, in its start clamp's frame; see `rod.energy_kernels`.

    Implements `solve.trust_region.Problem`: points are nodal quaternions (n, 4), multipliers the end force
    (3,), steps (3n,) nodal rotation vectors, zero at the clamps.

    Args:
        mesh: the elements.
        stiffness: (3,) about the section's axes, in units of the cable.
        natural: (3,) curvature and twist of the unloaded cable.
    """

    work = np.inf
    """Budget left for a solve, iterations times unknowns: results must not depend on the clock."""

    few = 3
    """Maximum number of iterations of a step after which the next one may be longer."""

    compliance = NOTHING
    """(3,) of shear and axial strain, EI / L^2 over the stiffness."""

    clamped = True
    """Whether both ends are clamps; if not, see `HeldRod`."""

    given = NOTHING
    """(3,) part of the end force that is given, EI / L^2."""

    least = 1e-6
    """Wrench, in units of the cable, to which smaller ones are rounded up in a relative error."""

    def __init__(self, mesh: Mesh, stiffness: np.ndarray, natural: np.ndarray | None = None) -> None:
        self.K = np.ascontiguousarray(stiffness, float)
        self.natural = np.zeros(3) if natural is None else np.ascontiguousarray(natural, float)
        self.section = self.K, self.natural  # fields of `Section`
        self.qe, self.re, self.f = np.array([1.0, 0, 0, 0]), np.array([0.0, 0, 1]), np.zeros(3)
        self._allocate(mesh)

    def _allocate(self, mesh: Mesh) -> None:
        order, elements = mesh.element.order, len(mesh.lengths)
        nodes = elements * order + 1
        n, band = 3 * nodes, 3 * (order + 1)
        self.mesh = mesh
        self.h, self.s0 = np.array(mesh.lengths), mesh.starts
        self.tables = mesh.element.tables
        fine, bubble = enrichment(order)
        self.fine = fine.tables
        self.elastic, self.geometric = np.zeros((n, band)), np.zeros((n, band))
        self.A, self.L, self.pivots = np.zeros((n, band)), np.zeros((n, band)), np.ones(n)
        self.C, self.Y, self.S = np.zeros((3, n)), np.zeros((3, n)), np.zeros((3, 3))
        self.dchord, self.acc = np.zeros((elements, 3, band)), np.zeros((nodes, 4))
        lanes = workspace(self.h, self.tables.by_point)
        self.g, self.radial, self.totals = np.zeros((nodes, 3)), np.zeros(nodes), np.zeros(5)
        self.shares = np.zeros(elements)
        self.mode = np.zeros(n)
        # fields of `Grid`, `Enrichment` and `System`, as `entry_points` takes them
        self.grid = self.h, self.s0, tuple(self.tables)
        self.enrichment = tuple(self.fine), bubble
        self.saddle = (
            (self.acc, self.g, self.radial, self.totals, lanes),
            (self.elastic, self.geometric, self.dchord, self.C),
            (self.A, self.L, self.pivots, self.Y, self.S),
        )
        self._start_vector: np.ndarray | None = None
        self.rotation, self.rotation_before, self.refactor_at = np.inf, np.inf, REFACTOR
        self.margin = np.nan
        # the last equilibria of `advance` on this mesh: the latest itself, how many, and all of them
        self.latest: np.ndarray | None = None
        self.known = 0
        path = np.zeros((3, nodes, 4)), np.zeros((3, 3)), np.zeros((3, 10))
        self.arrays = *self.section, *self.grid, *chain.from_iterable(self.saddle), *path  # of `advance`
        self._normal: tuple[np.ndarray, np.ndarray] | None = None

    @property
    def iteration_work(self) -> float:
        """Work of an iteration: unknowns, those of a rod without contact."""
        return self.elastic.shape[0]

    def set_conditions(
        self, qe: np.ndarray, re: np.ndarray, f: np.ndarray, obstacles: np.ndarray | None = None
    ) -> None:
        """End frame (4,) scalar first, end position (3,), load (3,) per length; see `TouchingRod`."""
        self.qe, self.re, self.f = qe, re, f

    def kept(self) -> Callable[[], None]:
        """A function that puts back the conditions of now, and the contacts, if any, with their mesh."""
        return partial(self.set_conditions, self.qe, self.re, self.f, self.obstacles)

    def chord(self, qe: np.ndarray, re: np.ndarray) -> float:
        """Least distance of the cable's ends, L, with an end frame qe (4,) at re (3,)."""
        return norm(re)

    def on_end(self, q: np.ndarray) -> np.ndarray:
        """A copy of the frames q (n, 4) whose last one is on the end frame."""
        q = q.copy()
        q[-1] = self.qe if q[-1] @ self.qe > 0.0 else -self.qe
        return q

    def reactions(self) -> np.ndarray:
        """Moment of the end clamp (3,), EI / L: it tells apart equilibria of equal energy and twist."""
        return self.g[-1]

    def start_force(self, F: np.ndarray) -> np.ndarray:
        """(3,): force in the rod at its start, beside the end force F (3,)."""
        return F + self.f + self.contact_force()

    def unresolved(self, q: np.ndarray, leeway: float = 1.0) -> np.ndarray:
        """(m,) which elements are too long for contact, see `ConstrainedRod`."""
        return np.zeros(len(self.h), bool)

    @property
    def rubbed(self) -> np.ndarray:
        """(m,) which elements lie along an obstacle with friction."""
        return np.zeros(len(self.h), bool)

    def suited(self, mesh: Mesh) -> Mesh:
        """The mesh with the boundaries between elements that this rod needs."""
        return mesh

    def variant(
        self, mesh: Mesh | None = None, stiffness: np.ndarray | None = None,
        natural: np.ndarray | None = None, scale: float = 1.0,
    ) -> Rod:  # fmt: skip
        """The rod with another mesh or section, the same conditions; `scale`: forces, new unit over old."""
        new = Rod(
            self.mesh if mesh is None else mesh,
            self.K if stiffness is None else stiffness,
            self.natural if natural is None else natural,
        )
        new.set_conditions(self.qe, self.re, self.f / scale)
        return new

    def for_tolerance(self, tolerance: float) -> Rod:
        """The rod for another tolerance of the end wrench: itself, if only its mesh depends on that."""
        return self

    def snapshot(self) -> Callable[[], Rod]:
        """A function that makes a copy of this rod as it is now; cheap until it is called."""
        return self.variant

    # Problem

    def value(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        self.latest = None
        entry_points.linearize(x, np.zeros(3), self.f, self.section, self.grid, self.saddle, False)
        return float(self.totals[ENERGY]), self.totals[:ENERGY] - self.re

    def linearize(self, x: np.ndarray, y: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        self.latest = self._normal = None
        entry_points.linearize(x, y, self.f, self.section, self.grid, self.saddle, True)
        g = self.g.ravel().copy()
        g[:3] = g[-3:] = 0.0
        return float(self.totals[ENERGY]), self.totals[:ENERGY] - self.re, g

    def factor(self, mu: float) -> bool:
        self.rotation = 0.0
        return entry_points.factor(mu, self.mesh.element.order, self.saddle)

    def step(self, gradient: np.ndarray, constraints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        s, dF = np.empty(gradient.shape[0]), np.empty(3)
        entry_points.saddle_step(gradient, constraints, self.mesh.element.order, self.saddle, s, dF)
        return s, dF

    def normal_step(self, constraints: np.ndarray) -> np.ndarray:
        if self._normal is None:
            order, n = self.mesh.element.order, self.elastic.shape[0]
            L, pivots = np.zeros_like(self.L), np.ones(n)
            banded.factor(self.elastic, 3, n - 3, order, L, pivots)
            X = self.C.copy()
            X[:, :3] = X[:, -3:] = 0.0
            for row in X:
                banded.solve(L, pivots, 3, n - 3, order, row)
            self._normal = X, self.C @ X.T
        X, G = self._normal
        # a straight rod cannot move its end along itself: a little damping keeps that direction finite
        return -np.linalg.solve(G + 1e-9 * np.trace(G) * np.eye(3), constraints) @ X

    def apply_hessian(self, s: np.ndarray) -> np.ndarray:
        """The Hessian at the point linearised last, times the step s (3n,)."""
        y, z = np.empty_like(s), np.empty_like(s)
        banded.multiply(self.elastic, s, y)
        banded.multiply(self.geometric, s, z)
        return y + z

    def derivative(self, s: np.ndarray) -> np.ndarray:
        return self.C @ s

    def norm(self, s: np.ndarray) -> float:
        y = np.empty_like(s)
        banded.multiply(self.elastic, s, y)
        return float(np.sqrt(max(s @ y, 0.0)))

    def retract(self, x: np.ndarray, s: np.ndarray) -> np.ndarray:
        out = np.empty_like(x)
        quaternion.retract(x, s, out)
        return out

    def minimum(
        self, q: np.ndarray, F: np.ndarray, options: Options
    ) -> tuple[np.ndarray, np.ndarray, int] | None:
        """The stable equilibrium where a descent from (q, F) ends, factored: q, F, iterations; or None."""
        result = minimize(self, q, F, options)
        if not result.converged:
            return None
        return (result.x, result.y, result.iterations) if self.refactor(result.x, result.y) else None

    def fall(
        self, q: np.ndarray, F: np.ndarray, options: Options
    ) -> tuple[np.ndarray, np.ndarray, int] | None:
        """`minimum` from a shape that has just lost its stability; knows nothing of friction."""
        return self.minimum(q, F, options)

    def fall_closely(
        self, q: np.ndarray, F: np.ndarray, options: Options
    ) -> tuple[np.ndarray, np.ndarray, int] | None:
        """As `fall`, among obstacles at more places."""
        return self.fall(q, F, options)

    def refactor(self, q: np.ndarray, F: np.ndarray) -> bool:
        """Factor the tangent at (q, F); whether that is a strict minimum."""
        self.linearize(q, F)
        return self.factor(0.0)

    # what an equilibrium says

    def advance(
        self, q: np.ndarray, F: np.ndarray, qe: np.ndarray, re: np.ndarray, f: np.ndarray,
        tolerance: float, limit: float = 0.6, obstacles: np.ndarray | None = None,
    ) -> tuple[int, int, np.ndarray, np.ndarray]:  # fmt: skip
        """One warm-started solve, see `warm_step.advance`; returns code, iterations and the new (q, F)."""
        q_new, F_new = np.empty_like(q), np.empty(3)
        known = self.known if q is self.latest else 0
        code, iterations, self.rotation_before, fresh = warm_step.advance(
            q,
            F,
            qe,
            re,
            f,
            *self.arrays,
            known,
            tolerance,
            limit,
            self.rotation,
            self.refactor_at,
            q_new,
            F_new,
        )
        self.latest, self.known = None, 0
        self.rotation = 0.0 if fresh else self.rotation_before
        if code == warm_step.ADVANCED:
            self.set_conditions(qe, re, f)
            self.latest, self.known = q_new, min(known + 1, 3)
        return code, iterations, q_new, F_new

    def stability_margin(self) -> float:
        """Smallest eigenvalue of the Hessian on the tangent space, relative to the elastic stiffness.

        The rod must be factored at a strict minimum; the eigenvector found last is the start of the next
        search.
        """
        margin = self._softest()
        change = abs(margin - self.margin)
        self.refactor_at = REFACTOR
        if self.rotation_before == np.inf:  # how fast it changes is not known
            self.refactor_at = min(REFACTOR, margin)
        elif change > 0.0:
            self.refactor_at = min(REFACTOR, OFF * margin * self.rotation_before / change)
        if margin < FREE_TO_TURN:  # any motion may leave it one place to turn to
            self.refactor_at = 0.0
        self.margin = margin
        return margin

    def _softest(self) -> float:
        order, factors = self.mesh.element.order, self.saddle[2]
        return float(
            error_estimate.margin(self.elastic, self.C, 3, order, factors, self.mode, self.start_vector(), 50)
        )

    def start_vector(self) -> np.ndarray:
        """(3n,) a smooth rotation of the sections, zero at the clamps, of elastic energy 1/2."""
        if self._start_vector is None:
            k = np.arange(1, 5)
            start = np.sin(np.pi * np.outer(self.mesh.nodes, k)) / k**2
            start = (start @ np.random.default_rng(0).normal(size=(4, 3))).ravel()
            start[:3] = start[-3:] = 0.0
            self._start_vector = start / self.norm(start)
        return self._start_vector

    def clamp_stiffness(self, q: np.ndarray, F: np.ndarray) -> np.ndarray:
        """Derivative (12, 12) of the clamps' wrenches by their motions; see
        `clamp_stiffness.clamp_response`.
        """
        self.linearize(q, F)
        self.factor(-bordered.NEUTRAL)
        return clamp_response(q, F, (self.qe, self.re, self.f), self.grid, self.saddle)

    def wrench_response(self, q: np.ndarray, F: np.ndarray, moving: Sequence[int]) -> np.ndarray:
        """Derivative (12 + 6k, 12 + 6k) of the wrenches on the clamps and the k obstacles `moving` by their
        motions; zero for obstacles that it does not touch.
        """
        out = np.zeros((12 + 6 * len(moving), 12 + 6 * len(moving)))
        out[:12, :12] = self.clamp_stiffness(q, F)
        return out

    def stretch_points(
        self, q: np.ndarray, F: np.ndarray, table: tuple[np.ndarray, ...], start: np.ndarray,
        length: float, points: np.ndarray,
    ) -> None:  # fmt: skip
        """Add the displacement by the stretch to the `points`; see `StretchingRod`."""

    def stretch_anywhere(
        self, q: np.ndarray, F: np.ndarray, at: np.ndarray, start: np.ndarray, length: float,
        points: np.ndarray,
    ) -> None:  # fmt: skip
        """Put the `points` (c, 3) at the arc lengths `at` (c,) where a cable that stretches has them."""

    def wrench_error(self, q: np.ndarray, F: np.ndarray) -> np.ndarray:
        """Estimated error (6,) of end force and moment, in units of the cable; see `error_estimate.error`."""
        return self._wrench_error(q, F, self.re, np.zeros(self.g.size))

    def _wrench_error(self, q: np.ndarray, F: np.ndarray, re: np.ndarray, residual: np.ndarray) -> np.ndarray:
        rows = self.C, self.C, NO_DELTA, NO_LINES, NO_ELEMENTS, NO_ELEMENTS
        return error_estimate.error(
            q, warm_step.spread(F, self.h), (self.qe, re, self.f), self.section, self.grid, self.enrichment,
            self.saddle, rows, 3, (NO_LINES, residual, self.shares),
        )  # fmt: skip

    def relative_error(self, q: np.ndarray, F: np.ndarray) -> float:
        """Estimated relative error of the end wrench; see `units.relative_change`."""
        change = self.wrench_error(q, F)
        return float(error_estimate.relative_error(change, F, self.g[-1], self.shares, self.least))
