"""One cable of a tracker: its state between two solves."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from cable_ros.branch import handover, results
from cable_ros.branch.cold_start import (
    ACCEPT,
    LENIENT,
    Conditions,
    Found,
    better_mesh,
    equilibria,
    on_mesh,
    refine,
    same,
)
from cable_ros.branch.continuation import End, Fall, walk
from cable_ros.branch.property_change import Section, follow, made_of
from cable_ros.branch.standing import Standing, alone, motion
from cable_ros.contact.distance import nearest, placed
from cable_ros.contact.friction_kernels import COULOMB, FRICTIONLESS, SLIDING
from cable_ros.contact.nodal_rod import STEP, NodalRod
from cable_ros.contact.overlaps import OUTLINE, SPACING, closest_approach, warning
from cable_ros.contact.points import KIND, POINT, SLIPS
from cable_ros.contact.shortest_path import too_short
from cable_ros.contact.touching_rod import TouchingRod
from cable_ros.contact.travel import CONTACT_STEP, FRICTION_STEP, travel
from cable_ros.effects.choice import Choice
from cable_ros.effects.effect import Properties
from cable_ros.equilibrium import Equilibrium, Overlap, Status
from cable_ros.linalg.bordered import NEUTRAL
from cable_ros.rod import warm_step
from cable_ros.rod.initial_shapes import side
from cable_ros.rod.kirchhoff import NOTHING, Rod
from cable_ros.rod.units import Units, relative, relative_change
from cable_ros.scene import Cable, Kinematics

ALGEBRAIC = 1e-3
"""The iteration stops at this part of the tolerance: nothing beside the resolution's error."""
LONGEST = 0.5
"""Longest step in joint values, rad or m, that may be taken at once: whole turns must not be overlooked."""
PATIENCE = 6
"""So many descents may be made of steps that fail, in one solve: each takes as long as a cold start."""
FREE_WORK = 60_000
"""Budget of one solve without obstacles, iterations times unknowns: about 50 ms at 0.8 us."""
WORK = 150_000
"""The same among obstacles, about 300 ms at 2 us; ways that lead somewhere take a fourth of it."""
PROGRESS = 0.01
"""Part of the longest step that a solve must get on with its budget; otherwise it is stuck."""
TWIST = 1e-2
"""Difference of total twist, rad, below which two meshes show the same equilibrium."""
CLAMP_DEPTH = 1e-6
"""A clamp may be this deep inside an obstacle, parts of the length: rounding of poses."""
MODELS = {"coulomb": COULOMB, "sliding": SLIDING}
LONGEST_STRETCH = 1.1
"""A cable that stretches may be pulled to so many lengths; past that its stiffness is no constant."""
GRID = 0.05
"""Largest estimated error that a grid of contacts may have where friction counts; see `NodalRod`."""
COARSE = "Contact was followed on a grid, whose estimated error of the end wrench, {:.1e}, is too large."
ON_GRID = "; contact was followed on a grid, to an estimated error of the end wrench of {:.1e}."
EQUAL = 1e-11
"""Relative difference of two energies that is rounding: a whisper of weight is more, and chooses a side."""
BARRED = 1.0
"""Number of longest steps beyond which a way is first asked whether anything bars it."""
PLACES = np.linspace(0.0, 1.0, 65)
"""Where shapes are compared."""
SINKS = "The cable could not be kept out of what it touches between the places that hold it."
IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])
MOST_WAITING = 64
"""Number of poses that may wait to be gone through, as friction depends on the path."""
ENOUGH = 0.1
"""Part of the budget that must be left to go on from one of them to the next."""
CUT = (
    f"more than {MOST_WAITING} poses were asked for before they were reached, and friction depends on the way"
)
FREE = "Converged to one of many equilibria that turn freely into each other, none more stable than the next."
"""What a result says whose stability margin is 0."""


