# SPDX-License-Identifier: Apache-2.0
"""Our work-precision curve beside programs that one would pick instead, on the arm; for docs/peers.md.

Needs, in an environment of its own (Python 3.11 or later), this package's own requirements and

    pip install mujoco==4.0.0 pyelastica==1.0.0 soromox==0.5.0 dismech-newton==0.1.0.post4 matplotlib

Every program follows the same clamp from 0 to 90 degrees in steps of one degree, from the same shape, on one
thread; a warm step is all that it takes to the next equilibrium. The error is that of the end force, worst of
six poses whose references `test/data/equilibria.json` has from a spectral homotopy and collocation to 1e-10.
Ours is measured before and after the others, in the same run.

    OMP_NUM_THREADS=1 XLA_FLAGS=--xla_cpu_multi_thread_eigen=false taskset -c 1 python benchmarks/peers.py
"""

from __future__ import annotations

import argparse
import csv
import importlib
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import Protocol

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from peer_arm import ANGLES, Arm
from scipy.spatial.transform import Rotation
from tqdm import tqdm

from cable_ros import Tracker
from cable_ros.bench.machine import describe
from cable_ros.bench.markdown import markdown_table, write_between

mpl.use("Agg")

ROOT = Path(__file__).parents[1]
PACKAGES = ("mujoco", "pyelastica", "soromox", "dismech-newton", "jax", "warp-lang")
TOLERANCES = tuple(10.0**-k for k in range(1, 11))


class Program(Protocol):
    """A program at one setting, at rest at 0 degrees."""

    name: str
    setting: str

    def warm(self, degrees: float) -> None:
        """Solve at the next angle, from where it is."""

    def force(self) -> np.ndarray:
        """(3,) of the end clamp on the cable, world, N; not timed."""


class Ours:
    """`Tracker.solve` as a user calls it, polyline included."""

    name = "cable_ros"

    def __init__(self, arm: Arm, tolerance: float) -> None:
        self.setting = f"{tolerance:.0e}"
        self._arm, self._tracker = arm, Tracker(arm.scene, tolerance)
        self._tracker.arrive({"orientation": 0.0})

    def warm(self, degrees: float) -> None:
        self._found = self._tracker.solve({"orientation": math.radians(degrees)})["camera_cable"]
        self._degrees = degrees

    def force(self) -> np.ndarray:
        turn = Rotation.from_quat(self._arm.clamp(self._degrees)[3:])
        return -turn.apply(self._found.end_wrench[:3])


def _peer(module: str, kind: str, *settings: tuple) -> list[Callable[[Arm], Program]]:
    """Makers of a program at several settings; it is imported where it is first made."""

    def maker(setting: tuple) -> Callable[[Arm], Program]:
        return lambda arm: getattr(importlib.import_module(module), kind)(arm, *setting)

    return [maker(setting) for setting in settings]


PEERS = {
    "mujoco": _peer(
        "peer_mujoco", "Flex", (20, 0.1, 3), (40, 0.1, 8), (80, 0.1, 16), (160, 0.1, 16), (160, 0.1, 64)
    ),
    "dismech": _peer("peer_dismech", "Rod", (20, 5), (40, 5), (80, 5)),
    "soromox": _peer("peer_soromox", "Strains", (6, 8, 2), (8, 16, 2), (10, 32, 2), (12, 64, 2)),
    "elastica": _peer("peer_elastica", "Rod", (10, 1e-4, 6000), (20, 1e-4, 8000), (40, 5e-5, 16000)),
}


@dataclass(frozen=True)
class Row:
    """One program at one setting."""

    program: str
    setting: str
    seconds: float
    """Median of the warm steps."""
    seconds_90: float
    """Nine of ten are faster."""
    error: float
    """Worst relative error of the end force; NaN if it became no number."""


def measure(arm: Arm, program: Program) -> Row:
    """Follow the clamp through all angles."""
    seconds, errors = [], []
    for degrees in ANGLES[1:]:
        begin = time.perf_counter()
        program.warm(float(degrees))
        seconds.append(time.perf_counter() - begin)
        if degrees in arm.references:
            errors.append(arm.error(degrees, program.force()))
    median, ninety = np.quantile(seconds, (0.5, 0.9))
    return Row(program.name, program.setting, float(median), float(ninety), float(np.max(errors)))


def rows(arm: Arm, wanted: list[str]) -> Iterator[Row]:
    """Ours, the others, and ours again."""
    ours = [lambda arm, t=t: Ours(arm, t) for t in TOLERANCES]
    makers = [*ours, *(maker for name in wanted for maker in PEERS[name]), *ours]
    for maker in tqdm(makers, unit=" programs", disable=None):
        yield measure(arm, maker(arm))


def table(found: list[Row]) -> str:
    """The rows in Markdown, ours as the quicker of its two runs."""
    best: dict[tuple[str, str], Row] = {}
    for row in found:
        key = row.program, row.setting
        best[key] = min(best.get(key, row), row, key=lambda one: one.seconds)
    lines = [
        [row.program, row.setting, _time(row.seconds), _time(row.seconds_90), f"{row.error:.1e}"]
        for row in best.values()
    ]
    return markdown_table(("program", "setting", "warm step", "nine of ten below", "worst error"), lines)


def _time(seconds: float) -> str:
    return f"{seconds * 1e6:.0f} us" if seconds < 1e-3 else f"{seconds * 1e3:.3g} ms"


def draw(found: list[Row], facts: str, path: Path) -> None:
    """Error against time, a line for each program."""
    figure, axes = plt.subplots(figsize=(8.0, 5.2), layout="constrained")
    for name in dict.fromkeys(row.program for row in found):
        of = [row for row in found if row.program == name]
        axes.loglog(
            [row.seconds * 1e3 for row in of],
            [row.error for row in of],
            "o-" if name != "cable_ros" else "s",
            label=name,
            markersize=5,
        )
    axes.set_xlabel("time of a warm step, one degree on, ms (median)")
    axes.set_ylabel("relative error of the end force, worst of six poses")
    axes.grid(which="major", alpha=0.3)
    axes.legend()
    axes.set_title("The arm's cable: one thread, one run, the same references")
    figure.text(0.01, -0.02, facts, fontsize=6, va="top", wrap=True)
    figure.savefig(path, dpi=130, bbox_inches="tight")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="*", choices=PEERS, default=list(PEERS), help="some of the programs")
    parser.add_argument("--out", type=Path, default=ROOT / "docs", help="folder of peers.md, .csv and .png")
    args = parser.parse_args()
    facts = describe() | {name: metadata.version(name) for name in PACKAGES}
    arm, found = Arm(), []
    for row in rows(arm, args.only):
        found.append(row)
        tqdm.write(f"{row.program:15} {row.setting:40} {_time(row.seconds):>9} {row.error:.1e}")
    told = ", ".join(f"{name} {fact}" for name, fact in facts.items())
    with (args.out / "peers.csv").open("w", newline="", encoding="utf-8") as file:
        file.write(f"# {told}\n")
        writer = csv.DictWriter(file, list(asdict(found[0])), lineterminator="\n")
        writer.writeheader()
        for row in found:
            values = asdict(row)
            writer.writerow({k: f"{v:.4g}" if isinstance(v, float) else v for k, v in values.items()})
    draw(found, told, args.out / "peers.png")
    write_between(args.out / "peers.md", "peers", f"{table(found)}\n\nOne run: {told}.\n")


if __name__ == "__main__":
    main()
