# SPDX-License-Identifier: Apache-2.0
"""`cable bench robustness`: random cases by the thousand, or a list of named ones; all verified."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TypeVar

import numpy as np

from cable_ros.bench import drawn_table
from cable_ros.bench.baseline_share import baseline_rows
from cable_ros.bench.cases import Case, Outcome, Step, run_case
from cable_ros.bench.contact_fuzz import contact_case
from cable_ros.bench.drawn import drawn_case
from cable_ros.bench.drawn_judge import run_drawn
from cable_ros.bench.fuzz import STEPS, cold_case, tracked_case
from cable_ros.bench.machine import describe
from cable_ros.bench.markdown import markdown_table, write_between
from cable_ros.equilibrium import Equilibrium, Status

Each = TypeVar("Each")
SHARE = 0.999
"""Least share of cases that must converge to a verified equilibrium, of those that may have one."""
SLOW = 1.0
"""No case may take longer, s."""
HEAD = (
    "method",
    "cases",
    "count",
    "no equilibrium exists, confirmed",
    "converged and verified",
    "reported as not",
    "wrong",
    "median ms",
    "most ms",
)
GRAVITY_EDGES = (0, 1, 10, 50, 100, 200, np.inf)
CHORD_EDGES = (0.0, 0.2, 0.5, 0.8, 0.9, 0.95, np.inf)


def run(args: argparse.Namespace) -> int:
    """Run it and print what came out; 1 where an answer was wrong or too few converged."""
    if args.zoo:
        from cable_ros.bench.zoo_table import run_zoo

        return run_zoo(args.zoo, args.markdown)
    if args.only:
        return _run_one(args)
    steps = args.cases if args.steps is None else args.steps
    paths = -(-steps // STEPS)
    for warm in (tracked_case(args.seed, 0, args.tolerance, steps=3), contact_case(0, 0, args.tolerance)):
        run_case(warm)  # compiling is not solving
    cold = Tally("cold starts")
    for outcome in _progress(
        (run_case(cold_case(args.seed, i, args.tolerance)) for i in range(args.cases)), args.cases, "cold"
    ):
        cold.add(outcome)
    tracked = Tally("tracked steps")
    for outcome in _progress(
        (run_case(tracked_case(args.seed, i, args.tolerance)) for i in range(paths)), paths, "tracked"
    ):
        tracked.add(outcome)
    touching = Tally("poses among obstacles")
    for outcome in _progress(
        (run_case(contact_case(args.seed, i, args.tolerance)) for i in range(args.contacts)),
        args.contacts,
        "contact",
    ):
        touching.add(outcome)
    tallies = [tally for tally in (cold, tracked, touching) if tally.answers]
    print("\n\n".join(tally.report(args.seed) for tally in tallies))
    facts = f"Seed {args.seed}, tolerance {args.tolerance:g}; " + ", ".join(
        f"{name} {fact}" for name, fact in describe().items()
    )
    drawn = (run_drawn(drawn_case(args.seed, i, args.tolerance)) for i in range(args.drawn))
    drawn_good = not args.drawn or drawn_table.publish(
        _progress(drawn, args.drawn, "drawn"), args.markdown, facts
    )
    if not tallies:
        return 0 if drawn_good else 1
    rows = [tally.row() for tally in tallies]
    if args.baselines:
        rows += baseline_rows([cold_case(args.seed, i, args.tolerance) for i in range(args.baselines)])
    table = markdown_table(HEAD, rows)
    print(f"\n{table}")
    if args.markdown:
        write_between(args.markdown, "fuzz", f"{facts}.\n\n{table}\n")
    return 0 if drawn_good and all(tally.good for tally in tallies) else 1


def _progress(outcomes: Iterable[Each], total: int, name: str) -> Iterator[Each]:
    from tqdm import tqdm

    return iter(tqdm(outcomes, total=total, desc=name, leave=False, disable=not sys.stderr.isatty()))


def _run_one(args: argparse.Namespace) -> int:
    kind, _, index = args.only.partition(":")
    if kind == "drawn" and index.isdecimal():
        one = run_drawn(drawn_case(args.seed, int(index), args.tolerance))
        print("\n".join([*drawn_table.poses(one), *(drawn_table.lines(one) or ["verified"])]))
        return 1 if drawn_table.lines(one) else 0
    makers = {"cold": cold_case, "tracked": tracked_case, "contact": contact_case}
    if kind not in makers or not index.isdecimal():
        raise RobustnessError(
            f"'{args.only}' names no case; give cold:INDEX, tracked:INDEX, contact:INDEX or drawn:INDEX,"
            " as a run prints"
        )
    outcome = run_case(makers[kind](args.seed, int(index), args.tolerance))
    for i, step in enumerate(outcome.steps):
        found = step.equilibrium
        error = step.verification.wrench_error if step.verification else np.nan
        print(
            f"{i:4d}  {found.status.name:13s} twist {found.total_twist:+9.4f}  energy {found.energy:.6g}  "
            f"margin {found.stability_margin:.3g}  error {error:.1e}  iterations {found.iterations:3d}  "
            f"{1e3 * step.seconds:.2f} ms  {_touched(found)}{step.fault or _reason(step)}"
        )
    tally = Tally(kind)
    tally.add(outcome)
    print(outcome.fault or "verified")
    return 0 if outcome.passed and not tally.reported else 1


def _reason(step: Step) -> str:
    """Why there is no answer, where there is none, and how long paths past the obstacles are."""
    if step.equilibrium.status.trusted:
        return ""
    checked = f" Checked: {step.paths.describe(step.rod.length)}." if step.paths else ""
    return step.equilibrium.message + checked


def _touched(found: Equilibrium) -> str:
    names = Counter(contact.obstacle for contact in found.contacts)
    return "".join(f"{name} x {count}  " for name, count in names.items())


class RobustnessError(ValueError):
    """The arguments do not name something to run."""


@dataclass(frozen=True)
class Answer:
    """What is counted of one answer: the whole of 20,000 would not fit into memory."""

    verified: bool
    impossible: bool
    seconds: float
    iterations: int
    error: float
    """Of the wrench; NaN where it could not be verified."""
    gravity_number: float
    chord: float
    """Relative to the length."""
    touching: bool

    @classmethod
    def of(cls, step: Step) -> Answer:
        rod = step.rod
        return cls(
            step.verified,
            step.impossible,
            step.seconds,
            step.equilibrium.iterations,
            step.verification.wrench_error if step.verification and step.verified else np.nan,
            rod.gravity_number,
            float(np.linalg.norm(rod.end[:3] - rod.start[:3]) / rod.length),
            bool(step.equilibrium.contacts),
        )


@dataclass
class Tally:
    """What became of many cases."""

    name: str
    answers: list[Answer] = field(default_factory=list)
    wrong: list[tuple[Case, str]] = field(default_factory=list)
    """Published as true and not, raised, or took too long."""
    reported: list[tuple[Case, str]] = field(default_factory=list)
    """Honestly said not to be solved."""
    impossible: list[tuple[Case, str]] = field(default_factory=list)
    """Said to have no equilibrium, which was confirmed."""
    statuses: Counter[Status] = field(default_factory=Counter)

    def add(self, outcome: Outcome) -> None:
        self.answers += [Answer.of(step) for step in outcome.steps]
        for i, step in enumerate(outcome.steps):
            self.statuses[step.equilibrium.status] += 1
            where = f"pose {i}: " if len(outcome.steps) > 1 else ""
            if step.fault is not None:
                self.wrong.append((outcome.case, where + step.fault))
            elif step.impossible:
                self.impossible.append((outcome.case, where + _reason(step)))
            elif not step.equilibrium.status.trusted:
                self.reported.append((outcome.case, where + _reason(step)))
            if step.seconds > SLOW:
                self.wrong.append((outcome.case, f"{where}took {step.seconds:.1f} s"))
        for before, after in pairwise(outcome.steps):
            if _hidden_jump(before, after):
                self.wrong.append((outcome.case, "the shape jumped without a report of a snap"))
        listed = self.wrong + self.reported + self.impossible
        if not outcome.passed and not any(case is outcome.case for case, _ in listed):
            self.wrong.append((outcome.case, outcome.fault or ""))

    @property
    def share(self) -> float:
        """Share of answers that are verified equilibria, of those that may have one."""
        return _share(self.answers)

    @property
    def good(self) -> bool:
        return not self.wrong and self.share >= SHARE

    def row(self) -> list[str]:
        """As HEAD has it."""
        ms = 1e3 * np.array([answer.seconds for answer in self.answers])
        return [
            "cable_ros",
            self.name,
            str(len(self.answers)),
            str(len(self.impossible)),
            f"{100 * self.share:.2f} %",
            str(len(self.reported)),
            str(len(self.wrong)),
            f"{np.median(ms):.2f}",
            f"{ms.max():.0f}",
        ]

    def report(self, seed: int) -> str:
        times = 1e3 * np.array([answer.seconds for answer in self.answers])
        iterations = np.array([answer.iterations for answer in self.answers])
        errors = [answer.error for answer in self.answers if answer.verified]
        lines = [
            f"{self.name}: {len(self.answers)}, seed {seed}",
            f"  no equilibrium exists   {len(self.impossible)}, confirmed",
            f"  converged and verified  {100 * self.share:.3f} % of the others",
            f"  reported as not         {len(self.reported)}",
            f"  wrong                   {len(self.wrong)}",
            "  statuses                "
            + ", ".join(f"{status.name} {count}" for status, count in self.statuses.most_common()),
            f"  touching something      {sum(answer.touching for answer in self.answers)}",
            f"  wrench error            median {np.median(errors or [np.nan]):.1e}, "
            f"largest {max(errors, default=np.nan):.1e}",
            f"  time                    median {np.median(times):.2f} ms, "
            f"99 % {np.quantile(times, 0.99):.2f} ms, most {times.max():.1f} ms",
            f"  iterations              median {np.median(iterations):.0f}, most {iterations.max()}",
            *self._by("gravity number", [answer.gravity_number for answer in self.answers], GRAVITY_EDGES),
            *self._by("chord / length", [answer.chord for answer in self.answers], CHORD_EDGES),
        ]
        for title, cases in (
            ("no equilibrium", self.impossible),
            ("reported", self.reported),
            ("WRONG", self.wrong),
        ):
            lines += [f"  {title}: {_label(case)}: {why}" for case, why in cases[:50]]
            if len(cases) > 50:
                lines.append(f"  ... and {len(cases) - 50} more {title}")
        return "\n".join(lines)

    def _by(self, name: str, values: list[float], edges: tuple[float, ...]) -> list[str]:
        place = np.digitize(values, edges) - 1
        lines = [
            f"  {name:22s}  {'cases':>6s} {'verified':>9s} {'iterations':>10s} {'ms':>8s} {'most ms':>8s}"
        ]
        for i in range(len(edges) - 1):
            chosen = [answer for answer, at in zip(self.answers, place, strict=True) if at == i]
            if not chosen:
                continue
            ms = [1e3 * answer.seconds for answer in chosen]
            lines.append(
                f"    {edges[i]:8g} .. {edges[i + 1]:8g}  {len(chosen):6d} "
                f"{100 * _share(chosen):8.2f}% "
                f"{np.median([answer.iterations for answer in chosen]):10.0f} "
                f"{np.median(ms):8.2f} {max(ms):8.1f}"
            )
        return lines


def _share(answers: list[Answer]) -> float:
    possible = sum(not answer.impossible for answer in answers)
    return sum(answer.verified for answer in answers) / possible if possible else 1.0


def _label(case: Case) -> str:
    return case.name.replace(" ", ":")


def _hidden_jump(before: Step, after: Step) -> bool:
    """Whether the shape moved far while the clamp moved little, and no snap was reported."""
    first, second = before.equilibrium, after.equilibrium
    if Status.SNAPPED is second.status or not (first.status.trusted and second.status.trusted):
        return False
    moved = np.linalg.norm(second.points - first.points, axis=1).max() / after.rod.length
    turn = abs(second.total_twist - first.total_twist)
    clamp = np.linalg.norm(after.rod.end[:3] - before.rod.end[:3]) / after.rod.length
    # Near a fold the shape moves like the root of the clamp's motion; a jump is far beyond that.
    return bool(clamp < 0.02 and (moved > 0.4 or turn > np.pi))
