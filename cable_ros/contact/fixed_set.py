# SPDX-License-Identifier: Apache-2.0
"""A rod with contact points as they are: their constraint rows, and what they say about an equilibrium."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cable_ros.common.backoff import Backoff
from cable_ros.contact.assembly import nodal
from cable_ros.contact.clamp_force import clamp_error
from cable_ros.contact.contact_entry_points import assemble_kkt, point_forces
from cable_ros.contact.dead_loads import DeadLoads
from cable_ros.contact.distance import FRICTION_COEFFICIENT
from cable_ros.contact.friction_kernels import COULOMB, FRICTIONLESS, SLIDING, STICK
from cable_ros.contact.gap_search import dips, scan
from cable_ros.contact.meshing import suited
from cable_ros.contact.path_error import NONE
from cable_ros.contact.points import (
    ARC_LENGTH,
    ARM,
    BEFORE,
    CAPACITY,
    COLUMNS,
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
    total_force,
)
from cable_ros.contact.resolution import highest_mode, misplaced
from cable_ros.contact.response import HELD, UNSTRAINED, Contacts, wrench_response
from cable_ros.rod import entry_points, error_estimate
from cable_ros.rod.centreline import curve
from cable_ros.rod.elements import Mesh
from cable_ros.rod.kirchhoff import NOTHING, Rod
from cable_ros.rod.units import relative_change

ROWS = 3 + 6 * CAPACITY
LARGE = {"V": False, "W": False, "responses": False, "Y_slip": False, "complement": True, "S_slip": True}
"""Arrays with ROWS rows, by name, and whether they have as many columns."""
DEEPEST = 1e-5
"""Maximum depth inside an obstacle of an equilibrium, L."""
BEDDING = 4e3
"""Stiffness of stick per length along a patch, EI / L^4, times the tolerance. A cable that resists its clamps
by less than that is off by less than the tolerance. Where stick is rigid, neighbouring samples share their
friction in any way, anew with every one that begins to slip: Newton's method loses its way."""
FRICTION_SHORTENS = 0.3
"""Length of elements along a patch with friction over that along others."""
CREEP_SHORTENS = 0.4
"""The same of a cable that stretches."""
CHANGED, SHIFTED = 0.1, 1e-3
"""Relative change of friction, and motion of a contact point along the cable, L, after which the error is
estimated again."""
START = 0.2
"""Weight of an error of the start's wrench beside one of the end's."""
RELEASED = 1e30
"""Compliance of a constraint row, L^3 / EI, that holds nothing."""


LONGEST_STAY = 31
"""Maximum number of steps that keep a mesh after another one failed."""

SAME_COMPLIANCE = 0.01
"""Maximum change of the end's compliance, relative, with which factors still serve."""
NO_ROWS = np.zeros(0, int)
UNSTRAINED_HELD = NOTHING, UNSTRAINED, np.zeros((0, 0)), np.zeros((0, 0)), HELD
"""`Strain` of a cable that keeps its length and is held at its end."""


