"""One cable of a tracker: its state between two solves."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from cable_ros import results
from cable_ros.auto_effects import Choice
from cable_ros.equilibrium import Equilibrium, Overlap
from cable_ros.mechanics.effects.contact import nearest, placed
from cable_ros.mechanics.effects.effect import Properties
from cable_ros.overlaps import OUTLINE, SPACING, closest_approach, warning
from cable_ros.scene import Cable, Kinematics
from cable_ros.solve.status import Status
from cable_ros.statics import compiled
from cable_ros.statics.change import Section, follow, made_of
from cable_ros.statics.detour import too_short
from cable_ros.statics.friction_kernels import COULOMB, FRICTIONLESS, SLIDING
from cable_ros.statics.rod import NOTHING, Rod
from cable_ros.statics.saddle import NEUTRAL
from cable_ros.statics.search import ACCEPT, LENIENT, Conditions, Found, equilibria, refine, same
from cable_ros.statics.touching import TouchingRod
from cable_ros.statics.units import Units, relative, relative_change
from cable_ros.statics.walk import End, Walk, walk

ALGEBRAIC = 1e-3
"""The iteration stops at this part of the tolerance: nothing beside the resolution's error."""
LONGEST = 0.5
"""Longest step in joint values, rad or m, that may be taken at once: whole turns must not be overlooked."""
AMONG_OBSTACLES = 0.1
"""The same where there are obstacles: what is touched on the way decides where the cable ends up."""
PATIENCE = 6
"""So many descents may be made of steps that fail, in one solve: each takes as long as a cold start."""
WORK = 150_000
"""So many iterations times unknowns may a way among obstacles take, as long as some cold starts; ways that
lead somewhere take a tenth of it."""
CLAMP_DEPTH = 1e-6
"""A clamp may be this deep inside an obstacle, parts of the length: rounding of poses."""
MODELS = {"coulomb": COULOMB, "sliding": SLIDING}
LONGEST_STRETCH = 1.1
"""A cable that stretches may be pulled to so many lengths; past that its stiffness is no constant."""
SINKS = "The cable could not be kept out of what it touches between the places that hold it."
IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])
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
        """Longest step that may be taken at once."""
        return LONGEST if self._obstacles is None else AMONG_OBSTACLES

    def reset(self) -> None:
        """Forget the equilibrium."""
        self._rod: Rod | None = None
        self._q, self._F = np.empty((0, 4)), np.empty(3)
        self._joints = np.empty(0)
        self._twist: float | None = None
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
        return changed is not None

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
        rod = self._rod
        if rod is None or self._resolved != self.tolerance:
            hint = self._hint if self._twist is None else self._twist
            return self._cold(kinematics, joints, poses, begin, hint)
        if isinstance(rod, TouchingRod):
            rod.patience, rod.work = PATIENCE, WORK
        if _farthest(joints, self._joints) > self._longest:
            return self._far(kinematics, index, joints, poses, begin)
        qe, re, f = relative(poses, rod.qe, self._weight, self._units.length, self._units.force)
        obstacles = self._placed(kinematics, joints, poses)
        if obstacles is not None and (blocked := self._blocked(obstacles, re)):
            return self.failed(Status.OUT_OF_REACH, blocked, time.perf_counter() - begin)
        code, iterations, q, F = rod.advance(
            self._q, self._F, qe, re, f, ALGEBRAIC * self.tolerance, 0.6, obstacles
        )
        if code == compiled.ADVANCED:
            self._q, self._F, self._joints = q, F, joints
            return self._finish(Status.CONVERGED, Status.CONVERGED.sentence, iterations, poses, begin)
        return self._far(kinematics, index, joints, poses, begin)

    def _no_way(self, conditions: Conditions) -> str:
        """What is in the way of every cable of this length between the clamps; empty where nothing is."""
        obstacles, re = conditions.obstacles, conditions.re
        return "" if obstacles is None else self._blocked(obstacles, re) or self._barred(obstacles, re)

    def _blocked(self, obstacles: np.ndarray, re: np.ndarray) -> str:
        """A sentence where a clamp is inside an obstacle, so that no shape of the cable can be right."""
        for end, r in (("start", NOTHING), ("end", re)):
            distance, which = nearest(obstacles, r)
            if distance < -CLAMP_DEPTH:
                return (
                    f"The {end} clamp of cable '{self.name}' is"
                    f" {-distance * self._units.length * 1e3:.4g} mm inside"
                    f" obstacle '{self._names[which]}', the cable's radius counted; it must be outside."
                )
        return ""

    def _barred(self, obstacles: np.ndarray, re: np.ndarray) -> str:
        """A sentence where no way past the obstacles is as short as the cable."""
        found = too_short(re, obstacles, self._reach)
        if found is None:
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
        if np.linalg.norm(there.re) < self._reach and (barred := self._no_way(there)):
            # no walk leads anywhere
            return self.failed(Status.OUT_OF_REACH, barred, time.perf_counter() - begin)
        rod.refactor(self._q, self._F)
        origin = self._joints
        frames = {0.0: rod.qe}

        def path(t: float) -> Conditions:
            nearest = max((s for s in frames if s <= t), default=0.0)
            there = origin + t * (joints - origin)
            conditions = self._conditions(kinematics, there, kinematics.poses(there)[index], frames[nearest])
            frames[t] = conditions.qe
            return conditions

        longest = self._longest / max(np.abs(joints - origin).max(initial=0.0), self._longest)
        result = walk(rod, self._q, self._F, path, ALGEBRAIC * self.tolerance, 0.5 * longest, longest)
        if result.end in (End.ARRIVED, End.SNAPPED):
            self._q, self._F, self._joints = result.q, result.F, joints
            rod.refactor(self._q, self._F)
            status = Status.SNAPPED if result.snaps else Status.CONVERGED
            return self._finish(status, self._story(result), result.iterations, poses, begin)
        # the way is barred: the pose itself may still be fine, on the branch nearest in twist
        twist = self._twist
        # the rod is where the walk ended, maybe on another mesh: what comes next goes on from there
        self._q, self._F, self._joints = result.q, result.F, origin + result.at * (joints - origin)
        anew = self._cold(kinematics, joints, poses, begin, twist)
        if result.end is End.STUCK and anew.status is Status.CONVERGED:
            told = (
                f"lost at {100 * result.at:.4g} % of the step and solved anew: total twist {twist:.3f} -> "
                f"{anew.total_twist:.3f} rad"
            )
            return replace(anew, status=Status.SNAPPED, message=f"{Status.SNAPPED.sentence[:-1]} ({told}).")
        return anew

    def _story(self, result: Walk) -> str:
        if not result.snaps:
            return Status.CONVERGED.sentence
        unit = self._units.moment
        falls = "; ".join(
            f"total twist {s.twist_before:.3f} -> {s.twist_after:.3f} rad,"
            f" energy {s.energy_before * unit:.4g} -> {s.energy_after * unit:.4g} J"
            f" at {100 * s.at:.4g} % of the step"
            for s in result.snaps
        )
        return f"{Status.SNAPPED.sentence[:-1]} ({falls})."

    def _cold(
        self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray, begin: float, hint: float | None
    ) -> Equilibrium:
        """Search the pose for stable equilibria: take the one nearest the hint, or of least energy."""
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
        best: tuple[float, Found, Found] | None = None
        for one in found:
            fine, estimate = refine(one, self.tolerance)
            if best is None or estimate < best[0]:
                best = estimate, fine, one
            if estimate <= self.tolerance:
                break
        if best is not None and best[0] < np.inf:
            self._take(best[1], joints)
            return self._finish(Status.CONVERGED, _choice(best[2], found), best[1].iterations, poses, begin)
        return self.failed(Status.NOT_CONVERGED, Status.NOT_CONVERGED.sentence, time.perf_counter() - begin)

    def branches(self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray) -> list[Equilibrium]:
        """The stable equilibria of a wide search at a pose, by rising energy; the last is followed on."""
        begin = time.perf_counter()
        conditions = self._conditions(kinematics, joints, poses, IDENTITY)
        out: list[Equilibrium] = []
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
        if rod.drift == 0.0 or not self._estimate <= self.tolerance or rod.rubs_anew():
            self._estimate = rod.relative_error(self._q, self._F)
            sinks = rod.unresolved(self._q, LENIENT).any()
            if self._estimate > ACCEPT * self.tolerance or sinks:
                found = Found(rod, self._q, self._F, float(rod.totals[3]), float(rod.totals[4]), 0)
                fine, self._estimate = refine(found, self.tolerance)
                iterations += fine.iterations
                self._take(fine, self._joints)
                rod = fine.rod
                sinks = rod.unresolved(self._q, LENIENT).any()
            self._estimate = max(self._estimate, rod.friction_error(self._q, self._F))
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
        if self._margin < 10.0 * NEUTRAL and status is Status.CONVERGED:
            message = FREE
        overlaps: tuple[Overlap, ...] = ()
        if self._apart < self._diameter:
            overlaps = (Overlap(self.name, self._apart, self._diameter),)
            message = f"{message} {warning(self._apart, self._diameter)}"
        if self.choice is not None:
            message += self.choice.note
        unit = self._units
        self._twist = float(rod.totals[4])
        start = poses[0]
        end_wrench, start_wrench, points, orientations = self._reader.read(
            rod, self._q, self._F, start, unit, self.polyline_points
        )
        friction = None if self._obstacles is None else self._obstacles[:, 17]
        return Equilibrium.of(
            status=status, message=message, converged=True, stable=True, stability_margin=self._margin,
            end_wrench=end_wrench, start_wrench=start_wrench, points=points, orientations=orientations,
            total_twist=self._twist,
            energy=float(rod.totals[3]) * unit.moment - unit.length * float(self._weight @ start[:3]),
            error_estimate=self._estimate, iterations=iterations,
            solve_time=time.perf_counter() - begin, overlaps=overlaps,
            _tangent=results.tangent(rod, self._q, self._F, unit, self._names, start),
            _touching=results.touching(rod, friction, self._names, start, unit),
        )  # fmt: skip

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


def _farthest(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference of two arrays (n,); in Python, which is quicker for a few joints."""
    out = 0.0
    for x, y in zip(a.tolist(), b.tolist(), strict=True):
        out = max(out, abs(x - y))
    return out


def _choice(chosen: Found, found: list[Found]) -> str:
    """The sentence of a cold start, which says so where there are others of the same energy."""
    twins = sum(abs(other.energy - chosen.energy) <= 1e-6 * (1.0 + abs(chosen.energy)) for other in found)
    sentence = Status.CONVERGED.sentence
    if twins < 2:
        return sentence
    return f"{sentence[:-1]}, one of {twins} of equal energy: this side is an arbitrary choice."
