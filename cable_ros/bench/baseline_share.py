# SPDX-License-Identifier: Apache-2.0
"""How far the baselines get from a cold start on the cases that we solve."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cable_ros.baselines import bvp, published
from cable_ros.baselines.result import BaselineResult, ClampedCable, from_equilibrium
from cable_ros.bench.cases import Case, run_case
from cable_ros.bench.verification import Rod, refine
from cable_ros.equilibrium import Equilibrium

LIMIT = 10.0
"""A baseline's solve is given up after this, s."""
PARTS = 80
"""Parts of the published method; its error falls with the first power at best."""
Solve = Callable[[ClampedCable, BaselineResult], BaselineResult]
METHODS: dict[str, tuple[float, Solve]] = {
    "solve_bvp": (1e-4, lambda cable, _: bvp.solve_cold(cable, tolerance=1e-6)),
    "published": (0.1, lambda cable, _: published.solve(cable, PARTS)),
    "published, from our answer": (0.1, lambda cable, ours: published.solve(cable, PARTS, ours)),
}
"""By name: the wrench error up to which an answer counts, and the solve: cold but for the last one, which
shows what the published equations reach when they are handed the solution."""

OVER, DIVERGED, NOT_FINITE = f"over {LIMIT:g} s", "diverged", "not finite"
REPORTED = (OVER, DIVERGED, NOT_FINITE, "ValueError", "LinAlgError")
"""Failures that the method itself tells."""


@dataclass(frozen=True)
class Attempt:
    """A baseline's answer."""

    verified: bool
    """A stable equilibrium with its wrench within the method's bound."""
    error: float
    """Of the wrench, by verification; inf where no equilibrium is near."""
    seconds: float
    why: str
    """Why it does not count; empty where it does."""

    @property
    def cell(self) -> str:
        """For a table."""
        return f"{self.error:.0e}, {1e3 * self.seconds:.0f} ms" if self.verified else self.why


def attempt(name: str, rod: Rod, ours: Equilibrium) -> Attempt:
    """Solve and verify; on the main thread, as the time limit is an alarm."""
    _compile()
    bound, solve = METHODS[name]
    cable = ClampedCable(rod.length, rod.stiffness, rod.weight, rod.start, rod.end)
    began = time.perf_counter()
    try:
        with _limit(LIMIT), np.errstate(all="ignore"):
            result = solve(cable, from_equilibrium(ours, cable))
    except TimeoutError:
        return Attempt(False, np.inf, LIMIT, OVER)
    except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
        return Attempt(False, np.inf, time.perf_counter() - began, type(error).__name__)
    seconds = time.perf_counter() - began
    if not np.all(np.isfinite(result.points)) or not np.all(np.isfinite(result.end_wrench)):
        return Attempt(False, np.inf, seconds, NOT_FINITE)
    even = result.at(np.linspace(0.0, result.arc_length[-1], max(201, result.nodes)))
    to_clamp = Rotation.from_quat(rod.start[3:]).inv()
    start_wrench = np.concatenate([to_clamp.apply(even.force[0]), to_clamp.apply(even.moment[0])])
    found = refine(rod, even.points, even.orientations, start_wrench, result.end_wrench)
    if not found.converged or found.wrench_error > bound:
        return Attempt(False, found.wrench_error, seconds, DIVERGED if not result.converged else "wrong")
    return Attempt(found.stable, found.wrench_error, seconds, "" if found.stable else "unstable")


def baseline_rows(cases: list[Case]) -> list[list[str]]:
    """What becomes of cold cases by each baseline, as rows of the table of `robustness`."""
    from tqdm import tqdm

    attempts: dict[str, list[Attempt]] = {name: [] for name in METHODS}
    for case in tqdm(cases, desc="baselines", leave=False, disable=None):
        for step in run_case(case).steps[-1:]:
            for name in METHODS:
                attempts[name].append(attempt(name, step.rod, step.equilibrium))
    rows = []
    for name, tries in attempts.items():
        good = sum(a.verified for a in tries)
        reported = sum(a.why in REPORTED for a in tries)
        ms = [1e3 * a.seconds for a in tries]
        rows.append(
            [
                name,
                f"cold starts, error below {METHODS[name][0]:g}",
                str(len(tries)),
                "",
                f"{100 * good / max(1, len(tries)):.2f} %",
                str(reported),
                str(len(tries) - good - reported),
                f"{np.median(ms):.0f}",
                f"{max(ms):.0f}",
            ]
        )
    return rows


@cache
def _compile() -> None:
    """Compile what the published method calls: the alarm must not stop that half way."""
    start, end = np.array([0.0, 0, 0, 0, 0, 0, 1]), np.array([0.1, 0, 0.9, 0, 0, 0, 1])
    with suppress(ValueError, ArithmeticError, np.linalg.LinAlgError):
        published.solve(ClampedCable(1.0, np.ones(3), np.array([0.0, -1, 0]), start, end), 8)


@contextmanager
def _limit(seconds: float) -> Iterator[None]:
    def give_up(*_: Any) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, give_up)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