class FixedSetRod(Rod):
    """A `Rod` with contact points, which `TouchingRod` finds: while there are none it is one, bit for bit.

    Args:
        mesh, stiffness, natural: as in `Rod`.
        tolerance: of the end wrench; it sets the depth at which a contact may be overlooked, and the spacing
            of the samples.
        density: number of samples over that which the tolerance asks for.
    """

    def __init__(
        self, mesh: Mesh, stiffness: np.ndarray, natural: np.ndarray | None = None, tolerance: float = 1e-4,
        density: int = 1, **more: np.ndarray,
    ) -> None:  # fmt: skip
        self.tolerance, self.density = tolerance, density
        # penetration far below 1e-6 at the default tolerance, above the rounding of positions
        self.depth = float(np.clip(1e-5 * tolerance, 1e-12, 1e-8))
        # depth between two samples, and where only a finer mesh could be clear of the obstacle
        self.sag = 5e-7 * (tolerance / 1e-4) ** 0.5
        self.give = 0.5 * min(self.sag, 0.1 * tolerance)
        self.cells, self.spacing, self.samples = 1, 1.0, np.zeros(0)
        self.model = FRICTIONLESS
        # descents that are left for steps that fail, see `penalty_continuation.descend_instead`
        self.patience = 0
        self._remeshing = Backoff(LONGEST_STAY)
        self.seen: list[np.ndarray] | None = None  # states that a search with several starts has found
        self.direction, self.presliding = np.zeros(3), 0.0  # see `contact_state.History`
        self.followed = NONE  # the path so far, see `PathError`
        self.bedding = self.softest_bedding = BEDDING / tolerance
        self.drag = 0.0  # see `contact_state.Options`
        self.points = np.zeros((CAPACITY, COLUMNS))
        self.count, self.rows = 0, 3
        # `_patch_friction` and the contact points' arc lengths when `friction_error` was last computed
        self.friction_then, self.arc_lengths_then = 0.0, np.zeros(0)
        self.settled: np.ndarray | None = None  # the shape at which the gradient with contact was computed
        self.gaps, self.normals = np.zeros(ROWS), np.zeros((CAPACITY, 3))
        super().__init__(mesh, stiffness, natural, **more)

    def _allocate(self, mesh: Mesh) -> None:
        super()._allocate(mesh)
        n = self.elastic.shape[0]
        # megabytes, of which few rows are ever used: nothing is read that was not written
        self.V, self.W, self.responses = np.empty((ROWS, n)), np.empty((ROWS, n)), np.empty((ROWS, n))
        self.lines = np.zeros((ROWS, 3))
        self.upto, self.owners = np.zeros(ROWS, np.int64), np.zeros(ROWS, np.int64)
        self.delta, self.complement = np.zeros(ROWS), np.empty((ROWS, ROWS))
        # with friction: `skew_factor`'s
        self.Y_slip, self.S_slip = np.empty((ROWS, n)), np.empty((ROWS, ROWS))
        self.c = np.zeros((len(self.h), len(self.tables.points) + 1, 3))
        self.judged = True  # whether `responses` and `complement` are those of the present constraint rows
        self.ready = False  # whether the factors are those of the last equilibrium with its contact points

    def __getstate__(self) -> dict[str, Any]:
        """Of the large arrays only the rows in use: the others hold what was in memory before."""
        state = self.__dict__.copy()
        for name, square in LARGE.items():
            state[name] = state[name][: self.rows, : self.rows if square else None].copy()
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        for name, square in LARGE.items():
            used = state[name]
            whole = np.empty((ROWS, ROWS if square else used.shape[1]))
            whole[: used.shape[0], : used.shape[1]] = used
            setattr(self, name, whole)

    def set_conditions(
        self, qe: np.ndarray, re: np.ndarray, f: np.ndarray, obstacles: np.ndarray | None = None
    ) -> None:
        """As `Rod.set_conditions`; `obstacles` (n, WIDTH): see `distance.gap`."""
        super().set_conditions(qe, re, f)
        if obstacles is not None:
            if self.obstacles is None or len(obstacles) != len(self.obstacles):
                self._sample(len(obstacles))
            self.obstacles = obstacles

    def _sample(self, obstacles: int) -> None:
        """Choose samples at which contact is looked for, so close that the cable sags little in between."""
        weight = float(np.linalg.norm(self.f))
        cells = int(np.clip(np.ceil((weight / (384.0 * self.sag)) ** 0.25), 40, 150))
        self.cells = min(self.density * cells, 150)
        self.spacing = 1.0 / self.cells
        self.samples = np.linspace(0.0, 1.0, self.cells + 1)
        self.phi = np.zeros((obstacles, self.cells + 1))

    def densify(self, density: int) -> None:
        """Look for contact at `density` times as many samples as the tolerance asks for, from here on."""
        self.density = density
        self._sample(len(self.phi))

    def contact_force(self) -> np.ndarray:
        if not self.count:
            return NOTHING
        out = np.empty(3)
        total_force(self.points, self.normals, self.count, out)
        return out

    # groups of `contact_state` and `rod_state`, as plain tuples, see `rod.entry_points`

    def shape(self, q: np.ndarray) -> tuple[Any, ...]:
        """`Shape` of the nodal frames q (n, 4); its centreline is that of the last `trace`."""
        return q, self.c, self.grid

    @property
    def contacts(self) -> tuple[np.ndarray, ...]:
        """`ContactSet`."""
        return self.points, self.gaps, self.normals

    @property
    def constraints(self) -> tuple[np.ndarray, ...]:
        """`ConstraintRows`."""
        return self.V, self.W, self.delta, self.lines, self.upto, self.owners

    def kkt(self, factors: tuple[np.ndarray, ...]) -> tuple[tuple[np.ndarray, ...], ...]:
        """`KKT` with these factors."""
        evaluation, tangents, _ = self.saddle
        return evaluation, tangents, self.constraints, factors, self.strain

    def _factors(self, complement: np.ndarray) -> tuple[np.ndarray, ...]:
        """`Factors` for stability and error estimates, with this Schur complement."""
        return self.A, self.L, self.pivots, self.responses, complement

    end_compliance = HELD
    """(3, 3) how far the end gives way to changes of the end force since the last equilibrium, L^3 / EI: that
    of a cable that is all but straight must, if what pulls it is given; see `yield_at_end`."""
    _yields = False

    def yield_at_end(self, compliance: np.ndarray) -> None:
        """Set the `end_compliance` (3, 3)."""
        other = np.abs(compliance - self.end_compliance).max()
        self.end_compliance, self._yields = compliance, bool(compliance.any())
        self.ready = self.ready and bool(other <= SAME_COMPLIANCE * np.abs(compliance).max())

    @property
    def bare(self) -> bool:
        """Whether two clamps hold it, and nothing else: it has no constraint rows but those of its end."""
        return self.count == 0 and not self._yields

    @property
    def strain(self) -> tuple[np.ndarray, ...]:
        """`Strain`."""
        return (*UNSTRAINED_HELD[:-1], self.end_compliance) if self._yields else UNSTRAINED_HELD

    # where it is

    def trace(self, q: np.ndarray, F: np.ndarray | None = None) -> None:
        """Compute the centreline of the nodal frames q (n, 4); a cable that stretches needs the end force F,
        or takes that of the last time.
        """
        curve(q, self.h, self.tables.values, self.tables.primitives, self.c)

    @property
    def has_patch(self) -> bool:
        """Whether it lies along an obstacle."""
        return SAMPLE in self.points[: self.count, KIND].tolist()  # for few points quicker than NumPy

    def sunk(self, q: np.ndarray, F: np.ndarray, obstacles: np.ndarray) -> bool:
        """Whether a patch, or what is beside it, is deeper inside an obstacle than its springs allow.

        q, F: (n, 4) nodal frames and (3,) end force.
        """
        if not self.has_patch:
            return False
        if self.gaps[: self.count].min() < -DEEPEST:
            return True
        self.trace(q, F)
        scan(self.c, self.h, self.s0, self.samples, obstacles, self.phi)
        return float(self.phi[:, 1:-1].min()) < -DEEPEST

    def clear(self, q: np.ndarray) -> bool:
        """Whether the shape q (n, 4) is nowhere inside an obstacle, between the samples neither."""
        assert self.obstacles is not None
        self.trace(q)
        scan(self.c, self.h, self.s0, self.samples, self.obstacles, self.phi)
        return not self._dips(q, self.obstacles)

    def _dips(self, q: np.ndarray, obstacles: np.ndarray) -> bool:
        return bool(dips(self.shape(q), self.samples, obstacles, self.phi, self.depth))

    def finest(self) -> float:
        """Maximum length, L, of an element along a patch; friction is less smooth than pressure."""
        if self.model != COULOMB:
            return self.spacing
        return (CREEP_SHORTENS if self.creeps else FRICTION_SHORTENS) * self.spacing

    @property
    def touches(self) -> bool:  # type: ignore[override]
        return self.count > 0

    def unresolved(self, q: np.ndarray, leeway: float = 1.0) -> np.ndarray:
        """(m,) which elements are too long to stay clear of the obstacles between the samples; see `give`."""
        if not self.count:
            return super().unresolved(q, leeway)
        out = np.empty(len(self.h))
        self.trace(q)
        fine = self.fine.values, self.fine.weights
        misplaced(
            (q, self.c, self.h, self.s0), fine, self._bare(q), self.obstacles, self.points, self.count, out
        )
        return out > 2.0 * leeway * self.give

    def _bare(self, q: np.ndarray) -> np.ndarray:
        """The coefficients of the traced centreline of q (n, 4) without axial strain."""
        return self.c

    def suited(self, mesh: Mesh) -> Mesh:
        return suited(mesh, self.points[: self.count])

    # the constraint rows

    def assemble(self, q: np.ndarray, F: np.ndarray, model: int) -> int:
        """Gradient, Hessian and constraint rows at (q, F) with the present contact points; number of rows."""
        friction = model, self.direction, self.presliding, self.bedding
        history = *friction, self.c, self.c, self.h, self.s0, self.obstacles
        return int(assemble_kkt(
            self.shape(q), (F, self.f), self.section, self.obstacles, history, self.contacts, self.count,
            self.kkt(self._factors(self.complement)),
        ))  # fmt: skip

    def refactor(self, q: np.ndarray, F: np.ndarray) -> bool:
        if self.bare:
            return super().refactor(q, F)
        self.trace(q, F)
        self._normal = self.settled = None
        points = self.points[: self.count]
        points[:, BEFORE : BEFORE + 3] = points[:, FRICTION:BEFORE]  # what sticks holds the cable
        self.rows = self.assemble(q, F, self.model if self.model == COULOMB else FRICTIONLESS)
        self.rotation, self.ready = 0.0, self.model == FRICTIONLESS
        return self.kkt_factor(0.0, 3 + self.count)

    def kkt_factor(self, mu: float, equalities: int) -> bool:
        """Factor the bordered system; whether it is positive definite on the equalities' tangent space."""
        self.judged = True
        system = *self.saddle[:2], self._factors(self.complement)
        reach, give = self.strain[2], self.end_compliance
        turning = self._turning_rows()
        kept, self.V[turning] = self.V[turning], 0.0  # friction as it is
        definite = entry_points.kkt_factor(mu, system, self.V, self.delta, reach, give, self.rows, equalities)
        self.V[turning] = kept
        return bool(definite)

    def _turning_rows(self) -> np.ndarray:
        """Numbers of the constraint rows by which friction turns with the cable."""
        if self.model != SLIDING:
            return NO_ROWS
        rows = self.points[: self.count, SLIP_ROW].astype(int)
        rows = rows[rows > 0]
        return np.concatenate([rows, rows + 1])

    def _judge(self) -> None:
        """Compute factors for stability and error estimates: those of the iteration with friction are not."""
        if not self.judged:
            self.kkt_factor(0.0, 3 + self.count)

    def kkt_step(self, gradient: np.ndarray, constraints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `bordered.kkt_step`."""
        s, y = np.empty(gradient.shape[0]), np.empty(self.rows)
        order, factors = self.mesh.element.order, self._factors(self.complement)
        entry_points.kkt_step(gradient, constraints, self.V, self.rows, order, factors, s, y)
        return s, y

    # what an equilibrium says

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
        if self.compliance.any() and self.model == COULOMB and self.rough().any():
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
        return np.where(points[:, KIND] == SAMPLE, np.minimum(self.bedding * points[:, LENGTH], STICK), STICK)

    def rough(self) -> np.ndarray:
        """(count,) which contact points press on an obstacle with friction."""
        assert self.obstacles is not None
        points = self.points[: self.count]
        coefficients = self.obstacles[points[:, OBSTACLE].astype(int), FRICTION_COEFFICIENT]
        return np.asarray((coefficients > 0.0) & (points[:, FORCE] > 0.0))

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
        return np.asarray(error_estimate.error(
            q, Fe, (self.qe, re, self.f), self.section, self.grid, self.enrichment,
            (*self.saddle[:2], self._factors(complement)), self.constraints, self.rows,
            (boundaries, residual, self.shares),
        ))  # fmt: skip

    def _without_strain(self, q: np.ndarray, F: np.ndarray, boundaries: np.ndarray) -> np.ndarray:
        """The end position (3,) and, in place, the elements' `boundaries` (m + 1, 3) without the displacement
        by axial strain, whose pull on the nodes is added to `acc`.
        """
        return boundaries[-1] if self._yields else self.re

    def clamp_errors(self, q: np.ndarray, F: np.ndarray) -> np.ndarray:
        """(2,) relative errors of the clamps' forces where the cable lies beside them; see `clamp_error`.

        An error of the start's wrench counts for a fifth: the tolerance is the end's.
        """
        if not self.has_patch:
            return np.zeros(2)
        assert self.obstacles is not None
        points = self.points[: self.count]
        even = self.K[0] == self.K[1] and not self.natural[:2].any()
        starts = NOTHING, q[0], F + self.f + self.contact_force(), -self.g[0]
        ends = self.re, q[-1], F, self.g[-1]
        section = self.K[0] if even else 0.0, self.compliance[2]
        grid = self.h, self.s0
        size = relative_change(np.array([1.0, 0, 0, 0, 0, 0]), np.concatenate((F, self.g[-1])), self.least)
        errors = [
            clamp_error(s, clamp, section, grid, points, self.obstacles)
            for s, clamp in ((0.0, starts), (1.0, ends))
        ]
        return size * np.array([START * errors[0], errors[1]])

    def friction_error(self, q: np.ndarray, F: np.ndarray) -> float:
        """As `relative_error`, for friction along patches between the samples.

        It is taken to be as large as the highest mode that the samples resolve on each element. That is
        little if friction is smooth, but friction keeps its history, and the wrench of a cable that is nearly
        free to move sideways depends on it.
        """
        self.friction_then = self._patch_friction()
        self.arc_lengths_then = self.points[: self.count, ARC_LENGTH].copy()
        if self.friction_then == 0.0:
            return 0.0
        friction = self.points[: self.count, FRICTION : FRICTION + 3]
        kept, mode = friction.copy(), np.empty((self.count, 3))
        highest_mode(self.points, self.count, mode)
        change = self.wrench_error(q, F)
        friction -= mode
        change -= self.wrench_error(q, F)
        friction[:] = kept
        return float(relative_change(change, np.concatenate((F, self.g[-1])), self.least))

    def contact_changed(self) -> bool:
        """Whether contact points or friction along patches have changed much since `friction_error`."""
        if self.count == 0 or self.model == FRICTIONLESS:
            return False
        if not self.has_patch:
            before, here = self.arc_lengths_then, self.points[: self.count, ARC_LENGTH]
            return len(before) != len(here) or bool(np.abs(here - before).max() > SHIFTED)
        now, then = self._patch_friction(), self.friction_then
        return abs(now - then) > CHANGED * max(now, then)

    def _patch_friction(self) -> float:
        """Sum of the friction along patches."""
        if not self.has_patch:
            return 0.0
        points = self.points[: self.count]
        return float(np.abs(points[points[:, KIND] == SAMPLE, FRICTION : FRICTION + 3]).sum())
