# SPDX-License-Identifier: Apache-2.0
"""Compile what most tests run before any of them does: `make test` starts this once for each kind of kernels.

Otherwise the first test of each process would wait for the compiler, some longer than a test may take.
"""

from __future__ import annotations

from zoo_hose import PASSING, either_side
from zoo_make import SKEW, cable

from cable_ros import Tracker, load_scene
from cable_ros.bench.cases import case_scene

LYING = either_side()[0]
ON_A_GRID = next(case for case in PASSING if case.name.startswith("ground drawn sideways"))


def main() -> None:
    """A cable that stretches, one that touches, and one whose contact is followed on a grid."""
    Tracker(load_scene(cable(SKEW, axial_stiffness=1e3))).solve({})
    for case, poses in ((LYING, 20), (ON_A_GRID, 3)):
        tracker = Tracker(case_scene(case))
        for pose in case.path[:poses]:
            found = tracker.solve(pose)
        for one in found.values():
            assert one.status.trusted, f"{case.name}: {one.message}"
            one.as_dict()  # with contacts and stiffness


if __name__ == "__main__":
    main()
