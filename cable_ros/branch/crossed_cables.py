# SPDX-License-Identifier: Apache-2.0
"""The cables of a scene that may touch each other and themselves, from pose to pose on one branch."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from cable_ros.branch.crossing_balance import CrossedTangent, OneOf
from cable_ros.branch.crossing_cable import SLOTS
from cable_ros.branch.crossing_newton import Pair, overlapping
from cable_ros.branch.crossing_snap import CrossingSnap
from cable_ros.branch.followed_equilibrium import largest_difference
from cable_ros.branch.shared_piece import Place
from cable_ros.contact.active_set_rod import ActiveSetRod
from cable_ros.contact.crossing import Spacer
from cable_ros.contact.overlaps import with_overlap
from cable_ros.equilibrium import ContactTable, Equilibrium, Overlap, Status
from cable_ros.scene import Kinematics

LONGEST = 0.2
"""Maximum step in joint values, rad or m, that is taken at once."""
SHORTEST = 1e-4
"""Minimum step, rad or m; if even that fails, the cables cannot be followed."""
MOST_ITERATIONS = 600
"""Budget of one solve: about half a second for two cables."""
BEYOND = (10.0, 100.0)
"""Steps of `SHORTEST` along the path at which a snap-through is tried."""
JUMP = 0.02
"""Minimum motion of a cable, over its length, that shows another branch."""
COLD = 3
"""Budget of a cold start over that."""
PROGRESS = 0.01
"""Minimum progress of such a solve, rad or m; with less they are stuck."""
PATIENCE = 2
"""Number of poses in a row that they cannot be followed to, before equilibria are searched for again."""
DEEP = 0.3
"""Depth at which two cables are pushed apart in steps, as a fraction of the distance of their axes."""
LEAST_PUSH = 1e-3
"""Minimum such step."""
CHANGES = 6
"""Maximum number of times that contacts begin or end in one step."""
NOT_SOLVED = "Cable '{}' could not be solved, and the cables may touch each other."
NOT_TOGETHER = "Cables that touch each other, or themselves, could not be followed to this pose."
SNAPS = "Cables that touch each other, or themselves, snap on the way to this pose: where to is not followed."
AT_CLAMP = (
    "Cable '{}' is pressed beside its clamp, {:.3g} mm from it: contact that moves onto a clamp is not "
    "followed."
)
ONTO_ITSELF = "The cable snaps onto itself on the way to this pose: where to is not followed."
LYING = "Cables '{}' and '{}' lie along each other: contact between cables is modelled at points only."
LYING_ITSELF = "Cable '{}' lies along itself: contact between cables is modelled at points only."
ON_GRID = "Cable '{}' lies on a grid of contacts, which cannot touch other cables."
LOST = "the cables that touch each other could not be followed from pose to pose"
NOT_APART = "Cables that overlap could not be pushed apart."
NO_SIDE = (
    "Without contact {} would pass through the middle of {}: nothing tells on which side; start where they "
    "are apart."
)
SIDE = (
    "The scene does not tell on which side {} passes {}: this is the one on which they pass without contact."
)
SIDELESS = 0.02
"""Distance of two centrelines, as a fraction of that at which they touch, that tells no side."""


class CrossedCables(CrossingSnap):
    """Keeps all cables of a scene on their common branch, and knows where they touch.

    Args:
        cables: of the scene.
        radii: of the cables, m; one of radius 0 touches no other.
    """

    def reset(self) -> None:
        """Forget the equilibria."""
        super().reset()
        self._failures, self._lost = 0, ""
        self._cold = self._snaps = False
        self._told = ""  # a sentence on a snap that is not told yet
        self._chosen: list[tuple[int, int]] = []  # whose side a cold start has taken, not told yet

    def solve(
        self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray, begin: float
    ) -> list[Equilibrium]:
        """The equilibria of all cables; `poses` (n, 2, 7): of their clamps at `joints`."""
        gone = any(cable.rod is None for cable in self.cables) or self._failures >= PATIENCE
        resolved = gone or [cable.resolve() for cable in self.cables]
        if gone:
            lost = LOST if self._joints is not None else ""
            self.reset()
            self._lost = lost
        elif resolved is not True and not all(resolved):
            self.reset()
            self._lost = f"they could not be brought to the tolerance {self.cables[0].tolerance:g}"
        if self._joints is None:
            problem = self._start(kinematics, joints, poses)
            if problem is not None:
                status, message, which = problem
                self._joints = None
                return self._failed(status, message, begin, which)
        else:
            arrived = self._follow(kinematics, joints)
            if not arrived:
                unfinished = arrived is None
                self._failures += not unfinished
                status = Status.UNFINISHED if unfinished else Status.NOT_CONVERGED
                message = status.sentence if unfinished else self._why()
                return self._failed(status, message, begin)
        self._failures = 0
        return self._publish(kinematics, joints, poses, begin)

    def _start(
        self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray
    ) -> tuple[Status, str, int] | None:
        """Equilibria as if no cable touched another, pushed apart where they overlap.

        None, or status and message of the cable that failed, and its number.
        """
        for i, (cable, own) in enumerate(zip(self.cables, poses, strict=True)):
            found = cable.find(kinematics, joints, Place(own, cable.length))
            if not found.converged:
                return found.status, found.message, i
            if not isinstance(cable.rod, ActiveSetRod):
                return Status.NOT_CONVERGED, ON_GRID.format(cable.name), i
            if self._lost:
                cable.distrust(self._lost)
        self._accept(joints, [], [])
        self._cold, self.iterations = True, 0
        settled = self._settled(kinematics, joints, poses, [])
        self._cold = False
        if settled is None:
            return Status.NOT_CONVERGED, self._why_not_apart(self.pairs(poses)), 0
        self._chosen = list(dict.fromkeys(one.cables for one in settled))
        return None

    def _two(self, cables: tuple[int, int]) -> tuple[str, str]:
        """What to call two cables, or strands."""
        first, second = (f"cable '{self.cables[i].name}'" for i in cables)
        return first, "itself" if cables[0] == cables[1] else second

    def _why_not_apart(self, pairs: Sequence[Pair]) -> str:
        """A sentence on why a cold start failed; `pairs`: without contact."""
        deep = min(overlapping(pairs, []), key=lambda pair: pair.closest.distance, default=None)
        if deep is None or deep.closest.distance >= SIDELESS * deep.apart:
            return NOT_APART
        return NO_SIDE.format(*self._two(deep.cables))

    def _follow(self, kinematics: Kinematics, joints: np.ndarray) -> bool | None:
        """Continue the branch straight to `joints`; whether it arrived. None: it goes on at the next call."""
        origin = self._joints
        assert origin is not None
        distance = largest_difference(joints, origin)
        longest = LONGEST / max(distance, LONGEST)
        at, step, self.iterations, self.lying, self._snaps = 0.0, longest, 0, None, False
        self.onto_itself = False
        while self.iterations < MOST_ITERATIONS:
            target = min(1.0, at + step)
            there = joints if target == 1.0 else origin + target * (joints - origin)
            poses = kinematics.poses(there)
            found = self._settled(kinematics, there, poses, self._extrapolated(there))
            if found is None and self._before is not None:
                self._before = None
                found = self._settled(kinematics, there, poses, self.spacers)
            if found is not None:
                at, step = target, min(2.0 * step, longest)
                if at == 1.0:
                    return True
                continue
            step = 0.5 * (target - at)
            if step * distance < SHORTEST:
                beyond = self._past_fold(kinematics, joints, at, step)
                if beyond is None:
                    return False
                at, step = beyond, longest
                if at == 1.0:
                    return True
        return None if at * distance >= PROGRESS else False

    def _past_fold(self, kinematics: Kinematics, joints: np.ndarray, at: float, step: float) -> float | None:
        """Snap beyond a fraction `at` of the way to `joints`, by steps of `step`; where, None: not."""
        last = self._joints
        assert last is not None
        if self._failures or self._at_clamp():  # it has been tried, or would slip off the cable's end
            return None
        origin = (last - at * joints) / (1.0 - at)
        before = self._energy(kinematics.poses(last))
        for reach in BEYOND:  # next to a fold nothing is exact
            target = min(1.0, at + reach * step)
            there = joints if target == 1.0 else origin + target * (joints - origin)
            poses = kinematics.poses(there)
            moved = self._snap(kinematics, there, poses)
            if moved is not None:
                if moved > JUMP:
                    change = f"energy {before:.4g} -> {self._energy(poses):.4g} J"
                    where = f"at {100.0 * target:.4g} % of the step"
                    self._told = f"{Status.SNAPPED.sentence[:-1]} ({change} {where})."
                return target
            if self.onto_itself:
                return None
        return None

    def _energy(self, poses: np.ndarray) -> float:
        """Of all cables, J; `poses` (n, 2, 7): of their clamps."""
        return sum(cable.energy(own) for cable, own in zip(self.cables, poses, strict=True))

    def _settled(
        self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray, guess: list[Spacer]
    ) -> list[Spacer] | None:
        """The equilibrium at a pose nearby, with contacts that begin and end, accepted; None: all is back."""
        spacers = guess
        for _ in range(CHANGES):
            found = self._newton(kinematics, joints, poses, spacers)
            if found is None and self.loose:
                kept = [one for j, one in enumerate(spacers) if j not in self.loose]
                self._restore(self._kept)
                spacers = kept
                continue
            if found is None:
                break
            pairs = self.pairs(poses)
            if self._passed(pairs):
                break
            deepest = self._deepest(pairs, found)
            if deepest is not None and not self._tells_side(deepest[0]):
                break
            if deepest is None:
                if not self._stable(poses, found):
                    self._snaps = True
                    break
                self._accept(joints, pairs, found)
                return found
            pushed = self._pushed(kinematics, joints, poses, found, *deepest)
            if pushed is None:
                break
            spacers = pushed
        self._restore(self._kept)
        return None

    def _tells_side(self, pair: Pair) -> bool:
        """Whether it is known on which side of each other two overlapping points belong."""
        if self._cold:
            return pair.closest.distance >= SIDELESS * pair.apart
        return self._before_was(pair) is not None

    def _deepest(
        self, pairs: Sequence[Pair], spacers: Sequence[Spacer]
    ) -> tuple[Pair, tuple[int, int]] | None:
        """The points that overlap most without a spacer, and slots for one; None: there are none."""
        over = [pair for pair in overlapping(pairs, spacers) if pair.inside]
        if not over:
            return None
        worst = min(over, key=lambda pair: pair.closest.distance / pair.apart)
        taken = [pair for one in spacers for pair in zip(one.cables, one.slots, strict=True)]
        for cable in worst.cables:
            free = [slot for slot in range(SLOTS) if (cable, slot) not in taken]
            if not free:
                return None
            taken.append((cable, free[0]))
        (_, first), (_, second) = taken[-2:]
        return worst, (first, second)

    def _pushed(
        self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray, spacers: list[Spacer],
        pair: Pair, slots: tuple[int, int],
    ) -> list[Spacer] | None:  # fmt: skip
        """The equilibrium with one contact more; None: it is not found."""
        near = pair.closest
        new = Spacer.between(pair.cables, slots, near.points, near.tangents, near.distance)
        state, size = [*spacers, new], near.distance
        step = pair.apart - size if size > (1.0 - DEEP) * pair.apart else 0.25 * pair.apart
        most = COLD * MOST_ITERATIONS if self._cold else MOST_ITERATIONS
        self._checkpoint()
        while size < pair.apart:
            to = min(size + step, pair.apart)
            guess = [*state[:-1], state[-1].with_apart(to)]
            if size == near.distance:
                guess = self._centred(kinematics, joints, poses, guess, to - size)
            found = self._newton(kinematics, joints, poses, guess)
            if found is None:
                self._restore(self._spare)
                step *= 0.5
                if step < LEAST_PUSH * pair.apart or self.iterations > most:
                    return None
                continue
            state, size, step = found, to, 1.5 * step
            self._checkpoint()
        return state

    def _publish(
        self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray, begin: float
    ) -> list[Equilibrium]:
        """The results of all cables."""
        self._name_slots()
        for _ in range(3):
            meshes = [cable.mesh for cable in self.cables]
            found = [cable.publish(own, begin) for cable, own in zip(self.cables, poses, strict=True)]
            if all(cable.mesh is mesh for cable, mesh in zip(self.cables, meshes, strict=True)):
                break
            exact = self._newton(kinematics, joints, poses, self.spacers)
            if exact is None:
                return self._failed(Status.NOT_CONVERGED, self._why(), begin)
            self._accept(joints, self.pairs(poses), exact)
        if self._told:
            for i, one in enumerate(found):
                if one.status is Status.CONVERGED:
                    found[i] = replace(one, status=Status.SNAPPED, message=self._told)
        self._told = ""
        for pair in overlapping(self._pairs, self.spacers):
            itself = pair.cables[0] == pair.cables[1]
            for i, k in [pair.cables] if itself else [pair.cables, pair.cables[::-1]]:
                other = Overlap(self.cables[k].name, pair.closest.distance, pair.apart)
                if all(one.other != other.other for one in found[i].overlaps):
                    found[i] = with_overlap(found[i], other, itself)
        for cables in self._chosen:
            for i, k in dict.fromkeys([cables, cables[::-1]]):
                side = SIDE.format(*self._two((i, k)))
                found[i] = replace(found[i], message=f"{found[i].message} {side}")
        self._chosen = []
        if not self.spacers:
            return found
        failed = [one for one in found if not one.status.trusted]
        tangent = self.tangent(poses)
        arcs = self._other_arcs(poses)
        return [
            Equilibrium.of(vars(one) | {
                "_touching": partial(with_other_arcs, one._touching, arcs[i]),
                "_tangent": OneOf(tangent, i), "_coupled": tangent if i == 0 and not failed else None,
                "error_estimate": one.error_estimate / (cable.finer if arcs[i] else 1.0),
            })
            for i, (one, cable) in enumerate(zip(found, self.cables, strict=True))
        ]  # fmt: skip

    def tangent(self, poses: np.ndarray) -> CrossedTangent:
        """The linearised equations about the present equilibria; `poses` (n, 2, 7): of the clamps."""
        return CrossedTangent(self.cables, self.spacers, poses)

    def _other_arcs(self, poses: np.ndarray) -> list[dict[int, float]]:
        """By cable and number of an obstacle that is another cable: the arc length on that one, m."""
        out: list[dict[int, float]] = [{} for _ in self.cables]
        for one in self.spacers:
            touches = self._touches(one, poses)
            for side, (cable, slot) in enumerate(zip(one.cables, one.slots, strict=True)):
                out[cable][self.cables[cable].first_slot + slot] = touches[1 - side].arc_length
        return out

    def _why(self) -> str:
        """A sentence on why they could not be followed."""
        if self.onto_itself:
            return ONTO_ITSELF
        if self.lying is None:
            return self._at_clamp() or (SNAPS if self._snaps else NOT_TOGETHER)
        first, second = (self.cables[i].name for i in self.lying)
        return LYING_ITSELF.format(first) if first == second else LYING.format(first, second)

    def _at_clamp(self) -> str:
        """A sentence on a contact that is beside a clamp, by the last equilibrium; empty: there is none."""
        for pair in self._pairs:
            if pair.known_to(self.spacers):
                for i, s in zip(pair.cables, pair.closest.arcs, strict=True):
                    beside = min(s, self.cables[i].length - s)
                    if beside < pair.apart:
                        return AT_CLAMP.format(self.cables[i].name, beside * 1e3)
        return ""

    def _failed(
        self, status: Status, message: str, begin: float, which: int | None = None
    ) -> list[Equilibrium]:
        """Results without numbers; `message`: of the cable `which`, or of all."""
        seconds = time.perf_counter() - begin
        told = [message] * len(self.cables)
        if which is not None:
            told = [NOT_SOLVED.format(self.cables[which].name)] * len(self.cables)
            told[which] = message
        return [
            cable.failed(status, one, seconds if i == 0 else 0.0)
            for i, (cable, one) in enumerate(zip(self.cables, told, strict=True))
        ]


def with_other_arcs(
    read: Callable[[], ContactTable | None] | None, arcs: Mapping[int, float]
) -> ContactTable | None:
    """The contacts of a cable with the arc lengths on others, by number of the obstacle."""
    table = None if read is None else read()
    if table is None:
        return None
    return replace(table, other_arc_length=np.array([arcs.get(k, np.nan) for k in table.obstacle.tolist()]))
