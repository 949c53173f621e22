# SPDX-License-Identifier: Apache-2.0
"""A rod with contact points as they are: where it is, and their constraint rows."""

from __future__ import annotations

from typing import Any

import numpy as np

from cable_ros.common.backoff import Backoff
from cable_ros.contact.contact_entry_points import assemble_kkt
from cable_ros.contact.distance import FRICTION_COEFFICIENT
from cable_ros.contact.friction_kernels import COULOMB, FRICTIONLESS, SLIDING
from cable_ros.contact.gap_search import dips, scan
from cable_ros.contact.meshing import suited
from cable_ros.contact.path_error import NONE
from cable_ros.contact.points import (
    ARC_LENGTH,
    BEFORE,
    CAPACITY,
    COLUMNS,
    FORCE,
    FRICTION,
    KIND,
    OBSTACLE,
    POINT,
    SAMPLE,
    SLIP_ROW,
    SLOPE_ROW,
    STICK_ROW,
    total_force,
)
from cable_ros.contact.resolution import misplaced
from cable_ros.contact.response import HELD, UNSTRAINED
from cable_ros.contact.rough_points import slip_rows
from cable_ros.rod import entry_points
from cable_ros.rod.centreline import curve
from cable_ros.rod.elements import Mesh
from cable_ros.rod.extensible import SAME_COMPLIANCE
from cable_ros.rod.kirchhoff import NOTHING, Rod

ROWS = 3 + 6 * CAPACITY
LARGE = {"V": False, "W": False, "responses": False, "Y_slip": False, "complement": True, "S_slip": True}
"""Arrays with ROWS rows, by name, and whether they have as many columns."""
PULL = 1e-6
"""Part of the largest contact force by which nothing may pull."""
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

SLIP_JUDGED = 1e-4
"""Least slip, L, with which the stability of an even shape is judged: what grows e-fold within so much is not
stable. A cable dragged across a slot stayed even in steps of 1e-5, 8 to 10 % off."""
LONGEST_STAY = 31
"""Maximum number of steps that keep a mesh after another one failed."""

NO_ROWS = np.zeros(0, int)
UNSTRAINED_HELD = NOTHING, UNSTRAINED, np.zeros((0, 0)), np.zeros((0, 0)), HELD
"""`Strain` of a cable that keeps its length and is held at its end."""


class ConstrainedRod(Rod):
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
        self.unforeseen = 0.0  # of `slip_kernels.slip_bend`, in the last step
        self.bedding = self.softest_bedding = BEDDING / tolerance
        self.drag, self.carried = 0.0, False  # see `contact_state.Options`
        self.points = np.zeros((CAPACITY, COLUMNS))
        self.count, self.rows = 0, 3
        # `_patch_friction` and the contact points' arc lengths when `friction_error` was last computed
        self.friction_then, self.arc_lengths_then, self.on_plane_then = 0.0, np.zeros(0), 0
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
        self.movers, self.shifts = np.zeros(ROWS, np.int64), np.zeros(ROWS)
        self.delta, self.complement = np.zeros(ROWS), np.empty((ROWS, ROWS))
        # with friction: `skew_factor`'s
        self.Y_slip, self.S_slip = np.empty((ROWS, n)), np.empty((ROWS, ROWS))
        self.c = np.zeros((len(self.h), len(self.tables.points) + 1, 3))
        self.even = False  # whether it is its own image, nearly, at the last equilibrium
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
        marks = self.upto, self.owners, self.movers, self.shifts
        return self.V, self.W, self.delta, self.lines, *marks

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
        """(m,) which elements are too long to stay clear of the obstacles between the samples, see `give`, or
        so long that an obstacle would have to pull.
        """
        if not self.count:
            return super().unresolved(q, leeway)
        out = np.empty(len(self.h))
        self.trace(q)
        fine = self.fine.values, self.fine.weights
        misplaced(
            (q, self.c, self.h, self.s0), fine, self._bare(q), self.obstacles, self.points, self.count,
            self.spacing, out,
        )  # fmt: skip
        long = out > 2.0 * leeway * self.give
        if self.model != FRICTIONLESS:
            return long
        forces = self.points[: self.count, FORCE]
        pull = self.points[: self.count, ARC_LENGTH][forces < -PULL * forces.max()]
        long[np.searchsorted(self.s0, pull, side="right") - 1] = True
        return long

    def _bare(self, q: np.ndarray) -> np.ndarray:
        """The coefficients of the traced centreline of q (n, 4) without axial strain."""
        return self.c

    def suited(self, mesh: Mesh) -> Mesh:
        return suited(mesh, self.points[: self.count])

    # the constraint rows

    def assemble(self, q: np.ndarray, F: np.ndarray, model: int) -> int:
        """Gradient, Hessian and constraint rows at (q, F) with the present contact points; number of rows."""
        friction = model, self.direction, self.presliding, self.bedding, False, 0.0
        history = *friction, self.c, self.c, self.h, self.s0, self.obstacles
        assert len(q) == len(self.mesh.nodes)  # compiled code does not look
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
        slips, gives = self._slip_rows() if self.even else (NO_ROWS, np.zeros(0))
        stiff, self.delta[slips] = self.delta[slips], gives
        carried = self._carried_rows()
        W = self.V if not len(carried) else self.V.copy()
        W[carried] = self.W[carried]
        rows = self.V, W, self.delta
        try:
            stable = entry_points.kkt_factor(
                mu, system, rows, len(carried) > 0, reach, give, self.rows, equalities
            )
        except np.linalg.LinAlgError:
            stable = False
        self.V[turning] = kept
        self.delta[slips] = stiff
        return bool(stable)

    def _slip_rows(self) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of the constraint rows that hold a slip's direction more than one of SLIP_JUDGED, and how
        that would give, L^3 / EI.

        Friction turns with slip, by the force over the length of slip: in short steps it would hold anything,
        though what is uneven by nothing grows as slip goes on.
        """
        if self.model != COULOMB or self.obstacles is None:
            return NO_ROWS, np.zeros(0)
        rows, gives = np.empty(self.count, np.int64), np.empty(self.count)
        n = slip_rows(self.points, self.count, self.obstacles, self.delta, SLIP_JUDGED, rows, gives)
        return rows[:n], gives[:n]

    def _coefficients(self, points: np.ndarray | None = None) -> np.ndarray:
        """(k,) coefficients of friction of the obstacles that `points` (k, COLUMNS) are on, or its own."""
        if self.obstacles is None:
            return np.zeros(0)
        points = self.points[: self.count] if points is None else points
        return self.obstacles[points[:, OBSTACLE].astype(int), FRICTION_COEFFICIENT]

    def _carried_rows(self) -> np.ndarray:
        """Numbers of the constraint rows by which a point that sticks and rolls takes its friction along."""
        if self.model != COULOMB or self.soft:
            return NO_ROWS
        points = self.points[: self.count]
        rolls = (points[:, KIND] == POINT) & (points[:, STICK_ROW] > 0.0) & (points[:, SLOPE_ROW] > 0.0)
        return points[rolls, SLOPE_ROW].astype(int)

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
