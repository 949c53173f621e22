# SPDX-License-Identifier: Apache-2.0
"""One cable that lengthens and shears under its force: its end position answers to that force, too."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np

from cable_ros.linalg.bordered import NEUTRAL
from cable_ros.rod import entry_points, quaternion, warm_step
from cable_ros.rod.clamp_stiffness import clamp_response
from cable_ros.rod.elements import Mesh, sampling
from cable_ros.rod.extensible_kernels import stretch_polyline
from cable_ros.rod.extensible_step import advance_stretching, moments
from cable_ros.rod.kirchhoff import Rod
from cable_ros.rod.rod_state import ENERGY, TWIST, Tables
from cable_ros.solve.trust_region import Options

Conditions = tuple[np.ndarray, np.ndarray, np.ndarray]
"""End frame, end position and load, as `Rod.set_conditions` takes them."""
IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])
SLACK = 0.95
"""Maximum distance of the clamps, L, at which a cold start begins, with an inextensible rod."""
KICKS = (0.3, -0.3, 1.0, -1.0)
"""Rotations, rad, along the softest mode from which a descent starts where a branch has ended."""
PUSH = 10.0
"""EI / L^3; a load per length that bends the cable as far as it can."""
SHORT = 0.7
"""Minimum length of a compressed cable, L."""
SHORTEST = 1e-3
"""Minimum step of a continuation, fraction of the path."""
SAME_COMPLIANCE = 0.01
"""Maximum change of the end's compliance, relative, with which factors still serve."""


