# SPDX-License-Identifier: Apache-2.0
"""Drawn scenes, one line for each failure as it comes, then the totals.

python benchmarks/drawn.py 60 --seed 1                # scenes 0 to 59
python benchmarks/drawn.py 17 23 --seed 1 --only      # these two, every pose told
python benchmarks/drawn.py 60 --kind hose --quick     # without the finer paths: a third of the time
python benchmarks/drawn.py 60 --most 21               # only paths of up to 21 poses
"""

from __future__ import annotations

import argparse
import sys
import time

from cable_ros.bench.cases import run_case
from cable_ros.bench.contact_fuzz import contact_case
from cable_ros.bench.drawn import drawn_case
from cable_ros.bench.drawn_judge import FINER, Drawn, run_drawn
from cable_ros.bench.drawn_scenes import KINDS
from cable_ros.bench.drawn_table import ALL, HEAD, count, lines, poses
from cable_ros.bench.markdown import markdown_table


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("numbers", type=int, nargs="+", help="how many scenes, or with --only their indices")
    parser.add_argument("--from", type=int, default=0, dest="first", help="first index")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--tolerance", type=float, default=1e-4)
    parser.add_argument("--only", action="store_true", help="the numbers are indices; every pose is told")
    parser.add_argument("--kind", choices=KINDS, help="only scenes of this kind")
    parser.add_argument("--most", type=int, default=10_000, metavar="N", help="only paths of up to N poses")
    parser.add_argument("--quick", action="store_true", help="leave out the finer paths")
    args = parser.parse_args()
    run_case(contact_case(0, 0, 1e-4))  # compiling is not solving
    indices = args.numbers if args.only else range(args.first, args.first + args.numbers[0])
    done: list[Drawn] = []
    began = time.perf_counter()
    for index in indices:
        case = drawn_case(args.seed, index, args.tolerance, args.kind)
        if len(case.path) > args.most:
            continue
        one = run_drawn(case, 1 if args.quick else FINER)
        done.append(one)
        if args.only:
            print("\n".join(poses(one)))
        for line in lines(one):
            print(line, flush=True)
    counts = count(done)
    print(f"\n{markdown_table(HEAD, [each.row(name) for name, each in counts.items()])}")
    if ALL in counts:
        print(", ".join(f"{name} {n}" for name, n in counts[ALL].statuses.most_common()))
    print(f"{len(done)} scenes in {time.perf_counter() - began:.0f} s")
    return 0 if ALL in counts and counts[ALL].good else 1


if __name__ == "__main__":
    sys.exit(main())
