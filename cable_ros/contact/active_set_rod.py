# SPDX-License-Identifier: Apache-2.0
"""A rod with contact points that come and go, by Newton's method on a changing active set alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from cable_ros.contact.edges import across_edges
from cable_ros.contact.friction_kernels import COULOMB, FRICTIONLESS, SLIDING
from cable_ros.contact.frictional_rod import FrictionalRod
from cable_ros.contact.meshing import CLOSEST, fitted, layered
from cable_ros.contact.newton import REVERSES, active_set_newton, iteration_work
from cable_ros.contact.patches import resample
from cable_ros.contact.path_error import STILL, PathError
from cable_ros.contact.points import (
    ARC_LENGTH,
    BEFORE,
    FIRST,
    FORCE,
    FRICTION,
    INTERFACE,
    KIND,
    NUMBER,
    OBSTACLE,
    POINT,
    SAMPLE,
    SPARED,
)
from cable_ros.contact.report import coefficients, listed
from cable_ros.contact.slip_kernels import note_slip
from cable_ros.contact.symmetry import GRID, is_even, leaves_plane, takes_side
from cable_ros.contact.travel import SHORTER, SHORTEST, travel
from cable_ros.rod import quaternion, warm_step
from cable_ros.rod.centreline import position
from cable_ros.rod.elements import Mesh, end_bubbles
from cable_ros.rod.loaded_contacts import LoadedContacts
from cable_ros.rod.without_contact import SAME

FAILED = warm_step.NOT_CONTRACTING, warm_step.TOO_FAR, REVERSES
"""How a step ends that may be solved in another way."""
GOES = 3e-3
"""Maximum force of a contact that is about to end, as a fraction of the largest one, of the end's too."""
KEPT, SETTLES, PRESSES = 1e-3, 0.05, 0.005
"""Maximum relative change of friction and contact forces on a new mesh with friction as it was, rotation of
a section, rad, and relative change of contact forces that go on as they did: what friction holds may be far
from where it would be without, and an edge that it rolls over may be near."""
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
TURN, LEAST_TURN = 0.25, 1 / 128
"""First and least part of mobilised friction that turns back at once."""
EULER, LOADED = 4.0 * np.pi**2, 0.5
"""Force that buckles a straight cable between its clamps, EI / L^2; and the part of the stability margin that
the end force may have changed by, over that, before stability is judged: what is pressed hardly turns first.
"""
Solved = tuple[int, int, bool, float, float, np.ndarray, np.ndarray]
"""What `ActiveSetRod._newton` returns."""