class Follower:
    """Keeps one cable on its branch. Poses come in as world poses of its two clamps, (2, 7)."""

    def __init__(
        self, cable: Cable, properties: Properties, tolerance: float, polyline_points: int,
        obstacle_names: Sequence[str] = (),
    ) -> None:  # fmt: skip
        self.name = cable.name
        self.tolerance, self.polyline_points = tolerance, polyline_points
        self._hint = cable.total_twist
        self._names = obstacle_names
        self.environment: dict[str, float] = {}
        self.choice: Choice | None = None
        self._use(properties)
        self._reader, self._outline = results.Reader(), results.Reader()
        self._diameter = 2.0 * cable.radius
        self.reset()

    def _use(self, properties: Properties) -> None:
        bending = properties.stiffness[:2]
        self._units = Units(properties.length, float(np.sqrt(bending[0] * bending[1])))
        self._stiffness = properties.stiffness / self._units.stiffness
        self._natural = np.zeros(3) if properties.natural is None else properties.natural * properties.length
        self._weight = properties.weight
        compliance = properties.compliance
        self._compliance = None if compliance is None else compliance * self._units.force
        self._obstacles = properties.obstacles
        self._model = FRICTIONLESS
        if properties.obstacles is not None and properties.friction is not None and properties.friction.any():
            self._obstacles = properties.obstacles.copy()
            self._obstacles[:, 17] = properties.friction
            self._model = MODELS[properties.friction_model]

    @property
    def _reach(self) -> float:
        """How far apart the clamps may be, parts of the length."""
        return 1.0 if self._compliance is None or not self._compliance[2] else LONGEST_STRETCH

    @property
    def _longest(self) -> float:
        """Longest step among obstacles, lengths."""
        if isinstance(self._rod, NodalRod):
            return STEP
        return CONTACT_STEP if self._model == FRICTIONLESS else FRICTION_STEP

    @property
    def _whole(self) -> float:
        """Budget of one solve, iterations times unknowns."""
        return FREE_WORK if self._obstacles is None else WORK

    def reset(self) -> None:
        """Forget the equilibrium."""
        self._rod: Rod | None = None
        self._q, self._F = np.empty((0, 4)), np.empty(3)
        self._joints = np.empty(0)
        self._twist: float | None = None
        self._standing = Standing()
        self._budget, self._passing = self._whole, False
        self._resolved = 0.0
        self._estimate = self._margin = np.nan
        self._apart = np.inf

    def become(
        self, properties: Properties, kinematics: Callable[[np.ndarray], np.ndarray], index: int
    ) -> bool:
        """Go on with other properties, on the same branch; `kinematics(joints)[index]`: where the clamps are.

        Returns whether the equilibrium could be followed. Where not, the next solve starts from it as it was
        if there are obstacles, whose friction remembers, and otherwise searches for the one nearest in twist.
        """
        before, rod = self._units, self._rod
        self._use(properties)
        if rod is None:
            return True
        poses = kinematics(self._joints)[index]
        load = relative(poses, rod.qe, self._weight, self._units.length, self._units.force)[2]
        section = Section(self._stiffness, self._natural, load, self._compliance)
        scale = self._units.force / before.force
        changed = follow(rod, self._q, self._F, section, scale, ALGEBRAIC * self.tolerance)
        self._estimate = np.inf
        if changed is not None:
            self._rod, self._q, self._F = changed
        elif rod.obstacles is not None:
            self._rod, self._F = made_of(rod, section, scale), self._F / scale
            self._rod.refactor(self._q, self._F)
        else:
            self._rod = None
            self._lose("it could not be followed to the cable's new properties")
        return changed is not None

    def _lose(self, told: str) -> None:
        self._standing = self._standing.lost(told, self._model == COULOMB)
        if self._rod is not None:
            self._rod.forgot = False

    @property
    def lost(self) -> str:
        """What happened to the branch; empty while it is known."""
        loss = self._standing.loss
        return "" if loss is None else loss.told

    def distrust(self, told: str) -> None:
        """Take the branch for lost until it is known again, or `reset`; `told`: what happened, a clause."""
        self._lose(told)

    def _conditions(
        self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray, before: np.ndarray
    ) -> Conditions:
        qe, re, f = relative(poses, before, self._weight, self._units.length, self._units.force)
        return Conditions(qe, re, f, self._placed(kinematics, joints, poses))

    def _placed(self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray) -> np.ndarray | None:
        if self._obstacles is None:
            return None
        return placed(self._obstacles, kinematics.obstacle_poses(joints), poses[0], self._units.length)

    def solve(
        self, kinematics: Kinematics, index: int, joints: np.ndarray, poses: np.ndarray, begin: float
    ) -> Equilibrium:
        """The equilibrium at `joints`, the clamps at `poses`; `kinematics` tells of the way there."""
        self._budget = self._whole
        if self._standing.waiting:
            unfinished = self._catch_up(kinematics, index, joints, begin)
            if unfinished is not None:
                return unfinished
        return self._follow(kinematics, index, joints, poses, begin)

    def _catch_up(
        self, kinematics: Kinematics, index: int, joints: np.ndarray, begin: float
    ) -> Equilibrium | None:
        """Go through the poses that wait, on the way to `joints`; the result if that is not finished."""
        waiting = self._standing.waiting if self._model == COULOMB and self._rod is not None else ()
        self._standing = replace(self._standing, waiting=())
        if len(waiting) > MOST_WAITING:
            self._lose(CUT)
            return None
        for i, asked in enumerate(waiting):
            unfinished = self._past(kinematics, index, np.array(asked), begin)
            if unfinished is not None:
                self._standing = replace(self._standing, waiting=waiting[i:]).asked(self._joints, joints)
                return unfinished
        return None

    def _past(
        self, kinematics: Kinematics, index: int, joints: np.ndarray, begin: float
    ) -> Equilibrium | None:
        """Go through a pose that was asked for before; the result if that, or the budget, is not finished."""
        self._passing = True
        found = self._follow(kinematics, index, joints, kinematics.poses(joints)[index], begin)
        self._passing = False
        if self._rod is not None:
            self._budget = self._rod.work
        if found.status is Status.UNFINISHED:
            return found
        if self._budget > ENOUGH * self._whole:
            return None
        return self.failed(Status.UNFINISHED, Status.UNFINISHED.sentence, time.perf_counter() - begin)

    def _follow(
        self, kinematics: Kinematics, index: int, joints: np.ndarray, poses: np.ndarray, begin: float
    ) -> Equilibrium:
        if self._rod is not None and self._resolved != self.tolerance:
            self._resolve()
        rod = self._rod
        if rod is None:
            hint = self._hint if self._twist is None else self._twist
            return self._cold(kinematics, joints, poses, begin, hint)
        rod.work = self._budget
        if isinstance(rod, TouchingRod):
            rod.patience = PATIENCE
        if _farthest(joints, self._joints) > LONGEST:
            return self._far(kinematics, index, joints, poses, begin)
        qe, re, f = relative(poses, rod.qe, self._weight, self._units.length, self._units.force)
        obstacles = self._placed(kinematics, joints, poses)
        if obstacles is not None and (blocked := self._blocked(obstacles, re)):
            return self.failed(Status.OUT_OF_REACH, blocked, time.perf_counter() - begin)
        if obstacles is not None and (
            travel(rod.qe, rod.re, rod.obstacles, qe, re, obstacles) > self._longest
        ):
            return self._far(kinematics, index, joints, poses, begin)
        before = None if self._standing.loss is None else _conditions(rod)
        code, iterations, q, F = rod.advance(
            self._q, self._F, qe, re, f, ALGEBRAIC * self.tolerance, 0.6, obstacles
        )
        if code == warm_step.ADVANCED:
            self._q, self._F, self._joints = q, F, joints
            if before is not None:
                self._mend(before, step=True)
            return self._finish(Status.CONVERGED, Status.CONVERGED.sentence, iterations, poses, begin)
        return self._far(kinematics, index, joints, poses, begin)

    def _resolve(self) -> None:
        """Bring the equilibrium to another tolerance on its branch; forget it if that fails."""
        rod, tolerance = self._rod, self.tolerance
        assert rod is not None
        if isinstance(rod, NodalRod):  # its grid stays
            self._resolved = tolerance
            return
        spare = copy.deepcopy(rod)
        if rod.refactor(self._q, self._F):
            found = Found(rod, self._q, self._F, float(rod.totals[3]), float(rod.totals[4]), 0)
            if not _touches(rod):
                # its mesh may be too fine as well
                other = on_mesh(found, better_mesh(rod, rod.relative_error(self._q, self._F), tolerance))
                found = found if other is None or abs(other.twist - found.twist) > TWIST else other
            fine, estimate = refine(found, tolerance)
            if estimate <= tolerance:
                self._take(fine, self._joints)
                self._estimate = np.inf
                return
        if rod.relative_error(self._q, self._F) <= tolerance:
            # fine enough as it is
            self._rod, self._resolved = spare, tolerance
            return
        if self._carried(rod, self._q, self._F):
            self._resolved = tolerance
            return
        self._rod = None
        self._lose(f"it could not be brought to the tolerance {tolerance:g}")

    def _mend(self, before: Conditions, step: bool) -> None:
        """Count the motion since `before` in what must happen before a lost branch is known again."""
        rod, loss = self._rod, self._standing.loss
        assert rod is not None
        assert loss is not None
        touches = _touches(rod)
        loss = loss.followed(motion(before, _conditions(rod)), touches and _slips(rod), step)
        if loss.forgotten or (not touches and loss.due and self._alone(rod)):
            self._standing = Standing()
            return
        self._standing = Standing(replace(loss, unasked=0.0) if not touches and loss.due else loss)

    def _alone(self, rod: Rod) -> bool:
        energy, _, _ = rod.linearize(self._q, self._F)
        rod.factor(0.0)
        here = Found(rod, self._q, self._F, energy, float(rod.totals[4]), 0)
        return alone(here, self._stiffness, self._natural, self._compliance, self.tolerance)

    def _no_way(self, conditions: Conditions) -> str:
        """What is in the way of every cable of this length between the clamps; empty where nothing is."""
        obstacles, re = conditions.obstacles, conditions.re
        return self._blocked(obstacles, re) or self._barred(obstacles, re)

    def _blocked(self, obstacles: np.ndarray | None, re: np.ndarray) -> str:
        """A sentence where a clamp is inside an obstacle, so that no shape of the cable can be right."""
        if obstacles is None:
            return ""
        for end, r in (("start", NOTHING), ("end", re)):
            distance, which = nearest(obstacles, r)
            if distance < -CLAMP_DEPTH:
                return (
                    f"The {end} clamp of cable '{self.name}' is"
                    f" {-distance * self._units.length * 1e3:.4g} mm inside"
                    f" obstacle '{self._names[which]}', the cable's radius counted; it must be outside."
                )
        return ""

    def _barred_far(self, rod: Rod, there: Conditions) -> str:
        """As `_barred`, asked only for a way of several steps: it takes as long as some."""
        assert rod.obstacles is not None
        assert there.obstacles is not None
        far = travel(rod.qe, rod.re, rod.obstacles, there.qe, there.re, there.obstacles)
        return self._barred(there.obstacles, there.re) if far > BARRED * self._longest else ""

    def _barred(self, obstacles: np.ndarray | None, re: np.ndarray) -> str:
        """A sentence where no way past the obstacles is as short as the cable."""
        found = None if obstacles is None else too_short(re, obstacles, self._reach)
        if found is None or obstacles is None:
            return ""
        missing, which = found
        return (
            f"Cable '{self.name}' is too short to get past obstacle '{self._names[which]}': the shortest way"
            f" found between its clamps is {missing * self._units.length * 1e3:.4g} mm longer."
        )

    def _far(
        self, kinematics: Kinematics, index: int, joints: np.ndarray, poses: np.ndarray, begin: float
    ) -> Equilibrium:
        """Too far for one step: walk there through the joints, and start again where no walk leads there."""
        rod = self._rod
        assert rod is not None
        there = self._conditions(kinematics, joints, poses, IDENTITY)
        within = there.obstacles is not None and float(np.linalg.norm(there.re)) < self._reach
        if within and (no_way := self._blocked(there.obstacles, there.re) or self._barred_far(rod, there)):
            # no walk leads anywhere
            return self.failed(Status.OUT_OF_REACH, no_way, time.perf_counter() - begin)
        rod.refactor(self._q, self._F)
        origin, before, start = self._joints, _conditions(rod), rod

        def path(t: float) -> Conditions:
            there = origin + t * (joints - origin)
            return self._conditions(kinematics, there, kinematics.poses(there)[index], start.qe)

        way = float(np.abs(joints - origin).max(initial=0.0))
        longest = LONGEST / max(way, LONGEST)
        carrier = handover.nodal if isinstance(rod, TouchingRod) and rod.model != SLIDING else None
        first = longest * min(rod.stride, 1.0 if isinstance(rod, NodalRod) else 0.5)
        result = walk(
            rod, self._q, self._F, path, ALGEBRAIC * self.tolerance, first, longest, carrier, self._longest
        )
        self._rod = rod = result.rod
        # the rod is where the walk ended, maybe on another mesh: what comes next goes on from there
        reached = joints if result.end is End.ARRIVED else origin + result.at * (joints - origin)
        self._q, self._F, self._joints = result.q, result.F, reached
        self._fell(result.falls)
        got_on = result.at >= PROGRESS * longest or any(fall.folded for fall in result.falls)
        got_on |= self._budget < self._whole  # a whole one may do better
        if result.end is End.ARRIVED or (result.end is End.UNFINISHED and got_on):
            rod.refactor(result.q, result.F)
            if self._standing.loss is not None and not any(fall.jumped for fall in result.falls):
                self._mend(before, step=False)
            if result.end is End.ARRIVED:
                return self._finish(
                    Status.CONVERGED, Status.CONVERGED.sentence, result.iterations, poses, begin
                )
            # the mesh must keep up with what the cable does on a long way
            there_poses = kinematics.poses(reached)[index]
            self._finish(Status.UNFINISHED, "", result.iterations, there_poses, begin)
            self._standing = self._standing.asked(reached, joints)
            unfinished = self.failed(
                Status.UNFINISHED, Status.UNFINISHED.sentence, time.perf_counter() - begin
            )
            return replace(unfinished, iterations=result.iterations)
        if within and (barred := self._barred(there.obstacles, there.re)):
            return self.failed(Status.OUT_OF_REACH, barred, time.perf_counter() - begin)
        beyond = result.end is End.BEYOND_REACH
        why = "its clamps were farther apart than it is long" if beyond else "it could not be followed"
        told = f"at {100 * result.at:.4g} % of a step {why}, and the pose was solved anew"
        return self._cold(kinematics, joints, poses, begin, self._twist, told)

    def _fell(self, falls: Sequence[Fall]) -> None:
        """Keep what falls on a walk mean for what is known."""
        for fall in falls:
            if fall.touched and self._model == COULOMB:
                self._lose("it fell with contacts whose friction was forgotten")
            elif fall.jumped and not fall.folded:
                turned = f"total twist {fall.twist_before:.3f} -> {fall.twist_after:.3f} rad"
                self._lose(f"it fell, {turned}, with a stability margin of {fall.margin:.2g} before")
            elif fall.jumped:
                self._standing = self._standing.snapped(fall)

    def _cold(
        self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray, begin: float, hint: float | None,
        told: str = "",
    ) -> Equilibrium:  # fmt: skip
        """Search the pose for stable equilibria: take the one nearest the hint, or of least energy.

        `told`: how the branch was lost, if there was one.
        """
        conditions = self._conditions(kinematics, joints, poses, IDENTITY)
        chord = float(np.linalg.norm(conditions.re))
        if not chord < self._reach:
            length = self._units.length
            message = (
                f"The clamps are {(chord - 1.0) * length * 1e3:.4g} mm farther apart than the cable is long"
                f" ({length:g} m)."
            )
            if chord <= 1.0:
                message = (
                    f"The clamps are as far apart as the cable is long ({length:g} m):"
                    " its tension has no bound."
                )
            return self.failed(Status.OUT_OF_REACH, message, time.perf_counter() - begin)
        if barred := self._no_way(conditions):
            return self.failed(Status.OUT_OF_REACH, barred, time.perf_counter() - begin)
        found = equilibria(
            self._stiffness, self._natural, conditions, hint, self.tolerance, False, self._compliance
        )
        if hint is not None:
            found.sort(key=lambda one: abs(one.twist - hint))
        found = _one_side_first(found, hint or 0.0)
        best: tuple[float, Found, Found] | None = None
        for one in found:
            fine, estimate = refine(one, self.tolerance)
            if best is None or estimate < best[0]:
                best = estimate, fine, one
            if estimate <= self.tolerance:
                break
        if (best is None or best[0] > self.tolerance) and conditions.obstacles is not None:
            rested = handover.cold(self._stiffness, self._natural, conditions, hint, self.tolerance)
            best, found = (best, found) if rested is None else ((0.0, rested, rested), [rested])
        if best is not None and best[0] < np.inf:
            if told:
                twist = "" if hint is None else f", total twist {hint:.3f} -> {best[1].twist:.3f} rad"
                self._lose(told + twist)
            self._take(best[1], joints)
            return self._finish(Status.CONVERGED, _choice(best[2], found), best[1].iterations, poses, begin)
        return self.failed(Status.NOT_CONVERGED, Status.NOT_CONVERGED.sentence, time.perf_counter() - begin)

    def branches(self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray) -> list[Equilibrium]:
        """The stable equilibria of a wide search at a pose, by rising energy; the last is followed on."""
        begin = time.perf_counter()
        conditions = self._conditions(kinematics, joints, poses, IDENTITY)
        out: list[Equilibrium] = []
        self._standing = Standing()
        if not np.linalg.norm(conditions.re) < self._reach:
            return out
        found: list[Found] = []
        for turns in (-1, 0, 1):
            hint = (self._hint or 0.0) + 2.0 * np.pi * turns
            for one in equilibria(
                self._stiffness, self._natural, conditions, hint, self.tolerance, True, self._compliance
            ):
                fine, estimate = refine(one, self.tolerance)
                if estimate <= self.tolerance and not any(same(fine, other) for other in found):
                    found.append(fine)
        for one in sorted(found, key=lambda one: one.energy):
            self._take(one, joints)
            status = Status.CONVERGED
            out.append(self._finish(status, status.sentence, one.iterations, poses, begin))
        return out

    def _take(self, found: Found, joints: np.ndarray) -> None:
        self._rod, self._q, self._F, self._joints = found.rod, found.q, found.F, joints
        if isinstance(found.rod, TouchingRod) and found.rod.model != self._model:
            # its factors are those without friction
            found.rod.model, found.rod.ready = self._model, False
        self._resolved = self.tolerance

    def _finish(
        self, status: Status, message: str, iterations: int, poses: np.ndarray, begin: float
    ) -> Equilibrium:
        """Check the resolution, refine where it has become too coarse, and read off the result."""
        rod = self._rod
        assert rod is not None
        if isinstance(rod, NodalRod):
            rod = self._exactly(rod)
        if isinstance(rod, NodalRod):
            self._estimate, self._margin = rod.relative_error(self._q, self._F), rod.stability_margin()
            self._apart = self._closest_approach(poses[0])
            if self._estimate > self._limit:
                message = COARSE.format(self._estimate)
                return self.failed(Status.NOT_CONVERGED, message, time.perf_counter() - begin)
            if self._estimate > self.tolerance and status is Status.CONVERGED:
                message = f"{message[:-1]}{ON_GRID.format(self._estimate)}"
        elif rod.drift == 0.0 or not self._estimate <= self.tolerance or rod.rubs_anew():
            self._estimate = rod.relative_error(self._q, self._F)
            sinks = rod.unresolved(self._q, LENIENT).any()
            beside = rod.clamp_errors(self._q, self._F).max()
            if max(self._estimate, beside) > ACCEPT * self.tolerance or sinks:
                found = Found(rod, self._q, self._F, float(rod.totals[3]), float(rod.totals[4]), 0)
                fine, self._estimate = refine(found, self.tolerance)
                iterations += fine.iterations
                before = rod, self._q, self._F
                self._take(fine, self._joints)
                rod = fine.rod
                sinks = rod.unresolved(self._q, LENIENT).any()
                if (rod.forgot or sinks or self._estimate > self.tolerance) and self._carried(*before):
                    return self._finish(status, message, iterations, poses, begin)
            beside = rod.clamp_errors(self._q, self._F).max()
            self._estimate = max(self._estimate, beside, rod.friction_error(self._q, self._F))
            if self._estimate > self.tolerance and self._carried(rod, self._q, self._F):
                return self._finish(status, message, iterations, poses, begin)
            if self._estimate > self.tolerance:
                message = (
                    f"The end wrench cannot be had to {self.tolerance:.0e}: its estimated error stays"
                    f" {self._estimate:.1e}."
                )
                return self.failed(Status.NOT_CONVERGED, message, time.perf_counter() - begin)
            if sinks:
                return self.failed(Status.NOT_CONVERGED, SINKS, time.perf_counter() - begin)
            self._margin = rod.stability_margin()
            self._apart = self._closest_approach(poses[0])
        elif self._apart < self._diameter + self._units.length * rod.drift:
            # two points can have come so much nearer since that was last looked at
            self._apart = self._closest_approach(poses[0])
        if rod.forgot:
            self._lose("friction was forgotten in a change of the mesh")
        unit, standing = self._units, self._standing
        if self._margin < 10.0 * NEUTRAL and status is Status.CONVERGED:
            message = FREE
        if standing.loss is not None:
            status, message = Status.BRANCH_LOST, standing.loss.message
        elif standing.snaps and status is Status.CONVERGED and not self._passing:
            status, message = Status.SNAPPED, standing.story(unit.moment)
            self._standing = Standing()
        overlaps: tuple[Overlap, ...] = ()
        if self._apart < self._diameter:
            overlaps = (Overlap(self.name, self._apart, self._diameter),)
            message = f"{message} {warning(self._apart, self._diameter)}"
        if self.choice is not None:
            message += self.choice.note
        self._twist = float(rod.totals[4])
        start = poses[0]
        end_wrench, start_wrench, points, orientations = self._reader.read(
            rod, self._q, self._F, start, unit, self.polyline_points
        )
        friction = None if self._obstacles is None else self._obstacles[:, 17]
        return Equilibrium.of(
            status=status, message=message, converged=standing.loss is None, stable=True,
            stability_margin=self._margin, end_wrench=end_wrench, start_wrench=start_wrench,
            points=points, orientations=orientations, total_twist=self._twist,
            energy=float(rod.totals[3]) * unit.moment - unit.length * float(self._weight @ start[:3]),
            error_estimate=self._estimate, iterations=iterations,
            solve_time=time.perf_counter() - begin, overlaps=overlaps,
            _tangent=results.tangent(rod, self._q, self._F, unit, self._names, start),
            _touching=results.touching(rod, friction, self._names, start, unit),
        )  # fmt: skip

    def _carried(self, rod: Rod, q: np.ndarray, F: np.ndarray) -> bool:
        """Go on with the equilibrium (q, F), whose friction counts, on a uniform grid; whether that is so."""
        if not isinstance(rod, TouchingRod) or rod.model != COULOMB or not rod.count:
            return False
        carried = handover.nodal(rod, q, F)
        if carried is not None:
            self._rod, self._q, self._F = carried, carried.shape, carried.end_force
        return carried is not None

    def _exactly(self, rod: NodalRod) -> Rod:
        """The equilibrium to the tolerance, if nothing rubs; else the rod as it is."""
        found = handover.exact(rod, self.tolerance, self._model)
        if found is None:
            return rod
        self._take(found, self._joints)
        self._estimate = np.inf
        return found.rod

    @property
    def _limit(self) -> float:
        """Largest error on a grid of contacts that is published."""
        return max(self.tolerance, GRID if self._model == COULOMB else 0.0)

    def _closest_approach(self, start: np.ndarray) -> float:
        """How near the cable comes to itself, m; `start` (7,): its start clamp."""
        if not self._diameter or self._rod is None:
            return np.inf
        return closest_approach(self.outline(start), self._units.length, SPACING * self._diameter)

    def outline(self, start: np.ndarray) -> np.ndarray:
        """(OUTLINE, 3) centreline of the present equilibrium, world, m; `start` (7,): its start clamp."""
        assert self._rod is not None
        return self._outline.read(self._rod, self._q, self._F, start, self._units, OUTLINE)[2]

    @property
    def rod(self) -> Rod | None:
        """The rod of the present equilibrium; None without one."""
        return self._rod

    @property
    def q(self) -> np.ndarray:
        """(n, 4) its nodal frames."""
        return self._q

    def difference(self, found: np.ndarray, expected: np.ndarray) -> float:
        """Relative difference of two end wrenches (6,), SI: the larger of the force's and the moment's."""
        unit = np.repeat([self._units.force, self._units.moment], 3)
        return relative_change((found - expected) / unit, expected / unit, Rod.least)

    def size(self, wrench: np.ndarray) -> float:
        """Magnitude of a wrench (6,), SI, in units of the cable."""
        return float(np.hypot(np.linalg.norm(wrench[:3]) / self._units.force,
                              np.linalg.norm(wrench[3:]) / self._units.moment)) + Rod.least  # fmt: skip

    def wrenches(self, rod: Rod) -> tuple[np.ndarray, np.ndarray]:
        """(6,), (6,): what the cable exerts at its end and start at present, SI, in the clamps' frames."""
        return results.wrenches(rod, self._F, self._units)

    def failed(self, status: Status, message: str, solve_time: float) -> Equilibrium:
        """A result without numbers."""
        return results.failed(status, message, solve_time, self.polyline_points)


