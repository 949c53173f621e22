# SPDX-License-Identifier: Apache-2.0
"""A rod with contact points that come and go, by Newton's method on a changing active set alone."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from cable_ros.contact.friction_kernels import COULOMB, FRICTIONLESS, SLIDING
from cable_ros.contact.laying_down import Landing
from cable_ros.contact.letting_go import lets_go
from cable_ros.contact.mobilising_rod import MobilisingRod
from cable_ros.contact.newton import REVERSES, active_set_newton, iteration_work
from cable_ros.contact.path_error import STILL
from cable_ros.contact.points import FORCE, NUMBER, OBSTACLE, SPARED
from cable_ros.contact.remeshing_rod import State
from cable_ros.contact.report import coefficients, listed
from cable_ros.contact.slip_kernels import note_slip
from cable_ros.contact.symmetry import GRID, is_even, leaves_plane, takes_side
from cable_ros.contact.thin_patches import with_ends_alone
from cable_ros.contact.travel import SHORTER, SHORTEST, travel
from cable_ros.rod import quaternion, warm_step
from cable_ros.rod.elements import Mesh, end_bubbles
from cable_ros.rod.loaded_contacts import LoadedContacts
from cable_ros.rod.units import norm
from cable_ros.rod.without_contact import SAME

FAILED = warm_step.NOT_CONTRACTING, warm_step.TOO_FAR, REVERSES
"""How a step ends that may be solved in another way."""
EASY_STILL = 12
"""Maximum number of iterations in which what slips along a patch goes on as it did: in more of them stick and
slip have changed in many places."""
FORESEEN, LEVER, LEAST_LEAP = 5.0, 30.0, 0.05
"""Maximum rotation of a section in a step with friction: multiple of that in the tangent step, rad per motion
of clamps and obstacles, L, and an addend, rad. In a larger one the iteration may have gone elsewhere."""
FEWER = 0.3
"""Part of the latter two where a contact ends: where it lets go there may be no equilibrium nearby."""
LEAST_SOFT = 1e-6
"""Least presliding, L, from which what sticks is made firmer where nothing moves."""
SHORT = 1e-3
"""Length of a step, L, up to which points may stay soft, see `Rod.tentative`."""
STAYS_SOFT = 1 / 256
"""Part of that which points keep, at which no rounding decides whether they stick or slip."""
LANDED_AT_ONCE = 1e-4
"""Length of a step, L, above which nothing may come down in one that has to begin with a soft stick."""
SLOW_REVERSAL = 1e-4
"""Length of a step, L, in which friction turns back nearly everywhere, above which it is not begun softly."""
FEWEST, SPARE_WORK = 3, 20_000.0
"""Number of iterations that a solve on another mesh takes at least, and work that they may take however
little is left."""
MANY, SOME = 8, 5
"""Number of iterations in which rounding may lead out of a plane, and friction to a side."""
UNEVEN = 1e-3
"""Difference of the elements' lengths from those counted from the other end, L, that leads to a side, too."""
EASY, TURN_BACK = 12, 0.5
"""Maximum number of iterations of a step that was not hard to solve, and the factor of one that was and in
which friction turns back at a point: it may have stuck, and then the cable goes elsewhere."""
EULER, LOADED = 4.0 * np.pi**2, 0.5
"""Force that buckles a straight cable between its clamps, EI / L^2; and the part of the stability margin that
the end force may have changed by, over that, before stability is judged: what is pressed hardly turns first.
"""


class Step(NamedTuple):
    """A step that is asked for, and the rod before it."""

    q: np.ndarray
    """(n, 4) nodal frames."""
    F: np.ndarray
    """(3,) end force."""
    ends: tuple[np.ndarray, np.ndarray, np.ndarray]
    """New end frame (4,), end position (3,), L, and load per length (3,)."""
    obstacles: np.ndarray
    """(o, WIDTH) that it leads to."""
    tolerance: float
    limit: float
    """Of Newton's method: its last rotation, and the maximum of any, rad."""
    remesh: bool
    """Whether the mesh may change."""
    distance: float
    """Its length, L; 0 without friction."""
    kept: State
    mesh: Mesh
    direction: np.ndarray
    """(3,) of the end's motion that friction is mobilised against."""


