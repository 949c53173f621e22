# SPDX-License-Identifier: Apache-2.0
"""One cable whose branch of equilibria is followed from pose to pose, within the budget of each call."""

from __future__ import annotations

import copy
import time
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from cable_ros.branch.branch_record import Loss
from cable_ros.branch.cable_model import CLAMP_DEPTH
from cable_ros.branch.cold_start import Conditions, Found, conditions_of, equilibria
from cable_ros.branch.continuation import FALLBACK_LYING_WORK, HASTY_WORK, LITTLE, continue_branch
from cable_ros.branch.mirror_image import GRID, by_rule
from cable_ros.branch.refinement import MOST_ELEMENTS, afresh, better_mesh, on_mesh, refine, without_slivers
from cable_ros.branch.searched_equilibrium import IDENTITY, SearchedEquilibrium
from cable_ros.branch.walk import VERY_TAUT, Continuation, End, Path
from cable_ros.contact.friction_kernels import COULOMB, SLIDING
from cable_ros.contact.shortest_path import gets_taut
from cable_ros.contact.travel import travel
from cable_ros.equilibrium import Equilibrium, Status
from cable_ros.rod import warm_step
from cable_ros.rod.elements import Mesh
from cable_ros.rod.kirchhoff import ALGEBRAIC, FREE_TO_TURN, Rod
from cable_ros.rod.rod_state import TWIST
from cable_ros.rod.units import relative
from cable_ros.scene import Kinematics

LONGEST = 0.5
"""Maximum step in joint values, rad or m, that is taken at once: a whole turn must not be overlooked."""
PATIENCE = 6
"""Maximum number of penalty continuations in one solve: each takes as long as a cold start."""
FREE_WORK = 60_000
"""Budget of one solve without obstacles, iterations times unknowns: about 50 ms at 0.8 us."""
WORK = 200_000
"""The same among obstacles, 200 to 400 ms at 1 to 2 us; continuations that arrive take a quarter of it."""
SMOOTH = 5
"""Number of iterations of a step above which the branch may have forked in it."""
LEAST_WAY_BACK = 1e-4
"""Least part of the longest step with which a cable that is taut tries the next pose, if all steps of a call
failed: one drawn around a ball could not be led back, for each call began with the same long steps."""
PROGRESS = 0.01
"""Minimum progress of one solve, as a fraction of the longest step; with less it is stuck."""
PROGRESS_LYING = 1e-3
"""The same on a grid, or where it lies on something rough: a budget is ten steps there, and after a hard
place they grow again."""
LEAST_SHARE, LEAST_SHARE_GRID, LEAST_SHARE_ROUGH = 0.01, 1e-3, 1e-6
"""Unless its steps, halved again and again, were still longer than this when the budget was used up. On a
grid a step that fails may cost all of it, and where the cable falls several do; where it touches something
rough, friction may turn within 1e-7 lengths."""
MOST_SNAPS = 12
"""Maximum number of snap-throughs with friction on the way to one pose: a joint value that no robot has would
lead round and round."""
SAME_TWIST = 1e-2
"""Maximum difference of total twist, rad, of one equilibrium on two meshes."""
FAR = 1.0
"""Number of longest steps beyond which the path is checked for obstruction before it is tried."""
TAUT = (
    "Cable '{}' is taut around obstacle '{}': on the way to this pose, of which {:.3g} % could be followed,"
    " its tension has no bound. Go back, or reset the cable if it lies otherwise."
)
RISES = (
    "Cable '{}' is pulled around obstacle '{}' and could not be followed beyond {:.3g} % of the way to this"
    " pose: its end force is {:.3g} N there and rises steeply. Go back, or reset the cable if it lies"
    " otherwise."
)
TURNED_OVER = (
    "With all friction that friction_model: sliding asks for, the cable has no equilibrium beside the last"
    " one on the way to this pose: that friction turns it over. The next pose is followed from there."
)
TIGHT = 1e3
"""Minimum end force, EI / L^2, of a cable on a grid that may be taut where it gets no farther."""
PATIENT = 3
"""Maximum number of such poses in a row; then an equilibrium is sought."""
MOST_CRAWLS = 12
"""Maximum number of solves in a row that hardly got on: from a cold start, without friction, a heavy cable on
rough ground takes steps of 1e-7 lengths at first, and five solves until they are long."""
AFTER_FALL = 0.25
"""Factor of the step that failed, for the next one after a fall in vain."""
ORIGIN = np.array([0.0] * 6 + [1.0])
"""A start clamp there: x y z, quaternion x y z w."""
POSE_LEFT_OUT = "a pose asked for before could not be reached, and friction depends on the path"