class ActiveSetRod(FrictionalRod):
    """A rod whose contact points belong to its last equilibrium: `step_in_contact` changes them, together
    with the lengths of the elements, and puts them back if it fails.
    """

    loaded: float = 0.0
    """Change of the end force since stability was judged, in EULER."""
    still = False
    """See `History`."""
    step_length = 0.0
    """Of the present step, L; see `History.step`."""
    found_on: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
    """Frames (k, 4) of the last equilibrium, lengths (j,) and starts (j,) of the elements on which it was
    found, if it lies with friction and its mesh has changed since: what sticks stays where it was there."""

    @property
    def adapts_mesh(self) -> bool:  # type: ignore[override]
        return self.count > 0

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

    def _let_go(self, q: np.ndarray, F: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
        """The equilibrium (q, F) on a fresh mesh with the friction that it had: what sticks moves with it.

        A finer mesh shows the shape better everywhere; friction does not act against that change. Only for
        contact points: along a patch friction that is held, not what sticks, would let the cable drift.
        """
        points = self.points[: self.count]
        if self.model != COULOMB or not points[:, FRICTION:BEFORE].any() or (points[:, KIND] != POINT).any():
            return q, F
        assert self.obstacles is not None
        kept, mesh, followed = self.state(), self.mesh, self.followed
        total = points[:, FRICTION:BEFORE].sum(axis=0)
        then = self._state_of(q)
        self.model = FRICTIONLESS
        code, _, q_new, F_new = self.correct(q, F, tolerance, SETTLES, remesh=False)
        self.model, self.ready, self.followed = COULOMB, False, followed
        left = self.points[: self.count, FRICTION:BEFORE].sum(axis=0)
        near = code == warm_step.ADVANCED and self._settled(then, q_new, KEPT)
        if near and np.abs(left - total).max() <= KEPT * np.abs(total).max():
            return q_new, F_new
        self.restore(kept, mesh)
        return q, F

    def fit(self, q: np.ndarray) -> np.ndarray:
        """Change to a mesh fitted to the contact points; returns the shape q (n, 4) on it."""
        points = self.points[: self.count]
        return self._onto(fitted(self.mesh.element, list(self.s0[1:]), points, self.finest()), q)

    def fit_patches(self, q: np.ndarray) -> np.ndarray:
        """`fit` if the cable lies along anything; with contact points alone it keeps its mesh."""
        return self.fit(q) if (self.points[: self.count, KIND] != POINT).any() else q

    def resolve(self, q: np.ndarray, F: np.ndarray) -> np.ndarray:
        """Change to a mesh fine enough for the layers in which the end force F bends the cable; q on it."""
        mesh = layered(self.mesh, self.points[: self.count], float(np.linalg.norm(F)))
        return q if len(mesh.lengths) == len(self.h) else self._onto(mesh, q)

    def refined(self, q: np.ndarray) -> np.ndarray:
        """Change to a mesh with all elements halved; returns the shape q (n, 4) on it."""
        return self._onto(self.mesh.split(np.ones(len(self.h), bool)), q)

    def _onto(self, mesh: Mesh, q: np.ndarray) -> np.ndarray:
        fresh = self.mesh.interpolate(q, mesh.nodes)
        fresh[0], fresh[-1] = q[0], q[-1]
        before = (q, self.h, self.s0) if self.found_on is None else self.found_on
        self._allocate(mesh)
        self.stay(before)
        self.points[: self.count, INTERFACE] = -1.0
        self.take_samples()
        return fresh

    def stay(self, found_on: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
        """Let what sticks along a patch stay where it was on another mesh, see `found_on`.

        On a new mesh the frames between two nodes are others than they were, and the cable is elsewhere, if
        only by 1e-6 of its length. A taut one that sticks there has another end force, by up to 1 %.
        """
        if self.model == COULOMB and self.has_patch:
            self.found_on = found_on

    def state(self) -> tuple[np.ndarray, int, np.ndarray, np.ndarray]:
        """Contact points, their number, lengths and starts of the elements, for `restore`."""
        return self.points[: self.count].copy(), self.count, self.h.copy(), self.s0.copy()

    def restore(
        self, state: tuple[np.ndarray, int, np.ndarray, np.ndarray], mesh: Mesh | None = None
    ) -> None:
        """Put back a `state`, and the `mesh` if it may have changed."""
        if mesh is not None and self.mesh is not mesh:
            self._allocate(mesh)
            self.found_on = None
        points, self.count, self.h[:], self.s0[:] = state
        self.points[: self.count] = points

    def kept(self) -> Callable[[], None]:
        conditions = self.qe, self.re, self.f, self.obstacles
        return partial(self._put_back, self.state(), self.mesh, conditions, self.followed)

    def _put_back(
        self, state: tuple[np.ndarray, int, np.ndarray, np.ndarray], mesh: Mesh, conditions: tuple[Any, ...],
        followed: PathError,
    ) -> None:  # fmt: skip
        self.restore(state, mesh)
        self.set_conditions(*conditions)
        self.ready, self.followed = False, followed

    def lets_go(self, q: np.ndarray, F: np.ndarray, near: float) -> bool:
        """Whether at the equilibrium (q, F) all that holds the cable is a point that hardly presses any more,
        or the face under a point whose edge, at most `near` away, would not.

        If so, the branch ends at a fold, at which the stability margin jumps. Leaves (q, F) factored.
        """
        forces = self.points[: self.count, FORCE]
        if self.count == 0 or self.model != FRICTIONLESS:
            return False
        held, kept = True, self.state()
        for obstacles in self._edges_crossed(q, near):
            there, self.obstacles = self.obstacles, obstacles
            held = held and self.refactor(q, F)
            self.restore(kept)
            self.obstacles = there
        least = int(np.argmin(forces))
        most = max(float(forces.max()), float(np.linalg.norm(F)))
        if self.points[least, KIND] == POINT and forces[least] <= GOES * most:
            self.points[least : self.count - 1] = self.points[least + 1 : self.count].copy()
            self.count -= 1
            held = held and self.refactor(q, F)
            self.restore(kept)
        self.refactor(q, F)
        return not held

    def _edges_crossed(self, q: np.ndarray, near: float) -> Iterator[np.ndarray]:
        """The obstacles (o, WIDTH) with one moved, a point just beyond its edge; see `across_edges`."""
        assert self.obstacles is not None
        self.trace(q)
        r = np.empty(3)
        for point in self.points[: self.count]:
            if point[KIND] == POINT:
                position(self.c, self.h, self.s0, point[ARC_LENGTH], r)
                which = int(point[OBSTACLE])
                for moved in across_edges(self.obstacles[which], r, near):
                    obstacles = self.obstacles.copy()
                    obstacles[which] = moved
                    yield obstacles

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

    def _state_of(self, q: np.ndarray) -> tuple[Mesh, np.ndarray, np.ndarray, float]:
        """Mesh, frames q (n, 4), contact force (3,) and sum of the sizes of the contact forces."""
        size = float(self.points[: self.count, FORCE].sum())
        return Mesh(self.mesh.element, self.h.copy()), q, self.contact_force(), size

    def _settled(
        self, then: tuple[Mesh, np.ndarray, np.ndarray, float], q: np.ndarray, most: float = PRESSES
    ) -> bool:
        """Whether the cable has settled at q (n, 4) and not gone elsewhere since `then`, see `_state_of`.

        `most`: relative change of the contact forces.
        """
        mesh, before, force, size = then
        same = float(np.abs(self.contact_force() - force).max()) <= most * size
        return same and self._rotated(before, q, mesh) <= SETTLES

    def take_samples(self) -> None:
        """Give the patches the samples of the present mesh; what slips goes on slipping."""
        before = self.points[: self.count].copy()
        self.count = resample(self.points, self.count, self.h, self.s0, self.creeps)
        self._slip_on(before)

    def step_in_contact(
        self, q: np.ndarray, F: np.ndarray, qe: np.ndarray, re: np.ndarray, f: np.ndarray,
        tolerance: float, limit: float, obstacles: np.ndarray, remesh: bool = True,
    ) -> tuple[int, int, np.ndarray, np.ndarray]:  # fmt: skip
        """One solve with contact points, from the equilibrium (q, F) with its own.

        Returns code, iterations and the new (q, F), see `newton.active_set_newton`.
        """
        kept, direction, mesh = self.state(), self.direction, self.mesh
        self.latest, self.stride = None, 2.0  # the gradient will be another's
        Y, S = (self.responses, self.complement) if self.model == FRICTIONLESS else (self.Y_slip, self.S_slip)
        spent = 0
        if remesh and self.model == SLIDING:
            code, spent, q, F = self._reverse(q, F, re, tolerance, limit)
            if code != warm_step.ADVANCED:
                self.restore(kept, mesh)
                self.direction, self.ready = direction, False
                return code, spent, q, F
        rubs = self.model == COULOMB
        distance = travel(self.qe, self.re, self.obstacles, qe, re, obstacles) if rubs else 0.0
        self.step_length = distance if distance > STILL else 0.0
        self._set_bedding(distance, F)
        goal = (qe, re, f), obstacles, (tolerance, limit, self.rotation, self.refactor_at)
        factors = self.A, self.L, self.pivots, Y, S
        found = self._newton(q, F, goal, factors)
        # a step against more drag costs less
        if found[0] in FAILED and self.drag == 0.0 and self.work > 0.0:
            more, found = self._begin_soft(q, F, goal, factors, found, distance, (kept, mesh))
            spent += more
        code, iterations, moved, turned, foreseen, q_new, F_new = found
        code = warm_step.TOO_FAR if code == REVERSES else code
        self.then, landing = SAME, None
        forked = self.count < kept[1] and self._holds_alone()
        rotated = quaternion.largest_rotation(q, q_new) if code == warm_step.ADVANCED else np.inf
        if code == warm_step.ADVANCED and self.model == COULOMB:
            self.stride = self._friction_stride(F, q_new, F_new, obstacles, kept[0], distance)
            addend = LEVER * distance + LEAST_LEAP
            farthest = FORESEEN * foreseen + (FEWER if self.count < kept[1] else 1.0) * addend
            leaps = distance > 0.0 and rotated > farthest and self._rotated(q, q_new) > farthest
            if iterations > EASY and self._turns_back():
                self.stride = min(self.stride, TURN_BACK)
            landing = self.landing(kept[0]) if distance > STILL else None
            again, onward = self._landing_strides(landing, distance, F_new)
            again = min(again, self.stride if leaps or self.stride < SHORTER else 1.0)
            if not self.trial and (leaps or (again < 1.0 and distance > SHORTEST)):
                code, self.stride = warm_step.TOO_FAR, max(again, 0.99 * SHORTEST / distance)
            else:
                self.onward, self.stride = onward, min(self.stride, onward)
        if code == warm_step.ADVANCED and iterations > MANY and leaves_plane(q, q_new, qe, re):
            code = warm_step.TOO_FAR
        falls = self.trial or self.tentative  # which does leave what is not stable
        may_fork = code == warm_step.ADVANCED and rubs and iterations > SOME and not falls
        sided = may_fork and self._takes_side(mesh, q, q_new, qe, re)
        if sided:
            code = warm_step.TOO_FAR
        self.ready, same = code == warm_step.ADVANCED, self.count == kept[1]
        rotation = self.rotation + rotated if self.ready else np.inf
        was_loaded = self.loaded
        presses = float(np.linalg.norm(F_new - F)) / EULER
        if self.ready and rubs:
            self.even = (self.lies or self._slip_rows()[0].size > 0) and self._is_even(q_new, re)
        if self.lies and turned == 0.0 and same and rotation < self.refactor_at and not self.even:
            # what slips has new factors in most steps: stability need not be judged as often where it lies;
            # a point that sticks lets a fork begin and end within a few steps, as does what is its own image
            turned, self.judged = rotation, False
        if self.ready and self.model != FRICTIONLESS and turned == 0.0:
            # with friction as it is; the iteration's own factors say nothing about stability, but they
            # predict the next step
            code = warm_step.ADVANCED if self.kkt_factor(self.drag, 3 + self.count) else warm_step.NOT_CONVEX
        if code != warm_step.ADVANCED:
            too_long = np.zeros(0, bool)
            if remesh and sided:
                # the mesh, which patches draw to them, may have taken the side
                too_long = np.full(len(self.h), np.abs(self.h - self.h[::-1]).max() > UNEVEN)
            elif remesh and self.model == FRICTIONLESS and code in FAILED:
                too_long = self._crowded(kept[0])
            self.restore(kept, mesh)
            self.direction = direction
            if too_long.any():
                asked = qe, re, f, tolerance, limit, obstacles
                more, split = self._step_on_split(q, F, too_long, asked)
                spent += more
                if split is not None:
                    code, (q_new, F_new) = warm_step.ADVANCED, split
            return code, iterations + spent, q_new, F_new
        sunk, before = self.sunk(q_new, F_new, obstacles), (self.qe, self.re, self.f, self.obstacles)
        followed, found_on, self.found_on = self.followed, self.found_on, None
        self.set_conditions(qe, re, f, obstacles)
        if not self.tentative:
            if not self.trial:  # a medium's drag is none of the cable's forces
                self.follow(distance, F, F_new, landing)
            if distance > STILL:
                note_slip(self.points, self.count, distance)
        self.forked = self.forked or forked
        self.rotation_before, self.rotation = rotation, turned if same else 0.0
        # factors that this step has made are those of an iteration, not of where it ends
        self.loaded = presses if self.rotation == 0.0 else was_loaded + presses
        self.mesh = Mesh(self.mesh.element, self.h.copy())
        left_unstable = False
        if remesh and (sunk or (moved and not self._remeshing.waits)):
            finer = self._remesh(q_new, F_new, iterations, tolerance, sunk)
            if finer is not None:
                self._remeshing.reset()
                return finer
            self._remeshing.tried()
            if not sunk and self.refactor(q_new, F_new):
                return code, iterations, q_new, F_new
            left_unstable = not sunk
        if moved and remesh:
            self._remeshing.skip()
        if self.bare:  # what it does against a drag is judged with it
            self.linearize(q_new, F_new)
            left_unstable = not self.factor(self.drag)
        elif self.loaded > LOADED * self.margin and self.model == FRICTIONLESS:
            left_unstable, self.loaded = not self.refactor(q_new, F_new), 0.0
        if sunk or left_unstable:
            self.restore(kept, mesh)
            self.set_conditions(*before)
            self.direction, self.ready, self.followed = direction, False, followed
            self.loaded, self.found_on = was_loaded, found_on
            code = warm_step.NOT_CONTRACTING if sunk else warm_step.NOT_CONVEX
            return code, iterations, q_new, F_new
        self.settled = q_new
        return code, iterations, q_new, F_new

    def _takes_side(
        self, mesh: Mesh, q: np.ndarray, q_new: np.ndarray, qe: np.ndarray, re: np.ndarray
    ) -> bool:
        """See `takes_side`, from q (n, 4) on `mesh` to q_new (n, 4), whose nodes have moved along."""
        now = Mesh(self.mesh.element, self.h.copy())
        return takes_side(mesh.interpolate(q, GRID), now.interpolate(q_new, GRID), qe, re, self.f)

    def _is_even(self, q: np.ndarray, re: np.ndarray) -> bool:
        """See `is_even`; q (n, 4) at the nodes as they have moved."""
        return is_even(Mesh(self.mesh.element, self.h).interpolate(q, GRID), re)

    def _crowded(self, before: np.ndarray) -> np.ndarray:
        """(m,) which elements have less than a boundary for each end of a patch of a step that failed.

        Those beside these ends and the contacts before it, if any end goes without: there the shear force can
        have no jump, and contact forces of either sign take its place.

        Args:
            before: (k, COLUMNS) the contact points before it.
        """
        points = self.points[: self.count]
        without = points[(points[:, KIND] >= FIRST) & (points[:, INTERFACE] < 0.0), ARC_LENGTH]
        if not len(without):
            return np.zeros(len(self.h), bool)
        s = np.concatenate([without, before[before[:, KIND] != SAMPLE, ARC_LENGTH]])[:, None]
        ends = np.cumsum(self.mesh.lengths)
        near = (s >= ends - self.mesh.lengths - CLOSEST) & (s <= ends + CLOSEST)
        return np.asarray(near.any(axis=0))

    def _step_on_split(
        self, q: np.ndarray, F: np.ndarray, which: np.ndarray,
        asked: tuple[np.ndarray, np.ndarray, np.ndarray, float, float, np.ndarray],
    ) -> tuple[int, tuple[np.ndarray, np.ndarray] | None]:  # fmt: skip
        """`step_in_contact` on the mesh with some elements halved: iterations, and where it led, if it did.

        Args:
            q, F: frames and end force of the last equilibrium.
            which: (m,) which elements.
            asked: of `step_in_contact`, from the end frame to the obstacles.
        """
        put_back, direction = self.kept(), self.direction
        fresh = self._onto(self.mesh.split(which), q)
        code, spent, q_new, F_new = self.correct(fresh, F, asked[3], 0.6, remesh=False)
        if code == warm_step.ADVANCED:
            code, more, q_new, F_new = self.step_in_contact(q_new, F_new, *asked, remesh=False)
            spent += more
        if code == warm_step.ADVANCED:
            return spent, (q_new, F_new)
        put_back()
        self.refactor(q, F)  # the finer mesh had its own factors
        self.direction = direction
        return spent, None

    def _begin_soft(
        self, q: np.ndarray, F: np.ndarray, goal: tuple[Any, ...], factors: tuple[np.ndarray, ...],
        failed: Solved, distance: float, before: tuple[Any, Mesh],
    ) -> tuple[int, Solved]:  # fmt: skip
        """Solve a step that has failed once more, with a stick that is soft at first, as firm as ever then.

        Points of a rod that is tentative stay a little soft: where they come to rest, a step may have no
        solution in which each sticks or slips.

        Args:
            q, F, goal, factors: as of `_newton`.
            failed: what that returned.
            distance: length of the step, L; 0 without friction.
            before: the `state` and the mesh before it.

        Returns:
            Iterations in vain, and what the last attempt ended in.
        """
        touched = distance <= SHORT if self.tentative else before[0][1] > 0
        too_long = failed[0] == REVERSES and distance > SLOW_REVERSAL
        if self.creeps or self.model != COULOMB or not (self.lies or touched) or too_long:
            return 0, failed
        stays_soft = self.tentative and not self.lies
        self.restore(*before)
        softest, asked, self.ready = max(distance, LEAST_SOFT), self.presliding, False
        if stays_soft:
            self.presliding = max(asked, STAYS_SOFT * softest)
        found = self._newton(q, F, goal, factors, softest)
        self.presliding = asked
        if self.count > before[0][1] and distance > LANDED_AT_ONCE:
            found = (warm_step.NOT_CONTRACTING, *found[1:])  # in which order it lands matters
        return failed[1], found

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

        Returns:
            How it ended, iterations, whether another mesh would hold the points better, rotation since the
            last factorisation and in the tangent step, rad, and the new (q, F).
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
        return code, iterations, moved, turned, foreseen, q_new, F_new

    def touched(self) -> tuple[np.ndarray, np.ndarray]:
        """Obstacles (k,) of the contact points, and normals (k, 3) there."""
        return self.points[: self.count, OBSTACLE].copy(), self.normals[: self.count].copy()

    def _reverse(
        self, q: np.ndarray, F: np.ndarray, re: np.ndarray, tolerance: float, limit: float
    ) -> tuple[int, int, np.ndarray, np.ndarray]:
        """Turn mobilised friction against the end's new direction, in steps if that turns back."""
        motion = re - self.re
        size = float(np.linalg.norm(motion))
        before, after = self.direction, motion / max(size, 1e-300)
        if size < 1e-12:
            return warm_step.ADVANCED, 0, q, F
        if self.count and before @ after <= 0.0 and self.obstacles is not None:
            return self.mobilise(q, F, before, after, tolerance, limit)
        self.direction = after
        return warm_step.ADVANCED, 0, q, F

    def mobilise(
        self, q: np.ndarray, F: np.ndarray, before: np.ndarray, after: np.ndarray, tolerance: float,
        limit: float,
    ) -> tuple[int, int, np.ndarray, np.ndarray]:  # fmt: skip
        """Lead friction that is mobilised against `before` through zero to that against `after`, both (3,).

        Returns code, iterations and equilibrium as `step_in_contact`. Where friction turns the cable over,
        there is none with all of it.
        """
        at, step, spent = -1.0 if before.any() else 0.0, TURN, 0
        while at < 1.0:
            there = min(at + step, 1.0)
            self.direction = -there * before if there < 0.0 else there * after
            code, iterations, q_new, F_new = self.correct(q, F, tolerance, limit, remesh=False)
            spent += iterations
            if code == warm_step.ADVANCED:
                q, F, at, step = q_new, F_new, there, 2.0 * step
                continue
            step *= 0.5
            if step < LEAST_TURN:
                return code, spent, q, F
        return warm_step.ADVANCED, spent, q, F

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