class Solved(NamedTuple):
    """How a solve ended."""

    code: int
    """See `newton.active_set_newton`."""
    iterations: int
    moved: bool
    """Whether another mesh would hold the points better."""
    turned: float
    """Rotation since the last factorisation, rad."""
    foreseen: float
    """Rotation in the tangent step, rad."""
    q: np.ndarray
    """(n, 4) nodal frames."""
    F: np.ndarray
    """(3,) end force."""


class ActiveSetRod(MobilisingRod):
    """A rod whose contact points belong to its last equilibrium: `step_in_contact` changes them, together
    with the lengths of the elements, and puts them back if it fails.
    """

    loaded: float = 0.0
    """Change of the end force since stability was judged, in EULER."""
    still = False
    """See `History`."""
    step_length = 0.0
    """Of the present step, L; see `History.step`."""

    def loaded_contacts(self, q: np.ndarray) -> Callable[[], LoadedContacts] | None:
        if not self.count or self.obstacles is None:
            return None
        points, normals = self.points[: self.count].copy(), self.normals[: self.count].copy()
        grid = self.mesh.lengths, self.s0.copy()
        rough = self.model != FRICTIONLESS
        return partial(listed, points, normals, self._centreline(q), grid, self.obstacles, rough)

    def _centreline(self, q: np.ndarray) -> Callable[[], np.ndarray]:
        """A function that computes the coefficients of the centreline of q (n, 4), which it keeps."""
        return partial(coefficients, q, self.mesh.lengths, self.mesh.element)

    def spend(self, iterations: int) -> None:
        """Count iterations with the present mesh and contacts as work done."""
        self.work -= iterations * self.iteration_work

    @property
    def iteration_work(self) -> float:
        """With the present mesh and contacts."""
        return float(iteration_work(self.elastic.shape[0], self.rows))

    def lets_go(self, q: np.ndarray, F: np.ndarray, near: float) -> bool:
        return lets_go(self, q, F, near)

    def polished(self, q: np.ndarray, F: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
        """The equilibrium (q, F) solved once more if it lies along something without friction.

        A pressure bends its element by the fourth power of its length: where the shape has settled, the
        pressures in short elements may not have, which `relative_error` takes for an error of the mesh.
        """
        if not self.has_patch or self.model != FRICTIONLESS:
            return q, F
        code, _, q_new, F_new = self.correct(q, F, tolerance, remesh=False)
        return (q_new, F_new) if code == warm_step.ADVANCED else (q, F)

    def correct(
        self, q: np.ndarray, F: np.ndarray, tolerance: float, limit: float = 1.0, remesh: bool = True
    ) -> tuple[int, int, np.ndarray, np.ndarray]:
        """`step_in_contact` under the conditions that are set, from (q, F) nearby.

        Along a patch what slips goes on as it did, if that leads nowhere else: a new mesh moves it by all but
        nothing, in any direction.
        """
        assert self.obstacles is not None
        asked = self.qe, self.re, self.f, tolerance, limit, self.obstacles, remesh
        if self.lies and not self.creeps and self.presliding == 0.0:
            put_back, found_on = self.kept(), self.found_on
            then = self._state_of(q)
            self.still = True
            found = self.step_in_contact(q, F, *asked)
            self.still = False
            easy = found[0] == warm_step.ADVANCED and found[1] <= EASY_STILL
            if easy and self._settled(then, found[2]):
                return found
            put_back()
            self.found_on = found_on
        before = self.points[: self.count].copy()
        found = self.step_in_contact(q, F, *asked)
        if found[0] == warm_step.ADVANCED:
            self._slip_on(before)
        return found

    def step_in_contact(
        self, q: np.ndarray, F: np.ndarray, qe: np.ndarray, re: np.ndarray, f: np.ndarray,
        tolerance: float, limit: float, obstacles: np.ndarray, remesh: bool = True,
    ) -> tuple[int, int, np.ndarray, np.ndarray]:  # fmt: skip
        """One solve with contact points, from the equilibrium (q, F) with its own.

        Returns code, iterations and the new (q, F), see `newton.active_set_newton`.
        """
        before, spent = (self.state(), self.mesh, self.direction), 0
        self.latest, self.stride = None, 2.0  # the gradient will be another's
        if remesh and self.model == SLIDING:
            code, spent, q, F = self._reverse(q, F, re, tolerance, limit)
            if code != warm_step.ADVANCED:
                self._back_to(before)
                self.ready = False
                return code, spent, q, F
        rubs = self.model == COULOMB
        distance = travel(self.qe, self.re, self.obstacles, qe, re, obstacles) if rubs else 0.0
        step = Step(q, F, (qe, re, f), obstacles, tolerance, limit, remesh, distance, *before)
        more, found = self._solve(step)
        spent += more
        fewer = self.count < step.kept[1]
        forked = fewer and self._holds_alone()
        rotated = quaternion.largest_rotation(q, found.q) if found.code == warm_step.ADVANCED else np.inf
        code, landing = self._within_limits(step, found, rotated, fewer)
        sided = code == warm_step.ADVANCED and self._takes_side(step, found)
        code, turned = self._judged(step, found, warm_step.TOO_FAR if sided else code, rotated)
        if code == warm_step.ADVANCED:
            return self._take(step, found, turned, rotated, landing, forked)
        too_long = self._too_long(step, code, sided)
        self._back_to(before)
        if too_long.any():
            more, split = self._step_on_split(step, too_long)
            spent += more
            if split is not None:
                return warm_step.ADVANCED, found.iterations + spent, *split
        return code, found.iterations + spent, found.q, found.F

    def _back_to(self, before: tuple[State, Mesh, np.ndarray]) -> None:
        """Put back contact points, mesh and the direction of mobilised friction."""
        self.restore(*before[:2])
        self.direction = before[2]

    def _solve(self, step: Step) -> tuple[int, Solved]:
        """Iterations in vain, and what the last solve of a step ended in."""
        Y, S = (self.responses, self.complement) if self.model == FRICTIONLESS else (self.Y_slip, self.S_slip)
        self.step_length = step.distance if step.distance > STILL else 0.0
        self._set_bedding(step.distance, step.F)
        control = step.tolerance, step.limit, self.rotation, self.refactor_at
        goal, factors = (step.ends, step.obstacles, control), (self.A, self.L, self.pivots, Y, S)
        spent, found = 0, self._newton(step.q, step.F, goal, factors)
        for again in (self._on_ends_alone, self._begin_soft):
            # a step against more drag costs less
            if found.code in FAILED and self.drag == 0.0 and self.work > 0.0:
                more, found = again(step, goal, factors, found)
                spent += more
        self.then = SAME
        return spent, found._replace(code=warm_step.TOO_FAR) if found.code == REVERSES else found

    def _within_limits(
        self, step: Step, found: Solved, rotated: float, fewer: bool
    ) -> tuple[int, Landing | None]:
        """The code of a step that is solved, TOO_FAR if friction changed too much in it, and what came down.

        Sets the `stride`. `rotated`: the largest rotation of a node, rad; `fewer`: whether a contact ended.
        """
        if found.code != warm_step.ADVANCED:
            return found.code, None
        landing, (qe, re, _) = None, step.ends
        if self.model == COULOMB:
            points, distance, hard = step.kept[0], step.distance, found.iterations > EASY
            self.stride = self._friction_stride(
                step.F, found.q, found.F, step.obstacles, points, distance, hard
            )
            addend = LEVER * distance + LEAST_LEAP
            farthest = FORESEEN * found.foreseen + (FEWER if fewer else 1.0) * addend
            leaps = distance > 0.0 and rotated > farthest and self._rotated(step.q, found.q) > farthest
            if hard and self._turns_back():
                self.stride = min(self.stride, TURN_BACK)
            landing = self.landing(points) if distance > STILL else None
            again, onward = self._landing_strides(landing, distance, found.F)
            again = min(again, self.stride if leaps or self.stride < SHORTER else 1.0)
            if not self.trial and (leaps or (again < 1.0 and distance > SHORTEST)):
                self.stride = max(again, 0.99 * SHORTEST / distance)
                return warm_step.TOO_FAR, landing
            self.onward, self.stride = onward, min(self.stride, onward)
        strays = found.iterations > MANY and leaves_plane(step.q, found.q, qe, re)
        return warm_step.TOO_FAR if strays else warm_step.ADVANCED, landing

    def _takes_side(self, step: Step, found: Solved) -> bool:
        """Whether a step with friction `takes_side`, its nodes having moved along; not while it falls, which
        does leave what is not stable.
        """
        if self.model != COULOMB or found.iterations <= SOME or self.trial or self.tentative:
            return False
        now, (qe, re, f) = Mesh(self.mesh.element, self.h.copy()), step.ends
        return takes_side(step.mesh.interpolate(step.q, GRID), now.interpolate(found.q, GRID), qe, re, f)

    def _judged(self, step: Step, found: Solved, code: int, rotated: float) -> tuple[int, float]:
        """Judge the stability of a step that is solved: its code, and the rotation since the factors, rad."""
        self.ready = code == warm_step.ADVANCED
        if not self.ready or self.model == FRICTIONLESS:
            return code, found.turned
        if self.model == COULOMB:
            evens = self.lies or self._slip_rows()[0].size > 0
            grid = Mesh(self.mesh.element, self.h)
            self.even = evens and is_even(grid.interpolate(found.q, GRID), step.ends[1])
        turned, rotation = found.turned, self.rotation + rotated
        same = self.count == step.kept[1]
        if self.lies and turned == 0.0 and same and rotation < self.refactor_at and not self.even:
            # what slips has new factors in most steps: stability need not be judged as often where it lies;
            # a point that sticks lets a fork begin and end within a few steps, as does what is its own image
            turned, self.judged = rotation, False
        if turned == 0.0 and not self.kkt_factor(self.drag, 3 + self.count):
            # with friction as it is; the iteration's own factors say nothing about stability, but they
            # predict the next step
            code = warm_step.NOT_CONVEX
        return code, turned

    def _take(
        self, step: Step, found: Solved, turned: float, rotated: float, landing: Landing | None, forked: bool
    ) -> tuple[int, int, np.ndarray, np.ndarray]:
        """Take a step that was solved, on a new mesh if its contacts need one; as `step_in_contact`.

        turned, rotated: see `_judged`; `landing`: what came down; `forked`: see `Rod.forked`.
        """
        q, F, iterations = found.q, found.F, found.iterations
        sunk, conditions = self.sunk(q, F, step.obstacles), (self.qe, self.re, self.f, self.obstacles)
        followed, found_on, was_loaded = self.followed, self.found_on, self.loaded
        self.set_conditions(*step.ends, step.obstacles)
        self.found_on = None
        if not self.tentative:
            if not self.trial:  # a medium's drag is none of the cable's forces
                self.follow(step.distance, step.F, F, landing)
            self.note_slip(step.distance)
        self.forked = self.forked or forked
        self.rotation_before = self.rotation + rotated
        self.rotation = turned if self.count == step.kept[1] else 0.0
        # factors that this step has made are those of an iteration, not of where it ends
        presses = norm(F - step.F) / EULER
        self.loaded = presses if self.rotation == 0.0 else was_loaded + presses
        self.mesh = Mesh(self.mesh.element, self.h.copy())
        left_unstable = False
        if step.remesh and (sunk or (found.moved and not self._remeshing.waits)):
            finer = self._remesh(q, F, iterations, step.tolerance, sunk)
            if finer is not None:
                self._remeshing.reset()
                return finer
            self._remeshing.tried()
            if not sunk and self.refactor(q, F):
                return warm_step.ADVANCED, iterations, q, F
            left_unstable = not sunk
        if found.moved and step.remesh:
            self._remeshing.skip()
        if self.bare:  # what it does against a drag is judged with it
            self.linearize(q, F)
            left_unstable = not self.factor(self.drag)
        elif self.loaded > LOADED * self.margin and self.model == FRICTIONLESS:
            left_unstable, self.loaded = not self.refactor(q, F), 0.0
        if sunk or left_unstable:
            self._back_to((step.kept, step.mesh, step.direction))
            self.set_conditions(*conditions)
            self.ready, self.followed = False, followed
            self.loaded, self.found_on = was_loaded, found_on
            code = warm_step.NOT_CONTRACTING if sunk else warm_step.NOT_CONVEX
            return code, iterations, q, F
        self.settled = q
        return warm_step.ADVANCED, iterations, q, F

    def note_slip(self, distance: float) -> None:
        """Keep how far its contacts slipped in a step of so far, L, that has been taken."""
        if distance > STILL:
            note_slip(self.points, self.count, distance)

    def _too_long(self, step: Step, code: int, sided: bool) -> np.ndarray:
        """(m,) which elements are to be halved before a step that failed is tried again: none if none is."""
        if step.remesh and sided:
            # the mesh, which patches draw to them, may have taken the side
            return np.full(len(self.h), np.abs(self.h - self.h[::-1]).max() > UNEVEN)
        if step.remesh and self.model == FRICTIONLESS and code in FAILED:
            return self._crowded(step.kept[0])
        return np.zeros(0, bool)

    def _step_on_split(
        self, step: Step, which: np.ndarray
    ) -> tuple[int, tuple[np.ndarray, np.ndarray] | None]:
        """The step on the mesh with the elements `which` (m,) halved: iterations, and where it led."""
        put_back, direction = self.kept(), self.direction
        fresh = self._onto(self.mesh.split(which), step.q)
        code, spent, q, F = self.correct(fresh, step.F, step.tolerance, 0.6, remesh=False)
        if code == warm_step.ADVANCED:
            asked = *step.ends, step.tolerance, step.limit, step.obstacles
            code, more, q, F = self.step_in_contact(q, F, *asked, remesh=False)
            spent += more
        if code == warm_step.ADVANCED:
            return spent, (q, F)
        put_back()
        self.refactor(step.q, step.F)  # the finer mesh had its own factors
        self.direction = direction
        return spent, None

    def _on_ends_alone(
        self, step: Step, goal: tuple[Any, ...], factors: tuple[np.ndarray, ...], failed: Solved
    ) -> tuple[int, Solved]:
        """Solve a step that has failed once more, without its thin patches; as `_begin_soft`."""
        points = step.kept[0]
        if self.model != COULOMB or self.creeps or (left := with_ends_alone(points)) is None:
            return 0, failed
        self.restore((left, len(left), *step.kept[2:]), step.mesh)
        self.ready = False
        found = self._newton(step.q, step.F, goal, factors)
        if found.code == warm_step.ADVANCED:
            return failed.iterations, found
        return found.iterations, failed

    def _begin_soft(
        self, step: Step, goal: tuple[Any, ...], factors: tuple[np.ndarray, ...], failed: Solved
    ) -> tuple[int, Solved]:
        """Solve a step that has failed once more, with a stick that is soft at first, as firm as ever then.

        Points of a rod that is tentative stay a little soft: where they come to rest, a step may have no
        solution in which each sticks or slips.

        Args:
            step: the step.
            goal, factors: as of `_newton`.
            failed: what that returned.

        Returns:
            Iterations in vain, and what the last attempt ended in.
        """
        distance, count = step.distance, step.kept[1]
        touched = distance <= SHORT if self.tentative else count > 0
        too_long = failed.code == REVERSES and distance > SLOW_REVERSAL
        if self.creeps or self.model != COULOMB or not (self.lies or touched) or too_long:
            return 0, failed
        stays_soft = self.tentative and not self.lies
        self.restore(step.kept, step.mesh)
        softest, asked, self.ready = max(distance, LEAST_SOFT), self.presliding, False
        if stays_soft:
            self.presliding = max(asked, STAYS_SOFT * softest)
        found = self._newton(step.q, step.F, goal, factors, softest)
        self.presliding = asked
        if self.count > count and distance > LANDED_AT_ONCE:
            # in which order it lands matters
            found = found._replace(code=warm_step.NOT_CONTRACTING)
        return failed.iterations, found

    def _holds_alone(self) -> bool:
        """Whether the last solve dropped one of two mirror images, and the other one holds the cable."""
        points = self.points[: self.count]
        return bool(((points[:, NUMBER] == SPARED) & (points[:, FORCE] > 0.0)).any())

    def _newton(
        self, q: np.ndarray, F: np.ndarray, goal: tuple[Any, ...], factors: tuple[np.ndarray, ...],
        softest: float = 0.0,
    ) -> Solved:  # fmt: skip
        """`newton.active_set_newton` from the last equilibrium (q, F).

        Args:
            q, F: frames and end force.
            goal: the new conditions and obstacles, and the `StepControl`.
            factors: `Factors`.
            softest: see `contact_state.Options`.

        """
        conditions, obstacles, control = goal
        known = self.ready, self.settled is q
        found_on = (q, self.h, self.s0) if self.found_on is None else self.found_on
        last = q, F, self.f, self.obstacles, self.count, self.rows, *known, *self.then, *found_on
        friction = self.model, self.direction, self.presliding, self.bedding, self.still, self.step_length
        contact = self.samples, self.depth, self.give, self.finest(), end_bubbles(self.mesh.element.order)
        limits = self.drag, self.carried, float(self.least), float(self.work)
        q_new, F_new = np.empty_like(q), np.empty(3)
        try:
            code, iterations, self.count, self.rows, moved, turned, foreseen = active_set_newton(
                last, conditions, obstacles, self.section, self.grid, self.contacts, self.kkt(factors),
                (*friction, softest, *contact, *limits), control, (q_new, F_new),
            )  # fmt: skip
        except np.linalg.LinAlgError:
            code, iterations, moved, turned, foreseen = warm_step.NOT_CONTRACTING, 0, False, np.inf, 0.0
        self.spend(iterations)
        return Solved(code, iterations, moved, turned, foreseen, q_new, F_new)

    def touched(self) -> tuple[np.ndarray, np.ndarray]:
        """Obstacles (k,) of the contact points, and normals (k, 3) there."""
        return self.points[: self.count, OBSTACLE].copy(), self.normals[: self.count].copy()

    def _remesh(
        self, q: np.ndarray, F: np.ndarray, iterations: int, tolerance: float, sunk: bool
    ) -> tuple[int, int, np.ndarray, np.ndarray] | None:
        """The equilibrium (q, F) on a mesh fitted to its contact points; None if it is not found.

        If it has `sunk` in, the elements that are too long for that are halved as well; what is left of the
        budget must allow for that.
        """
        old, kept = self.mesh, self.state()
        fresh = self.fit(q)
        assert self.obstacles is not None
        if sunk:
            # beside a patch, too: a taut cable bends away from it within a short length
            fresh = self.resolve(fresh, max((F, self.start_force(F)), key=np.linalg.norm))
            long = self.unresolved(fresh)
            fresh = self._onto(self.mesh.split(long), fresh) if long.any() else fresh
            each = 1 if self.model == FRICTIONLESS else 3
            rows = each * round(kept[1] / len(old.lengths) * len(self.h))
            if FEWEST * iteration_work(self.elastic.shape[0], rows) > max(self.work, SPARE_WORK):
                self.restore(kept, old)
                return None
        fresh, F_fresh = self._let_go(fresh, F, tolerance)
        code, more, q_new, F_new = self.correct(fresh, F_fresh, tolerance, 0.6, remesh=False)
        self.rotation = 0.0
        if code == warm_step.ADVANCED:
            return code, iterations + more, q_new, F_new
        self.restore(kept, old)
        return None
