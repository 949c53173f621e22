# SPDX-License-Identifier: Apache-2.0
"""Newton's method for cables that touch each other at given places, and the pairs of points that may."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cable_ros.branch.crossing_balance import CrossedTangent, is_minimum
from cable_ros.branch.crossing_cable import CrossingCable, Remembered, Touch
from cable_ros.branch.prediction import onward
from cable_ros.branch.shared_piece import Place
from cable_ros.contact.crossing import FREEDOMS, Closest, Spacer, candidates, closest
from cable_ros.contact.overlaps import SPACING
from cable_ros.scene import Kinematics

ITERATIONS = 25
"""Maximum number of steps of Newton's method."""
SLOW, STALLED = 0.2, 0.5
"""Rate of convergence beyond which the tangent is renewed, and beyond which a renewed one fails."""
MOST_SLOW = 2
"""Maximum number of the latter."""
CENTRED = 4
"""Maximum number of shifts of a new spacer along its normal, before Newton's method."""
SHORTER = 4
"""Maximum number of times that a step is halved after which a cable does not touch a spacer."""
FARTHEST = 0.3
"""Maximum step of Newton's method, as a fraction of the distance of the axes."""
WRENCH = 0.1
"""Weight of a relative change of the wrenches beside such a step."""
NOISE, ROUNDING = 0.02, 2e-9
"""Fraction of the tolerance, and size, below which steps that stall are rounding of the cables' solutions."""
EXACT = 1e-3
"""Fraction of the tolerance at which the steps end."""
FINER = 0.1
"""Tolerance of each cable over that of all together, in the distance of the axes over the cable's length."""
RENEWED, SURE = 0.002, 0.5
"""Maximum motion of clamps and spacers, rad or parts of the length, after which stability is judged again;
and as a fraction of that at which an eigenvalue would be zero if it went on as between the last two times."""
TANGENT = 4
"""Work of a tangent, in iterations."""
NEAR = 3.0
"""Distance along a cable, in distances of the axes, within which two pairs of closest points are the same."""
TOUCHES = 1e-9
"""Depth of an overlap that is rounding, as a fraction of the distance of the axes."""
AHEAD = 0.1
"""Distance of two cables, in the length of the longer one, within which their closest points are watched."""


class Pair(NamedTuple):
    """Points of two cables that are closest nearby."""

    cables: tuple[int, int]
    """Their numbers, rising."""
    closest: Closest
    apart: float
    """Distance at which they touch, m."""
    inside: bool
    """Whether both are between the ends of their cables, where they can touch."""

    def known_to(self, spacers: Sequence[Spacer]) -> bool:
        """Whether a spacer is there."""
        return any(
            one.cables == self.cables
            and float(np.linalg.norm(one.points - self.closest.points, axis=1).max()) < NEAR * self.apart
            for one in spacers
        )


def overlapping(pairs: Sequence[Pair], spacers: Sequence[Spacer]) -> list[Pair]:
    """The pairs of points that overlap without one of these spacers."""
    return [
        pair for pair in pairs
        if pair.closest.distance < (1.0 - TOUCHES) * pair.apart and not pair.known_to(spacers)
    ]  # fmt: skip


