# SPDX-License-Identifier: Apache-2.0
"""Heavy hoses led about on rough ground against an independent incremental rod: trusted poses, errors.

python benchmarks/hose_paths.py [NAME ...]        # all of test/data/hose_paths.json, or those named
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "test"))
from references.hose_paths import known
from test_hose_paths import FORCE, run


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("names", nargs="*")
    paths = known()
    chosen = [paths[name] for name in parser.parse_args().names or paths]
    print(
        "| path | poses | trusted | off | far off | largest | statuses | s | slowest, ms |\n"
        + "|---" * 9
        + "|"
    )
    poses = trusted = off = 0
    for one in chosen:
        led = run(one.hose.name)
        if not abs(led.twist - one.total_twist) < 0.02:
            print(
                f"| {one.hose.name} | starts from another equilibrium, twist {led.twist:.3f} rad: left out |"
            )
            continue
        wrong = led.trusted & (led.difference > FORCE + one.error)
        poses, trusted, off = poses + len(wrong), trusted + int(led.trusted.sum()), off + int(wrong.sum())
        statuses = ", ".join(f"{name} {count}" for name, count in Counter(led.statuses).items())
        largest = led.difference[led.trusted].max() if led.trusted.any() else np.nan
        far = int(np.sum(led.trusted & (led.difference > 0.2 + one.error)))
        times = f"{led.times.sum():.1f} | {1e3 * led.times.max():.0f}"
        print(
            f"| {one.hose.name} | {len(wrong)} | {led.trusted.sum()} | {wrong.sum()} | {far} | {largest:.3f} "
            f"| {statuses} | {times} |",
            flush=True,
        )
    print(f"\n{poses} poses on {len(chosen)} paths: {trusted} trusted, {off} of them more than 5 % off.")
    return int(off > 0)


if __name__ == "__main__":
    sys.exit(main())
