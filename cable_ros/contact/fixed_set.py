# SPDX-License-Identifier: Apache-2.0
"""A rod with contact points as they are, and what they say about an equilibrium."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cable_ros.contact.assembly import nodal
from cable_ros.contact.clamp_force import clamp_error, on_plane
from cable_ros.contact.constrained_rod import ConstrainedRod
from cable_ros.contact.contact_entry_points import point_forces
from cable_ros.contact.dead_loads import DeadLoads
from cable_ros.contact.friction_kernels import COULOMB, FRICTIONLESS, SLIDING, STICK
from cable_ros.contact.points import (
    ARC_LENGTH,
    ARM,
    FIRST,
    FORCE,
    FRICTION,
    KIND,
    LENGTH,
    OBSTACLE,
    POINT,
    SAMPLE,
    SLIP_ROW,
    SLIPS,
    STICK_ROW,
)
from cable_ros.contact.report import coefficients
from cable_ros.contact.resolution import highest_mode
from cable_ros.contact.response import Contacts, wrench_response
from cable_ros.rod import error_estimate
from cable_ros.rod.kirchhoff import NOTHING
from cable_ros.rod.units import relative_change

CHANGED, SHIFTED = 0.1, 1e-3
"""Relative change of friction, and motion of a contact point along the cable, L, after which the error is
estimated again."""
RELEASED = 1e30
"""Compliance of a constraint row, L^3 / EI, that holds nothing."""


class FixedSetRod(ConstrainedRod):
    """What an equilibrium with its contact points says: stability, its wrench's response and errors."""

    def _softest(self) -> float:
        if self.bare:
            return super()._softest()
        self._judge()
        order, factors = self.mesh.element.order, self._factors(self.complement)
        return float(error_estimate.margin(
            self.elastic, self.V, self.rows, order, factors, self.mode, self.start_vector(), 50,
        ))  # fmt: skip

    def clamp_stiffness(self, q: np.ndarray, F: np.ndarray) -> np.ndarray:
        return super().clamp_stiffness(q, F) if self.bare else self.wrench_response(q, F, ())

    def wrench_response(self, q: np.ndarray, F: np.ndarray, moving: Sequence[int]) -> np.ndarray:
        """As `Rod.wrench_response`; see `response.wrench_response`.

        NaN for a cable that stretches and touches what has friction: where its point rolls along the cable it
        creeps to one side otherwise than to the other.
        """
        if self.bare:
            return super().wrench_response(q, F, moving)
        if self.soft and self.model == COULOMB and self.rough().any():
            return np.full((12 + 6 * len(moving), 12 + 6 * len(moving)), np.nan)
        return self._response(q, F, moving, None)

    def loaded_response(
        self, q: np.ndarray, F: np.ndarray, moving: Sequence[int], loaded: np.ndarray, before: np.ndarray
    ) -> np.ndarray:
        """The same with columns and rows of `dead_loads`.

        Args:
            q, F, moving: as there.
            loaded: (k,) numbers of the obstacles whose contact points carry given friction.
            before: (k,) arc lengths that touched them before, L.
        """
        return self._response(q, F, moving, (loaded, before))

    def _response(
        self, q: np.ndarray, F: np.ndarray, moving: Sequence[int],
        given: tuple[np.ndarray, np.ndarray] | None,
    ) -> np.ndarray:  # fmt: skip
        self.trace(q, F)
        self.rows = self.assemble(q, F, FRICTIONLESS)
        self.judged = self.ready = False
        points = self.points[: self.count]
        kind, pressure = points[:, KIND], points[:, FORCE]
        which = points[:, OBSTACLE].astype(int)
        assert self.obstacles is not None
        rough = self.rough()
        contacts = Contacts(
            arc_lengths=points[:, ARC_LENGTH].copy(), obstacles=which, pressure=pressure,
            friction=points[:, FRICTION : FRICTION + 3], at_minimum=kind == POINT, lifts_off=kind >= FIRST,
            sticks=rough & (points[:, SLIPS] == 0.0) & (self.model == COULOMB), across=self.model == SLIDING,
            give=1.0 / self._stick_stiffness(), given=np.asarray(points[:, ARM : ARM + 3].any(axis=1)),
        )  # fmt: skip
        clamps = self.qe, F, F + self.f + self.contact_force(), self.g
        loads = None
        if given is not None:
            loads = DeadLoads.of(self.mesh, self.shape(q), self.saddle[1][2], points, *given)
        compliance, G = self.strain[:2]
        return wrench_response(self.shape(q), clamps, self.saddle[1], self.obstacles, contacts, moving,
                               compliance, G, loads, self.end_compliance)  # fmt: skip

    def _stick_stiffness(self) -> np.ndarray:
        """(count,) stiffness of the contact points' stick, EI / L^3; see `stick_stiffness`."""
        points = self.points[: self.count]
        length = points[:, LENGTH]
        return np.where(length > 0.0, np.minimum(self.bedding * length, STICK), STICK)

    def _on_rough(self) -> np.ndarray:
        """(count,) which contact points are on an obstacle with friction, whether they press or not."""
        return self._coefficients() > 0.0

    def rough(self) -> np.ndarray:
        """(count,) which contact points press on an obstacle with friction."""
        return self._on_rough() & (self.points[: self.count, FORCE] > 0.0)

    def wrench_error(self, q: np.ndarray, F: np.ndarray) -> np.ndarray:
        """As `Rod.wrench_error`, with the contact forces as loads and the constraint rows of the contacts."""
        if self.bare:
            return super().wrench_error(q, F)
        self._judge()
        Fe, residual = np.empty((len(self.h), 3)), np.empty(self.g.size)
        self.trace(q, F)
        point_forces(self.shape(q), F, self.contacts, self.count, Fe, self.acc)
        boundaries = np.ascontiguousarray(np.vstack([self.c[:, 0], self.c[-1].sum(axis=0)])[:, :3])
        re = self._without_strain(q, F, boundaries)
        nodal(q, self.acc, residual)
        # where a sticking point sits depends on this mesh: its force is a given load, its rows are released
        sticks, slips = self.points[: self.count, [STICK_ROW, SLIP_ROW]].astype(int).T
        sticks, slips = sticks[sticks > 0], slips[slips > 0]
        friction = np.concatenate([sticks, 1 + sticks, slips])
        complement = self.complement
        if len(friction) and self.model == COULOMB:
            complement = complement[: self.rows, : self.rows].copy()
            complement[friction, friction] = RELEASED
        try:
            return np.asarray(error_estimate.error(
                q, Fe, (self.qe, re, self.f), self.section, self.grid, self.enrichment,
                (*self.saddle[:2], self._factors(complement)), self.constraints[:6], self.rows,
                (boundaries, residual, self.shares),
            ))  # fmt: skip
        except np.linalg.LinAlgError:  # contacts depend on each other: what each bears is not known
            return np.full(6, np.inf)

    def _without_strain(self, q: np.ndarray, F: np.ndarray, boundaries: np.ndarray) -> np.ndarray:
        """The end position (3,) and, in place, the elements' `boundaries` (m + 1, 3) without the displacement
        by axial strain, whose pull on the nodes is added to `acc`.
        """
        return boundaries[-1] if self._yields else self.re

    def centreline(self, q: np.ndarray, F: np.ndarray) -> np.ndarray:
        """(m, g + 1, 3) of `centreline.curve`, for q (n, 4) under the end force F (3,)."""
        return coefficients(q, self.mesh.lengths, self.mesh.element)

    def clamp_errors(self, q: np.ndarray, F: np.ndarray) -> np.ndarray:
        """(2,) relative errors of the clamps' forces where the cable lies beside them; see `clamp_error`.

        Each counts as much as `clamps` says.
        """
        if not self.has_patch:
            return np.zeros(2)
        assert self.obstacles is not None
        points = self.points[: self.count]
        even = self.K[0] == self.K[1] and not self.natural[:2].any()
        starts = NOTHING, q[0], F + self.f + self.contact_force(), -self.g[0]
        ends = self.re, q[-1], F, self.g[-1]
        section = self.K[0] if even else 0.0, self.compliance[2]
        curve = self.centreline(q, F), self.h, self.s0
        size = relative_change(np.array([1.0, 0, 0, 0, 0, 0]), np.concatenate((F, self.g[-1])), self.least)
        errors = [
            clamp_error(s, clamp, section, curve, points, self.obstacles)
            for s, clamp in ((0.0, starts), (1.0, ends))
        ]
        return size * np.array(self.clamps) * errors

    def beside_clamps(self) -> tuple[list[int], list[int]]:
        # an element may be so short that the samples of its neighbour tell how it lies
        points = self.points[: self.count]
        at = points[points[:, KIND] == SAMPLE, ARC_LENGTH]
        if not len(at):
            return [0], [-1]
        first, last = np.searchsorted(self.s0, [at.min(), at.max()], "right") - 1
        return [0, int(first)], [-1, int(last)]

    def friction_error(self, q: np.ndarray, F: np.ndarray) -> float:
        """As `relative_error`, for friction along patches between the samples.

        It is taken to be as large as the highest mode that the samples resolve on each element. That is
        little if friction is smooth, but friction keeps its history, and the wrench of a cable that is nearly
        free to move sideways depends on it.
        """
        self.friction_then, self.on_plane_then = self._patch_friction(), self._on_plane()
        self.arc_lengths_then = self.points[: self.count, ARC_LENGTH].copy()
        if self.friction_then == 0.0:
            return 0.0
        friction = self.points[: self.count, FRICTION : FRICTION + 3]
        kept, mode = friction.copy(), np.empty((self.count, 3))
        highest_mode(self.points, self.count, mode)
        change = self.wrench_error(q, F)
        if not np.isfinite(change).all():
            return np.inf
        friction -= mode
        change -= self.wrench_error(q, F)
        friction[:] = kept
        return float(relative_change(change, np.concatenate((F, self.g[-1])), self.least))

    def contact_changed(self) -> bool:
        """Whether contact points or friction along patches have changed much since `friction_error`.

        Or a clamp has come down where the cable lies, of whose force more is known then.
        """
        if self._on_plane() > self.on_plane_then:
            return True
        if self.count == 0 or self.model == FRICTIONLESS:
            return False
        if not self.has_patch:
            before, here = self.arc_lengths_then, self.points[: self.count, ARC_LENGTH]
            return len(before) != len(here) or bool(np.abs(here - before).max() > SHIFTED)
        now, then = self._patch_friction(), self.friction_then
        return abs(now - then) > CHANGED * max(now, then)

    def _on_plane(self) -> int:
        """Number of clamps that are on an obstacle's surface, if the cable lies anywhere; see `on_plane`."""
        if not self.has_patch:
            return 0
        assert self.obstacles is not None
        return on_plane(self.obstacles, NOTHING) + on_plane(self.obstacles, self.re)

    def _patch_friction(self) -> float:
        """Sum of the friction along patches."""
        if not self.has_patch:
            return 0.0
        points = self.points[: self.count]
        return float(np.abs(points[points[:, KIND] == SAMPLE, FRICTION : FRICTION + 3]).sum())
