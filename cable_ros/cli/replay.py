# SPDX-License-Identifier: Apache-2.0
"""`cable replay`: solve a logged run again, under its own scene or another one."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cable_ros.cli._arguments import CommandError, add_command
from cable_ros.common.arguments import from_zero
from cable_ros.share import scene_path

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from cable_ros.equilibrium import Equilibrium
    from cable_ros.log.reader import LogReader
    from cable_ros.log.resolve import Comparison, Outcome
    from cable_ros.log.run import LoggedRun, Solve
    from cable_ros.scene import Scene

EXAMPLE = """example:
  cable replay run.mcap --resolve
  cable replay run.mcap --with space_arm_cold.yaml --out what_if

--resolve: exit code 0 when no wrench differs by more than the tolerance, else 1.
--with: writes STEM_with_SCENE.mcap and STEM_with_SCENE.png.
To publish a log again: ros2 run cable_ros cable_replay LOG."""

MOST_SAMPLES = 20_000  # in the picture


def add_parser(subparsers: argparse._SubParsersAction[Any]) -> None:
    """Add `cable replay`."""
    parser = add_command(
        subparsers,
        "replay",
        "solve a logged run again and compare",
        "Feed a log's joint states to its own scene, or to another, and compare every wrench.",
        EXAMPLE,
    )
    parser.add_argument("log", metavar="LOG", type=Path, nargs="+", help="log, or all files of a split one")
    parser.add_argument("--resolve", action="store_true", help="compare with the logged wrenches")
    parser.add_argument(
        "--tolerance",
        metavar="T",
        type=from_zero,
        default=0.0,
        help="largest difference allowed, relative to the largest force and moment (default 0: bit for bit,"
        " as the same machine and versions give it)",
    )
    parser.add_argument(
        "--with", dest="scene", metavar="SCENE", type=scene_path, help="solve under this scene instead"
    )
    parser.add_argument("--out", metavar="DIR", type=Path, help="folder for --with (default: the log's)")


def run(args: argparse.Namespace) -> int:
    """Exit code 0; 1 where --resolve found a larger difference than allowed."""
    from cable_ros.log.reader import LogReader
    from cable_ros.log.resolve import logged_scene
    from cable_ros.log.run import LoggedRun
    from cable_ros.scene import load_scene

    if not args.resolve and args.scene is None:
        raise CommandError("say what to do: --resolve, or --with SCENE; to publish the log, use cable_replay")
    with ExitStack() as stack:
        logs = [stack.enter_context(LogReader(path)) for path in args.log]
        logged = LoggedRun(logs)
        code = 0
        if args.resolve:
            code = _resolve(logged, logged_scene(logged.logs[0]), args.tolerance)
        if args.scene is not None:
            urdf = logged.logs[0].urdf_text
            scene = load_scene(args.scene, urdf=urdf)
            _what_if(logged, scene, args.scene, args.out or args.log[0].parent)
    return code


def _resolve(logged: LoggedRun, scene: Scene, tolerance: float) -> int:
    from cable_ros.log.resolve import Outcome

    outcome = Outcome()
    for _ in _solves(logged, scene, outcome, own_environment=False):
        pass
    print(f"{logged.name}: {outcome.solves} poses solved again")
    for (cable, clamp), comparison in sorted(outcome.comparisons.items()):
        print("  " + _line(cable, clamp, comparison, logged.logs[0].start, exact=True))
    for caveat in _caveats(logged, outcome) + ([] if outcome.within(0.0) else _differences(logged)):
        print(caveat)
    within = outcome.within(tolerance)
    asked = f"{'within' if within else 'beyond'} the tolerance {tolerance:g}"
    same = "the same bit for bit" if within else "not the same bit for bit"
    print(f"largest relative difference {outcome.relative:.3g}: {asked if tolerance else same}")
    return 0 if within else 1


def _solves(logged: LoggedRun, scene: Scene, outcome: Outcome, own_environment: bool) -> Any:
    """`resolve` with a progress bar."""
    from tqdm import tqdm

    from cable_ros.log.resolve import logged_tolerance, resolve
    from cable_ros.tracker import Tracker

    tracker = Tracker(scene, logged_tolerance(logged.logs[0]))
    solves = resolve(logged, tracker, outcome, own_environment)
    # disable=None: no bar where nobody looks.
    return tqdm(solves, total=logged.count, desc="solve", unit="pose", disable=None)


def _line(cable: str, clamp: str, comparison: Comparison, begin: int, exact: bool) -> str:
    text = f"{cable} {clamp}: "
    if exact:
        text += f"{comparison.identical} of {comparison.compared} wrenches bit for bit, "
    text += f"largest difference {comparison.force:.3g} N and {comparison.moment:.3g} N m"
    if comparison.force:
        text += f" (at {(comparison.worst_time - begin) / 1e9:.3f} s)"
    if comparison.unanswered:
        text += f"; {comparison.unanswered} times only one of both runs had a result"
    return text


def _caveats(logged: LoggedRun, outcome: Outcome) -> list[str]:
    lines = []
    if not logged.exact:
        lines.append("The log has no ~/solved_joints: the joint states as received were solved, each one.")
    if not outcome.fresh:
        lines.append("The log begins in the middle of a run: its first solve was warm, this one was cold.")
    if outcome.gaps:
        lines.append(
            f"{outcome.gaps} solves are missing: a slow disk had them dropped, or the log was damaged."
        )
    if outcome.environments:
        lines.append(
            "The environment is the scene's own; the temperatures and doses of the log were left out."
        )
    return lines


def _differences(logged: LoggedRun) -> list[str]:
    """Why the bits may differ: what was another machine or version."""
    from cable_ros.log.host import host_facts

    then, now = logged.logs[0].metadata.get("host", {}), host_facts()
    other = [
        f"{key} {then[key]}, here {now[key]}" for key in sorted({*then} & {*now}) if then[key] != now[key]
    ]
    return [f"The log is of another machine or version: {'; '.join(other)}."] if other else []


def _what_if(logged: LoggedRun, scene: Scene, path: Path, folder: Path) -> None:
    from cable_ros.drawing.figures import save
    from cable_ros.log.resolve import Outcome
    from cable_ros.ros.what_if_log import WhatIfLog

    stem = f"{Path(logged.name).stem}_with_{path.stem}"
    stride = 1 + logged.count // MOST_SAMPLES
    samples: list[Sample] = []
    refused = 0
    outcome = Outcome()
    with WhatIfLog(folder / f"{stem}.mcap", scene, logged.logs[0]) as log:
        for solve, equilibria in _solves(logged, scene, outcome, own_environment=True):
            log.write(solve, equilibria)
            refused += sum(not found.status.trusted for found in equilibria.values())
            if (outcome.solves - 1) % stride == 0:
                samples.append(Sample.of(solve, equilibria))
    if not samples:
        raise CommandError(f"{logged.name} holds no pose with every joint that {path} needs")
    picture = save(side_by_side(samples, logged.logs[0], path.stem), folder / f"{stem}.png")
    without = f", {refused} results that cannot be trusted left out" if refused else ""
    print(f"{folder / f'{stem}.mcap'}: {outcome.solves} poses under {path}{without}")
    for (cable, clamp), comparison in sorted(outcome.comparisons.items()):
        print("  " + _line(cable, clamp, comparison, logged.logs[0].start, exact=False))
    for caveat in _caveats(logged, outcome):
        print(caveat)
    print(f"{picture}: the end wrenches, logged and under {path.stem}, side by side")


@dataclass(frozen=True)
class Sample:
    """One pose for the picture; wrenches (6,) by cable, NaN where there was none."""

    log_time: int
    joints: dict[str, float]
    logged: dict[str, np.ndarray]
    again: dict[str, np.ndarray]

    @classmethod
    def of(cls, solve: Solve, equilibria: dict[str, Equilibrium]) -> Sample:
        """What the picture needs of a solve."""
        missing = np.full(6, np.nan)
        logged = {cable: solve.wrenches.get((cable, "end"), missing) for cable in equilibria}
        again = {cable: e.end_wrench if e.status.trusted else missing for cable, e in equilibria.items()}
        return cls(solve.log_time, solve.joints, logged, again)


def side_by_side(samples: Sequence[Sample], log: LogReader, name: str) -> Figure:
    """The end wrenches of every cable, as logged and under another scene, with the same axes."""
    from cable_ros.cli.plot import moving_joints, scene_of
    from cable_ros.drawing.figures import Abscissa, wrench_figure

    joints = list(samples[0].joints)
    values = np.array([[sample.joints[joint] for joint in joints] for sample in samples])
    ranges = np.ptp(values, axis=0)
    if joints and ranges.max() > 0:
        leading = int(np.argmax(ranges))
        kind = moving_joints(scene_of(log.path)).get(joints[leading], "revolute")
        abscissa, across = Abscissa.of_joint(joints[leading], kind != "prismatic"), values[:, leading]
    else:
        abscissa = Abscissa.of_time()
        across = np.array([(sample.log_time - log.start) / 1e9 for sample in samples])
    columns = {}
    for cable in samples[0].again:
        columns[f"{cable}, logged"] = across, np.array([sample.logged[cable] for sample in samples])
        columns[f"{cable}, {name}"] = across, np.array([sample.again[cable] for sample in samples])
    figure = wrench_figure(abscissa, columns)
    for row in (figure.axes[: len(columns)], figure.axes[len(columns) : 2 * len(columns)]):
        limits = np.array([axes.get_ylim() for axes in row])
        for axes in row:
            axes.set_ylim(limits[:, 0].min(), limits[:, 1].max())
    return figure
