# SPDX-License-Identifier: Apache-2.0
"""Speed and accuracy of the space arm's cable: every figure in one run, medians.

    taskset -c 2,3 python benchmarks/speed.py --out docs/speed.csv     # two cores; about five minutes

Warm: -90 to 90 degrees in steps of 0.5; the error of every step is measured against solve_bvp at 1e-9.
"""

from __future__ import annotations

import argparse
import csv
import gc
import subprocess
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path

import floor
import numpy as np
from tqdm import tqdm

from cable_ros import Tracker, load_scene
from cable_ros.batch import solve_many
from cable_ros.bench.machine import describe
from cable_ros.bench.methods import Method, OurTracker, PlainBvp, Pose, Published, SolveBvp
from cable_ros.bench.precision import FULL, Bench, Row
from cable_ros.scene import Scene
from cable_ros.share import share_file

SCENE = share_file("config", "space_arm.yaml")
PATH = np.radians(np.linspace(-90.0, 90.0, 361))
MICRO = 1e6


@dataclass(frozen=True)
class Figure:
    """One line of the table."""

    what: str
    measured: float
    unit: str
    wanted: str
    met: bool | None
    """None: nothing was asked for."""


class WithoutJacobians(SolveBvp):
    """solve_bvp on our best formulation, left to differentiate numerically."""

    name = "solve_bvp without Jacobians"

    def __init__(self, tolerance: float) -> None:
        super().__init__(tolerance, jacobians=False)


RIVALS: tuple[type[SolveBvp], ...] = (PlainBvp, SolveBvp, WithoutJacobians)
"""Written as the equations stand; and with all that makes it fast, exact Jacobians first."""


def at_most(what: str, measured: float, unit: str, bound: float) -> Figure:
    return Figure(what, measured, unit, f"at most {bound:g}", measured <= bound)


def at_least(what: str, measured: float, unit: str, bound: float) -> Figure:
    return Figure(what, measured, unit, f"at least {bound:g}", measured >= bound)


def warm_and_cold(scene: Scene, progress: tqdm[None]) -> Iterator[Figure]:
    """Against the baselines, every pose with its reference."""
    bench = Bench(
        scene, PATH[:, None], FULL, lambda what: progress.set_description(what) or progress.update()
    )
    poses = bench.poses(scene, PATH[:, None], len(PATH), 1e-9)
    assert all(pose.reference is not None for pose in poses)
    ours = [OurTracker(scene, tolerance) for tolerance in (1e-4, 1e-6, 1e-8)]
    theirs: list[Method] = [make(t) for make in RIVALS for t in FULL.bvp_tolerances[1:]]
    published = [Published(parts) for parts in FULL.parts]
    rows = list(bench.warm("warm", [*ours, *theirs, *published], poses))
    by_method = {name: [row for row in rows if row.method == name] for name in {row.method for row in rows}}
    mine = by_method["cable_ros"]
    for row in mine:
        yield Figure(f"warm at {row.setting}: failed steps", row.failed, "", "0", row.failed == 0)
    yield at_most("warm at 1e-4: time", mine[0].seconds * MICRO, "us", 50.0)
    yield Figure("warm at 1e-4: nine of ten below", mine[0].seconds_90 * MICRO, "us", "", None)
    yield at_most("warm at 1e-4: worst error of all steps", mine[0].error, "", 1e-4)
    yield at_most("warm at 1e-8: time", mine[2].seconds * MICRO, "us", 1e3)
    yield at_most("warm at 1e-8: worst error of all steps", mine[2].error, "", 1e-8)
    for rival in RIVALS:
        for row in mine:
            other = equally_accurate(by_method[rival.name], row.value)
            if other is not None:
                what = f"error at most {row.setting}: {rival.name} at {other.setting}"
                yield Figure(f"{what}, time", other.seconds * 1e3, "ms", "", None)
                yield at_least(f"{what}, time over ours", other.seconds / row.seconds, "", 200.0)
    quickest = min(by_method["published method"], key=lambda row: row.seconds)
    best = min(by_method["published method"], key=lambda row: row.error)
    yield at_least(
        f"published method, quickest ({quickest.setting}), time over ours",
        quickest.seconds / mine[0].seconds, "", 1.0,
    )  # fmt: skip
    for row in mine[:2]:
        what = f"published method, most accurate ({best.setting}), error over ours at {row.setting}"
        yield at_least(what, best.error / row.error, "", 100.0)
    yield from cold(scene, poses[::10])


def equally_accurate(rows: Sequence[Row], error: float) -> Row | None:
    """The quickest setting that is good to `error` at every pose."""
    good = [row for row in rows if row.error <= error and row.failed == 0]
    return min(good, key=lambda row: row.seconds, default=None)


def cold(scene: Scene, poses: Sequence[Pose]) -> Iterator[Figure]:
    """From nothing, at poses all over the path."""
    for tolerance in (1e-4, 1e-8):
        method = OurTracker(scene, tolerance)
        seconds = [method.cold(pose).seconds for pose in poses]
        yield at_most(f"cold at {tolerance:.0e}: time", float(np.median(seconds)) * 1e3, "ms", 20.0)
        yield Figure(f"cold at {tolerance:.0e}: slowest", max(seconds) * 1e3, "ms", "", None)


