# SPDX-License-Identifier: Apache-2.0
"""The same answer on other machines: named scenes under other BLAS kernels and instruction sets.

    python benchmarks/kernels.py                          # a few scenes; the last setting compiles
    python benchmarks/kernels.py --drawn 0 4 6 --seed 1   # these drawn scenes instead
    python benchmarks/kernels.py --zoo test/zoo_open.py --named sideways hose

Each setting is a process of its own, for both are read when NumPy and Numba are loaded; the first is this
machine's. A kernel that this processor cannot run is left out.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from cable_ros.bench.cases import Case, case_scene, rods
from cable_ros.bench.drawn import drawn_case
from cable_ros.bench.markdown import markdown_table
from cable_ros.bench.metamorphic import TOLERANCES, follow
from cable_ros.bench.zoo_table import load_cases
from cable_ros.scene.kinematics import Kinematics

CORES = ("Haswell", "SkylakeX", "Sandybridge", "Prescott", "Zen")
SETTINGS = ({}, *({"OPENBLAS_CORETYPE": core} for core in CORES), {"NUMBA_CPU_NAME": "generic"})
"""Environment variables of each process."""
ZOO = Path(__file__).parents[1] / "test" / "zoo.py"
NAMED = ("ball with friction", "two balls: jump", "heavy cable", "rod led over a drum", "edge of a box: deep")
HEAD = ("setting", "poses", "status differs", "wrench differs", "most, tolerances")


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--drawn", type=int, nargs="*", default=[], metavar="INDEX", help="drawn scenes")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--zoo", type=Path, default=ZOO, help="file of named cases (default: the zoo)")
    parser.add_argument("--settings", nargs="*", help="only these values, such as Haswell generic")
    parser.add_argument("--named", nargs="*", help="those whose name has one of these in it")
    parser.add_argument("--solve", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.solve:
        solve(chosen(args))
        return 0
    settings = [
        one for one in SETTINGS if not one or args.settings is None or {*one.values()} & {*args.settings}
    ]
    answers = [run(setting) for setting in settings]
    cases = chosen(args)
    rows, good = [], True
    for setting, found in zip(settings, answers, strict=True):
        name = ", ".join(f"{key}={value}" for key, value in setting.items()) or "as this machine chooses"
        if found is None:
            rows.append([name, "does not run here", "", "", ""])
            continue
        row, why = compare(cases, answers[0] or {}, found)
        print("\n".join(f"{name}: {line}" for line in why), end="\n" if why else "")
        rows.append([name, *row])
        good &= not why
    print(f"\n{markdown_table(HEAD, rows)}")
    return 0 if good else 1


def chosen(args: argparse.Namespace) -> list[Case]:
    if args.drawn:
        return [drawn_case(args.seed, index, 1e-4) for index in args.drawn]
    parts = NAMED if args.named is None and args.zoo == ZOO else args.named or ("",)
    return [case for case in load_cases(args.zoo) if any(part in case.name for part in parts)]


def solve(cases: list[Case]) -> None:
    """Print status and end wrench of every pose of every case."""
    out = {
        case.name: [[one.status.name, *one.end_wrench.tolist()] for one in follow(case).found]
        for case in cases
    }
    print(json.dumps(out))


def run(setting: dict[str, str]) -> dict[str, list[list]] | None:
    """The answers of a process with these variables; None where it cannot run."""
    command = [sys.executable, __file__, *sys.argv[1:], "--solve"]
    done = subprocess.run(command, env={**os.environ, **setting}, capture_output=True, text=True)
    if done.returncode < 0:  # an illegal instruction
        return None
    if done.returncode:
        raise SystemExit(f"{setting}: {done.stderr}")
    return json.loads(done.stdout)


def compare(
    cases: list[Case], first: dict[str, list[list]], second: dict[str, list[list]]
) -> tuple[list[str], list[str]]:
    """Cells of a row as HEAD has them after the setting, and a line for each case that differs."""
    poses = statuses = far = 0
    largest = 0.0
    why = []
    for case in cases:
        scene = case_scene(case)
        rod = next(iter(rods(scene, Kinematics(scene), case.path[-1]).values()))
        unit = np.array([1.0] * 3 + [1.0 / rod.length] * 3)
        differs = []
        for i, (a, b) in enumerate(zip(first[case.name], second[case.name], strict=True)):
            poses += 1
            if a[0] != b[0]:
                statuses += 1
                differs.append(f"pose {i}: {a[0]}, here {b[0]}")
                continue
            wrenches = np.array([a[1:], b[1:]], dtype=float) * unit
            if not np.all(np.isfinite(wrenches)):
                continue
            off = (
                float(np.linalg.norm(wrenches[1] - wrenches[0]) / np.linalg.norm(wrenches[0]))
                / case.tolerance
            )
            largest = max(largest, off)
            if off > TOLERANCES:
                far += 1
                differs.append(f"pose {i}: wrench {off:.1e} tolerances away")
        if differs:
            why.append(f"{case.name}: {differs[0]}, {len(differs)} in all")
    return [str(poses), str(statuses), str(far), f"{largest:.1e}"], why


if __name__ == "__main__":
    sys.exit(main())
