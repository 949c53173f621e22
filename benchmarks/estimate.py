# SPDX-License-Identifier: Apache-2.0
"""How honest the error estimate is: published error_estimate against the error, over random tracked paths.

    taskset -c 2,3 python benchmarks/estimate.py --paths 120      # half a minute

The paths are those of `cable bench robustness`. The error of a pose is the difference of its end wrench from
that of the same equilibrium with every element halved, which divides it by 4096; force and moment each
relative to its own size, the larger of both. Errors below 1e-3 of the tolerance are left out: the iteration
stops there. Prints the quantiles of error / estimate and the share of poses beyond the tolerance.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np
from tqdm import tqdm

from cable_ros import Tracker
from cable_ros.bench.cases import case_scene
from cable_ros.bench.fuzz import tracked_case
from cable_ros.bench.machine import describe
from cable_ros.branch.cable_tracker import ALGEBRAIC, CableTracker
from cable_ros.branch.cold_start import Found
from cable_ros.branch.refinement import on_mesh

QUANTILES = (0.01, 0.5, 0.9, 0.99, 0.999, 1.0)


def true_error(tracked: CableTracker) -> float:
    """Relative error of the end wrench of a cable's equilibrium; NaN if the halved mesh has none."""
    rod, q, F = tracked._rod, tracked._q, tracked._F
    assert rod is not None
    rod = rod.variant()
    rod.refactor(q, F)
    moment = rod.g[-1].copy()
    found = Found(rod, q, F, 0.0, 0.0, 0)
    finer = on_mesh(found, rod.mesh.split(np.ones(len(rod.h), bool)))
    if finer is None:
        return np.nan
    force_error = np.linalg.norm(finer.F - F) / np.linalg.norm(F)
    moment_error = np.linalg.norm(finer.rod.g[-1] - moment) / np.linalg.norm(moment)
    return float(max(force_error, moment_error))


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--paths", type=int, default=120)
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--every", type=int, default=3, help="poses from one that is judged to the next")
    parser.add_argument("--tolerance", type=float, default=1e-4)
    arguments = parser.parse_args()

    ratios, beyond, judged = [], 0, 0
    for index in tqdm(range(arguments.paths), unit="path"):
        case = tracked_case(arguments.seed, index, arguments.tolerance)
        tracker = Tracker(case_scene(case), tolerance=arguments.tolerance, polyline_points=2)
        for i, joints in enumerate(case.path):
            (found,) = tracker.solve(joints).values()
            if i % arguments.every or not found.status.trusted:
                continue
            error = true_error(tracker._tracked_cables[0])
            if np.isnan(error):
                continue
            judged += 1
            beyond += error > arguments.tolerance
            if error > ALGEBRAIC * arguments.tolerance:
                ratios.append(error / found.error_estimate)
    print(", ".join(f"{name} {value}" for name, value in describe().items()), end="\n\n")
    print(f"{judged} poses of {arguments.paths} paths, tolerance {arguments.tolerance:g}")
    print(f"beyond the tolerance: {beyond}")
    for level, ratio in zip(QUANTILES, np.quantile(ratios, QUANTILES), strict=True):
        print(f"error / estimate, {100 * level:g} %: {ratio:.2f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