def against_the_floor(scene: Scene) -> Iterator[Figure]:
    """Steps with the factors at hand and steps that assemble and factor anew, each against its arithmetic."""
    tracker = Tracker(scene)
    tracked = tracker._tracked_cables[0]
    name = tracker.joint_names[0]
    kept, renewed, corrections = [], [], []
    for angle in np.concatenate([PATH, PATH[::-1]] * 3):
        begin = time.perf_counter()
        (equilibrium,) = tracker.solve({name: angle}).values()
        seconds = time.perf_counter() - begin
        assert tracked._rod is not None
        (renewed if tracked._rod.rotation == 0.0 else kept).append(seconds)
        corrections.append(equilibrium.iterations)
    mesh = tracked._rod.mesh
    least = floor.measure(len(mesh.lengths), mesh.element.order)
    evaluations = 1.0 + float(np.median(corrections))  # the predictor and the corrections
    for what, seconds, anew in (("factors at hand", kept, 0), ("tangent and factors anew", renewed, 1)):
        bare = least.equilibrium(evaluations, anew)
        yield Figure(f"steps with {what}: share", len(seconds) / len(corrections), "", "", None)
        yield Figure(f"steps with {what}: their arithmetic alone", bare * MICRO, "us", "", None)
        yield at_most(
            f"steps with {what}: time over their arithmetic's", float(np.median(seconds)) / bare, "", 3.0
        )


def allocations(scene: Scene) -> Iterator[Figure]:
    """What a step leaves allocated beyond its result, and what 2000 steps leave when nobody keeps results."""
    tracker = Tracker(scene)
    name = tracker.joint_names[0]
    for angle in PATH:
        result = tracker.solve({name: angle})
    (equilibrium,) = result.values()
    arrays = ("points", "orientations", "end_wrench", "start_wrench")
    numbers = sum(getattr(equilibrium, array).nbytes for array in arrays)
    del result, equilibrium
    gc.collect()
    gc.disable()
    tracemalloc.start()
    kept, peaks = [], []
    for angle in PATH[::-1]:
        tracemalloc.reset_peak()
        before, _ = tracemalloc.get_traced_memory()
        result = tracker.solve({name: angle})
        after, peak = tracemalloc.get_traced_memory()
        peaks.append(peak - before)
        del result
        kept.append(after - before)
    start, _ = tracemalloc.get_traced_memory()
    for k in range(2000):
        tracker.solve({name: PATH[-1 - k % 2]})
    stop, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    gc.enable()
    yield Figure("arrays of a result", numbers, "B", "", None)
    yield Figure("allocated in a step, with the result", float(np.median(peaks)), "B", "", None)
    yield at_most("left by 2000 steps whose results are dropped", stop - start, "B", 4096)


def throughput(scene: Scene) -> Iterator[Figure]:
    """Batch in this process; then the command over both cores, with its start and its table."""
    joints = np.tile(np.concatenate([PATH, PATH[::-1]]), 10)[:, None]
    begin = time.perf_counter()
    solve_many(scene, joints)
    yield at_least("solve_many, one process", len(joints) / (time.perf_counter() - begin), "1/s", 1000.0)
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / "sweep.csv"
        command = (
            f"sweep {SCENE} --joint orientation=-90:90:0.5deg --vary youngs_modulus=5e6:8e6:2e4 --out {table}"
        )
        begin = time.perf_counter()
        run = [sys.executable, "-m", "cable_ros.cli.main", *command.split()]
        subprocess.run(run, check=True, capture_output=True)
        seconds = time.perf_counter() - begin
        with table.open() as file:
            rows = sum(1 for _ in file) - 1
    cores = int(describe()["cores"])
    what = f"cable sweep, {rows} equilibria over {cores} cores: each core"
    yield at_least(what, rows / seconds / cores, "1/s", 1000.0)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="table as CSV")
    args = parser.parse_args()
    facts = describe()
    print(", ".join(f"{name} {fact}" for name, fact in facts.items()))
    scene = load_scene(SCENE)
    with tqdm(unit=" steps", disable=None) as progress:
        figures = [
            *warm_and_cold(scene, progress),
            *against_the_floor(scene),
            *allocations(scene),
            *throughput(scene),
        ]
    for figure in figures:
        verdict = {None: "", True: "met", False: "NOT MET"}[figure.met]
        print(f"{figure.what:84} {figure.measured:10.4g} {figure.unit:4} {figure.wanted:16} {verdict}")
    if args.out is not None:
        with args.out.open("w", newline="", encoding="utf-8") as file:
            file.writelines(f"# {name}: {fact}\n" for name, fact in facts.items())
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["what", "measured", "unit", "wanted", "met"])
            for figure in figures:
                what, measured, *rest = astuple(figure)
                writer.writerow([what, f"{measured:.4g}", *rest])
    return 0 if all(figure.met is not False for figure in figures) else 1


if __name__ == "__main__":
    sys.exit(main())
