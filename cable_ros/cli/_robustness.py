# SPDX-License-Identifier: Apache-2.0
"""`cable bench robustness`: its arguments."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from cable_ros.cli._arguments import count, relative_tolerance

EXAMPLE = """examples:
  cable bench robustness --cases 10000 --seed 1
  cable bench robustness --seed 1 --only cold:4711       one case of a run again
  cable bench robustness --cases 0 --drawn 2000 --seed 1
  cable bench robustness --zoo test/zoo.py --markdown docs/robustness.md

Exit code 1: an answer that was published as true is not, or fewer than 99.9 % converged."""


def add_parser(benchmarks: argparse._SubParsersAction[Any]) -> None:
    parser = benchmarks.add_parser(
        "robustness",
        help="random cases by the thousand, or named hard ones, every answer verified",
        description="Solve random cables cold and along random paths of their clamps, or the named cases of "
        "a file, and verify every answer by integrating the rod's differential equations.",
        epilog=EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--cases", type=count, default=1000, metavar="N", help="cold cases (default 1000)")
    parser.add_argument("--steps", type=count, metavar="N", help="tracked steps (default: as many as cases)")
    parser.add_argument(
        "--contacts",
        type=count,
        default=0,
        metavar="N",
        help="scenes with obstacles, 5 poses each (default 0)",
    )
    parser.add_argument(
        "--drawn",
        type=count,
        default=0,
        metavar="N",
        help="scenes as people draw them: planar, on round numbers, led there and back (default 0)",
    )
    parser.add_argument("--seed", type=count, default=0, metavar="S", help="which random cases (default 0)")
    parser.add_argument(
        "--tolerance", type=relative_tolerance, default=1e-4, metavar="T", help="asked for (default 1e-4)"
    )
    parser.add_argument(
        "--only", metavar="KIND:INDEX", help="a single case, such as cold:17, tracked:3, contact:8 or drawn:5"
    )
    parser.add_argument(
        "--baselines", type=count, default=0, metavar="N", help="also solve the first N cold cases by those"
    )
    parser.add_argument(
        "--zoo", type=Path, metavar="FILE", help="run the named cases (CASES) of a Python file instead"
    )
    parser.add_argument(
        "--markdown", type=Path, metavar="FILE", help="write the tables there, between their marks"
    )
