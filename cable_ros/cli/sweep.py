# SPDX-License-Identifier: Apache-2.0
"""`cable sweep`: many poses and parameters to a table or a log."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import itertools
import os
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cable_ros.cli._arguments import (
    add_command,
    add_scene,
    add_tolerance,
    check_joints,
    check_names,
    named_range,
    not_named,
    process_count,
)

if TYPE_CHECKING:
    from cable_ros.scene import Scene

EXAMPLE = """examples:
  cable sweep config/space_arm.yaml --joint orientation=-90:90:0.5deg --out arm.csv
  cable sweep config/space_arm.yaml --joint orientation=-90:90:1deg \\
      --vary youngs_modulus=1e6:10e6:1e6 --vary camera_cable.length=0.38,0.40 --out stiffness.parquet
  cable sweep config/space_arm.yaml --joint orientation=-90:90:0.001deg --out arm.parquet \\
      --cluster tcp://192.168.1.10:8786

The last joint is tracked in order, from the branch that the scene names. --vary takes a field of every
cable, or CABLE.FIELD for one; every cable then starts near the total twist of the first variant, unless
the scene or --vary gives it. Rows that are not to be trusted hold their status and no numbers.
The result does not depend on the number of processes, nor on the machines of --cluster if they have the
same processor and the same versions. Others join this process when it has worked for half a second."""


def add_parser(subparsers: argparse._SubParsersAction[Any]) -> None:
    parser = add_command(
        subparsers,
        "sweep",
        "many poses and parameters, to CSV, Parquet or MCAP",
        "Solve the product of joint ranges and scene variations, over all cores.",
        EXAMPLE,
    )
    add_scene(parser)
    ranges: dict[str, Any] = {"type": named_range, "action": "append", "default": []}
    parser.add_argument(
        "--joint",
        metavar="NAME=START:STOP:STEP",
        help="joint range, both ends included; or NAME=A,B,C; 0 for joints not named",
        **ranges,
    )
    parser.add_argument("--vary", metavar="FIELD=START:STOP:STEP", help="range of a scene field", **ranges)
    parser.add_argument(
        "--out", metavar="FILE", type=Path, required=True, help="table (.csv, .parquet) or log (.mcap)"
    )
    add_tolerance(parser)
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--jobs", metavar="N", type=process_count, help="processes (default: one for each core)"
    )
    where.add_argument(
        "--cluster", metavar="ADDRESS", help="Dask scheduler, such as tcp://HOST:8786, whose workers solve"
    )


def run(args: argparse.Namespace) -> int:
    from tqdm import tqdm

    from cable_ros.batch import solve_paths
    from cable_ros.cli._tables import check_out, open_table
    from cable_ros.scene import Kinematics, load_scene, vary

    check_out(args.out, bool(args.vary))
    scene = load_scene(args.scene)
    for sentence in beyond_limits(args.joint, scene):
        print(f"cable sweep: {sentence} Solved all the same.", file=sys.stderr)
    names = [name for name, _ in args.vary]
    variants = [
        dict(zip(names, values, strict=True))
        for values in itertools.product(*(values.tolist() for _, values in args.vary))
    ]
    scenes = [vary(scene, variant) for variant in variants]  # reports every mistake before the first solve
    needed = Kinematics(scene).joint_names
    check_names([name for name, _ in args.joint], needed)
    resting = not_named(args.command, [name for name, _ in args.joint], needed)
    paths = grid([*((name, np.zeros(1)) for name in resting), *args.joint], needed)
    count = len(scenes) * sum(map(len, paths))
    point_count = 101 if args.out.suffix == ".mcap" else 2
    statuses: Counter[str] = Counter()
    begin = time.monotonic()
    tqdm.monitor_interval = 0  # its thread would keep `solve_paths` from forking
    with (
        workers_of(args) as (executor, workers),
        open_table(args.out, scene) as table,
        tqdm(total=count, unit="pose", disable=None) as progress,
    ):
        jobs = ((varied, paths) for varied in same_branch(scenes, paths[0][0]))
        solved = solve_paths(jobs, args.tolerance, point_count, workers, False, executor)
        with contextlib.closing(solved):
            for index, batch in solved:
                table.write(variants[index], batch)
                statuses.update(status.name for status in batch.status.ravel())
                progress.update(len(batch))
    seconds = time.monotonic() - begin
    what = ", ".join(f"{number} {name}" for name, number in statuses.most_common())
    where = f"up to {workers} processes" if workers > 1 else "1 process"
    if args.cluster:
        where = f"{args.cluster} with {workers} thread{'s' if workers > 1 else ''}"
    speed = f"{where}, {seconds:.1f} s, {count / seconds:.0f} poses/s"
    print(f"{args.out}: {count} poses, {what}; {speed}")
    return 0


@contextlib.contextmanager
def workers_of(args: argparse.Namespace) -> Iterator[tuple[Executor | None, int]]:
    """Where to solve by --cluster and --jobs: an executor or this machine's processes; how many at a time."""
    if args.cluster is None:
        yield None, args.jobs or cores()
        return
    from cable_ros.cli._cluster import cluster

    with cluster(args.cluster) as found:
        yield found


def grid(ranges: Sequence[tuple[str, np.ndarray]], joint_names: Sequence[str]) -> list[np.ndarray]:
    """The product of the ranges as paths (m, n_joints) along the last one, columns as in `joint_names`."""
    given = [name for name, _ in ranges]
    check_joints(given, joint_names)
    if not ranges:
        return [np.empty((1, 0))]
    order = [given.index(name) for name in joint_names]
    *slow, fast = (values for _, values in ranges)
    return [
        np.column_stack([*(np.full(len(fast), value) for value in values), fast])[:, order]
        for values in itertools.product(*slow)
    ]


def beyond_limits(ranges: Sequence[tuple[str, np.ndarray]], scene: Scene) -> Iterator[str]:
    """A sentence for each end of a joint's range that is outside the URDF's limits."""
    from cable_ros.scene import Kinematics
    from cable_ros.scene.joint_limits import JointLimits

    limits = {limit.name: limit for limit in JointLimits(scene, Kinematics(scene).joint_names).joints}
    for name, values in ranges:
        for value in dict.fromkeys((float(values.min()), float(values.max()))):
            if name in limits and (sentence := limits[name].beyond(value)):
                yield sentence


def same_branch(scenes: Sequence[Scene], pose: np.ndarray) -> Iterator[Scene]:
    """The scenes, each cable without a hint given the total twist that it has in the first of them."""
    from cable_ros.tracker import Tracker

    yield scenes[0]
    if len(scenes) == 1 or all(cable.total_twist is not None for cable in scenes[0].cables):
        yield from scenes[1:]
        return
    tracker = Tracker(scenes[0])
    found = tracker.arrive(dict(zip(tracker.joint_names, pose.tolist(), strict=True)))
    for scene in scenes[1:]:
        cables = tuple(
            dataclasses.replace(cable, total_twist=found[cable.name].total_twist)
            if cable.total_twist is None and not cable.supports and found[cable.name].status.trusted
            else cable
            for cable in scene.cables
        )
        yield dataclasses.replace(scene, cables=cables)


def cores() -> int:
    """How many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
