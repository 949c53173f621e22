# SPDX-License-Identifier: Apache-2.0
"""A piece of a cable next to a pin, ring or tube, moved and lengthened by what its supports share."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from operator import is_
from typing import NamedTuple

import numpy as np

from cable_ros.branch.cable_tracker import CableTracker
from cable_ros.branch.cold_start import Conditions, conditions_of
from cable_ros.branch.coupling import Ends, Section
from cable_ros.branch.held_ends import ends_of
from cable_ros.branch.mirror_image import GRID
from cable_ros.branch.results import Reader, Tangent, both_wrenches
from cable_ros.branch.snap_through import FALL_WORK, snap_through
from cable_ros.contact.active_set_rod import ActiveSetRod
from cable_ros.contact.distance import FRICTION_COEFFICIENT, placed
from cable_ros.contact.friction_kernels import COULOMB, FRICTIONLESS
from cable_ros.contact.lengthening import lengthen
from cable_ros.contact.points import BEFORE, FRICTION
from cable_ros.contact.travel import SHORTER
from cable_ros.effects.effect import Properties
from cable_ros.equilibrium import Equilibrium, Status
from cable_ros.rod import warm_step
from cable_ros.rod.elements import Mesh
from cable_ros.rod.held_rod import HeldRod
from cable_ros.rod.kirchhoff import ALGEBRAIC, Rod
from cable_ros.rod.rod_state import ENERGY
from cable_ros.rod.units import Units
from cable_ros.rod.without_contact import SAME, SHORTEST_STEP
from cable_ros.scene import Kinematics

MOST_TURN = 0.35
"""Maximum rotation of a section in one attempt, rad."""
STALLED = 10.0
"""Algebraic tolerance of a piece in which rounding is larger, over the usual one."""
REMEDY = "It stays so until reset is called (of the node: ~/reset), which takes that of a cold start."
"""When a branch is known again that pieces share: motion alone does not tell."""
WORLD = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
STRAIGHT = 1e-9
"""Slack, L, below which a piece that is held at both ends is straight: nothing leads on from there."""
LENGTHENED = 1e-3
"""Relative change of the length after which a piece is judged again, also if no section has turned."""


class Place(NamedTuple):
    """Where a piece is held, and how long it is."""

    poses: np.ndarray
    """(2, 7) of the sections or mounts at both ends, world."""
    length: float
    """m."""
    begin: float = 0.0
    """Arc length of the cable where it starts, m."""
    yields: np.ndarray | None = None
    """See `Tip.yields`: along these directions its end is tried there, and is where forces let it be."""
    pull: np.ndarray | None = None
    """(3,) N, world, the force that is given there."""


class Kept(NamedTuple):
    """An equilibrium of a piece."""

    q: np.ndarray
    F: np.ndarray
    conditions: Conditions
    mesh: Mesh
    contacts: tuple[np.ndarray, int, np.ndarray, np.ndarray] | None
    """See `ActiveSetRod.state`; None: no contact."""
    length: float
    begin: float
    joints: np.ndarray
    path_force: np.ndarray
    """See `TrackedEquilibrium`."""


class SharedPiece(CableTracker):
    """One piece between two supports; it never looks for another branch by itself."""

    _length: float | None = None
    _begin = 0.0
    """Arc length of the cable where the piece starts, m."""
    _bent = False
    """Whether it is curved or twisted when unloaded."""
    _rough = FRICTIONLESS
    """The friction of its obstacles; `_model` is without as long as friction is left out."""
    _origin: Kept | None = None
    """The equilibrium since which friction opposes what moves."""
    _judged_length = np.nan
    """m, at which it was last known to be stable."""
    _turned = np.nan
    """Rotation, rad, after which its factors were renewed since the last result; inf: not known. NaN: they
    were not."""
    clear = False
    """Whether it is solved as if nothing rough could hold it, for it touches nothing."""
    _far = 0.0
    """Travel, L, in the step to the present equilibrium from that which was kept last."""
    worked = 0.0
    """Iterations times unknowns since this was set to 0."""
    _spent = 0
    """Iterations since the last result."""
    _known_ends: tuple[tuple[object, ...], Ends] | None = None
    """The ends of the equilibrium known last, and which that is."""
    _known_section: tuple[tuple[object, ...], Section] | None = None
    """What it is made of, and from which arrays that follows; another length has others if it matters."""

    def reset(self) -> None:
        super().reset()
        self._reader, self._outline = Reader(slides=True), Reader(slides=True)

    def _use(self, properties: Properties) -> None:
        if self._length is not None:
            properties = replace(properties, length=self._length)
        super()._use(properties)
        self._rough, self._bent = self._model, bool(self._natural.any())

    @property
    def unit(self) -> tuple[float, float]:
        """EI / L^2 and EI / L, N and N m."""
        return self._units.force, self._units.moment

    @property
    def names(self) -> Sequence[str]:
        """Of the obstacles."""
        return self._names

    @property
    def weight(self) -> np.ndarray:
        """(3,) load per length in the world, N/m."""
        return self._weight

    def obstacles(self, kinematics: Kinematics, joints: np.ndarray) -> np.ndarray | None:
        """(o, WIDTH) of `contact.distance` in the world, SI; None: there are none."""
        if self._obstacles is None:
            return None
        return placed(self._obstacles, kinematics.obstacle_poses(joints), WORLD, 1.0)

    @property
    def may_rub(self) -> bool:
        """Whether there are obstacles with friction."""
        return self._rough == COULOMB

    @property
    def rubs(self) -> bool:
        """Whether friction of obstacles may hold it."""
        return self._model == COULOMB and not self.clear

    def friction_of(self, obstacle: int) -> float:
        """The coefficient of an obstacle, by its number; 0 as long as friction is left out."""
        if self._obstacles is None or self._model != COULOMB:
            return 0.0
        return float(self._obstacles[obstacle, FRICTION_COEFFICIENT])

    @property
    def rubbing(self) -> bool:
        """Whether it touches something with friction."""
        return self.may_rub and self._rod is not None and self._rod.touches

    def rub(self, rubs: bool) -> None:
        """Let friction hold it from here on, from nothing; or leave friction out."""
        self._model, rod = self._rough if rubs else FRICTIONLESS, self._rod
        if isinstance(rod, ActiveSetRod) and self.may_rub:
            rod.points[: rod.count, FRICTION : BEFORE + 3] = 0.0
            rod.use_friction(self._model)

    @property
    def length(self) -> float:
        """m."""
        return self._units.length

    @property
    def stretches(self) -> bool:
        """Whether it lengthens under tension: it may be straight, and longer than unloaded."""
        return self._compliance is not None and bool(self._compliance[2])

    @property
    def longest(self) -> float:
        """Maximum distance of its ends, as a fraction of its length."""
        return self._reach

    @property
    def slack(self) -> float:
        """What it is longer than the distance of its ends, as a fraction of its length."""
        assert self._rod is not None
        return 1.0 - self._rod.chord(self._rod.qe, self._rod.re)

    def set_length(self, length: float) -> None:
        """Take another length, m: the rod, in units of its length, gets another load and natural strain."""
        before, rod = self._units, self._rod
        if length == before.length:
            return
        self._length, ratio = length, length / before.length
        self._units = Units(length, before.stiffness)
        if self._compliance is not None:
            self._compliance = self._compliance / ratio**2
            if rod is not None:
                rod.compliance = rod.compliance / ratio**2
        if self._bent:
            self._natural = ratio * self._natural
            if rod is not None:
                rod.natural *= ratio
        if self._ends is not None and (self._ends.start.force.any() or self._ends.end.force.any()):
            self._ends = ends_of(*self._mounts, self._units)
            if isinstance(rod, HeldRod) and self._ends is not None:
                rod.ends = self._ends
                rod.set_conditions(rod.qe, rod.re, rod.f)

    def distrust(self, cause: str) -> None:
        super().distrust(cause)
        assert self._record.loss is not None
        self._record = replace(self._record, loss=replace(self._record.loss, remedy=REMEDY))

    def find(self, kinematics: Kinematics, joints: np.ndarray, place: Place) -> Equilibrium:
        """A cold start as if its sections were clamped there."""
        self.reset()
        self.set_length(place.length)
        self.rub(False)
        self._judged_length, self._begin = place.length, place.begin
        while True:
            found = self.solve(kinematics, 0, joints, place.poses, time.perf_counter())
            if found.status is not Status.UNFINISHED:
                return found

    def has_come_to(self, joints: np.ndarray) -> None:
        """Tell the joint values (n,) of its pose otherwise."""
        self._joints = joints

    def keep(self) -> Kept:
        """The present equilibrium, for `put_back`; friction opposes what moves since then."""
        rod = self._rod
        assert rod is not None
        contacts = rod.state() if isinstance(rod, ActiveSetRod) else None
        conditions, where = conditions_of(rod), (self.length, self._begin, self._joints)
        self._origin = Kept(self._q, self._F, conditions, rod.mesh, contacts, *where, self._path_force)
        return self._origin

    def arrive(self) -> None:
        """Count the step from the equilibrium that was kept last: of all that were tried it is the one."""
        rod, origin = self._rod, self._origin
        if self.rubs and isinstance(rod, ActiveSetRod) and origin is not None:
            before = (self.length / origin.length) ** 2 * origin.path_force
            rod.follow(self._far, before, self._path_force)
            rod.note_slip(self._far)

    def holds(self, kept: Kept) -> bool:
        """Whether it is at this equilibrium."""
        return kept.q is self._q and self._rod is not None and kept.mesh is self._rod.mesh

    def put_back(self, kept: Kept) -> None:
        """Return to an equilibrium of the same rod."""
        self._restore(kept)
        self._stable()

    def _restore(self, kept: Kept) -> None:
        """`put_back` without new factors."""
        rod, there = self._rod, kept.conditions
        assert rod is not None
        self.set_length(kept.length)
        self._origin, self._begin = kept, kept.begin
        if isinstance(rod, ActiveSetRod) and kept.contacts is not None:
            rod.restore(kept.contacts, kept.mesh)
            rod.ready = False
        rod.set_conditions(there.qe, there.re, there.f, there.obstacles)
        self._q, self._F, self._joints = kept.q, kept.F, kept.joints

    def attempt(self, kinematics: Kinematics, joints: np.ndarray, place: Place) -> bool:
        """Follow the branch to a place nearby in one step; if not, nothing has moved.

        With friction the step is one from where it was kept last: friction opposes the motion since then.
        """
        rod = self._rod
        assert rod is not None
        if self.rubs:
            assert self._origin is not None
            touched = rod.touches
            self._restore(self._origin)
            if touched and not rod.touches:
                rod.refactor(self._q, self._F)  # its factors are those with contact
        before = self.length
        longer = abs(place.length / self._judged_length - 1.0) > LENGTHENED
        kept = self.keep() if longer else None
        then = self._lengthen(rod, place)
        qe, re, f, obstacles, far, _ = self._destination(kinematics, joints, place.poses, rod)
        self._let_yield(rod, place)
        holds = rod.chord(qe, re) < self._reach and (self.stretches or self.slack > STRAIGHT)
        if far <= rod.longest_step and (place.yields is not None or holds):
            rod.work, rod.patience, rod.short = self._full_budget, 0, False
            rod.trial = rod.tentative = self.rubs
            for tolerance in (1.0, STALLED):
                rod.then = then
                code, iterations, q, F = rod.advance(
                    self._q, self._F, qe, re, f, tolerance * ALGEBRAIC * self.tolerance, MOST_TURN, obstacles
                )
                if code != warm_step.NOT_CONTRACTING:
                    break
            rod.then, rod.trial, rod.tentative = SAME, False, False
            self.worked += self._full_budget - rod.work
            if code == warm_step.ADVANCED:
                self._q, self._F, self._joints, self._begin = q, F, joints, place.begin
                self._spent += iterations
                self._far = far
                self._arrived(rod, place)
                if rod.rotation == 0.0:
                    self._turned = np.fmax(self._turned, rod.rotation_before)
                if kept is None:
                    return True
                if self._stable():
                    self._turned = np.inf
                    return True
                self.put_back(kept)
                return False
        if self.rubs:
            assert self._origin is not None
            self._restore(self._origin)
        self.set_length(before)
        return False

    def _let_yield(self, rod: Rod, place: Place) -> None:
        """Before a step to `place`: see `LoosePiece`."""

    def _arrived(self, rod: Rod, place: Place) -> None:
        """After it."""

    def _lengthen(self, rod: Rod, place: Place) -> tuple[float, float]:
        """Take the length at another place; what its material was then, ratio and shift of `lengthen`."""
        ratio, shift = self.length / place.length, (self._begin - place.begin) / place.length
        self.set_length(place.length)
        if not (self.rubs and isinstance(rod, ActiveSetRod)) or (ratio, shift) == SAME:
            return SAME
        self._F = lengthen(rod, self._F, ratio, shift)
        return ratio, shift

    @property
    def hasty(self) -> bool:
        """Whether the step to the present equilibrium has changed friction more than a step may.

        What lands changes friction at once: a shorter step than `SHORTEST_STEP` does so no less.
        """
        turns = self._rod is not None and self._rod.stride < SHORTER
        return self.rubs and turns and self._far > SHORTEST_STEP

    def _onto_grid(self, rod: Rod, q: np.ndarray, F: np.ndarray) -> bool:
        """Not between supports: a grid has one length."""
        return False

    def _stable(self) -> bool:
        """Whether the present equilibrium is a minimum, by factors made there."""
        rod = self._rod
        assert rod is not None
        stable = rod.refactor(self._q, self._F)
        if stable:
            self._judged_length = self.length
        return stable

    def resolve(self) -> bool:
        """Solve the present equilibrium to the tolerance if that has changed; whether it is still there."""
        if self._rod is not None and self._resolved != self.tolerance:
            self._resolve()
        return self._rod is not None

    @property
    def shape(self) -> np.ndarray:
        """(65, 4) frames at `mirror_image.GRID`, in that of its start."""
        return self.mesh.interpolate(self._q, GRID)

    @property
    def mesh(self) -> Mesh:
        """Of the present equilibrium."""
        assert self._rod is not None
        return self._rod.mesh

    def fall(self, kinematics: Kinematics, joints: np.ndarray, place: Place) -> bool:
        """Descend the energy of this piece alone at a place nearby; if that fails, `put_back` is needed."""
        rod = self._rod
        assert rod is not None
        self.set_length(place.length)
        there = self._conditions(kinematics, joints, place.poses, rod.qe)
        if not rod.chord(there.qe, there.re) < self._reach:
            return False
        self._let_yield(rod, place._replace(yields=None))
        # where it touches, from outside: soft obstacles with rounded edges may lead nowhere
        for descend in (rod.minimum, rod.fall) if rod.touches else (rod.minimum,):
            rod.work = self._full_budget
            found = snap_through(rod, self._q, self._F, there, descend)
            if found is not None:
                self._q, self._F, self._joints, self._begin = found.q, found.F, joints, place.begin
                self._spent += found.iterations
                return True
            rod.refactor(self._q, self._F)  # the descent has left other factors
        return False

    def flow(self, kinematics: Kinematics, joints: np.ndarray, place: Place) -> bool:
        """Fall at a place nearby as if in a viscous medium, with friction; if not, nothing has moved."""
        rod = self._rod
        assert rod is not None
        if not self.rubs:
            return False
        before = self.length
        then = self._lengthen(rod, place)
        qe, re, f, obstacles, far, _ = self._destination(kinematics, joints, place.poses, rod)
        fallen, rod.work = None, FALL_WORK
        if rod.chord(qe, re) < self._reach:
            rod.then = then
            fallen = rod.fall_with_friction(self._q, self._F, qe, re, f, obstacles)
            rod.falling = None  # other pieces would have to wait
        self.worked += FALL_WORK - rod.work
        if fallen is None:
            assert self._origin is not None
            self._restore(self._origin)
            self.set_length(before)
            return False
        self._q, self._F, iterations = fallen
        self._joints, self._begin, self._far, self._turned = joints, place.begin, far, np.inf
        self._spent += iterations
        return True

    def publish(self, poses: np.ndarray, begin: float) -> Equilibrium:
        """The result of the present equilibrium, on a better mesh if it needs one."""
        iterations, self._spent = self._spent, 0
        if not np.isnan(self._turned) and self._stable():
            # margin and error estimate are renewed with the factors
            assert self._rod is not None
            self._rod.rotation_before, self._turned = self._turned, np.nan
        return self._finish(Status.CONVERGED, Status.CONVERGED.sentence, iterations, poses, begin)

    def energy(self, poses: np.ndarray) -> float:
        """Of the present equilibrium, J."""
        assert self._rod is not None
        return float(self._rod.totals[ENERGY]) * self._units.moment - self._datum(self._rod, poses)

    def ends(self) -> Ends:
        """The ends of the present equilibrium, along the axes of its sections."""
        rod, known = self._rod, self._known_ends
        assert rod is not None
        at = rod, self._q, self._F, self._units
        if known is None or not all(map(is_, known[0], at)):
            wrenches = both_wrenches(rod, self._q, self._F, self._units)
            self._known_ends = known = at, Ends.of(wrenches, self.section)
        return known[1]

    @property
    def section(self) -> Section:
        """What it is made of."""
        known, of = self._known_section, (self._stiffness, self._natural, self._compliance)
        if known is None or not all(map(is_, known[0], of)):
            section = Section(self._stiffness * self._units.stiffness, self._natural / self.length)
            if self._compliance is not None:
                section = section._replace(compliance=self._compliance / self._units.force)
            self._known_section = known = of, section
        return known[1]

    def tangent(self, poses: np.ndarray) -> Tangent:
        """The linearised equations about the present equilibrium."""
        assert self._rod is not None
        return Tangent(self._rod, self._q, self._F, self._units, self._names, poses[0], self._density)
