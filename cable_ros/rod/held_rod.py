# SPDX-License-Identifier: Apache-2.0
"""One cable whose ends are pinned, free or sliding; see `rod.ends` and `rod.held_kernels`."""

from __future__ import annotations

import numpy as np

from cable_ros.linalg import banded
from cable_ros.linalg.bordered import NEUTRAL
from cable_ros.rod import error_estimate, quaternion, warm_step
from cable_ros.rod.elements import Mesh
from cable_ros.rod.ends import Ends
from cable_ros.rod.held_kernels import held_factor, held_linearize, held_solution
from cable_ros.rod.held_response import response
from cable_ros.rod.held_step import advance_held
from cable_ros.rod.kirchhoff import NO_ELEMENTS, NO_LINES, Rod
from cable_ros.rod.rod_state import ENERGY, Conditions
from cable_ros.rod.supports import Supports
from cable_ros.solve.trust_region import Options

SHORTEST = 1e-3
"""Minimum step of the continuation in a given moment, as a fraction of it."""
MODE_ITERATIONS = 50
"""Maximum number of inverse iterations for the stability margin."""
MODE_CHANGE = 1e-4
"""Relative change of the margin at which they end."""


class HeldRod(Rod):
    """A `Rod` with other ends than two clamps.

    The end force F of a state has the given force in it; the frames of the first and last node are those of
    the sections, not of the mounts.

    Args:
        mesh, stiffness, natural: as in `Rod`.
        ends: how the ends are held.
    """

    clamped = False

    def __init__(self, mesh: Mesh, stiffness: np.ndarray, natural: np.ndarray | None, ends: Ends) -> None:
        self.ends = ends
        super().__init__(mesh, stiffness, natural)

    def _allocate(self, mesh: Mesh) -> None:
        super()._allocate(mesh)
        nodes = len(self.g)
        self.path = np.zeros((3, nodes, 4)), np.zeros((3, 3)), np.zeros((3, 10))
        self.free_rotations = self.ends.free_rotations(nodes)
        self._plain = True
        self.q = np.empty((0, 4))
        self._hold()

    def _hold(self) -> None:
        """Set up the fields of `held_kernels.Hold` under the present conditions."""
        ends, qe = self.ends, self.qe
        rows, count = ends.rows(qe)
        moments = ends.given_moments(qe)
        self.given, self.moments = ends.given_force(qe, self.f), moments
        self.projector = rows[:count].T @ rows[:count]
        self.hold = self.free_rotations, rows, self.given, moments, count, ends.both_turn
        self.conservative = *self.hold[:3], np.zeros((2, 3)), *self.hold[4:]

    def set_conditions(
        self, qe: np.ndarray, re: np.ndarray, f: np.ndarray, obstacles: np.ndarray | None = None
    ) -> None:
        super().set_conditions(qe, re, f)
        if not self.ends.constant:
            self._hold()

    def variant(
        self, mesh: Mesh | None = None, stiffness: np.ndarray | None = None,
        natural: np.ndarray | None = None, scale: float = 1.0,
    ) -> HeldRod:  # fmt: skip
        new = HeldRod(
            self.mesh if mesh is None else mesh,
            self.K if stiffness is None else stiffness,
            self.natural if natural is None else natural,
            self.ends if scale == 1.0 else self.ends.scaled(1.0 / scale),
        )
        new.set_conditions(self.qe, self.re, self.f / scale)
        return new

    def chord(self, qe: np.ndarray, re: np.ndarray) -> float:
        return self.ends.chord(qe, re)

    def on_end(self, q: np.ndarray) -> np.ndarray:
        q = q.copy()
        turns = self.ends.end.turns
        if not any(turns):
            q[-1] = self.qe if q[-1] @ self.qe > 0.0 else -self.qe
        elif not all(turns):
            along = np.array([0.0, 0.0, 1.0])
            tilt = quaternion.between(quaternion.rotate(q[-1], along), quaternion.rotate(self.qe, along))
            q[-1] = quaternion.multiply(tilt, q[-1])
        return q

    def reactions(self) -> np.ndarray:
        """Moments at both ends, EI / L, and the end position, L."""
        return np.concatenate([self.g[0], self.g[-1], self.totals[:ENERGY]])

    def end_force(self, F: np.ndarray) -> np.ndarray:
        """F (3,) with its given components as they are given now."""
        return self.projector @ F + self.given

    # Problem: without a given moment, whose work is no potential

    def value(self, x: np.ndarray) -> tuple[float, np.ndarray]:
        self.latest = None
        held_linearize(x, self.given, self.f, self.section, self.grid, self.saddle, self.conservative, False)
        energy = float(self.totals[ENERGY])
        return energy, self.projector @ (self.totals[:ENERGY] - self.re)

    def linearize(self, x: np.ndarray, y: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        self.latest = self._normal = None
        self.q = x
        F = self.end_force(y)
        held_linearize(x, F, self.f, self.section, self.grid, self.saddle, self.conservative, True)
        c = self.projector @ (self.totals[:ENERGY] - self.re)
        return float(self.totals[ENERGY]), c, self.g.ravel() * self.free_rotations

    def factor(self, mu: float) -> bool:
        self.rotation = 0.0
        return bool(held_factor(self.q, mu, self.mesh.element.order, self.saddle, self.conservative))

    def step(self, gradient: np.ndarray, constraints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self._solve(gradient, constraints, self.conservative)

    def _solve(
        self, gradient: np.ndarray, constraints: np.ndarray, hold: tuple[object, ...]
    ) -> tuple[np.ndarray, np.ndarray]:
        s, dF = np.empty(gradient.shape[0]), np.empty(3)
        order = self.mesh.element.order
        held_solution(self.q, gradient, constraints, order, self.saddle, hold, s, dF)
        return s, dF

    def normal_step(self, constraints: np.ndarray) -> np.ndarray:
        _, rows, _, _, count, _ = self.hold
        n = self.elastic.shape[0]
        if not count:
            return np.zeros(n)
        if self._normal is None:
            order = self.mesh.element.order
            D, held = self.elastic.copy(), np.flatnonzero(self.free_rotations == 0.0)
            for i in held:  # a row and a column of the unit matrix
                below = np.arange(min(D.shape[1], n - i))
                D[i + below, D.shape[1] - 1 - below] = 0.0
                D[i] = 0.0
                D[i, -1] = 1.0
            L, pivots = np.zeros_like(self.L), np.ones(n)
            banded.factor(D, 0, n, order, L, pivots)
            X = rows[:count] @ self.C * self.free_rotations
            for row in X:
                banded.solve(L, pivots, 0, n, order, row)
            self._normal = X, rows[:count] @ self.C @ X.T
        X, G = self._normal
        regular = G + 1e-9 * np.trace(G) * np.eye(count)  # as `Rod.normal_step`
        return -np.linalg.solve(regular, rows[:count] @ constraints) @ X

    def derivative(self, s: np.ndarray) -> np.ndarray:
        return self.projector @ (self.C @ s)

    def minimum(
        self, q: np.ndarray, F: np.ndarray, options: Options
    ) -> tuple[np.ndarray, np.ndarray, int] | None:
        """As `Rod.minimum`; a given moment then grows from zero along the branch."""
        given = self.moments.any()
        if given and self._correct(q, F, options.step_tolerance) is not None and self.refactor(q, F):
            found = self._correct(q, F, options.step_tolerance)
            if found is not None and self.refactor(*found[:2]):
                return found
        least = super().minimum(self.on_end(q), F, options)
        if least is None:
            return None
        q, F, iterations = least
        F = self.end_force(F)
        if not given:
            return (q, F, iterations) if self.refactor(q, F) else None
        found = self._wind(q, F, options.step_tolerance)
        if found is None or not self.refactor(*found[:2]):
            return None
        return found[0], found[1], iterations + found[2]

    def _correct(
        self, q: np.ndarray, F: np.ndarray, tolerance: float
    ) -> tuple[np.ndarray, np.ndarray, int] | None:
        """The equilibrium that Newton's method leads to from (q, F), or None."""
        if not self.refactor(q, F):
            return None
        code, count, q_new, F_new = self.advance(q, F, self.qe, self.re, self.f, tolerance)
        return (q_new, F_new, count) if code == warm_step.ADVANCED else None

    def _wind(
        self, q: np.ndarray, F: np.ndarray, tolerance: float
    ) -> tuple[np.ndarray, np.ndarray, int] | None:
        """Continue (q, F) from no given moment to the whole of it."""
        whole = self.hold
        at, step, iterations = 0.0, 0.25, 0
        while at < 1.0:
            to = min(1.0, at + step)
            self.hold = *whole[:3], to * self.moments, *whole[4:]
            ready = self.refactor(q, F)
            code, count, q_new, F_new = self._advance(q, F, tolerance, 0.6, 0) if ready else (1, 0, q, F)
            iterations += count
            if code == warm_step.ADVANCED:
                at, q, F, step = to, q_new, F_new, 2.0 * step
                continue
            step *= 0.5
            if step < SHORTEST:
                self.hold = whole
                return None
        self.hold = whole
        return q, F, iterations

    def refactor(self, q: np.ndarray, F: np.ndarray) -> bool:
        self.linearize(q, F)
        self.rotation = 0.0
        return bool(held_factor(q, 0.0, self.mesh.element.order, self.saddle, self.hold))

    # what an equilibrium says

    def advance(
        self, q: np.ndarray, F: np.ndarray, qe: np.ndarray, re: np.ndarray, f: np.ndarray,
        tolerance: float, limit: float = 0.6, obstacles: np.ndarray | None = None,
    ) -> tuple[int, int, np.ndarray, np.ndarray]:  # fmt: skip
        before = self.qe, self.re, self.f
        known = self.known if q is self.latest else 0
        self.set_conditions(qe, re, f)
        code, iterations, q_new, F_new = self._advance(q, F, tolerance, limit, known)
        self.latest, self.known = None, 0
        if code == warm_step.ADVANCED:
            self.latest, self.known, self.q = q_new, min(known + 1, 3), q_new
        else:
            self.set_conditions(*before)
        return code, iterations, q_new, F_new

    def _advance(
        self, q: np.ndarray, F: np.ndarray, tolerance: float, limit: float, known: int
    ) -> tuple[int, int, np.ndarray, np.ndarray]:
        q_new, F_new = np.empty_like(q), np.empty(3)
        code, iterations, self.rotation_before, fresh = advance_held(
            q, F, (self.qe, self.re, self.f), self.section, self.grid, self.saddle, self.hold, self.path,
            known, (tolerance, limit, self.rotation, self.refactor_at), q_new, F_new,
        )  # fmt: skip
        self.rotation = 0.0 if fresh else self.rotation_before
        return code, iterations, q_new, F_new

    def _softest(self) -> float:
        """By inverse iteration, as `error_estimate.margin`; a given moment does not count."""
        mode, zero = self.mode + error_estimate.ADMIXTURE * self.start_vector(), np.zeros(3)
        y, value = np.empty_like(mode), np.inf
        banded.multiply(self.elastic, mode, y)
        for _ in range(MODE_ITERATIONS):
            x, _ = self._solve(-y, zero, self.conservative)
            top = float(x @ y)
            banded.multiply(self.elastic, x, y)
            norm2 = float(x @ y)
            before, value = value, top / norm2
            self.mode, y = x / np.sqrt(norm2), y / np.sqrt(norm2)
            if abs(before - value) <= MODE_CHANGE * abs(value):
                break
        return value

    def start_vector(self) -> np.ndarray:
        if self._start_vector is None:
            k, nodes = np.arange(1, 5), self.mesh.nodes
            waves = np.concatenate(
                [np.sin(np.pi * np.outer(nodes, k)), np.cos(np.pi * np.outer(nodes, k))], 1
            )
            start = waves / np.tile(k**2, 2) @ np.random.default_rng(0).normal(size=(8, 3))
            start = start.ravel() * self.free_rotations
            self._start_vector = start / self.norm(start)
        return self._start_vector

    def wrench_error(self, q: np.ndarray, F: np.ndarray) -> np.ndarray:
        return self._wrench_errors(q, F)[1]

    def _wrench_errors(self, q: np.ndarray, F: np.ndarray) -> np.ndarray:
        """(2, 6) estimated error of force and moment at start and end; 0 where they are given."""
        self.q = q
        residual, c = np.zeros(self.g.size), np.zeros(3)
        error_estimate.condense(
            q, warm_step.spread(F, self.h), (self.qe, self.re, self.f), self.section, self.grid,
            self.enrichment, (NO_LINES, NO_ELEMENTS), (NO_LINES, residual, self.shares), c,
        )  # fmt: skip
        change = residual - self.g.ravel()
        right = residual.copy()
        for node, moment in zip((0, -1), self.moments, strict=True):
            at = slice(0, 3) if node == 0 else slice(-3, None)
            right[at] -= quaternion.rotate(quaternion.conjugate(q[node]), moment)
        s, dF = self._solve(right, c, self.hold)
        change += self.apply_hessian(s) - dF @ self.C
        change *= 1.0 - self.free_rotations
        return np.stack([np.concatenate([dF, change[:3]]), np.concatenate([dF, change[-3:]])])

    def relative_error(self, q: np.ndarray, F: np.ndarray) -> float:
        """As `Rod.relative_error`, of the wrench at either end: the larger one."""
        start, end = self._wrench_errors(q, F)
        pairs = (start, F + self.f, self.g[0]), (end, F, self.g[-1])
        return max(
            float(error_estimate.relative_error(change, force, moment, self.shares, self.least))
            for change, force, moment in pairs
        )

    def supports(self, q: np.ndarray, F: np.ndarray) -> Supports:
        conditions = Conditions(self.qe, self.re, self.f)
        return Supports(self.ends, conditions, self.totals[:ENERGY], F, q[[0, -1]], self.g[[0, -1]])

    def clamp_stiffness(self, q: np.ndarray, F: np.ndarray) -> np.ndarray:
        """Derivative (12, 12) of the mounts' wrenches by their motions; see `held_response.response`."""
        self.linearize(q, F)
        held_factor(q, -NEUTRAL, self.mesh.element.order, self.saddle, self.hold)
        return response(self, self.supports(q, F), lambda right, c: self._solve(right, c, self.hold), q, F)