class CrossingNewton:
    """The cables of a group, and where they touch at their last equilibrium.

    Args:
        cables: of the group.
        radii: of each, m; one of radius 0 touches no other.
    """

    def __init__(self, cables: Sequence[CrossingCable], radii: Sequence[float]) -> None:
        self.cables, self._radii = tuple(cables), tuple(radii)
        thick = [radius for radius in self._radii if radius]
        for cable, radius in zip(self.cables, self._radii, strict=True):
            if radius:
                cable.finer = min(FINER * (radius + min(thick)) / cable.length, 1.0)
        self.reset()

    def reset(self) -> None:
        """Forget the equilibria."""
        self.spacers: list[Spacer] = []
        self.loose: set[int] = set()
        """Numbers of the spacers that a cable did not touch in the last attempt."""
        self.lying: tuple[int, int] | None = None
        """Numbers of two cables that touched at more than a point in an attempt of this solve."""
        self.iterations = 0  # of this solve
        self._joints: np.ndarray | None = None
        self._kept: list[Remembered] = []
        self._spare: list[Remembered] = []
        self._before: tuple[np.ndarray, list[Spacer]] | None = None  # the step before the last
        self._pairs: list[Pair] = []
        self._inverse: np.ndarray | None = None
        self._spread, self._modes = np.zeros((0, 0)), (np.zeros(0), np.zeros((0, 0)))
        self._judged: tuple[np.ndarray, np.ndarray] | None = None  # where all was then, and eigenvalues
        self._sure = 0.0  # how far from there it is stable
        for cable in self.cables:
            cable.reset()

    def _name_slots(self) -> None:
        """Tell each cable which others are in its slots."""
        names: list[dict[int, str]] = [{} for _ in self.cables]
        for one in self.spacers:
            (i, k), (a, b) = one.cables, one.slots
            names[i][a], names[k][b] = self.cables[k].name, self.cables[i].name
        for cable, others in zip(self.cables, names, strict=True):
            cable.name_others(others)

    def _accept(self, joints: np.ndarray, pairs: Sequence[Pair], spacers: Sequence[Spacer]) -> None:
        """Take the present equilibria and `pairs` for those at `joints`, with axes along the cables."""
        same = [one.slots for one in spacers] == [one.slots for one in self.spacers]
        self._before = (self._joints, self.spacers) if same and self._joints is not None else None
        self._joints, self._pairs, self.spacers = joints, list(pairs), []
        for one in spacers:
            tangents = next((pair.closest.tangents for pair in pairs if pair.known_to([one])), one.axes[::-1])
            self.spacers.append(one.along(tangents))
        self._kept = [cable.remember() for cable in self.cables]

    def _touches(self, spacer: Spacer, poses: np.ndarray) -> list[Touch]:
        """How its two cables press on it."""
        return [
            self.cables[cable].touches(slot, poses[cable, 0])
            for cable, slot in zip(spacer.cables, spacer.slots, strict=True)
        ]

    def _show(
        self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray, spacers: Sequence[Spacer]
    ) -> None:
        """Have each cable see its spacers."""
        seen: list[dict[int, np.ndarray]] = [{} for _ in self.cables]
        for one in spacers:
            for side, (cable, slot) in enumerate(zip(one.cables, one.slots, strict=True)):
                seen[cable][slot] = one.obstacle(side, self._radii[one.cables[1 - side]])
        for tracked, rows, own in zip(self.cables, seen, poses, strict=True):
            tracked.see(rows, kinematics, joints, own)

    def _checkpoint(self) -> None:
        """Remember the present equilibria on the way to those of a pose."""
        self._spare = [cable.remember() for cable in self.cables]

    def _restore(self, known: Sequence[Remembered]) -> None:
        """Return to a checkpoint, or to the last equilibrium."""
        for cable, one in zip(self.cables, known, strict=True):
            cable.recall(one)
        self._inverse = None

    def _all_among(
        self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray, spacers: Sequence[Spacer]
    ) -> bool:
        """Solve all cables among these spacers; whether each is in equilibrium there."""
        self._show(kinematics, joints, poses, spacers)
        return all(
            cable.attempt(kinematics, joints, Place(own, cable.length)) and np.isfinite(cable.end_force).all()
            for cable, own in zip(self.cables, poses, strict=True)
        )

    def _newton(
        self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray, guess: Sequence[Spacer]
    ) -> list[Spacer] | None:
        """The spacers in balance near a guess, each cable in equilibrium among them; None: not found."""
        spacers, tolerance = list(guess), self.cables[0].asked
        size, slow, shorter = np.inf, 0, SHORTER  # no step can be made shorter yet
        before, each = spacers, np.zeros((len(spacers), FREEDOMS))
        for iteration in range(ITERATIONS):
            self.iterations += 1
            if not self._all_among(kinematics, joints, poses, spacers):
                return None
            if not spacers:
                return spacers
            residual = self._residual(spacers, poses)
            if residual is None and self.loose and shorter < SHORTER:
                # where contact begins a step may end beside it, if one of the two is stiff
                shorter, size, each = shorter + 1, np.inf, 0.5 * each
                spacers = [one.moved(own) for one, own in zip(before, each, strict=True)]
                continue
            if residual is None:
                return None
            step, new = self._step(residual, spacers)
            if iteration and new > STALLED * size and new <= max(NOISE * tolerance, ROUNDING):
                return spacers
            if new > SLOW * size or not new <= FARTHEST:
                if not self._renew(spacers, poses):
                    return None
                step, new = self._step(residual, spacers)
                slow += new > STALLED * size and new < FARTHEST
                if slow > MOST_SLOW or not np.isfinite(new):
                    return None
            if new <= EXACT * tolerance:
                return spacers
            size, part = new, min(1.0, FARTHEST / new)
            before, each, shorter = spacers, part * step.reshape(-1, FREEDOMS), 0
            spacers = [one.moved(own) for one, own in zip(before, each, strict=True)]
        return None

    def _centred(
        self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray, spacers: Sequence[Spacer],
        overlap: float,
    ) -> list[Spacer]:  # fmt: skip
        """Spacers whose last one, new and `overlap`, m, too wide, is pressed alike from both sides, roughly.

        Where one side is far stiffer than the other, Newton's method from the middle ends beside it.
        """
        *others, new = spacers
        shift = np.zeros(FREEDOMS)
        reach = np.full(2, 0.5 * overlap)  # how far it reaches into either side
        for _ in range(CENTRED):
            self._show(kinematics, joints, poses, [*others, new.moved(shift)])
            for cable, own in zip(self.cables, poses, strict=True):
                if not cable.attempt(kinematics, joints, Place(own, cable.length)):
                    return [*others, new]
            force = np.array([touch.force for touch in self._touches(new.moved(shift), poses)])
            if not force.all():
                break
            stiffness = force / reach
            reach = overlap * stiffness[::-1] / stiffness.sum()
            moved = shift[2]
            shift[2] = 0.5 * (reach[0] - reach[1])
            if abs(shift[2] - moved) < 0.1 * reach.min():
                break
        return [*others, new.moved(shift)]

    def _step(self, residual: np.ndarray, spacers: Sequence[Spacer]) -> tuple[np.ndarray, float]:
        """Newton's step (5 k,) by the last tangent, and its size; infinite without one."""
        if self._inverse is None or len(self._inverse) != len(residual):
            return residual, np.inf
        step = -self._inverse @ residual
        return step, self._size(step, spacers)

    def _residual(self, spacers: Sequence[Spacer], poses: np.ndarray) -> np.ndarray | None:
        """(5 k,) forces on the spacers, see `Spacer.basis`; None: some are not pressed at one point each."""
        out = np.empty((len(spacers), FREEDOMS))
        self.loose = set()
        for j, one in enumerate(spacers):
            touches = self._touches(one, poses)
            if any(touch.points == 0 for touch in touches):
                self.loose.add(j)
            elif any(touch.points > 1 for touch in touches):
                self.lying = one.cables
                return None
            out[j] = one.basis().T @ (touches[0].wrench + touches[1].wrench)
        return None if self.loose else out.ravel()

    def _renew(self, spacers: Sequence[Spacer], poses: np.ndarray) -> bool:
        """Invert the tangent at the present equilibria; whether it can be inverted."""
        self.iterations += TANGENT
        system = CrossedTangent(self.cables, spacers, poses).system()
        try:
            self._inverse, self._spread = np.linalg.inv(system.tangent), system.spread
            self._modes = system.modes()
        except np.linalg.LinAlgError:
            return False
        return bool(np.isfinite(self._inverse).all())

    def _stable(self, poses: np.ndarray, spacers: Sequence[Spacer]) -> bool:
        """Whether the present equilibria are a minimum of the energy of all cables together.

        Judged again if spacers or clamps have moved.
        """
        if not spacers:
            return True
        length = max(cable.length for cable in self.cables)
        here = np.concatenate([
            (poses / ([length] * 3 + [1.0] * 4)).ravel(),
            np.concatenate([one.centres.ravel() for one in spacers]) / length,
        ])  # fmt: skip
        before = self._judged if self._judged is not None and len(self._judged[0]) == len(here) else None
        moved = np.inf if before is None else float(np.abs(here - before[0]).max())
        if moved <= self._sure:
            return True
        if not self._renew(spacers, poses):
            return False
        values = self._modes[0]
        if not self._is_minimum(values):
            return False
        self._sure = 0.0
        if before is not None:
            closer = np.maximum((np.abs(before[1]) - np.abs(values)) / np.abs(values), 1e-9)
            self._sure = min(RENEWED, SURE * moved / float(closer.max()))
        self._judged = here, values
        return True

    def _is_minimum(self, values: np.ndarray) -> bool:
        """Whether the eigenvalues (5 k,) of the last tangent are those of a minimum."""
        return is_minimum(values)

    def _size(self, step: np.ndarray, spacers: Sequence[Spacer]) -> float:
        """Of a step (5 k,): over the distance of the axes, or of a change of the wrenches."""
        least = min(one.apart for one in spacers)
        changes = (self._spread @ step).reshape(-1, 12)
        told = [cable.size_of(change) for cable, change in zip(self.cables, changes, strict=True)]
        return max(float(np.abs(step).max()) / least, WRENCH * max(told))

    def _extrapolated(self, joints: np.ndarray) -> list[Spacer]:
        """The spacers there if they go on as in the last step."""
        if self._before is None or not self.spacers or self._joints is None:
            return self.spacers
        ratio = onward(self._joints - self._before[0], joints - self._joints)
        if ratio == 0.0:
            return self.spacers
        return [
            now.moved(ratio * before.step_to(now))
            for before, now in zip(self._before[1], self.spacers, strict=True)
        ]

    def pairs(self, poses: np.ndarray) -> list[Pair]:
        """Where cables with a radius come near each other or themselves; `poses` (n, 2, 7): of the clamps."""
        out: list[Pair] = []
        lines = [cable.outline(own[0]) for cable, own in zip(self.cables, poses, strict=True)]
        curves = [cable.curve(own[0]) for cable, own in zip(self.cables, poses, strict=True)]
        for i, a in enumerate(curves):
            for k, b in enumerate(curves[i:], i):
                apart = self._radii[i] + self._radii[k]
                if not (self._radii[i] and self._radii[k]):
                    continue
                reach = apart + AHEAD * max(a.length, b.length)
                beyond = SPACING * apart / a.length if i == k else None
                for s in candidates(lines[i], lines[k], reach, beyond):
                    found = closest(a, b, s)
                    if beyond is not None and not found.arcs[1] - found.arcs[0] > SPACING * apart:
                        continue  # neighbours, one point in the end
                    if not self._at_shared_clamp(found, poses[[i, k]], apart, itself=i == k):
                        inside = not found.at_end((a.length, b.length))
                        out.append(Pair((i, k), found, apart, inside))
        return out

    @staticmethod
    def _at_shared_clamp(found: Closest, poses: np.ndarray, apart: float, itself: bool) -> bool:
        """Whether the points are beside clamps of both, which are closer than the cables are thick.

        `itself`: of one cable, whose start and end may be.
        """
        first, second = (poses[0, :1], poses[1, 1:]) if itself else poses
        return any(
            float(np.linalg.norm(p[:3] - r[:3])) < apart
            and float(np.linalg.norm(found.points - np.stack([p[:3], r[:3]]), axis=1).min()) < SPACING * apart
            for p in first
            for r in second
        )

    def _before_was(self, pair: Pair) -> Pair | None:
        """The pair at the last equilibrium that has moved to this one; None: there was none nearby."""

        def shift(one: Pair) -> float:
            return float(np.abs(np.subtract(one.closest.arcs, pair.closest.arcs)).max())

        near = AHEAD * max(cable.length for cable in self.cables)
        known = [one for one in self._pairs if one.cables == pair.cables and shift(one) < near]
        return min(known, key=shift, default=None)

    def _passed(self, pairs: Sequence[Pair]) -> bool:
        """Whether two cables, or strands, have passed through each other since the last equilibrium."""
        for one in pairs:
            before = self._before_was(one)
            if before is None or not (one.inside and before.inside):
                continue
            if float(one.closest.normal @ before.closest.normal) < 0.0:
                return True
        return False
