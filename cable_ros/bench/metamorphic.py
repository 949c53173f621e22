# SPDX-License-Identifier: Apache-2.0
"""What must not change an answer: the last bits of the joints, and into how many states a path is divided.

No reference is needed: two answers of the same tracker are compared. Both take cases as they are listed
elsewhere, and leave out what is not trusted on either side, which is counted by itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from cable_ros.bench.cases import Case, Pose, answered, case_scene, lost, relative_difference, rods
from cable_ros.equilibrium import Equilibrium
from cable_ros.scene.kinematics import Kinematics
from cable_ros.tracker import Tracker

DIGIT = 1e-12
"""Joint values are changed by this part of themselves, or by so many rad or m where they are below 1."""
TOLERANCES = 10.0
"""Wrenches may then differ by so many tolerances: twice what both may be off, and room for what is soft."""
SAME = 0.01
"""Relative difference allowed between wrenches at the end of one path in other states."""


@dataclass(frozen=True)
class Told:
    """The answers along one path."""

    found: list[Equilibrium]
    difference: Callable[[Equilibrium, Equilibrium, int], float]
    """Relative difference of two end wrenches at a pose of this path."""

    @property
    def lost(self) -> int | None:
        """The first pose where the cable's history was lost, said or half said."""
        return next((i for i, one in enumerate(self.found) if lost(one)), None)


def follow(case: Case, path: Sequence[Pose] | None = None) -> Told:
    """The answers of a case's only cable along its path, or another through the same joints."""
    scene = case_scene(case)
    (cable,) = scene.cables
    tracker, kinematics = Tracker(scene, tolerance=case.tolerance), Kinematics(scene)
    path = case.path if path is None else path
    found = [answered(tracker, joints)[0][cable.name] for joints in path]

    def difference(a: Equilibrium, b: Equilibrium, index: int) -> float:
        return relative_difference(
            a.end_wrench, b.end_wrench, rods(scene, kinematics, path[index])[cable.name]
        )

    return Told(found, difference)


def nudged(case: Case, seed: int) -> Case:
    """The same case with every joint value changed in its twelfth digit, up or down by chance."""
    rng = np.random.default_rng([seed, len(case.path)])
    path = [
        {
            name: value + DIGIT * max(1.0, abs(value)) * float(rng.choice([-1.0, 1.0]))
            for name, value in pose.items()
        }
        for pose in case.path
    ]
    return replace(case, path=path)


@dataclass
class Rounded:
    """What the last bits of the joints changed in some cases."""

    scenes: int = 0
    poses: int = 0
    statuses: int = 0
    """Poses whose status changed."""
    far: int = 0
    """Poses whose wrench changed by more than `TOLERANCES`, trusted both times."""
    largest: float = 0.0
    """Change of a wrench, in tolerances."""
    lines: list[str] = field(default_factory=list)
    """One for each scene where something changed."""

    def add(self, case: Case, seed: int) -> None:
        first, second = follow(case), follow(nudged(case, seed))
        self.scenes += 1
        reported = False
        for i, (a, b) in enumerate(zip(first.found, second.found, strict=True)):
            self.poses += 1
            why = ""
            if a.status is not b.status:
                self.statuses += 1
                why = f"{a.status.name}, then {b.status.name}"
            elif a.status.trusted:
                change = first.difference(a, b, i) / case.tolerance
                self.largest = max(self.largest, change)
                if not change <= TOLERANCES:
                    self.far += 1
                    why = f"wrench changed by {change:.1e} tolerances"
            if why and not reported:
                self.lines.append(f"{case.name.replace(' ', ':')} pose {i}: {why} [{case.expected}]")
                reported = True

    @property
    def share(self) -> float:
        """Share of poses with the same status and wrench."""
        return 1.0 - (self.statuses + self.far) / max(1, self.poses)


