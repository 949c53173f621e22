# SPDX-License-Identifier: Apache-2.0
"""`cable bench`: what a digit costs, against the baselines."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cable_ros.cli import _robustness
from cable_ros.cli._arguments import check_joints, named_range
from cable_ros.share import scene_path

if TYPE_CHECKING:
    from cable_ros.bench.precision import Row

EXAMPLE = """examples:
  cable bench precision
  cable bench precision my_robot.yaml --joint shoulder=-45:45:0.5deg --out bench/
  cable bench precision draped.yaml --joint lift=0.02:0.35:0.001

precision.csv and precision.png hold processor, cores and versions. The error of an end wrench is the
larger of |difference| / |reference| of its force and of its moment, at the worst pose; references are
solve_bvp's at a tolerance of 1e-10; of cables that touch obstacles, an integration's of the rod's equations
beside the tracker's own of a tight tolerance; of other scenes, that alone; both have no baselines. Several
--joint move together."""


def add_parser(subparsers: argparse._SubParsersAction[Any]) -> None:
    parser = subparsers.add_parser(
        "bench",
        help="speed, accuracy and robustness, beside the baselines",
        description="Measure speed, accuracy and robustness on this machine.",
        epilog="example:\n  cable bench precision --quick",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    benchmarks = parser.add_subparsers(
        title="benchmarks", dest="benchmark", metavar="BENCHMARK", required=True
    )
    precision = benchmarks.add_parser(
        "precision",
        help="error of the end wrench against time, over tolerances and baselines",
        description="Work-precision diagram, and what effects, weight, joint steps and more cables cost.",
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    precision.add_argument(
        "scene",
        metavar="SCENE",
        type=scene_path,
        nargs="?",
        help="scene file (YAML), or the name of an installed one (default: the space arm)",
    )
    precision.add_argument(
        "--joint",
        metavar="NAME=START:STOP:STEP",
        type=named_range,
        action="append",
        default=[],
        help="path of the joints (default: -90:90:0.5deg for each)",
    )
    precision.add_argument("--out", metavar="DIR", type=Path, default=Path("bench"), help="default: bench/")
    precision.add_argument("--quick", action="store_true", help="fewer settings and poses: about a minute")
    _robustness.add_parser(benchmarks)


def run(args: argparse.Namespace) -> int:
    if args.benchmark == "robustness":
        from cable_ros.bench import robustness

        return robustness.run(args)

    from tqdm import tqdm

    from cable_ros.bench.machine import describe
    from cable_ros.bench.precision import FULL, QUICK, Bench, write_csv
    from cable_ros.bench.precision_figure import figure
    from cable_ros.drawing import figures
    from cable_ros.scene import Kinematics, load_scene
    from cable_ros.share import share_file

    scene = load_scene(args.scene or share_file("config", "space_arm.yaml"))
    path = joint_path(args.joint, Kinematics(scene).joint_names)
    facts = describe()
    print(", ".join(f"{name} {fact}" for name, fact in facts.items()))
    rows: list[Row] = []
    with tqdm(unit=" steps", disable=None) as progress:

        def tick(what: str) -> None:
            progress.set_description(what, refresh=False)
            progress.update()

        bench = Bench(scene, path, QUICK if args.quick else FULL, tick)
        progress.total = bench.ticks()
        for row in bench.rows():
            progress.clear()
            if not rows or row.panel != rows[-1].panel:
                print(HEADER)
            print(line(row), flush=True)
            rows.append(row)
    facts["references"] = bench.provenance
    print(f"references: {facts['references']}")
    write_csv(args.out / "precision.csv", rows, facts)
    name = Path(scene.source).stem
    picture = figure(rows, f"What accuracy costs: {name}", facts)
    print(f"{args.out / 'precision.csv'}, {figures.save(picture, args.out / 'precision.png')}")
    return 0


HEADER = (
    f"\n{'panel':8} {'method':28} {'setting':18} {'time':>10} {'90 % below':>10} {'worst':>8} "
    f"{'median':>8} failed"
)


def line(row: Row) -> str:
    """One row of the printed table: median time and its 90 % quantile, errors, failures."""
    return (
        f"{row.panel:8} {row.method:28} {row.setting:18} {row.seconds * 1e6:7.1f} us "
        f"{row.seconds_90 * 1e6:7.1f} us {row.error:8.1e} {row.error_median:8.1e} {row.failed:3d}/{row.poses}"
    )


def joint_path(ranges: Sequence[tuple[str, np.ndarray]], names: Sequence[str]) -> np.ndarray:
    """(m, n_joints): all joints from the starts to the stops of their ranges together."""
    if not ranges:
        whole = np.radians(np.linspace(-90.0, 90.0, 361))
        return np.repeat(whole[:, None], len(names), axis=1)
    check_joints([name for name, _ in ranges], names)
    given = dict(ranges)
    count = max(len(values) for values in given.values())
    return np.column_stack([np.linspace(given[name][0], given[name][-1], count) for name in names])
