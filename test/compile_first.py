"""Compile what most tests run before any of them does: `make test` starts this once for each kind of kernels.

Otherwise the first test of each process would wait for the compiler, some longer than a test may take.
"""

from __future__ import annotations

from zoo_hose import PASSING, either_side
from zoo_make import SKEW, cable

from cable_ros import Tracker, load_scene
from cable_ros.bench.cases import run_case

ON_A_GRID = next(case for case in PASSING if case.name.startswith("ground drawn sideways"))


def main() -> None:
    """A cable that stretches, one that touches, and one whose contact is followed on a grid."""
    Tracker(load_scene(cable(SKEW, axial_stiffness=1e3))).solve({})
    for case in (either_side()[0], ON_A_GRID):
        outcome = run_case(case)
        assert outcome.passed, f"{case.name}: {outcome.fault}"


if __name__ == "__main__":
    main()