def in_states(corners: Sequence[Pose], states: int) -> list[Pose]:
    """A path through `corners`, each leg of which has `states` states, both ends counted."""
    return _legs(corners, np.linspace(0.0, 1.0, states)[1:])


def at_rate(corners: Sequence[Pose], rate: float, seconds: float) -> list[Pose]:
    """The same path as a trajectory sampled at `rate`, Hz: each leg takes `seconds`, from rest to rest."""
    t = np.arange(1, round(rate * seconds) + 1) / round(rate * seconds)
    return _legs(corners, t * t * t * (10.0 - 15.0 * t + 6.0 * t * t))


def _legs(corners: Sequence[Pose], parts: np.ndarray) -> list[Pose]:
    out: list[Pose] = [dict(corners[0])]
    for before, after in pairwise(corners):
        for part in parts:
            # a corner is the same to the last bit however it is come by
            there = {name: before[name] + float(part) * (after[name] - before[name]) for name in after}
            out.append(dict(after) if part == 1.0 else there)
    return out


@dataclass(frozen=True)
class Telling:
    """One division of a path into states."""

    name: str
    path: Callable[[Sequence[Pose]], list[Pose]]


def tellings(
    states: Iterable[int] = (2, 8, 32), rates: Iterable[float] = (50, 100, 125, 250, 500, 1000),
    seconds: float = 0.5,
) -> list[Telling]:  # fmt: skip
    """States a leg, then rates, Hz, of legs that take so long; the last is what others are compared with."""
    counted = [Telling(f"{n} states", lambda corners, n=n: in_states(corners, n)) for n in states]  # type: ignore[misc]
    timed = [Telling(f"{r:g} Hz", lambda corners, r=r: at_rate(corners, r, seconds)) for r in rates]  # type: ignore[misc]
    return counted + timed


@dataclass
class Stepped:
    """What became of the end of paths that were divided in one way."""

    paths: int = 0
    states: int = 0
    lost: int = 0
    """Paths on which the cable's history was lost."""
    untrusted: int = 0
    """Paths that ended in a status that is not trusted."""
    far: int = 0
    """Paths that ended trusted in another wrench than the last telling's, which is not lost itself."""
    largest: float = 0.0
    """Relative difference from it."""


def step_all(
    case: Case, corners: Sequence[Pose], ways: Sequence[Telling], counts: dict[str, Stepped]
) -> list[str]:
    """Lead a case's cable through `corners` in all `ways`, count the outcomes, and report what differs."""
    results = {way.name: follow(case, way.path(corners)) for way in ways}
    last = results[ways[-1].name]
    why = []
    for name, one in results.items():
        count = counts.setdefault(name, Stepped())
        count.paths += 1
        count.states += len(one.found)
        end, reference = one.found[-1], last.found[-1]
        if one.lost is not None:
            count.lost += 1
            why.append(f"{name}: lost at state {one.lost} of {len(one.found)}")
        if not end.status.trusted:
            count.untrusted += 1
            why.append(f"{name}: {end.status.name}")
        elif one.lost is None and last.lost is None and reference.status.trusted:
            off = last.difference(end, reference, len(last.found) - 1)
            count.largest = max(count.largest, off)
            if not (off <= SAME and math.isfinite(off)):
                count.far += 1
                why.append(f"{name}: wrench {off:.1e} away")
    return [f"{case.name.replace(' ', ':')} [{case.expected}] {'; '.join(why)}"] if why else []


def corners(case: Case) -> list[Pose]:
    """Where a case's path, straight in the joints from corner to corner, turns; with its ends."""
    names = list(case.path[0])
    at = np.array([[pose[name] for name in names] for pose in case.path])
    turns = [
        i for i in range(1, len(at) - 1)
        if np.abs((at[i + 1] - at[i]) - (at[i] - at[i - 1])).max() > 1e-9 * max(1.0, np.abs(at).max())
    ]  # fmt: skip
    return [case.path[i] for i in (0, *turns, len(at) - 1)]
