# SPDX-License-Identifier: Apache-2.0
"""One joint value that cannot be, and back: what a solve answers and how long it takes.

    OMP_NUM_THREADS=1 python benchmarks/glitch.py

The cables of config/: one call at the glitch, then calls at the pose before it until that is reached again.
CPU time of the longest single call, and by how much the end wrench at that pose differs from what it was.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np

from cable_ros import Tracker, load_scene
from cable_ros.bench.markdown import markdown_table
from cable_ros.equilibrium import Equilibrium, Status

CONFIG = Path(__file__).parents[1] / "config"
SCENES = ("space_arm.yaml", "space_arm_sphere.yaml", "draped.yaml")
GLITCHES = (3.0, 100.0, 1000.0, 9999.0, 1e9)
HOME = 0.1
MOST = 1000
"""Calls after which a pose counts as never reached."""
HEAD = ("scene", "glitch, rad or m", "answer", "calls back", "its answer", "longest call", "end wrench off")


def reach(tracker: Tracker, joints: dict[str, float]) -> tuple[list[Equilibrium], float]:
    """The answers of calls for one pose until it is reached or refused, and the longest call, s."""
    found: list[Equilibrium] = []
    longest = 0.0
    while len(found) < MOST and (not found or found[-1].status is Status.UNFINISHED):
        begin = time.process_time()
        answers = tracker.solve(joints)
        longest = max(longest, time.process_time() - begin)
        found.append(next(iter(answers.values())))
    return found, longest


def main() -> None:
    rows = []
    for name in SCENES:
        for glitch in GLITCHES:
            tracker = Tracker(load_scene(CONFIG / name))
            joint, *others = tracker.joint_names
            pose = {joint: HOME} | dict.fromkeys(others, 0.0)
            reach(tracker, pose | {joint: 0.0})
            reach(tracker, pose | {joint: glitch})  # compiling is not solving
            tracker.reset()
            home, _ = reach(tracker, pose)
            begin = time.process_time()
            (there,) = tracker.solve(pose | {joint: glitch}).values()
            longest = time.process_time() - begin
            back, longest_back = reach(tracker, pose)
            before, after = home[-1].end_wrench, back[-1].end_wrench
            off = np.linalg.norm(after - before) / np.linalg.norm(before)
            rows.append([
                name, f"{glitch:g}", there.status.name, str(len(back)), back[-1].status.name,
                f"{1e3 * max(longest, longest_back):.0f} ms", f"{off:.1e}",
            ])  # fmt: skip
    print(markdown_table(HEAD, rows))


if __name__ == "__main__":
    main()
