# SPDX-License-Identifier: Apache-2.0
"""The present equilibrium of one cable: its checks, and the result that publishes it."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from cable_ros.branch import handover, results
from cable_ros.branch.branch_record import FORKED, BranchRecord
from cable_ros.branch.cold_start import Found
from cable_ros.branch.extremes import Obstacles, Reading, extremes
from cable_ros.branch.held_equilibrium import HeldEquilibrium
from cable_ros.branch.refinement import ACCEPT, LENIENT, refine
from cable_ros.branch.snap_through import left_on_refining
from cable_ros.contact.distance import FRICTION_COEFFICIENT
from cable_ros.contact.friction_kernels import COULOMB
from cable_ros.contact.nodal_contacts import MOST
from cable_ros.contact.nodal_rod import NodalRod
from cable_ros.contact.overlaps import OUTLINE, SPACING, closest_approach, warning
from cable_ros.equilibrium import Equilibrium, Overlap, Status
from cable_ros.rod import quaternion
from cable_ros.rod.kirchhoff import FREE_TO_TURN, Rod
from cable_ros.rod.rod_state import ENERGY, TWIST
from cable_ros.scene.cable_limits import CableLimits

GRID = 0.05
"""Maximum estimated error of an equilibrium with friction on a grid of contacts; see `NodalRod`."""
REFINE = 0.4
"""Part of that from which a grid becomes finer: the error that friction has once, it keeps."""
SAMPLED = 5e-3
"""Maximum error, by what friction does between its samples, that is told: a grid's is mostly larger, and has
been 1.7 % in the poses after one of 0.3 %."""
ACCEPT_ROUGH = 0.25
"""As ACCEPT, with friction at points alone, or at one that sticks. The estimate holds in place what sticks;
where its friction is held instead, as a judge does who is told it, the error was three to four times that."""
ASTRAY = "Friction was followed in steps, whose estimated error of the end wrench, {:.1e}, is too large."
UNKNOWN = (
    "A part of the path could not be followed: what friction holds since then may change the end wrench by "
    "{:.1e} of it. It is known again once all that touches has slipped."
)
MOST_OF_PATH = 0.1
"""The largest such error of what is published, relative: mostly it is told two or three times too large.
With 0.05 right answers about the ground drawn away under a rod were withheld."""
COARSE = "Contact was solved on a grid, whose estimated error of the end wrench, {:.1e}, is too large."
ON_GRID = "; contact was solved on a grid, to an estimated error of the end wrench of {:.1e}."
AT_SAMPLES = "; friction is known at samples, to an estimated error of the end wrench of {:.1e}."
IN_STEPS = "; friction was followed in steps, to an estimated error of the end wrench of {:.1e}."
INACCURATE = "The estimated error of the end wrench, {:.1e}, exceeds the tolerance {:.0e}."
SINKS = "The cable still penetrates an obstacle between contact points, or one would have to pull it."
UNSTABLE = "The equilibrium that was found is not stable: its stability margin is {:.1e}."
POLISHED = 1e-8
"""Last step of Newton's method before a mesh is judged too coarse, where it is solved again for that."""
FREE = "Converged to one of a continuous family of equilibria: the cable turns freely from one to the next."
"""The message of a result whose stability margin is 0."""


