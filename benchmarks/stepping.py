# SPDX-License-Identifier: Apache-2.0
"""The same path told otherwise: in 2, 8 and 32 states a leg, and as a trajectory at 50 to 1000 Hz.

    python benchmarks/stepping.py 200 --seed 1            # drawn scenes, half of them with friction
    python benchmarks/stepping.py 17 23 --seed 1 --only   # these two

tells each path that ends in wrenches more than 1 % apart, or on which the cable is lost, then one table.
Wrenches are compared with those at the highest rate.
"""

from __future__ import annotations

import argparse
import sys

from cable_ros.bench.drawn import drawn_case
from cable_ros.bench.markdown import markdown_table
from cable_ros.bench.metamorphic import Stepped, corners, step_all, tellings

HEAD = ("told in", "paths", "states", "lost", "not trusted at the end", "wrench more than 1 % away", "most")


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("numbers", type=int, nargs="+", help="how many scenes, or with --only their indices")
    parser.add_argument("--only", action="store_true", help="the numbers are indices")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--tolerance", type=float, default=1e-4)
    parser.add_argument("--seconds", type=float, default=0.5, help="that a leg takes (default 0.5)")
    args = parser.parse_args()
    counts: dict[str, Stepped] = {}
    for index in args.numbers if args.only else range(args.numbers[0]):
        case = drawn_case(args.seed, index, args.tolerance)
        for line in step_all(case, corners(case), tellings(seconds=args.seconds), counts):
            print(line, flush=True)
    rows = [
        [name, str(c.paths), str(c.states), str(c.lost), str(c.untrusted), str(c.far), f"{c.largest:.1e}"]
        for name, c in counts.items()
    ]
    print(f"\n{markdown_table(HEAD, rows)}")
    return 0 if all(c.lost == c.far == c.untrusted == 0 for c in counts.values()) else 1


if __name__ == "__main__":
    sys.exit(main())
