# SPDX-License-Identifier: Apache-2.0
"""The ways to an equilibrium that are compared: ours, `solve_bvp`, the published method.

Each takes one pose of the robot at a time, warm (from its own last result) or cold, and times nothing but its
solves: the clamps' poses are handed to the baselines, while ours works them out within its time.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from cable_ros.baselines import bvp, bvp_plain, published
from cable_ros.baselines.result import BaselineResult, ClampedCable
from cable_ros.scene import Scene
from cable_ros.tracker import Tracker

MESHES = (26, 101, 401, 1601)
"""Nodes that solve_bvp may start from: the fewest that do, for it never coarsens a mesh."""


@dataclass(frozen=True)
class Pose:
    """One pose of the robot."""

    joints: dict[str, float]
    cables: tuple[ClampedCable, ...]
    reference: tuple[BaselineResult, ...] | None
    """The true equilibria, where they were worked out."""
    counts: bool = True
    """Whether its time is part of the median: in a scene with obstacles, where one is touched."""


@dataclass(frozen=True)
class Outcome:
    """What a method made of a pose."""

    seconds: float
    """Per equilibrium."""
    wrenches: np.ndarray
    """(n_cables, 6) as `Equilibrium.end_wrench`; NaN where the method says itself that it failed."""


class Method(Protocol):
    """One method at one setting."""

    name: str
    setting: float
    """Tolerance, or number of parts."""

    def settle(self, pose: Pose) -> None:
        """Come to rest at the first pose of a path, which has its reference; not timed."""

    def warm(self, pose: Pose) -> Outcome:
        """Solve, starting from the last result."""

    def cold(self, pose: Pose) -> Outcome:
        """Solve, knowing nothing."""


class OurTracker:
    """`Tracker.solve` as a user calls it, polylines included."""

    name = "cable_ros"

    def __init__(self, scene: Scene, tolerance: float) -> None:
        self.setting = tolerance
        self._tracker = Tracker(scene, tolerance)

    def settle(self, pose: Pose) -> None:
        self._tracker.reset()
        self._tracker.arrive(pose.joints)

    def warm(self, pose: Pose) -> Outcome:
        begin = time.perf_counter()
        equilibria = self._tracker.arrive(pose.joints)
        seconds = time.perf_counter() - begin
        wrenches = [e.end_wrench if e.status.trusted else np.full(6, np.nan) for e in equilibria.values()]
        return Outcome(seconds / len(wrenches), np.array(wrenches))

    def cold(self, pose: Pose) -> Outcome:
        self._tracker.reset()
        return self.warm(pose)


class SolveBvp:
    """scipy's collocation with analytic Jacobians; warm on the last mesh."""

    name = "solve_bvp"

    def __init__(self, tolerance: float, jacobians: bool = True) -> None:
        self.setting = tolerance
        self._jacobians = jacobians
        self._last: Sequence[BaselineResult] = ()

    def settle(self, pose: Pose) -> None:
        assert pose.reference is not None
        for nodes in MESHES:
            self._last = [one.at(np.linspace(0.0, one.arc_length[-1], nodes)) for one in pose.reference]
            if np.all(np.isfinite(self.warm(pose).wrenches)):
                return

    def warm(self, pose: Pose) -> Outcome:
        begin = time.perf_counter()
        results = [self._solve(cable, last) for cable, last in zip(pose.cables, self._last, strict=True)]
        outcome = _outcome(begin, results)
        self._last = [new if new.converged else old for new, old in zip(results, self._last, strict=True)]
        return outcome

    def _solve(self, cable: ClampedCable, last: BaselineResult) -> BaselineResult:
        return bvp.solve(cable, last, tolerance=self.setting, jacobians=self._jacobians)

    def cold(self, pose: Pose) -> Outcome:
        begin = time.perf_counter()
        return _outcome(begin, [bvp.solve_cold(cable, tolerance=self.setting) for cable in pose.cables])


class PlainBvp(SolveBvp):
    """scipy's collocation on the equations as they stand, thirteen states; warm on the last mesh."""

    name = "solve_bvp, plain"

    def _solve(self, cable: ClampedCable, last: BaselineResult) -> BaselineResult:
        return bvp_plain.solve(cable, last, tolerance=self.setting)


class Published:
    """The published finite differences; cold from the paper's vector of ones, or from our equilibrium for
    nothing.
    """

    def __init__(self, parts: int, from_ones: bool = True) -> None:
        self.name = "published method" if from_ones else "published method, our start"
        self.parts, self.setting = parts, float(parts)
        self._from_ones = from_ones
        # the error of the differences is per cents: a warm start may stop at a thousandth
        self._options = published.GaussNewton(step_tolerance=1e-3)
        self._last: Sequence[BaselineResult] = ()

    def settle(self, pose: Pose) -> None:
        assert pose.reference is not None
        careful = published.GaussNewton(step_tolerance=1e-6)
        self._last = [
            published.solve(cable, self.parts, guess, careful)
            for cable, guess in zip(pose.cables, pose.reference, strict=True)
        ]

    def warm(self, pose: Pose) -> Outcome:
        begin = time.perf_counter()
        results = self._solve(pose, self._last)
        self._last = results
        return _outcome(begin, results)

    def cold(self, pose: Pose) -> Outcome:
        guesses = [None] * len(pose.cables) if self._from_ones else pose.reference
        assert guesses is not None
        begin = time.perf_counter()
        return _outcome(begin, self._solve(pose, guesses))

    def _solve(self, pose: Pose, guesses: Sequence[BaselineResult | None]) -> list[BaselineResult]:
        return [
            published.solve(cable, self.parts, guess, self._options)
            for cable, guess in zip(pose.cables, guesses, strict=True)
        ]


def _outcome(begin: float, results: Sequence[BaselineResult]) -> Outcome:
    seconds = time.perf_counter() - begin
    wrenches = [one.end_wrench if one.converged else np.full(6, np.nan) for one in results]
    return Outcome(seconds / len(results), np.array(wrenches))
