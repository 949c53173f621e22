# SPDX-License-Identifier: Apache-2.0
"""Where the time of a warm step goes: each compiled function that Python calls, and the Python about them.

    python benchmarks/profile_step.py                                  # the space arm
    python benchmarks/profile_step.py config/draped.yaml --to 0.1      # any scene; the last joint moves
    python benchmarks/profile_step.py --python 25                      # and the 25 dearest Python functions

All joints stay at 0 but one, which goes there and back. Timing costs about 0.2 us per compiled call, and
cProfile far more: compare figures of one kind only, of one run, on a machine that does nothing else.
"""

from __future__ import annotations

import argparse
import cProfile
import math
import pstats
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from typing import Any

import numpy as np

from cable_ros import Tracker, load_scene
from cable_ros.bench.markdown import markdown_table
from cable_ros.compilation import Kernel
from cable_ros.share import share_file

MICRO = 1e6


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("scene", nargs="?", default=share_file("config", "space_arm.yaml"))
    parser.add_argument("--joint", help="that moves (default: the last one)")
    parser.add_argument("--to", type=float, default=1.0, help="rad or m, from 0 and back (default 1)")
    parser.add_argument("--step", type=float, default=0.005, help="rad or m (default 0.005)")
    parser.add_argument("--python", type=int, default=0, metavar="N", help="show so many Python functions")
    args = parser.parse_args()
    if not (math.isfinite(args.to) and math.isfinite(args.step) and args.step > 0.0 and args.to != 0.0):
        parser.error("--to takes a number other than 0, --step one above 0, such as --to 1 --step 0.005")
    tracker = Tracker(load_scene(args.scene))
    joint = args.joint or (tracker.joint_names[-1] if tracker.joint_names else "")
    if joint not in tracker.joint_names:
        parser.error(f"the scene has no joint '{joint}'; it has: {', '.join(tracker.joint_names) or 'none'}")
    count = max(2, math.ceil(abs(args.to) / args.step))
    there = np.linspace(0.0, args.to, count + 1)
    path = [{**dict.fromkeys(tracker.joint_names, 0.0), joint: x} for x in [*there[1:], *there[-2::-1]]]
    tracker.solve(path[-1])
    walk(tracker, path)  # compiles, and leaves the pose where the next begins

    times, iterations = walk(tracker, path)
    median, most = MICRO * np.quantile(times, (0.5, 0.99))
    print(f"{len(path)} warm steps of {joint}, {iterations / len(path):.2f} iterations each: ", end="")
    print(f"median {median:.1f} us, 99 % within {most:.1f} us")
    if args.python:
        with cProfile.Profile() as profile:
            walk(tracker, path)
        pstats.Stats(profile, stream=sys.stdout).sort_stats("tottime").print_stats(args.python)
    spent = timed_kernels()
    total = MICRO * sum(walk(tracker, path)[0])
    rows = [
        [name, f"{len(calls) / len(path):.2f}", f"{sum(calls) / len(path):.2f}", f"{sum(calls) / total:.1%}"]
        for name, calls in sorted(spent.items(), key=lambda item: -sum(item[1]))
        if calls
    ]
    rest = total - sum(map(sum, spent.values()))
    rows.append(["Python, and the calls", "", f"{rest / len(path):.2f}", f"{rest / total:.1%}"])
    print(markdown_table(["compiled function", "calls a step", "us a step", "share"], rows))
    return 0


def walk(tracker: Tracker, path: list[dict[str, float]]) -> tuple[list[float], int]:
    """Wall time of each solve, s, and the iterations of all."""
    times, iterations = [], 0
    for joints in path:
        begin = time.perf_counter()
        found = tracker.solve(joints)
        times.append(time.perf_counter() - begin)
        iterations += sum(one.iterations for one in found.values())
    return times, iterations


def timed_kernels() -> dict[str, list[float]]:
    """From now on the times, us, of each compiled function that Python code of this package calls."""
    spent: dict[str, list[float]] = defaultdict(list)
    wrapped: dict[int, Callable[..., Any]] = {}

    def timed(kernel: Kernel) -> Callable[..., Any]:
        calls = spent[f"{kernel.py_func.__module__.partition('.')[2]}.{kernel.py_func.__name__}"]

        def call(*arguments: Any) -> Any:
            begin = time.perf_counter_ns()
            try:
                return kernel(*arguments)
            finally:
                calls.append(1e-3 * (time.perf_counter_ns() - begin))

        return call

    for name, module in list(sys.modules.items()):
        if name.startswith("cable_ros"):
            for attribute, value in list(vars(module).items()):
                if isinstance(value, Kernel):
                    wrapped.setdefault(id(value), timed(value))
                    setattr(module, attribute, wrapped[id(value)])
    return spent


if __name__ == "__main__":
    sys.exit(main())