class TrackedEquilibrium(HeldEquilibrium):
    """A cable whose last equilibrium is checked, refined and published."""

    _compared: tuple[np.ndarray | None, np.ndarray | None, bool] = None, None, False
    """Obstacles that were compared last, and whether they are where those of the equations are."""

    def _finish(
        self, status: Status, message: str, iterations: int, poses: np.ndarray, begin: float
    ) -> Equilibrium:
        """Check the discretisation error, refine the mesh if it is too large, and make the result."""
        assert self._rod is not None
        self._turned_over = 0
        if isinstance(self._rod, NodalRod):
            self._estimate = self._rod.relative_error(self._q, self._F)
            self._exactly(self._rod, status)
            self._finer()
            self._centre()
        else:
            self._off_grid.shorten()
        rod = self._rod
        due = rod.rotation == 0.0 or not self._estimate <= self.tolerance or rod.contact_changed()
        # on the way to a pose a new mesh costs what lies more of friction's history than the old one's error
        under_way = status is Status.UNFINISHED and rod.lies
        if due and not rod.on_grid and not under_way:
            more, problem = self._refine(rod)
            iterations, rod = iterations + more, self._rod
            if rod.on_grid:
                return self._finish(status, message, iterations, poses, begin)
            if problem:
                return self.failed(Status.NOT_CONVERGED, problem, time.perf_counter() - begin)
        if due or rod.on_grid:
            self._margin = rod.stability_margin()
        if self._margin < -FREE_TO_TURN:
            problem = UNSTABLE.format(self._margin)
            return self.failed(Status.NOT_CONVERGED, problem, time.perf_counter() - begin)
        if due or rod.on_grid or self._apart < self._diameter + self._units.length * rod.rotation:
            # two points can have approached by that much since the last check
            self._apart = self._closest_approach(poses[0])
        error = self._error
        if error > self.tolerance and error > self._limit:  # mostly it meets the tolerance
            return self.failed(Status.NOT_CONVERGED, COARSE.format(error), time.perf_counter() - begin)
        if rod.forgot:
            self._lose("friction was forgotten when the mesh changed")
        error = max(error, rod.path_error(self._path_force))
        if error > MOST_OF_PATH:
            why = (UNKNOWN if rod.holds_unknown else ASTRAY).format(error)
            return self.failed(Status.NOT_CONVERGED, why, time.perf_counter() - begin)
        status, message = self._verdict(status, message, error)
        return self._result(status, message, error, iterations, poses, begin)

    @property
    def _path_force(self) -> np.ndarray:
        """(3,) force, EI / L^2, by whose changes the error of friction's path is told: that at the end."""
        return self._F

    def _refine(self, rod: Rod) -> tuple[int, str]:
        """Estimate the error of a rod without a grid, and refine its mesh until it meets the tolerance.

        If it cannot meet that, a frictional cable moves to a grid. Returns the iterations that the new mesh
        took, and a sentence if there is no equilibrium to publish, else an empty one.
        """
        self._estimate = rod.relative_error(self._q, self._F)
        if self._estimate > ACCEPT * self.tolerance:
            self._q, self._F = rod.polished(self._q, self._F, POLISHED)
            self._estimate = rod.relative_error(self._q, self._F)
        sinks = rod.unresolved(self._q, LENIENT).any()
        beside = rod.clamp_errors(self._q, self._F).max()
        iterations = 0
        points = rod.frictional and (not rod.lies or rod.sticks_at_point)
        accept = ACCEPT_ROUGH if points else ACCEPT
        if max(self._estimate, beside) > accept * self.tolerance or sinks:
            before = Found.at(rod, self._q, self._F)
            fine, estimate = refine(before, self.tolerance)
            if fine.rod.forgot and not rod.forgot:
                # a pose that is not published costs less than the history of friction
                told = max(self._estimate, beside, rod.friction_error(before.q, before.F))
                moved = self._onto_better_grid(rod, before.q, before.F)
                if moved:
                    return fine.iterations, ""
                rod.refactor(before.q, before.F)
                self._estimate = told
                amiss = INACCURATE.format(told, self.tolerance) if told > self.tolerance else ""
                return fine.iterations, SINKS if sinks else amiss
            iterations, snapped = fine.iterations, left_on_refining(before, fine)
            fine = fine if snapped is None else snapped[0]
            self._take(fine, self._joints)
            rod, self._estimate = fine.rod, estimate
            sinks = rod.unresolved(self._q, LENIENT).any()
            left = snapped is not None and snapped[1].jumped
            worse = rod.forgot or sinks or self._estimate > self.tolerance or left
            if worse and self._onto_better_grid(before.rod, before.q, before.F):
                return iterations, ""
            if snapped is not None:
                self._record_snaps([snapped[1]])
            beside = rod.clamp_errors(self._q, self._F).max()
        resolved = max(self._estimate, beside) <= self.tolerance
        self._estimate = max(self._estimate, beside, rod.friction_error(self._q, self._F))
        most = max(SAMPLED, rod.path_error(self._path_force))  # that of the path is told as well
        told = resolved and self._model == COULOMB and self._estimate <= most
        if self._estimate > self.tolerance and not told:
            moved = self._onto_better_grid(rod, self._q, self._F)
            return iterations, "" if moved else INACCURATE.format(self._estimate, self.tolerance)
        return iterations, SINKS if sinks else ""

    def _verdict(self, status: Status, message: str, error: float) -> tuple[Status, str]:
        """Status and message of the present equilibrium, with all that its user should know."""
        converged, record = status is Status.CONVERGED, self._record
        if converged and error > self.tolerance:
            rod = self._rod
            assert rod is not None
            of_contact = ON_GRID if rod.on_grid or self._earlier_error >= self._estimate else AT_SAMPLES
            message = f"{message[:-1]}{(of_contact if error <= self._error else IN_STEPS).format(error)}"
        if converged and self._margin < FREE_TO_TURN:
            message = FREE
        if record.loss is not None:
            status, message = Status.BRANCH_LOST, record.loss.message
        elif converged and record.snaps and not self._passing:
            status, message = Status.SNAPPED, record.snap_message(self._units.moment)
            self._record = BranchRecord()
        elif converged and record.fork is not None and not self._passing:
            message = message[:-1] + FORKED.format(100.0 * record.fork)
            self._record = replace(record, fork=None)
        if self._apart < self._diameter:
            message = f"{message} {warning(self._apart, self._diameter)}"
        return status, message if self.choice is None else message + self.choice.note

    def _result(
        self, status: Status, message: str, error: float, iterations: int, poses: np.ndarray, begin: float
    ) -> Equilibrium:
        """The present equilibrium as it is published; `poses` (2, 7): where its ends are held."""
        rod, unit = self._rod, self._units
        assert rod is not None
        self._twist = float(rod.totals[TWIST])
        start = poses[0] if self._ends is None else self.origin(poses)
        where = self.polyline_points if self.fractions is None else self.fractions
        end_wrench, start_wrench, points, orientations = self._reader.read(
            rod, self._q, self._F, start, unit, where
        )
        touching = None
        if rod.obstacles is not None:
            touching = results.touching(rod, self._q, self._names, start, unit)
        meets = self._apart < self._diameter
        return Equilibrium.of({
            "status": status, "message": message, "converged": self._record.loss is None, "stable": True,
            "stability_margin": self._margin, "end_wrench": end_wrench, "start_wrench": start_wrench,
            "points": points, "orientations": orientations, "total_twist": self._twist,
            "energy": float(rod.totals[ENERGY]) * unit.moment - self._datum(rod, poses),
            "error_estimate": error, "iterations": iterations, "solve_time": time.perf_counter() - begin,
            "overlaps": (Overlap(self.name, self._apart, self._diameter),) if meets else (),
            "_tangent": results.Tangent(rod, self._q, self._F, unit, self._names, start, self._density),
            "_mounts": None if self._ends is None and self.fractions is None else poses[:, 3:].copy(),
            "_touching": touching,
        })  # fmt: skip

    def _onto_grid(self, rod: Rod, q: np.ndarray, F: np.ndarray) -> bool:
        """Move the frictional equilibrium (q, F) to a uniform grid of contacts; whether that succeeded."""
        if self._model != COULOMB or not rod.frictional:
            return False
        on_grid = self._on_grid(rod, q, F)
        if on_grid is not None:
            self._rod, self._q, self._F = on_grid, on_grid.shape, on_grid.end_force
            self._off_grid.skip_next()
        return on_grid is not None

    def _onto_better_grid(self, rod: Rod, q: np.ndarray, F: np.ndarray) -> bool:
        """`_onto_grid`, unless the grid's error is too large to be published: a mesh's is smaller."""
        kept = self._rod, self._q, self._F, self._grid_history
        if not self._onto_grid(rod, q, F):
            return False
        assert self._rod is not None
        if self._rod.relative_error(self._q, self._F) <= self._limit:
            return True
        self._rod, self._q, self._F, self._grid_history = kept
        return False

    def _on_grid(self, rod: Rod, q: np.ndarray, F: np.ndarray) -> NodalRod | None:
        """`handover.nodal`, which takes over the error of the path so far with friction's history."""
        on_grid, error = handover.nodal(rod, q, F), rod.path_error(F)
        if on_grid is not None and error > 0.0:
            # that of points refuses no pose: mostly it is told as too large
            self._keep_grid_error(error if rod.lies else min(error, self._limit))
        return on_grid

    def _exactly(self, rod: NodalRod, status: Status) -> None:
        """Take the equilibrium without the grid's error, if one is found beside it.

        With friction, this is tried only at poses that are asked for, but for the finest grid, which may come
        late for good, and less and less often the sooner the cable was on its grid again.
        """
        rubs = rod.rubs
        if rubs and (status is Status.UNFINISHED or self._passing) and rod.cells < MOST:
            return
        if rubs and self._off_grid.waits and self._estimate <= self._limit:
            self._off_grid.skip()
            return
        least = 0.0 if status is Status.UNFINISHED or self._passing else handover.LEAST_WORK
        found = handover.exact(rod, self.tolerance, self._model, least=least)
        if rubs:
            self._off_grid.tried()
        if found is None:
            return
        if rubs:
            apart = handover.apart(rod, found.rod, found.F)
            if apart > self._estimate:
                return  # its friction is not that of the grid
            self._keep_grid_error(apart + rod.twin_error)
        self._take(found, self._joints)

    def _finer(self) -> None:
        """Take a finer grid where the error of this one is too large, if there is one."""
        rod = self._rod
        if not isinstance(rod, NodalRod) or self._estimate <= REFINE * self._limit or rod.cells >= MOST:
            return
        finer = rod.finer()
        if finer is not None:
            self._rod, self._q, self._F = finer, finer.shape, finer.end_force
            self._estimate = finer.relative_error(self._q, self._F)

    def _centre(self) -> None:
        """Let what touches at a point alone touch where it does, not in its cell's middle.

        A cable that does not shear has left the grid before.
        """
        rod = self._rod
        if not isinstance(rod, NodalRod) or not self._shears or not rod.touches or self._passing:
            return
        centred = handover.centred(rod)
        if centred is not None:
            if ((rod.state.lam > 0.0) & ~rod.sliding()).any() and self._model == COULOMB:
                centred.doubt(rod.twin_error)  # what sticks keeps the grid's error
            self._rod, self._q, self._F = centred, centred.shape, centred.end_force
            self._estimate = centred.relative_error(self._q, self._F)

    @property
    def _limit(self) -> float:
        """Maximum error of a published equilibrium on a grid of contacts."""
        return max(self.tolerance, GRID if self._model == COULOMB or self._shears else 0.0)

    def _closest_approach(self, start: np.ndarray) -> float:
        """Smallest distance of the cable from itself, m; `start` (7,): where it starts."""
        if not self._diameter or self._rod is None:
            return np.inf
        return closest_approach(self.outline(start), self._units.length, SPACING * self._diameter)

    def origin(self, poses: np.ndarray) -> np.ndarray:
        """(7,) where the present equilibrium begins, world, along the start mount's axes.

        `poses` (2, 7): of the mounts. A cable whose start is free or slides begins where its end allows.
        """
        start: np.ndarray = poses[0]
        if self._ends is None:
            return start
        if self._ends.start.held or self._rod is None:
            return start
        turn = quaternion.matrix_from_ros(start[3:])
        return np.concatenate([poses[1, :3] - self._units.length * turn @ self._rod.totals[:3], start[3:]])

    def _datum(self, rod: Rod, poses: np.ndarray) -> float:
        """Work, J, of weight and given forces up to the mount from which the rod's energy counts."""
        ends, unit = self._ends, self._units
        if ends is None:
            return unit.length * float(self._weight.dot(poses[0, :3]))  # in a third of the time of @
        work = unit.length * float(self._weight @ poses[0 if ends.start.placed else 1, :3])
        if not ends.free:
            return work - unit.moment * float(rod.given @ rod.re)
        load, free, held = (ends.start, 0, 1) if ends.end.placed else (ends.end, 1, 0)
        force = unit.force * quaternion.matrix_from_ros(poses[free, 3:]) @ load.force
        return work + float(force @ poses[held, :3])

    def outline(self, start: np.ndarray) -> np.ndarray:
        """(OUTLINE, 3) centreline of the present equilibrium, world, m; `start` (7,): its start clamp."""
        assert self._rod is not None
        return self._outline.read(self._rod, self._q, self._F, start, self._units, OUTLINE)[2]

    def extremes(
        self, limits: CableLimits, obstacles: np.ndarray, links: np.ndarray, start: np.ndarray
    ) -> Reading:
        """Computes `Equilibrium.extremes` of the present equilibrium when called.

        Args:
            limits: of the cable.
            obstacles: (n, WIDTH) of the scene, SI, in the frames of their links.
            links: (n, 7) these links in the world.
            start: (7,) the start clamp in the world.
        """
        assert self._rod is not None
        known = self._obstacles is not None and self._ends is None and self._same_obstacles(obstacles)
        # behind them are those that stand for other cables
        placed = self._rod.obstacles[: len(obstacles)] if known and self._rod.obstacles is not None else None
        beside = Obstacles(obstacles, links, self._names, placed)
        return extremes(self._rod, self._q, self._F, start, self._units, limits, beside)

    def _same_obstacles(self, obstacles: np.ndarray) -> bool:
        """Whether these (n, WIDTH) are where those of its equations are."""
        if self._compared[0] is not obstacles or self._compared[1] is not self._obstacles:
            assert self._obstacles is not None
            geometry = slice(FRICTION_COEFFICIENT)
            same = np.array_equal(obstacles[:, geometry], self._obstacles[:, geometry])
            self._compared = obstacles, self._obstacles, same
        return self._compared[2]

    @property
    def rod(self) -> Rod | None:
        """The rod of the present equilibrium; None without one."""
        return self._rod

    @property
    def q(self) -> np.ndarray:
        """(n, 4) its nodal frames."""
        return self._q

    @property
    def end_force(self) -> np.ndarray:
        """(3,) end force of the present equilibrium, EI / L^2, along the start mount's axes."""
        return self._F

    def wrenches(self, rod: Rod) -> tuple[np.ndarray, np.ndarray]:
        """(6,), (6,): wrenches of the cable on its end and start clamps, SI, in the clamps' frames."""
        return results.wrenches(rod, self._q, self._F, self._units)

    def failed(self, status: Status, message: str, solve_time: float) -> Equilibrium:
        """A result without numbers."""
        return results.failed(status, message, solve_time, self.polyline_points)
