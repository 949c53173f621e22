"""One cable that may touch obstacles: a rod with contact points, which come and go."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from cable_ros.mechanics.effects.contact_kernels import curve
from cable_ros.mechanics.elements import Mesh, primitives
from cable_ros.solve.trust_region import Options
from cable_ros.statics import compiled
from cable_ros.statics.descent import NEAR, descend, give_way
from cable_ros.statics.friction_kernels import COULOMB, FRICTIONLESS, SLIDING
from cable_ros.statics.response import border_response
from cable_ros.statics.rod import Rod
from cable_ros.statics.saddle import NEUTRAL
from cable_ros.statics.touch_meshes import fitted, layered, suited
from cable_ros.statics.touch_points import (
    CAPACITY,
    COLUMNS,
    FORCE,
    FRICTION,
    GRIP,
    HELD,
    KIND,
    OBSTACLE,
    POINT,
    SAMPLE,
    TIE,
    held,
)
from cable_ros.statics.touch_resolution import misplaced
from cable_ros.statics.touch_search import dips, passage, scan
from cable_ros.statics.touch_step import touch
from cable_ros.statics.touch_stretches import resample
from cable_ros.statics.touch_system import nodal, point_forces, system

ROWS = 3 + 6 * CAPACITY
DEEPEST = 1e-5
"""What is deeper inside an obstacle, parts of the length, is no equilibrium."""
RELEASED = 1e30
"""A border so soft, L^3 / EI, holds nothing."""


class TouchingRod(Rod):
    """A `Rod` among obstacles: while nothing touches it is one, bit for bit.

    The contact points belong to its last equilibrium: `advance` and `minimum` change them, together with the
    lengths of the elements, and put them back where they fail.

    Args:
        mesh, stiffness, natural: as in `Rod`.
        tolerance: of the end wrench; it sets how deep a contact may be overlooked and how finely a stretch is
            held.
        density: contact is looked for at so many times as many places as that asks for.
    """

    def __init__(
        self, mesh: Mesh, stiffness: np.ndarray, natural: np.ndarray | None = None, tolerance: float = 1e-4,
        density: int = 1,
    ) -> None:  # fmt: skip
        self.tolerance, self.density = tolerance, density
        # penetration far below 1e-6 at the default tolerance, above the rounding of positions
        self.depth = float(np.clip(1e-5 * tolerance, 1e-12, 1e-8))
        self.sag = 5e-7 * (tolerance / 1e-4) ** 0.5  # what may be inside where no contact point is looked for
        self.give = 0.5 * min(self.sag, 0.1 * tolerance)  # and where only a finer mesh could keep it out
        self.cells, self.spacing, self.samples = 1, 1.0, np.zeros(0)
        self.model = FRICTIONLESS
        self.patience = 0  # so many descents more may be made of steps that fail; see `descent.give_way`
        self.seen: list[np.ndarray] | None = None  # what a search with several starts has found before
        self.sense = np.zeros(3)
        self.points = np.zeros((CAPACITY, COLUMNS))
        self.count, self.rows = 0, 3
        self.settled: np.ndarray | None = None  # the shape to which the gradient with contact belongs
        self.gaps, self.normals = np.zeros(ROWS), np.zeros((CAPACITY, 3))
        super().__init__(mesh, stiffness, natural)

    def _allocate(self, mesh: Mesh) -> None:
        super()._allocate(mesh)
        n = self.elastic.shape[0]
        self.h, self.s0 = self.h.copy(), self.s0.copy()
        self.primitives = primitives(mesh.element)
        # nothing is read of these that was not written: megabytes, of which few rows are ever used
        self.V, self.W, self.borders = np.empty((ROWS, n)), np.empty((ROWS, n)), np.empty((ROWS, n))
        self.lines, self.upto = np.zeros((ROWS, 3)), np.zeros(ROWS, np.int64)
        self.delta, self.complement = np.zeros(ROWS), np.empty((ROWS, ROWS))
        # with friction: `skew_factor`'s
        self.Y_slip, self.S_slip = np.empty((ROWS, n)), np.empty((ROWS, ROWS))
        self.c = np.zeros((len(self.h), len(self.primitives) + 1, 3))
        self.judged = True  # whether `borders` and `complement` are those of the present borders
        self.ready = False  # whether the factors are those of the last equilibrium with its contact points

    def set_conditions(
        self, qe: np.ndarray, re: np.ndarray, f: np.ndarray, obstacles: np.ndarray | None = None
    ) -> None:
        """As `Rod.set_conditions`; `obstacles` (n, WIDTH): see `contact_kernels.gap`."""
        super().set_conditions(qe, re, f)
        if obstacles is not None:
            if self.obstacles is None or len(obstacles) != len(self.obstacles):
                self._sample(len(obstacles))
            self.obstacles = obstacles

    def _sample(self, obstacles: int) -> None:
        """Choose where contact is looked for: as finely as tolerance asks; weight sags little between."""
        weight = float(np.linalg.norm(self.f))
        cells = int(np.clip(np.ceil((weight / (384.0 * self.sag)) ** 0.25), 40, 150))
        self.cells = min(self.density * cells, 150)
        self.spacing = 1.0 / self.cells
        self.samples = np.linspace(0.0, 1.0, self.cells + 1)
        self.phi = np.zeros((obstacles, self.cells + 1))

    def densify(self, density: int) -> None:
        """Look for contact at `density` times as many places as tolerance asks for, from here on."""
        self.density = density
        self._sample(len(self.phi))

    def variant(
        self, mesh: Mesh | None = None, stiffness: np.ndarray | None = None,
        natural: np.ndarray | None = None, scale: float = 1.0, tolerance: float | None = None,
    ) -> TouchingRod:  # fmt: skip
        new = TouchingRod(
            self.mesh if mesh is None else mesh,
            self.K if stiffness is None else stiffness,
            self.natural if natural is None else natural,
            self.tolerance if tolerance is None else tolerance,
            self.density,
        )
        new.set_conditions(self.qe, self.re, self.f / scale, self.obstacles)
        new.model, new.sense = self.model, self.sense
        new.points, new.count, new.normals = self.points.copy(), self.count, self.normals.copy()
        new.points[:, FORCE : HELD + 3] /= scale
        if mesh is not None:
            new.points[:, TIE] = -1.0
            new.count = resample(new.points, new.count, new.h, new.s0)
        return new

    def held(self) -> np.ndarray:
        return np.asarray(held(self.points, self.normals, self.count))

    # solving

    def spend(self, iterations: int) -> None:
        """Count iterations with the present mesh as work done."""
        self.work -= iterations * self.elastic.shape[0]

    def minimum(
        self, q: np.ndarray, F: np.ndarray, options: Options
    ) -> tuple[np.ndarray, np.ndarray, int] | None:
        """Descend with soft obstacles, which any shape can start from, then make them hard."""
        self.ready = False
        if self.count:
            assert self.obstacles is not None
            # mostly the same equilibrium on another mesh: its contacts are known
            q_let, F_let = self._let_go(q, F, options.step_tolerance)
            code, iterations, q_new, F_new = self.touch(
                q_let, F_let, self.qe, self.re, self.f, options.step_tolerance, 1.0, self.obstacles
            )
            if code == compiled.ADVANCED:
                return q_new, F_new, iterations
            return descend(self, q, F, options, NEAR)
        return descend(self, q, F, options)

    def _let_go(self, q: np.ndarray, F: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
        """The equilibrium (q, F) on a fresh mesh with the friction that it had: what sticks goes along.

        A finer mesh shows the shape better everywhere; that is no motion against which friction would act.
        Only where points touch: the samples of a stretch are others on another mesh.
        """
        points = self.points[: self.count]
        if self.model != COULOMB or not points[:, FRICTION:HELD].any() or (points[:, KIND] != POINT).any():
            return q, F
        assert self.obstacles is not None
        kept, mesh = self.state(), self.mesh
        self.model = FRICTIONLESS
        code, _, q_new, F_new = self.touch(
            q, F, self.qe, self.re, self.f, tolerance, 0.6, self.obstacles, remesh=False
        )
        self.model, self.ready = COULOMB, False
        same = self.count == kept[1] and (self.points[: self.count, OBSTACLE] == kept[0][:, OBSTACLE]).all()
        if code == compiled.ADVANCED and same:
            return q_new, F_new
        self.restore(kept, mesh)
        return q, F

    def fit(self, q: np.ndarray) -> np.ndarray:
        """Change to a mesh that holds the contact points well; returns the shape q (n, 4) on it."""
        points = self.points[: self.count]
        return self._onto(fitted(self.mesh.element, list(self.s0[1:]), points, self.spacing), q)

    def resolve(self, q: np.ndarray, F: np.ndarray) -> np.ndarray:
        """Change to a mesh that is fine enough for how end force F bends q about the points; q on it."""
        mesh = layered(self.mesh, self.points[: self.count], float(np.linalg.norm(F)))
        return q if len(mesh.lengths) == len(self.h) else self._onto(mesh, q)

    def _onto(self, mesh: Mesh, q: np.ndarray) -> np.ndarray:
        fresh = self.mesh.interpolate(q, mesh.nodes)
        fresh[0], fresh[-1] = q[0], q[-1]
        self._allocate(mesh)
        self.points[: self.count, TIE] = -1.0
        self.count = resample(self.points, self.count, self.h, self.s0)
        return fresh

    def refactor(self, q: np.ndarray, F: np.ndarray) -> bool:
        if not self.count:
            return super().refactor(q, F)
        curve(q, self.h, self.tables[0], self.primitives, self.c)
        self._normal = self.settled = None
        self.rows = self.system(q, F, FRICTIONLESS)
        self.drift, self.ready = 0.0, self.model == FRICTIONLESS
        return self.border_factor(0.0, 3 + self.count)

    def advance(
        self, q: np.ndarray, F: np.ndarray, qe: np.ndarray, re: np.ndarray, f: np.ndarray,
        tolerance: float, limit: float = 0.6, obstacles: np.ndarray | None = None,
    ) -> tuple[int, int, np.ndarray, np.ndarray]:  # fmt: skip
        assert obstacles is not None
        assert self.obstacles is not None
        if not self.count:
            before = self.qe, self.re, self.f
            self.ready = False
            code, iterations, q_new, F_new = super().advance(q, F, qe, re, f, tolerance, limit)
            if code != compiled.ADVANCED:
                return code, iterations, q_new, F_new
            clearance, crossed = passage(
                q, q_new, self.h, self.s0, self.tables[0], self.primitives, self.c,
                self.samples, self.obstacles, obstacles, self.phi,
            )  # fmt: skip
            near = clearance <= 0.5 * self.spacing
            if not near or (clearance > -self.depth and not self._dips(q_new, obstacles)):
                if crossed:
                    self.set_conditions(*before)
                    return compiled.TOO_FAR, iterations, q_new, F_new
                self.obstacles = obstacles
                return code, iterations, q_new, F_new
            self.set_conditions(*before)
        result = self.touch(q, F, qe, re, f, tolerance, limit, obstacles)
        if result[0] == compiled.ADVANCED:
            return result
        return give_way(self, q, F, qe, re, f, limit, obstacles, result)

    def sunk(self, obstacles: np.ndarray) -> bool:
        """Whether a stretch, or what is beside it, is deeper inside than springs may let it."""
        if not (self.points[: self.count, KIND] == SAMPLE).any():
            return False
        if self.gaps[: self.count].min() < -DEEPEST:
            return True
        scan(self.c, self.h, self.s0, self.samples, obstacles, self.phi)
        return float(self.phi[:, 1:-1].min()) < -DEEPEST

    def clear(self, q: np.ndarray) -> bool:
        """Whether the shape q (n, 4) is nowhere inside an obstacle, between the samples neither."""
        assert self.obstacles is not None
        curve(q, self.h, self.tables[0], self.primitives, self.c)
        scan(self.c, self.h, self.s0, self.samples, self.obstacles, self.phi)
        return not self._dips(q, self.obstacles)

    def _dips(self, q: np.ndarray, obstacles: np.ndarray) -> bool:
        return bool(dips(q, self.h, self.s0, self.mesh.element.nodes, self.c, self.samples,
                         obstacles, self.phi, self.depth))  # fmt: skip

    def state(self) -> tuple[np.ndarray, int, np.ndarray, np.ndarray]:
        """What `restore` takes: contact points, their number, lengths and starts of the elements."""
        return self.points[: self.count].copy(), self.count, self.h.copy(), self.s0.copy()

    def restore(
        self, state: tuple[np.ndarray, int, np.ndarray, np.ndarray], mesh: Mesh | None = None
    ) -> None:
        """Put back a `state`; and where it may have changed the `mesh`, too."""
        if mesh is not None and self.mesh is not mesh:
            self._allocate(mesh)
        points, self.count, self.h[:], self.s0[:] = state
        self.points[: self.count] = points

    def touch(
        self, q: np.ndarray, F: np.ndarray, qe: np.ndarray, re: np.ndarray, f: np.ndarray,
        tolerance: float, limit: float, obstacles: np.ndarray, remesh: bool = True,
    ) -> tuple[int, int, np.ndarray, np.ndarray]:  # fmt: skip
        """One solve with contact points, from the equilibrium (q, F) with its own; see `touch_step.touch`."""
        kept, sense, mesh = self.state(), self.sense, self.mesh
        self.latest = None  # the gradient will be another's
        Y, S = (self.borders, self.complement) if self.model == FRICTIONLESS else (self.Y_slip, self.S_slip)
        spent = 0
        if remesh and self.model == SLIDING:
            q, F, spent = self._reverse(q, F, re, tolerance, limit)
        q_new, F_new = np.empty_like(q), np.empty(3)
        try:
            known = self.settled is q
            code, iterations, self.count, self.rows, moved, turned = touch(
                q, F, qe, re, f, self.K, self.natural, self.h, self.s0, self.tables, self.mesh.element.nodes,
                self.primitives, self.samples, obstacles, self.obstacles, self.sense, self.model,
                self.points, self.count, self.rows, self.ready, known, self.f, self.gaps, self.normals,
                self.elastic, self.geometric, self.parts, self.C, self.A, self.L, self.pivots, self.V, self.W,
                self.delta, self.lines, self.upto, Y, S, self.acc, self.g, self.radial, self.totals,
                tolerance, self.depth, self.give, limit, self.drift, self.refresh, q_new, F_new,
            )  # fmt: skip
        except np.linalg.LinAlgError:
            code, iterations, moved, turned = compiled.NOT_CONTRACTING, 0, False, np.inf
        self.spend(iterations)
        self.ready, same = code == compiled.ADVANCED, self.count == kept[1]
        age = self.drift + 2.0 * float(np.abs(q_new - q).max()) if self.ready else np.inf
        if self.model == COULOMB and turned == 0.0 and same and age < self.refresh:
            # what slips has new factors in most steps: no reason to judge them as often
            turned, self.judged = age, False
        if self.ready and self.model != FRICTIONLESS and turned == 0.0:
            # with friction as it stands; the iteration's own factors say nothing about stability, but they
            # are what predicts the next step
            code = compiled.ADVANCED if self.border_factor(0.0, 3 + self.count) else compiled.NOT_CONVEX
        if code != compiled.ADVANCED:
            self.restore(kept, mesh)
            self.sense = sense
            return code, iterations + spent, q_new, F_new
        curve(q_new, self.h, self.tables[0], self.primitives, self.c)
        sunk, before = self.sunk(obstacles), (self.qe, self.re, self.f, self.obstacles)
        self.set_conditions(qe, re, f, obstacles)
        self.age, self.drift = age, turned if same else 0.0
        self.mesh = Mesh(self.mesh.element, self.h.copy())
        if moved and remesh:
            finer = self._remesh(q_new, F_new, iterations, tolerance)
            if finer is not None:
                return finer
            if not sunk:
                ready = self.refactor(q_new, F_new)
                return compiled.ADVANCED if ready else compiled.NOT_CONVEX, iterations, q_new, F_new
        if sunk:
            self.restore(kept, mesh)
            self.set_conditions(*before)
            self.sense, self.ready = sense, False
            return compiled.NOT_CONTRACTING, iterations, q_new, F_new
        if not self.count:
            super().refactor(q_new, F_new)
        self.settled = q_new
        return code, iterations, q_new, F_new

    def _reverse(
        self, q: np.ndarray, F: np.ndarray, re: np.ndarray, tolerance: float, limit: float
    ) -> tuple[np.ndarray, np.ndarray, int]:
        """Turn mobilised friction against the way the end now goes, little by little where it turns back.

        Returns the equilibrium reached and the iterations it took.
        """
        way = re - self.re
        size = float(np.linalg.norm(way))
        if size < 1e-12:
            return q, F, 0
        before, after = self.sense, way / size
        spent = 0
        if self.count and before @ after <= 0.0 and self.obstacles is not None:
            for part in np.linspace(0.75, -0.75, 7):
                self.sense = part * before if part > 0.0 else -part * after
                code, iterations, q_new, F_new = self.touch(
                    q, F, self.qe, self.re, self.f, tolerance, limit, self.obstacles, remesh=False
                )
                spent += iterations
                if code == compiled.ADVANCED:
                    q, F = q_new, F_new
        self.sense = after
        return q, F, spent

    def _remesh(
        self, q: np.ndarray, F: np.ndarray, iterations: int, tolerance: float
    ) -> tuple[int, int, np.ndarray, np.ndarray] | None:
        """The equilibrium (q, F) on a mesh that holds its contact points better; None: not found."""
        old, kept = self.mesh, self.state()
        fresh = self.fit(q)
        assert self.obstacles is not None
        fresh, F_fresh = self._let_go(fresh, F, tolerance)
        code, more, q_new, F_new = self.touch(
            fresh, F_fresh, self.qe, self.re, self.f, tolerance, 0.6, self.obstacles, remesh=False
        )
        self.drift = 0.0
        if code == compiled.ADVANCED:
            return code, iterations + more, q_new, F_new
        self.restore(kept, old)
        return None

    def unresolved(self, q: np.ndarray, leeway: float = 1.0) -> np.ndarray:
        """Which elements (elements,) are too long to stay where contacts hold them; see `give`."""
        if not self.count:
            return super().unresolved(q, leeway)
        out = np.empty(len(self.h))
        curve(q, self.h, self.tables[0], self.primitives, self.c)
        misplaced(q, self.h, self.s0, self.fine, self.c, self.obstacles, self.points, self.count, out)
        return out > 2.0 * leeway * self.give

    def suited(self, mesh: Mesh) -> Mesh:
        return suited(mesh, self.points[: self.count])

    # the borders' algebra

    def system(self, q: np.ndarray, F: np.ndarray, model: int) -> int:
        """Gradient, Hessian and borders at (q, F) with the contact points as they are; number of borders."""
        rows, _, _ = system(
            q, F, self.f, self.K, self.natural, self.h, self.s0, self.tables, self.mesh.element.nodes,
            self.primitives, self.c, self.obstacles, self.c, self.h, self.s0, self.obstacles, self.sense,
            model, False, self.points, self.count, self.gaps, self.normals, self.acc, self.g, self.radial,
            self.totals, self.elastic, self.geometric, self.parts, self.C, self.V, self.W, self.delta,
            self.lines, self.upto, True,
        )  # fmt: skip
        return int(rows)

    def border_factor(self, mu: float, equalities: int) -> bool:
        """Factor the bordered system; whether it is positive definite on the equalities' tangent space."""
        self.judged = True
        return bool(compiled.border_factor(
            self.elastic, self.geometric, mu, self.mesh.element.order, self.A, self.L, self.pivots,
            self.V, self.delta, self.rows, equalities, self.borders, self.complement,
        ))  # fmt: skip

    def _judge(self) -> None:
        """Have factors that tell of stability and errors, not those of the iteration with friction."""
        if not self.judged:
            self.border_factor(0.0, 3 + self.count)

    def border_step(self, gradient: np.ndarray, constraints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `compiled.border_step`."""
        s, y = np.empty(gradient.shape[0]), np.empty(self.rows)
        compiled.border_step(gradient, constraints, self.V, self.rows, self.mesh.element.order, self.L,
                             self.pivots, self.borders, self.complement, s, y)  # fmt: skip
        return s, y

    # what a solution says

    def _softest(self) -> float:
        if not self.count:
            return super()._softest()
        self._judge()
        return float(compiled.margin(
            self.elastic, self.V, self.rows, self.mesh.element.order, self.L, self.pivots, self.borders,
            self.complement, self.mode, self.waves(), 50,
        ))  # fmt: skip

    def snapshot(self) -> Callable[[], Rod]:
        return partial(_standing, self, self.mesh, self.points[: self.count].copy(), self.obstacles)

    def clamp_stiffness(self, q: np.ndarray, F: np.ndarray) -> np.ndarray:
        """See `response.clamp_response`; the contacts hold, and friction stays what it is, in the world."""
        if not self.count:
            return super().clamp_stiffness(q, F)
        curve(q, self.h, self.tables[0], self.primitives, self.c)
        self.rows = self.system(q, F, FRICTIONLESS)
        self.border_factor(-NEUTRAL, 3 + self.count)
        held = self.held()
        return np.asarray(border_response(
            F, F + self.f + held, self.qe, self.elastic, self.geometric, self.V, self.rows, self.lines,
            self.mesh.element.order, self.L, self.pivots, self.borders, self.complement, self.g,
        ))  # fmt: skip

    def wrench_error(self, q: np.ndarray, F: np.ndarray) -> np.ndarray:
        if not self.count:
            return super().wrench_error(q, F)
        self._judge()
        Fe, residual = np.empty((len(self.h), 3)), np.empty(self.g.size)
        point_forces(q, F, self.h, self.s0, self.tables[0], self.tables[4], self.primitives, self.points,
                     self.normals, self.count, Fe, self.acc)  # fmt: skip
        nodal(q, self.acc, residual)
        curve(q, self.h, self.tables[0], self.primitives, self.c)
        coarse = np.vstack([self.c[:, 0], self.c[-1].sum(axis=0)])
        # what sticks does so where this mesh has put it: the force stays, no border holds the place
        grips = np.abs(self.points[: self.count, GRIP]).astype(int)
        held = np.concatenate([grips[grips > 0], 1 + grips[self.points[: self.count, GRIP] > 0.0]])
        complement = self.complement
        if len(held) and self.model == COULOMB:
            complement = complement.copy()
            complement[held, held] = RELEASED
        return np.asarray(compiled.error(
            q, Fe, self.re, self.f, self.K, self.natural, self.h, self.s0, self.fine, self.bubble,
            self.elastic, self.geometric, self.V, self.rows, self.lines, self.upto, coarse, self.L,
            self.pivots, self.borders, complement, self.g, residual, self.shares,
        ))  # fmt: skip


def _standing(rod: TouchingRod, mesh: Mesh, points: np.ndarray, obstacles: np.ndarray | None) -> TouchingRod:
    """A rod like `rod`, among these obstacles and with these contact points (k, COLUMNS)."""
    new = rod.variant(mesh)
    new.count = len(points)
    new.points[: new.count] = points
    new.set_conditions(rod.qe, rod.re, rod.f, obstacles)
    return new
