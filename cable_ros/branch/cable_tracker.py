# SPDX-License-Identifier: Apache-2.0
"""One cable of a tracker, followed from pose to pose on its branch."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from cable_ros.branch import handover
from cable_ros.branch.cold_start import (
    Conditions,
    Found,
    better_mesh,
    equilibria,
    on_mesh,
    refine,
)
from cable_ros.branch.continuation import End, walk
from cable_ros.branch.property_change import Section, follow, made_of
from cable_ros.branch.searched_equilibrium import IDENTITY, SearchedEquilibrium
from cable_ros.branch.standing import Loss
from cable_ros.branch.tracked_equilibrium import conditions_of, touches
from cable_ros.contact.friction_kernels import COULOMB, FRICTIONLESS, SLIDING
from cable_ros.contact.nodal_rod import STEP, NodalRod
from cable_ros.contact.touching_rod import TouchingRod
from cable_ros.contact.travel import CONTACT_STEP, FRICTION_STEP, travel
from cable_ros.effects.effect import Properties
from cable_ros.equilibrium import Equilibrium, Status
from cable_ros.rod import warm_step
from cable_ros.rod.kirchhoff import Rod
from cable_ros.rod.rod_state import TWIST
from cable_ros.rod.units import relative
from cable_ros.scene import Kinematics

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
SAME_TWIST = 1e-2
"""Difference of total twist, rad, below which two meshes show the same equilibrium."""
BARRED = 1.0
"""Number of longest steps beyond which a way is first asked whether anything bars it."""
MOST_WAITING = 64
"""Number of poses that may wait to be gone through, as friction depends on the path."""
ENOUGH = 0.1
"""Part of the budget that must be left to go on from one of them to the next."""
LEFT_OUT = "a pose that was asked for on the way could not be followed to, and friction depends on the way"
CUT = (
    f"more than {MOST_WAITING} poses were asked for before they were reached, and friction depends on the way"
)


class CableTracker(SearchedEquilibrium):
    """Keeps one cable on its branch. Poses come in as world poses of its two clamps, (2, 7)."""

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

    def become(
        self, properties: Properties, kinematics: Callable[[np.ndarray], np.ndarray], index: int
    ) -> bool:
        """Go on with other properties, on the same branch; `kinematics(joints)[index]`: where the clamps are.

        Returns whether the equilibrium could be followed. Where not, the next solve starts from it as it was
        if there are obstacles, whose friction remembers, and otherwise searches for the one nearest in twist.
        """
        before, rod = self._units, self._rod
        self._pending = None
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

    def solve(
        self, kinematics: Kinematics, index: int, joints: np.ndarray, poses: np.ndarray, begin: float
    ) -> Equilibrium:
        """The equilibrium at `joints`, the clamps at `poses`; `kinematics` tells of the way there."""
        self._budget = self._whole
        if self._pending is not None:
            found = self._resume(joints, begin)
            if found is not None:
                return found
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
        if waiting and np.array_equal(waiting[-1], joints):
            waiting = waiting[:-1]
        for i, asked in enumerate(waiting):
            found = self._past(kinematics, index, np.array(asked), begin)
            done = found.status is not Status.UNFINISHED
            if not done or self._budget <= ENOUGH * self._whole:
                left = replace(self._standing, waiting=waiting[i + done :])
                self._standing = left.asked(self._joints, joints)
                return self.failed(Status.UNFINISHED, Status.UNFINISHED.sentence, time.perf_counter() - begin)
        return None

    def _past(self, kinematics: Kinematics, index: int, joints: np.ndarray, begin: float) -> Equilibrium:
        """Go through a pose that was asked for before."""
        self._passing = True
        found = self._follow(kinematics, index, joints, kinematics.poses(joints)[index], begin)
        self._passing = False
        if self._rod is not None:
            self._budget = min(self._budget, self._rod.work)
        return found

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
        rod.patience = 0
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
        before = conditions_of(rod) if self._remembers else None
        code, iterations, q, F = rod.advance(
            self._q, self._F, qe, re, f, ALGEBRAIC * self.tolerance, 0.6, obstacles
        )
        if code == warm_step.ADVANCED:
            self._q, self._F, self._joints = q, F, joints
            if before is not None:
                self._mend(before, True, partial(self._free_twist, kinematics, index))
            return self._finish(Status.CONVERGED, Status.CONVERGED.sentence, iterations, poses, begin)
        return self._far(kinematics, index, joints, poses, begin)

    def _free_twist(self, kinematics: Kinematics, index: int, loss: Loss) -> float | None:
        """Total twist, rad, of the cable if it touched nothing and came straight from where it was known.

        None if it was known nowhere; NaN if it could not have come.
        """
        if not loss.joints:
            return None
        origin = np.array(loss.joints)

        def free(t: float, before: np.ndarray) -> Conditions:
            there = kinematics.poses(origin + t * (self._joints - origin))[index]
            return Conditions(*relative(there, before, self._weight, self._units.length, self._units.force))

        start = free(0.0, IDENTITY)
        found = equilibria(
            self._stiffness, self._natural, start, loss.twist, self.tolerance, False, self._compliance
        )
        if not found:
            return np.nan
        one = min(found, key=lambda one: abs(one.twist - loss.twist))
        one.rod.work = FREE_WORK

        def path(t: float) -> Conditions:
            return free(t, one.rod.qe)

        led = walk(one.rod, one.q, one.F, path, ALGEBRAIC * self.tolerance)
        return float(led.rod.totals[TWIST]) if led.end is End.ARRIVED else np.nan

    def _resolve(self) -> None:
        """Bring the equilibrium to another tolerance on its branch; forget it if that fails."""
        rod, tolerance = self._rod, self.tolerance
        assert rod is not None
        if isinstance(rod, NodalRod):  # its grid stays
            self._resolved = tolerance
            return
        spare = copy.deepcopy(rod)
        if rod.refactor(self._q, self._F):
            found = Found.at(rod, self._q, self._F)
            if not touches(rod):
                # its mesh may be too fine as well
                other = on_mesh(found, better_mesh(rod, rod.relative_error(self._q, self._F), tolerance))
                found = found if other is None or abs(other.twist - found.twist) > SAME_TWIST else other
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

    def _barred_far(self, rod: Rod, there: Conditions) -> str:
        """As `_barred`, asked only for a way of several steps: it takes as long as some."""
        assert rod.obstacles is not None
        assert there.obstacles is not None
        far = travel(rod.qe, rod.re, rod.obstacles, there.qe, there.re, there.obstacles)
        return self._barred(there.obstacles, there.re) if far > BARRED * self._longest else ""

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
        rod.patience = PATIENCE if isinstance(rod, TouchingRod) else 0
        origin, before, start = self._joints, conditions_of(rod), rod

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
        # on another rod, or with a whole budget, it may do better
        got_on |= rod is not start or self._budget < self._whole
        if result.end is End.ARRIVED or (result.end is End.UNFINISHED and got_on):
            rod.refactor(result.q, result.F)
            if self._remembers and not any(fall.jumped for fall in result.falls):
                self._mend(before, False, partial(self._free_twist, kinematics, index))
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
        if self._passing:
            # nobody waits for an answer there: better to go on from here than from a cold start
            self._lose(LEFT_OUT)
            seconds = time.perf_counter() - begin
            return self.failed(Status.NOT_CONVERGED, Status.NOT_CONVERGED.sentence, seconds)
        beyond = result.end is End.BEYOND_REACH
        why = "its clamps were farther apart than it is long" if beyond else "it could not be followed"
        told = f"at {100 * result.at:.4g} % of a step {why}, and the pose was solved anew"
        return self._cold(kinematics, joints, poses, begin, self._twist, told)


def _farthest(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference of two arrays (n,); in Python, which is quicker for a few joints."""
    out = 0.0
    for x, y in zip(a.tolist(), b.tolist(), strict=True):
        out = max(out, abs(x - y))
    return out
