# SPDX-License-Identifier: Apache-2.0
"""The last bits of the joints: poses of both families solved again with the joints' twelfth digit changed.

    python benchmarks/rounding.py --contacts 250 --drawn 250 --seed 1

tells each scene where a status changed, or a wrench by more than ten tolerances, then one table.
"""

from __future__ import annotations

import argparse
import sys

from cable_ros.bench.contact_fuzz import contact_case
from cable_ros.bench.drawn import drawn_case
from cable_ros.bench.markdown import markdown_table
from cable_ros.bench.metamorphic import Rounded

SHARE = 0.999
"""Least share of poses that stay as they are."""
HEAD = (
    "family",
    "scenes",
    "poses",
    "status changed",
    "wrench changed by more",
    "the same",
    "most, tolerances",
)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--contacts", type=int, default=250, help="random scenes")
    parser.add_argument("--drawn", type=int, default=250, help="drawn scenes")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--tolerance", type=float, default=1e-4)
    args = parser.parse_args()
    rows, shares = [], []
    for name, make, scenes in (("random", contact_case, args.contacts), ("drawn", drawn_case, args.drawn)):
        count = Rounded()
        for index in range(scenes):
            known = len(count.lines)
            count.add(make(args.seed, index, args.tolerance), args.seed + index)
            for line in count.lines[known:]:
                print(line, flush=True)
        rows.append(
            [name, str(count.scenes), str(count.poses), str(count.statuses), str(count.far),
             f"{100 * count.share:.2f} %", f"{count.largest:.1e}"]
        )  # fmt: skip
        shares.append(count.share if count.statuses == 0 else 0.0)
    print(f"\n{markdown_table(HEAD, rows)}")
    return 0 if min(shares) >= SHARE else 1


if __name__ == "__main__":
    sys.exit(main())