def _conditions(rod: Rod) -> Conditions:
    """What the rod is up against at its last equilibrium."""
    return Conditions(rod.qe, rod.re, rod.f, rod.obstacles)


def _touches(rod: Rod) -> bool:
    return (isinstance(rod, TouchingRod) and rod.count > 0) or (isinstance(rod, NodalRod) and rod.touches)


def _slips(rod: Rod) -> bool:
    """Whether all contacts slip, and are points: where a patch lies is the past's doing even as it slips."""
    if not isinstance(rod, TouchingRod):
        return False
    points = rod.points[: rod.count]
    return bool((points[:, SLIPS] == 1.0).all() and (points[:, KIND] == POINT).all())


def _farthest(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference of two arrays (n,); in Python, which is quicker for a few joints."""
    out = 0.0
    for x, y in zip(a.tolist(), b.tolist(), strict=True):
        out = max(out, abs(x - y))
    return out


def _one_side_first(found: list[Found], hint: float) -> list[Found]:
    """Those as good as the first one by the side to which they go, before all others."""

    def alike(one: Found) -> bool:
        energy = abs(one.energy - found[0].energy) <= EQUAL * (1.0 + abs(found[0].energy))
        return energy and abs(abs(one.twist - hint) - abs(found[0].twist - hint)) <= 1e-3

    first = [one for one in found if alike(one)]
    first.sort(key=lambda one: -side(one.rod.mesh.interpolate(one.q, PLACES), PLACES))
    return first + [one for one in found if not alike(one)]


def _choice(chosen: Found, found: list[Found]) -> str:
    """The sentence of a cold start, which says so where there are others of the same energy."""
    twins = sum(abs(other.energy - chosen.energy) <= 1e-6 * (1.0 + abs(chosen.energy)) for other in found)
    sentence = Status.CONVERGED.sentence
    if twins < 2:
        return sentence
    rule = "this side, towards (-1, 3, 2) of the start clamp's axes, is a rule's choice"
    return f"{sentence[:-1]}, one of {twins} of equal energy: {rule}."