class Way(NamedTuple):
    """The way to a pose, and the cable before it."""

    kinematics: Kinematics
    number: int
    """Of the cable."""
    joints: np.ndarray
    """Joint values of the pose."""
    poses: np.ndarray
    """Of the clamps there."""
    begin: float
    """When the call began, s."""
    path: Path
    within: Conditions | None
    """At the pose, if there are obstacles and its clamps are near enough."""
    rod: Rod
    before: Conditions
    """Where the rod is."""
    shape: tuple[Mesh, np.ndarray]
    """Its mesh, and nodal frames (n, 4)."""
    longest: float
    """Maximum step, fraction of the way; so is the next one."""
    first: float
    """The first step."""
    share: float
    """Part of the longest step that the call before has left."""
    way_back: float
    """The same of a cable that is taut."""
    fell: bool
    """Whether it is falling."""
    untried: bool
    """Whether no step has been tried yet, for one to the pose itself has used the budget up."""


class FollowedEquilibrium(SearchedEquilibrium):
    """A cable with its last equilibrium, from which its branch is followed to the next pose."""

    @property
    def _full_budget(self) -> float:
        """Budget of one solve, iterations times unknowns."""
        return FREE_WORK if self._obstacles is None else WORK

    def _follow(
        self, kinematics: Kinematics, index: int, joints: np.ndarray, poses: np.ndarray, begin: float
    ) -> Equilibrium:
        """Follow the branch to the pose at `joints`, with the clamps at `poses`, or search there."""
        if self._rod is not None and self._resolved != self.tolerance:
            self._resolve()
        rod = self._rod
        if rod is None:
            target_twist = self._target_twist if self._twist is None else self._twist
            return self._cold(kinematics, joints, poses, begin, target_twist)
        rod.work = self._budget
        rod.patience, rod.short, rod.forked = PATIENCE, False, False
        falls = rod.falling is not None
        if (
            falls
            or min(self._share, self._way_back) < 1.0
            or largest_difference(joints, self._joints) > LONGEST
        ):
            return self._continue_to(kinematics, index, joints, poses, begin)
        qe, re, f, obstacles, far, room = self._destination(kinematics, joints, poses, rod)
        if room < -CLAMP_DEPTH and (inside := self._clamp_inside(obstacles, re)):
            return self.failed(Status.OUT_OF_REACH, inside, time.perf_counter() - begin)
        if far > (1.0 + LITTLE) * min(rod.longest_step, rod.next_step):
            return self._continue_to(kinematics, index, joints, poses, begin)
        before, shape = conditions_of(rod) if self._remembers else None, (rod.mesh, self._q)
        put_back = rod.kept() if rod.frictional and not rod.on_grid else None
        code, iterations, q, F = rod.advance(
            self._q, self._F, qe, re, f, ALGEBRAIC * self.tolerance, 0.6, obstacles
        )
        rod.note_step(code, far)
        hard = code == warm_step.ADVANCED and iterations > SMOOTH
        if hard and put_back is not None and rod.stability_margin() < -FREE_TO_TURN:
            # stability is not judged in each step with friction: this one has led past a fold
            put_back()
            code = warm_step.NOT_CONVEX
        if code == warm_step.ADVANCED:
            self._q, self._F, self._joints, self._afresh = q, F, joints, False
            if rod.forked:
                self._record = self._record.after_fork(1.0)
            if iterations > SMOOTH:
                self._take_by_rule(*shape)
            if before is not None:
                self._add_motion(before, True, partial(self._free_twist, kinematics, index))
            return self._finish(Status.CONVERGED, Status.CONVERGED.sentence, iterations, poses, begin)
        if code == warm_step.NOT_CONVEX and rod.frictional:
            rod.refactor_at = 0.0  # each step is judged on the way to where it loses its stability
        return self._continue_to(kinematics, index, joints, poses, begin)

    def _take_by_rule(self, mesh: Mesh, q: np.ndarray) -> None:
        """Of two images take that of a rule, if the branch has forked since the shape q (n, 4) on the mesh.

        Just beyond a fork both are so near each other that a step leads to either.
        """
        rod = self._rod
        assert rod is not None
        if rod.on_grid or rod.frictional or not rod.touches or self._ends is not None:
            return
        found, forked = by_rule(Found.at(rod, self._q, self._F), mesh.interpolate(q, GRID))
        if forked:
            self._record = self._record.after_fork(1.0)
        if found.rod is not rod:
            self._take(found, self._joints)

    def _free_twist(self, kinematics: Kinematics, index: int, loss: Loss) -> float | None:
        """Total twist, rad, here of a cable without contact, continued straight from the last known pose.

        None if there is no such pose; NaN if the continuation does not arrive.
        """
        if not loss.joints:
            return None
        origin = np.array(loss.joints)

        def free(t: float, before: np.ndarray) -> Conditions:
            there = kinematics.poses(origin + t * (self._joints - origin))[index]
            return Conditions(*relative(there, before, self._weight, self._units.length, self._units.force))

        start = free(0.0, IDENTITY)
        found = equilibria(
            self._stiffness,
            self._natural,
            start,
            loss.twist,
            self.tolerance,
            False,
            self._compliance,
            self._ends,
        )
        if not found:
            return np.nan
        one = min(found, key=lambda one: abs(one.twist - loss.twist))
        one.rod.work = FREE_WORK

        def path(t: float) -> Conditions:
            return free(t, one.rod.qe)

        led = continue_branch(one.rod, one.q, one.F, path, ALGEBRAIC * self.tolerance)
        return float(led.rod.totals[TWIST]) if led.end is End.ARRIVED else np.nan

    def _resolve(self) -> None:
        """Solve the present equilibrium to another tolerance; lose it if that fails."""
        rod, tolerance = self._rod, self.tolerance
        assert rod is not None
        rod.falling = None
        if rod.on_grid:  # the grid does not depend on the tolerance
            self._resolved = tolerance
            return
        spare = copy.deepcopy(rod)
        if rod.refactor(self._q, self._F):
            found = Found.at(rod, self._q, self._F)
            if not rod.touches:
                # a coarser mesh may do
                mesh = better_mesh(rod, rod.relative_error(self._q, self._F), tolerance)
                if len(mesh.lengths) > MOST_ELEMENTS:
                    mesh = without_slivers(rod.mesh)
                other = on_mesh(found, mesh)
                found = found if other is None or abs(other.twist - found.twist) > SAME_TWIST else other
            fine, estimate = refine(found, tolerance)
            if estimate <= tolerance and not fine.rod.forgot:
                self._take(fine, self._joints)
                return
        if rod.relative_error(self._q, self._F) <= tolerance:
            # the mesh is fine enough
            self._rod, self._resolved = spare, tolerance
            return
        if self._onto_grid(rod, self._q, self._F):
            self._resolved = tolerance
            return
        self._rod = None
        self._lose(f"it could not be brought to the tolerance {tolerance:g}")

    def _taut(self, rod: Rod, at: float, longer: bool) -> str:
        """The sentence on a cable whose end force seems to go to infinity, at a fraction of the way.

        It is taut if the string to which it can be pulled gets longer than the cable on the rest of the way.
        A cable that friction holds off its shortest path has slack, and yet a force that rises as steeply.
        """
        read = rod.loaded_contacts(self._q)
        if read is None:
            return Status.NOT_CONVERGED.sentence
        contacts = read()
        pressing = contacts.obstacles[np.argmax(np.linalg.norm(contacts.forces, axis=1))]
        told = self.name, self._names[int(pressing)], 100.0 * at
        if longer:
            return TAUT.format(*told)
        return RISES.format(*told, float(np.linalg.norm(self._F)) * self._units.force)

    def _gets_taut(self, rod: Rod, path: Path, at: float) -> bool:
        """See `gets_taut`, from the present equilibrium to the end of the path."""

        def there(t: float) -> tuple[np.ndarray, np.ndarray]:
            conditions = path(at + t * (1.0 - at))
            assert conditions.obstacles is not None
            return conditions.re, conditions.obstacles

        re, obstacles = there(1.0)
        assert rod.obstacles is not None
        far = travel(rod.qe, rod.re, rod.obstacles, rod.qe, re, obstacles)
        return gets_taut(self.outline(ORIGIN) / self._units.length, there, far, self._reach)

    def _too_short_far(self, rod: Rod, there: Conditions) -> str:
        """`_too_short` if the path takes several steps, else empty: the check costs as much as some steps."""
        assert rod.obstacles is not None
        assert there.obstacles is not None
        far = travel(rod.qe, rod.re, rod.obstacles, there.qe, there.re, there.obstacles)
        return self._too_short(there.obstacles, there.re) if far > FAR * rod.longest_step else ""

    def _continue_to(
        self, kinematics: Kinematics, index: int, joints: np.ndarray, poses: np.ndarray, begin: float
    ) -> Equilibrium:
        """Continue the branch through the joints to a pose too far for one step; cold start if that fails."""
        rod = self._rod
        assert rod is not None
        there = self._conditions(kinematics, joints, poses, IDENTITY)
        within = there.obstacles is not None and float(np.linalg.norm(there.re)) < self._reach
        if within and (
            obstruction := self._clamp_inside(there.obstacles, there.re) or self._too_short_far(rod, there)
        ):
            return self.failed(Status.OUT_OF_REACH, obstruction, time.perf_counter() - begin)
        rod.refactor(self._q, self._F)
        origin = self._joints

        def path(t: float) -> Conditions:
            there = origin + t * (joints - origin)
            return self._conditions(kinematics, there, kinematics.poses(there)[index], rod.qe)

        longest = LONGEST / max(largest_difference(joints, origin), LONGEST)
        shares, self._share, self._way_back = (self._share, self._way_back), 1.0, 1.0
        first = longest * min(rod.stride, rod.first_stride, *shares)
        untried = rod.work <= 0.0 < self._budget  # one step to the pose itself has used it up
        way = Way(
            kinematics, index, joints, poses, begin, path, there if within else None, rod, conditions_of(rod),
            (rod.mesh, self._q), longest, first, *shares, rod.falling is not None, untried,
        )  # fmt: skip
        result = continue_branch(
            rod, self._q, self._F, path, ALGEBRAIC * self.tolerance, first, longest,
            self._on_grid if rod.replaceable else None,
            lying_work=FALLBACK_LYING_WORK if self._grid_history is None else HASTY_WORK,
            taut_force=self._taut_force, may_turn=self._ends is None, slackens=way.way_back < 1.0,
        )  # fmt: skip
        reached = joints if result.end is End.ARRIVED else origin + result.at * (joints - origin)
        self._take_result(way, result, reached)
        progressed = self._progressed(way, result)
        if result.end is End.ARRIVED or (result.end is End.UNFINISHED and progressed):
            return self._on_the_way(way, result, reached)
        return self._ended(way, result, reached)

    def _take_result(self, way: Way, result: Continuation, reached: np.ndarray) -> None:
        """Take the equilibrium in which a continuation ended, maybe on another rod, at these joints."""
        self._rod, self._q, self._F, self._joints = result.rod, result.q, result.F, reached
        if result.fork is not None:
            self._record = self._record.after_fork(result.fork)
        self._record_snaps(result.snaps)
        if not any(snap.jumped for snap in result.snaps):
            self._take_by_rule(*way.shape)

    def _progressed(self, way: Way, result: Continuation) -> bool:
        """Whether the next call may go on from there, if this one has not arrived; sets its share."""
        rod = self._rod
        assert rod is not None
        slow = rod.on_grid or rod.lies
        snapped = sum(snap.jumped for snap in result.snaps) if self._model == COULOMB else 0
        self._snapped = 0 if result.end is End.ARRIVED else self._snapped + snapped
        least = PROGRESS_LYING if slow else PROGRESS
        progressed = result.at >= least * way.longest or any(snap.folded for snap in result.snaps)
        # another rod, another mesh, the rest of a fall, or a whole budget, may get farther
        falls = rod.falling is not None
        if falls:  # where it does not come to rest shorter steps may lead on
            self._share = way.share if way.fell else AFTER_FALL * result.step / way.longest
        progressed |= result.rod is not way.rod or rod.work > 0.0 or falls or self._budget < self._full_budget
        rough = LEAST_SHARE_ROUGH if rod.frictional else LEAST_SHARE
        least_step = way.longest * (LEAST_SHARE_GRID if rod.on_grid else rough)
        # where friction turns over within 1e-5 lengths steps are as short, and grow again behind it
        self._crawled = self._crawled + 1 if not progressed and result.at > 0.0 else 0
        crawls = slow and 0 < self._crawled <= MOST_CRAWLS
        shortened = least_step < result.step < way.first
        goes_on = crawls or way.untried or shortened or (way.fell and not falls)
        if not progressed and result.end is End.UNFINISHED and goes_on:
            progressed = True
            self._share = min(result.step / way.longest, way.share if way.fell else 1.0)
        return progressed and self._snapped <= MOST_SNAPS

    def _on_the_way(self, way: Way, result: Continuation, reached: np.ndarray) -> Equilibrium:
        """The result of a continuation that has arrived, or goes on from the joints that it has reached."""
        rod = self._rod
        assert rod is not None
        rod.refactor(self._q, self._F)
        if self._remembers and not any(snap.jumped for snap in result.snaps):
            self._add_motion(way.before, False, partial(self._free_twist, way.kinematics, way.number))
        if result.end is End.ARRIVED:
            self._afresh = False
            sentence = Status.CONVERGED.sentence
            return self._finish(Status.CONVERGED, sentence, result.iterations, way.poses, way.begin)
        if rod.falling is None:  # refine the mesh on a long path, too
            there = way.kinematics.poses(reached)[way.number]
            self._finish(Status.UNFINISHED, "", result.iterations, there, way.begin)
        return replace(self._unfinished(way, reached), iterations=result.iterations)

    def _unfinished(self, way: Way, reached: np.ndarray) -> Equilibrium:
        self._record = self._record.with_waiting(reached, way.joints)
        seconds = time.perf_counter() - way.begin
        return self.failed(Status.UNFINISHED, Status.UNFINISHED.sentence, seconds)

    def _ended(self, way: Way, result: Continuation, reached: np.ndarray) -> Equilibrium:
        """The result of a continuation that gets no farther: on a fresh mesh, taut, lost, or a cold start."""
        rod, there = self._rod, way.within
        assert rod is not None
        if result.end in (End.UNFINISHED, End.STUCK) and self._begin_afresh(rod, reached):
            return self._unfinished(way, reached)
        if there is not None and (too_short := self._too_short(there.obstacles, there.re)):
            return self.failed(Status.OUT_OF_REACH, too_short, time.perf_counter() - way.begin)
        if not self._passing and (taut := self._ended_taut(way, result)):
            return self.failed(Status.NOT_CONVERGED, taut, time.perf_counter() - way.begin)
        if self._passing:
            # nobody asks for this pose any more: continue from here rather than from a cold start
            self._lose(POSE_LEFT_OUT)
            seconds = time.perf_counter() - way.begin
            return self.failed(Status.NOT_CONVERGED, Status.NOT_CONVERGED.sentence, seconds)
        beyond = result.end is End.BEYOND_REACH
        why = "its clamps were farther apart than it is long" if beyond else "it could not be followed"
        if self._snapped > MOST_SNAPS:
            why, self._snapped = f"it had snapped {self._snapped} times", 0
        if self._model == SLIDING and rod.frictional and not beyond:
            # that friction has no history: where the next pose has an equilibrium with it, it is found
            self._turned_over += 1
            if self._turned_over <= PATIENT:
                return self.failed(Status.NOT_CONVERGED, TURNED_OVER, time.perf_counter() - way.begin)
            why += " with all friction that friction_model: sliding asks for"
        cause = f"at {100 * result.at:.4g} % of a step {why}, and the pose was solved again from a cold start"
        return self._cold(way.kinematics, way.joints, way.poses, way.begin, self._twist, cause)

    def _ended_taut(self, way: Way, result: Continuation) -> str:
        """A sentence if the continuation ended since the cable is taut, else an empty one."""
        rod, force = self._rod, float(np.linalg.norm(self._F))
        assert rod is not None
        # a branch that could not be followed at such a force is kept for the way back
        taut = result.end is End.TAUT or (force > VERY_TAUT and (rod.frictional or not rod.on_grid))
        # a grid bends a taut cable too little to follow it farther, but it keeps the branch for the way back
        if not (taut or (rod.on_grid and way.within is not None and force > TIGHT)):
            return ""
        longer = self._gets_taut(rod, way.path, result.at)
        if taut:
            self._taut_force = min(self._taut_force, force)
            rod.follow_nothing()
            if result.at == 0.0 and (rod.work <= 0.0 or way.way_back < 1.0):
                self._way_back = max(min(result.step / way.longest, way.way_back), LEAST_WAY_BACK)
        return self._taut(rod, result.at, longer) if taut or longer else ""

    def _begin_afresh(self, rod: Rod, joints: np.ndarray) -> bool:
        """Whether the present equilibrium, at `joints`, has got another mesh: the branch may go on there.

        Once between two poses, and not with friction, whose history belongs to the mesh.
        """
        if self._afresh or self._ends is not None or not rod.touches:
            return False
        if rod.on_grid or rod.remembers or rod.frictional or not rod.refactor(self._q, self._F):
            return False
        self._afresh = True
        fresh = afresh(Found.at(rod, self._q, self._F), self.tolerance)
        if fresh is not None:
            self._take(fresh, joints)
        return fresh is not None


def largest_difference(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference of two arrays (n,); in Python, which is faster for a few joints."""
    out = 0.0
    for x, y in zip(a.tolist(), b.tolist(), strict=True):
        if abs(x - y) > out:
            out = abs(x - y)
    return out