class StretchingRod(Rod):
    """A `Rod` with compliance against shear and tension; see `rod.extensible_kernels`.

    Args:
        mesh, stiffness, natural: as in `Rod`.
        compliance: (3,) 1 / GAx, 1 / GAy, 1 / EA in units of the cable.
    """

    def __init__(
        self, mesh: Mesh, stiffness: np.ndarray, natural: np.ndarray | None, compliance: np.ndarray
    ) -> None:
        self.compliance = np.ascontiguousarray(compliance, float)
        self.stretch, self.reach = np.zeros(4), np.zeros((3, 3))
        self.give_at_end = np.zeros((3, 3))
        """(3, 3) see `yield_at_end`."""
        self.least = least_force(self.compliance)
        super().__init__(mesh, stiffness, natural)

    def variant(
        self,
        mesh: Mesh | None = None,
        stiffness: np.ndarray | None = None,
        natural: np.ndarray | None = None,
        scale: float = 1.0,
    ) -> StretchingRod:
        new = StretchingRod(
            self.mesh if mesh is None else mesh,
            self.K if stiffness is None else stiffness,
            self.natural if natural is None else natural,
            self.compliance * scale,
        )
        new.set_conditions(self.qe, self.re, self.f / scale)
        new.give_at_end, new.least = self.give_at_end * scale, max(new.least, self.least / scale)
        return new

    @property
    def stretching(self) -> tuple[np.ndarray, ...]:
        """`rod_state.Stretch`."""
        return self.compliance, self.reach, self.stretch

    def yield_at_end(self, compliance: np.ndarray) -> bool:
        """Let the end give way (3, 3), L^3 / EI, to changes of its force since the last equilibrium.

        Whether its factors are others now.
        """
        other = float(np.abs(compliance - self.give_at_end).max())
        self.give_at_end = compliance
        return other > SAME_COMPLIANCE * float(np.abs(compliance).max())

    def linearize(self, x: np.ndarray, y: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        entry_points.stretch_linearize(
            x, y, self.f, self.section, self.stretching, self.grid, self.saddle, True
        )
        self.reach += self.give_at_end
        g = self.g.ravel().copy()
        g[:3] = g[-3:] = 0.0
        return float(self.totals[ENERGY]), self.totals[:ENERGY] - self.re, g

    def factor(self, mu: float) -> bool:
        self.rotation = 0.0
        return entry_points.stretch_factor(self.saddle, self.reach, mu, self.mesh.element.order)

    def advance(
        self, q: np.ndarray, F: np.ndarray, qe: np.ndarray, re: np.ndarray, f: np.ndarray,
        tolerance: float, limit: float = 0.6, obstacles: np.ndarray | None = None,
    ) -> tuple[int, int, np.ndarray, np.ndarray]:  # fmt: skip
        q_new, F_new = np.empty_like(q), np.empty(3)
        code, iterations, self.rotation_before, fresh = advance_stretching(
            q, F, (qe, re, f), self.section, self.stretching, self.give_at_end,
            self.grid, self.saddle, (tolerance, limit, self.rotation, self.refactor_at), q_new, F_new,
        )  # fmt: skip
        self.rotation = 0.0 if fresh else self.rotation_before
        if code == warm_step.ADVANCED:
            self.set_conditions(qe, re, f)
        return code, iterations, q_new, F_new

    def minimum(
        self, q: np.ndarray, F: np.ndarray, options: Options
    ) -> tuple[np.ndarray, np.ndarray, int] | None:
        """As `Rod.minimum`: near (q, F) by Newton's method, otherwise from the inextensible rod.

        Where the branch of (q, F) ends, that of the inextensible rod may not yet: the descent then starts
        beside it, along the softest mode.
        """
        if not F.any():
            return self._descend(q, F, options)
        if self.refactor(q, F):
            code, count, q_new, F_new = self.advance(q, F, self.qe, self.re, self.f, options.step_tolerance)
            if code == warm_step.ADVANCED and self.refactor(q_new, F_new):
                return q_new, F_new, count
        mode, energy = self.mode / max(float(np.abs(self.mode).max()), 1e-300), float(self.totals[ENERGY])
        for kick in (0.0, *KICKS):
            found = self._descend(self.retract(q, kick * mode), F, options)
            if found is not None and self.totals[ENERGY] <= energy + 1e-6 * (1.0 + abs(energy)):
                return found
        return None

    def _descend(
        self, q: np.ndarray, F: np.ndarray, options: Options
    ) -> tuple[np.ndarray, np.ndarray, int] | None:
        """By continuation from the inextensible rod or, first if the rod is taut, from the straight one."""
        chord = max(float(np.linalg.norm(self.re)), 1e-12)
        if chord > SLACK and (found := self._from_straight(q, options.step_tolerance)):
            return found
        start = self.re * min(1.0, SLACK / chord)
        across = np.cross(start, np.eye(3)[np.argmin(np.abs(start))])
        # a straight cable that is pulled taut passes its buckling load; a push sideways guides it past that
        for push in (np.zeros(3), PUSH * across / max(float(np.linalg.norm(across)), 1e-12)):
            stiff = Rod(self.mesh, self.K, self.natural)
            stiff.set_conditions(self.qe, start, self.f + push)
            found = stiff.minimum(q, F, options)
            if found is not None and (reached := self._soften(*found, start, push, options.step_tolerance)):
                return reached
        # so soft that it may be short rather than bent
        return self._from_straight(q, options.step_tolerance) if SHORT < chord <= SLACK else None

    def _from_straight(self, q: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray, int] | None:
        """From the straight rod between clamps along the chord, with about the twist of q, to our own clamps.

        The clamps turn to where they are while the load grows.
        """
        self.linearize(q, np.zeros(3))
        chord = float(np.linalg.norm(self.re))
        start = quaternion.between(np.array([0.0, 0.0, 1.0]), self.re / chord)
        tangent = quaternion.rotate(self.qe, np.array([0.0, 0.0, 1.0]))
        end = quaternion.multiply(quaternion.between(tangent, self.re / chord), self.qe)
        apart = quaternion.multiply(quaternion.conjugate(start), end)
        twist = 2.0 * np.arctan2(apart[3], apart[0])
        twist += 2.0 * np.pi * np.round((self.totals[TWIST] - twist) / (2.0 * np.pi))
        half = 0.5 * twist * self.mesh.nodes
        q = np.stack([np.cos(half), 0.0 * half, 0.0 * half, np.sin(half)], axis=1)
        F = np.array([0.0, 0.0, (chord - 1.0) / max(self.compliance[2], 1e-12)])
        rod = self.variant()

        def conditions(t: float) -> Conditions:
            back = quaternion.conjugate(quaternion.slerp(start, IDENTITY, t))
            there = quaternion.multiply(back, quaternion.slerp(end, self.qe, t))
            return there, quaternion.rotate(back, self.re), t * quaternion.rotate(back, self.f)

        found = _continuation(rod, q, F, conditions, tolerance)
        return found if found is not None and self.refactor(*found[:2]) else None

    def _soften(
        self,
        q: np.ndarray,
        F: np.ndarray,
        iterations: int,
        start: np.ndarray,
        push: np.ndarray,
        tolerance: float,
    ) -> tuple[np.ndarray, np.ndarray, int] | None:
        """From the inextensible equilibrium with its end at `start` under the added load `push` to our own.

        First the compliance grows, then the end moves out, then the push goes.
        """
        rod = self.variant()
        # compliance, end position, load, one after the other
        corners = [
            np.concatenate([soft * self.compliance, end, self.f + aside])
            for soft, end, aside in (
                (0.0, start, push),
                (1.0, start, push),
                (1.0, self.re, push),
                (1.0, self.re, 0.0),
            )
        ]
        for begin, finish in itertools.pairwise(corners):
            if np.array_equal(begin, finish):
                continue

            def conditions(t: float, begin: np.ndarray = begin, finish: np.ndarray = finish) -> Conditions:
                target = (1.0 - t) * begin + t * finish
                rod.compliance = target[:3].copy()
                return self.qe, target[3:6], target[6:]

            found = _continuation(rod, q, F, conditions, tolerance)
            if found is None:
                return None
            q, F, count = found
            iterations += count
        return (q, F, iterations) if self.refactor(q, F) else None

    def stretch_points(
        self,
        q: np.ndarray,
        F: np.ndarray,
        table: tuple[np.ndarray, ...],
        start: np.ndarray,
        length: float,
        points: np.ndarray,
    ) -> None:
        """Add the displacement by the stretch to the world `points` (m, 3) of `output.polyline`.

        `table` has the fields of `rod_state.Sampling`.
        """
        mesh = self.h, self.s0
        stretch_polyline(q, (F, self.f), self.compliance, mesh, table, start, length, points)

    def stretch_anywhere(
        self, q: np.ndarray, F: np.ndarray, at: np.ndarray, start: np.ndarray, length: float,
        points: np.ndarray,
    ) -> None:  # fmt: skip
        self.stretch_points(q, F, tuple(sampling(self.mesh, at)), start, length, points)

    def clamp_stiffness(self, q: np.ndarray, F: np.ndarray) -> np.ndarray:
        self.linearize(q, F)
        self.factor(-NEUTRAL)  # without what is added for stability's sake
        plain = clamp_response(q, F, (self.qe, self.re, self.f), self.grid, self.saddle)
        # what the load adds by the stretch, when it turns against a start clamp that turns
        return plain + self._turning_load(q, F)

    def _turning_load(self, q: np.ndarray, F: np.ndarray) -> np.ndarray:
        """(12, 12) part of `clamp_stiffness`: the stretch's gradient is quadratic in the force, so its
        central difference by the load is exact.
        """
        order = self.mesh.element.order
        out = np.zeros((12, 12))
        for k in range(3):
            turned = np.cross(np.eye(3)[k], self.f)
            more, less = (self._stretch(q, F, self.f + half * turned, self.tables) for half in (0.5, -0.5))
            right, c = more[0] - less[0], more[1] - less[1]
            s, dF = np.empty(self.g.size), np.empty(3)
            entry_points.saddle_step(right, c, order, self.saddle, s, dF)
            out[:, 3 + k] = -moments(right, s, dF, self.qe, self.saddle[1])
        return out

    def _stretch(
        self, q: np.ndarray, F: np.ndarray, f: np.ndarray, tables: Tables
    ) -> tuple[np.ndarray, np.ndarray]:
        """What the stretch adds to the gradient (3n,) and to the end position (3,) under the load f."""
        acc, totals = np.zeros_like(self.acc), np.empty(4)
        grid = self.h, self.s0, tuple(tables)
        stretch = self.compliance, self.reach, totals
        entry_points.stretch_gradient(q, warm_step.spread(F, self.h), f, grid, stretch, acc)
        w, x, y, z = q.T
        a, b, c, d = acc.T
        g = 0.5 * np.stack([-x * a + w * b + z * c - y * d, -y * a - z * b + w * c + x * d,
                            -z * a + y * b - x * c + w * d], axis=1)  # fmt: skip
        return g.ravel(), totals[:ENERGY]

    def wrench_error(self, q: np.ndarray, F: np.ndarray) -> np.ndarray:
        """As `Rod.wrench_error`; the added polynomials see the stretch at the solution only."""
        pull, displacement = self._stretch(q, F, self.f, self.fine)
        return self._wrench_error(q, F, self.re - displacement, pull)


def least_force(compliance: np.ndarray) -> float:
    """`Rod.least` of a rod with this compliance (3,): rounding of the end position, as force."""
    return max(1e-3, 1e-10 / float(np.max(compliance)))


def _continuation(
    rod: StretchingRod,
    q: np.ndarray,
    F: np.ndarray,
    conditions: Callable[[float], Conditions],
    tolerance: float,
) -> tuple[np.ndarray, np.ndarray, int] | None:
    """Natural-parameter continuation of (q, F) from conditions(0) to conditions(1); None if it stops."""
    at, step, iterations = 0.0, 1.0, 0
    rod.set_conditions(*conditions(0.0))
    while at < 1.0:
        to = min(1.0, at + step)
        target = conditions(to)
        if rod.refactor(q, F):
            code, count, q_new, F_new = rod.advance(q, F, *target, tolerance)
            iterations += count
            if code == warm_step.ADVANCED:
                at, q, F, step = to, q_new, F_new, 2.0 * step
                continue
        if step < SHORTEST:
            return None
        step *= 0.5
    return q, F, iterations
