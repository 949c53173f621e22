# SPDX-License-Identifier: Apache-2.0
"""`cable bench robustness --drawn N`: a line for each scene that fails, and the table of the family."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cable_ros.bench.drawn_judge import Drawn, Judged
from cable_ros.bench.markdown import markdown_table, write_between

HEAD = (
    "scenes",
    "count",
    "poses",
    "touching",
    "answered and verified",
    "no equilibrium exists, confirmed",
    "reported as not",
    "of them history lost",
    "scenes lost on a finer path",
    "wrong",
    "median ms",
    "99 % ms",
    "99.9 % ms",
    "most ms",
    "most ms, cold",
)
SHARE = 0.999
"""Least share of poses that must be answered and verified, of those that may have an equilibrium."""
ALL = "all"


@dataclass
class Count:
    """What became of the poses of some scenes."""

    scenes: int = 0
    poses: int = 0
    touching: int = 0
    verified: int = 0
    unseen: int = 0
    """Trusted and not verified by themselves, only against the finer path."""
    impossible: int = 0
    reported: int = 0
    lost: int = 0
    wrong: int = 0
    finer_lost: int = 0
    """Scenes whose finer path lost its history."""
    warm: list[float] = field(default_factory=list)
    """Seconds of each pose but the first."""
    cold: list[float] = field(default_factory=list)
    statuses: Counter[str] = field(default_factory=Counter)

    def add(self, drawn: Drawn) -> None:
        self.scenes += 1
        for pose in drawn.poses:
            equilibrium = pose.step.equilibrium
            self.poses += 1
            self.statuses[equilibrium.status.name] += 1
            self.touching += pose.trusted and bool(equilibrium.contacts)
            (self.warm if pose.index else self.cold).append(pose.step.seconds)
            what = kind(pose)
            self.verified += what == "verified"
            self.unseen += what == "unseen"
            self.impossible += what == "impossible"
            self.reported += what in ("reported", "lost")
            self.lost += what == "lost"
            self.wrong += what == "wrong"
        self.wrong += drawn.raised is not None
        self.finer_lost += drawn.finer_lost is not None

    @property
    def share(self) -> float:
        """Share of verified poses, of those that were looked at and may have an equilibrium."""
        of = self.poses - self.impossible - self.unseen
        return self.verified / of if of else 1.0

    @property
    def good(self) -> bool:
        return self.wrong == self.lost == self.finer_lost == 0 and self.share >= SHARE

    def row(self, name: str) -> list[str]:
        """As HEAD has it."""
        ms = 1e3 * np.array(self.warm or [np.nan])
        times = [np.median(ms), np.quantile(ms, 0.99), np.quantile(ms, 0.999), ms.max()]
        return [
            name,
            str(self.scenes),
            str(self.poses),
            str(self.touching),
            f"{100 * self.share:.2f} %",
            str(self.impossible),
            str(self.reported),
            str(self.lost),
            str(self.finer_lost),
            str(self.wrong),
            *(f"{time:.3g}" for time in times),
            f"{1e3 * max(self.cold, default=np.nan):.3g}",
        ]


def kind(pose: Judged) -> str:
    """verified, unseen, impossible, reported, lost or wrong."""
    if pose.wrong is not None:
        return "wrong"
    if pose.lost:
        return "lost"
    if pose.step.impossible:
        return "impossible"
    if not pose.trusted:
        return "reported"
    return "verified" if pose.judged else "unseen"


def lines(drawn: Drawn) -> list[str]:
    """One line for the first pose of each kind of failure in a scene; none where there is no failure."""
    head = f"{drawn.case.name.replace(' ', ':')} [{drawn.case.expected}]"
    if drawn.raised is not None:
        return [f"WRONG {head}: {drawn.raised}"]
    found: dict[str, list[Judged]] = {}
    for pose in drawn.poses:
        found.setdefault(kind(pose), []).append(pose)
    out = []
    for what in ("wrong", "lost", "reported"):
        if what in found:
            first, equilibrium = found[what][0], found[what][0].step.equilibrium
            why = first.wrong or f"{equilibrium.status.name}: {equilibrium.message}"
            step = first.step
            paths = "" if step.paths is None else f" Checked: {step.paths.describe(step.rod.length)}."
            word = "WRONG" if what == "wrong" else what
            out.append(f"{word} {head} pose {first.index}, {len(found[what])} in all: {why}{paths}")
    if drawn.finer_lost is not None:
        out.append(f"lost {head} on a finer path, {drawn.finer_lost}")
    return out


def count(drawn: Iterable[Drawn]) -> dict[str, Count]:
    """By kind of scene, with and without friction, and all together."""
    out: dict[str, Count] = {}
    for one in drawn:
        rough = any(obstacle["friction"] for obstacle in one.case.scene["obstacles"])  # type: ignore[index]
        what = one.case.expected.split(",")[0]
        for name in (what, "with friction" if rough else "without friction", ALL):
            out.setdefault(name, Count()).add(one)
    last = ("without friction", "with friction", ALL)
    names = sorted(name for name in out if name not in last) + [name for name in last if name in out]
    return {name: out[name] for name in names}


def poses(drawn: Drawn) -> list[str]:
    """A line for each pose of one scene."""
    out = [f"{drawn.case.name}: {drawn.case.expected}"]
    for pose in drawn.poses:
        found, seen = pose.step.equilibrium, pose.step.verification
        points = sum(contact.length == 0.0 for contact in found.contacts)
        out.append(
            f"{pose.index:4d}  {kind(pose):10s} {found.status.name:13s} end wrench "
            + " ".join(f"{x:+.4g}" for x in found.end_wrench)
            + f"  twist {found.total_twist:+.4f}  margin {found.stability_margin:.2g}"
            f"  error {seen.wrench_error if seen else np.nan:.1e}"
            f"  {points} points, {len(found.contacts) - points} along"
            f"  {1e3 * pose.step.seconds:.1f} ms  {pose.wrong or ''}"
        )
    return out


def publish(drawn: Iterable[Drawn], page: Path | None, facts: str) -> bool:
    """Print failures and the table, and write it into `page` where there is one; whether all is good.

    No scene is kept: what became of 2,000 takes more memory than a robot has.
    """
    counts = count(map(_told, drawn))
    table = markdown_table(HEAD, [each.row(name) for name, each in counts.items()])
    statuses = ", ".join(f"{name} {n}" for name, n in counts[ALL].statuses.most_common())
    print(f"\n{table}\n\n{statuses}\n")
    if page is not None:
        write_between(page, "drawn", f"{facts}.\n\n{table}\n")
    return counts[ALL].good


def _told(drawn: Drawn) -> Drawn:
    """The same, whose failures are printed."""
    for line in lines(drawn):
        print(line, flush=True)
    return drawn
