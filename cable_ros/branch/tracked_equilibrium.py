# SPDX-License-Identifier: Apache-2.0
"""The present equilibrium of one cable: its state, its checks, and the result that publishes it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from cable_ros.branch import handover, results
from cable_ros.branch.cable_model import CableModel
from cable_ros.branch.cold_start import (
    ACCEPT,
    LENIENT,
    Conditions,
    Found,
    refine,
)
from cable_ros.branch.continuation import FREE_TO_TURN, SnapThrough
from cable_ros.branch.extremes import Obstacles, extremes
from cable_ros.branch.standing import Loss, Memory, Standing, alone, motion
from cable_ros.common.backoff import Backoff
from cable_ros.contact.distance import FRICTION_COEFFICIENT, placed
from cable_ros.contact.friction_kernels import COULOMB
from cable_ros.contact.nodal_rod import NodalRod
from cable_ros.contact.overlaps import OUTLINE, SPACING, closest_approach, warning
from cable_ros.contact.points import KIND, POINT, SLIPS
from cable_ros.contact.touching_rod import TouchingRod
from cable_ros.effects.choice import Choice
from cable_ros.effects.effect import Properties
from cable_ros.equilibrium import Equilibrium, Overlap, Status
from cable_ros.limits import Extreme
from cable_ros.rod import quaternion
from cable_ros.rod.kirchhoff import Rod
from cable_ros.rod.rod_state import ENERGY, TWIST
from cable_ros.scene import Cable
from cable_ros.scene.cable_limits import CableLimits

GRID = 0.05
"""Maximum estimated error of an equilibrium with friction on a grid of contacts; see `NodalRod`."""
COARSE = "Contact was solved on a grid, whose estimated error of the end wrench, {:.1e}, is too large."
ON_GRID = "; contact was solved on a grid, to an estimated error of the end wrench of {:.1e}."
SINKS = "The cable still penetrates an obstacle between contact points."
LONGEST_STAY = 63
"""Maximum number of poses that a cable stays on its grid of contacts before it is solved without again."""
FREE = "Converged to one of a continuous family of equilibria: the cable turns freely from one to the next."
"""The message of a result whose stability margin is 0."""


class TrackedEquilibrium(CableModel):
    """A cable with its last equilibrium, and whether its branch is known."""

    def __init__(
        self, cable: Cable, properties: Properties, tolerance: float, polyline_points: int,
        obstacle_names: Sequence[str] = (),
    ) -> None:  # fmt: skip
        super().__init__(cable, properties, obstacle_names)
        self.tolerance, self.polyline_points = tolerance, polyline_points
        self.fractions: np.ndarray | None = None
        """(n,) of its length, at which a piece of a cable with clips has points; None: at equal distances."""
        self.environment: dict[str, float] = {}
        self.choice: Choice | None = None
        self._reader, self._outline = results.Reader(), results.Reader()
        self.reset()

    def reset(self) -> None:
        """Forget the equilibrium."""
        self._rod: Rod | None = None
        self._q, self._F = np.empty((0, 4)), np.empty(3)
        self._joints = np.empty(0)
        self._twist: float | None = None
        self._standing = Standing()
        self._passing = False  # whether the pose is a waiting one that the path passes through
        self._resolved = 0.0
        self._estimate = self._margin = np.nan
        self._apart = np.inf
        self._memory: Memory | None = None
        self._off_grid = Backoff(LONGEST_STAY)

    @property
    def lost(self) -> str:
        """Why the branch was lost, a clause; empty while it is known."""
        loss = self._standing.loss
        return "" if loss is None else loss.cause

    def distrust(self, cause: str) -> None:
        """Treat the branch as lost until it is known again, or `reset`; `cause`: a clause."""
        self._lose(cause)

    def _lose(self, cause: str) -> None:
        self._standing = self._standing.lost(cause, self._model == COULOMB, self._joints, self._twist)
        if self._rod is not None:
            self._rod.forgot = False

    def _record_snaps(self, snaps: Sequence[SnapThrough]) -> None:
        """Update whether the branch is known after snap-throughs."""
        for snap in snaps:
            if snap.touched and self._model == COULOMB:
                self._lose("it snapped, and the friction of its contacts was forgotten")
            elif snap.jumped and not snap.folded:
                turned = f"total twist {snap.twist_before:.3f} -> {snap.twist_after:.3f} rad"
                self._lose(f"it snapped, {turned}, with a stability margin of {snap.margin:.2g} before")
            elif snap.jumped:
                self._standing = self._standing.snapped(snap)

    def _mend(self, before: Conditions, step: bool, free: Callable[[Loss], float | None]) -> None:
        """Add the motion since `before` to the record of a lost branch, which may be known again by it.

        `free` gives the twist here of a cable without contact, continued from the last known pose.
        """
        rod, loss = self._rod, self._standing.loss
        assert rod is not None
        touching = rod.touches
        if self._memory is not None:
            gone = motion(before, conditions_of(rod))
            self._memory = self._memory.followed(gone, touching, touching and _slips(rod), step)
        if loss is None:
            return
        loss = loss.followed(motion(before, conditions_of(rod)), touching and _slips(rod), step)
        if loss.forgotten or (not touching and loss.due and self._alone(rod, free(loss))):
            self._standing = Standing()
            return
        self._standing = Standing(replace(loss, unasked=0.0) if not touching and loss.due else loss)

    @property
    def _error(self) -> float:
        """Estimated relative error of the end wrench, with that of friction's history."""
        return max(self._estimate, 0.0 if self._memory is None else self._memory.error)

    @property
    def _remembers(self) -> bool:
        """Whether the motion since a loss, or since friction came from a grid, counts."""
        return self._standing.loss is not None or self._memory is not None

    def _alone(self, rod: Rod, free: float | None) -> bool:
        """Whether no other equilibrium is near, and its twist is within half a turn of `free`, rad."""
        if free is not None and not abs(float(rod.totals[TWIST]) - free) < np.pi:
            return False
        energy, _, _ = rod.linearize(self._q, self._F)
        rod.factor(0.0)
        here = Found(rod, self._q, self._F, energy, float(rod.totals[TWIST]), 0)
        return alone(here, self._stiffness, self._natural, self._compliance, self.tolerance, self._ends)

    def _take(self, found: Found, joints: np.ndarray) -> None:
        self._rod, self._q, self._F, self._joints = found.rod, found.q, found.F, joints
        if isinstance(found.rod, TouchingRod) and found.rod.model != self._model:
            # it is factored without friction
            found.rod.model, found.rod.ready = self._model, False
        self._resolved = self.tolerance

    def _finish(
        self, status: Status, message: str, iterations: int, poses: np.ndarray, begin: float
    ) -> Equilibrium:
        """Check the discretisation error, refine the mesh if it is too large, and make the result."""
        rod = self._rod
        assert rod is not None
        if isinstance(rod, NodalRod):
            self._estimate = rod.relative_error(self._q, self._F)
            rod = self._exactly(rod, status)
        else:
            self._off_grid.shorten()
        if isinstance(rod, NodalRod):
            self._margin = rod.stability_margin()
            self._apart = self._closest_approach(poses[0])
        elif rod.rotation == 0.0 or not self._estimate <= self.tolerance or rod.friction_changed():
            self._estimate = rod.relative_error(self._q, self._F)
            sinks = rod.unresolved(self._q, LENIENT).any()
            beside = rod.clamp_errors(self._q, self._F).max()
            if max(self._estimate, beside) > ACCEPT * self.tolerance or sinks:
                found = Found.at(rod, self._q, self._F)
                fine, self._estimate = refine(found, self.tolerance)
                iterations += fine.iterations
                before = rod, self._q, self._F
                self._take(fine, self._joints)
                rod = fine.rod
                sinks = rod.unresolved(self._q, LENIENT).any()
                if (rod.forgot or sinks or self._estimate > self.tolerance) and self._onto_grid(*before):
                    return self._finish(status, message, iterations, poses, begin)
                beside = rod.clamp_errors(self._q, self._F).max()
            self._estimate = max(self._estimate, beside, rod.friction_error(self._q, self._F))
            if self._estimate > self.tolerance and self._onto_grid(rod, self._q, self._F):
                return self._finish(status, message, iterations, poses, begin)
            if self._estimate > self.tolerance:
                message = (
                    f"The estimated error of the end wrench, {self._estimate:.1e}, exceeds the tolerance"
                    f" {self.tolerance:.0e}."
                )
                return self.failed(Status.NOT_CONVERGED, message, time.perf_counter() - begin)
            if sinks:
                return self.failed(Status.NOT_CONVERGED, SINKS, time.perf_counter() - begin)
            self._margin = rod.stability_margin()
            self._apart = self._closest_approach(poses[0])
        elif self._apart < self._diameter + self._units.length * rod.rotation:
            # two points can have approached by that much since the last check
            self._apart = self._closest_approach(poses[0])
        error = self._error
        if error > self._limit:
            message = COARSE.format(error)
            return self.failed(Status.NOT_CONVERGED, message, time.perf_counter() - begin)
        if error > self.tolerance and status is Status.CONVERGED:
            message = f"{message[:-1]}{ON_GRID.format(error)}"
        if rod.forgot:
            self._lose("friction was forgotten when the mesh changed")
        unit, standing = self._units, self._standing
        if self._margin < FREE_TO_TURN and status is Status.CONVERGED:
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
        self._twist = float(rod.totals[TWIST])
        start = poses[0] if self._ends is None else self.origin(poses)
        end_wrench, start_wrench, points, orientations = self._reader.read(
            rod,
            self._q,
            self._F,
            start,
            unit,
            self.polyline_points if self.fractions is None else self.fractions,
        )
        friction = None if self._obstacles is None else self._obstacles[:, FRICTION_COEFFICIENT]
        return Equilibrium.of(
            status=status, message=message, converged=standing.loss is None, stable=True,
            stability_margin=self._margin, end_wrench=end_wrench, start_wrench=start_wrench,
            points=points, orientations=orientations, total_twist=self._twist,
            energy=float(rod.totals[ENERGY]) * unit.moment - self._datum(rod, poses),
            error_estimate=error, iterations=iterations,
            solve_time=time.perf_counter() - begin, overlaps=overlaps,
            _tangent=results.Tangent(rod, self._q, self._F, unit, self._names, start, self._density),
            _mounts=None if self._ends is None and self.fractions is None else poses[:, 3:].copy(),
            _touching=results.touching(rod, friction, self._names, start, unit),
        )  # fmt: skip

    def _onto_grid(self, rod: Rod, q: np.ndarray, F: np.ndarray) -> bool:
        """Move the frictional equilibrium (q, F) to a uniform grid of contacts; whether that succeeded."""
        if not isinstance(rod, TouchingRod) or rod.model != COULOMB or not rod.count:
            return False
        on_grid = handover.nodal(rod, q, F)
        if on_grid is not None:
            self._rod, self._q, self._F = on_grid, on_grid.shape, on_grid.end_force
            self._off_grid.skip_next()
        return on_grid is not None

    def _exactly(self, rod: NodalRod, status: Status) -> Rod:
        """The equilibrium without the grid's error, if one is found beside it; else the rod as it is.

        With friction, this is tried only at poses that are asked for, and less and less often the sooner the
        cable was on its grid again.
        """
        rubs = self._model == COULOMB and rod.touches
        if rubs and (status is Status.UNFINISHED or self._passing):
            return rod
        if rubs and self._off_grid.waits:
            self._off_grid.skip()
            return rod
        found = handover.exact(rod, self.tolerance, self._model)
        if rubs:
            self._off_grid.tried()
        if found is None:
            return rod
        if rubs:
            apart = handover.apart(rod, found)
            if apart > self._estimate:
                return rod  # its friction is not that of the grid
            # friction of points that slip follows from the motion; what sticks keeps the grid's error
            error = max(apart, 0.0 if _slips(found.rod) else rod.twin_error)
            self._memory = Memory(max(error, 0.0 if self._memory is None else self._memory.error))
        self._take(found, self._joints)
        self._estimate = np.inf
        return found.rod

    @property
    def _limit(self) -> float:
        """Maximum error of a published equilibrium on a grid of contacts."""
        return max(self.tolerance, GRID if self._model == COULOMB else 0.0)

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
            return unit.length * float(self._weight @ poses[0, :3])
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
    ) -> Callable[[], tuple[Extreme, ...]]:
        """A function that computes `Equilibrium.extremes` of the present equilibrium.

        Args:
            limits: of the cable.
            obstacles: (n, WIDTH) of the scene, SI, in the frames of their links.
            links: (n, 7) these links in the world.
            start: (7,) the start clamp in the world.
        """
        assert self._rod is not None
        beside = Obstacles(placed(obstacles, links, start, self._units.length), self._names)
        return extremes(self._rod, self._q, self._F, start, self._units, limits, beside)

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


def conditions_of(rod: Rod) -> Conditions:
    """The conditions of the rod's last equilibrium."""
    return Conditions(rod.qe, rod.re, rod.f, rod.obstacles)


def _slips(rod: Rod) -> bool:
    """Whether all contacts are points and slip: where a patch lies depends on the past even as it slips."""
    if not isinstance(rod, TouchingRod):
        return False
    points = rod.points[: rod.count]
    return bool((points[:, SLIPS] == 1.0).all() and (points[:, KIND] == POINT).all())
