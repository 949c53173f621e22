# SPDX-License-Identifier: Apache-2.0
"""Makes test/data/rubbing.json: two cables lowered onto each other and lifted again, by `rubbing`.

    python test/references/rubbing_path.py        # a quarter of an hour; compares, and with --write writes

The upper cable is lowered from where both first touch, without a force, in steps that double, then by 2.5 mm
to -27.8 mm, and goes back the same way. Each step is a boundary-value problem over both rods with the law of
friction from the last state on.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import brentq

TESTS = Path(__file__).parents[1]
if __name__ == "__main__":
    sys.path[:0] = [str(TESTS), str(TESTS.parent)]

from references.rubbing import Rods, Touch  # noqa: E402

DATA = TESTS / "data" / "rubbing.json"
FRICTION, ACCURACY = 0.1, 1e-10
BELOW: dict[str, Any] = {
    "length": 0.45, "stiffness": [0.0013, 0.0013, 0.0009], "linear_density": 0.1,
    "start": {"position": [-0.2, 0.01, 0.0], "rpy": [0.0, np.pi / 2, 0.0]},
    "end": {"position": [0.2, 0.0, 0.0], "rpy": [0.0, np.pi / 2, 0.3]},
}  # fmt: skip
ABOVE: dict[str, Any] = {
    "length": 0.45, "stiffness": [0.003, 0.002, 0.002], "linear_density": 0.12,
    "start": {"position": [0.02, -0.2, 0.0], "rpy": [-np.pi / 2, 0.0, 0.0]},
    "end": {"position": [0.03, 0.2, 0.0], "rpy": [-np.pi / 2, 0.0, 0.2]},
}  # fmt: skip
RADII = 0.004, 0.005
STARTS = np.array([
    [0.07, 0.009, 0.22, -0.0005, -0.018, 0.0023],
    [0.0044, 0.32, 0.27, 0.031, -0.005, 0.0093],
])  # fmt: skip
"""About the wrenches on the starts of both, N and N m, where they first touch: each hangs free there."""
ARCS = np.array([0.30, 0.21])
"""About where, m."""
NEAR, FAR = 0.0165, 0.0175
"""Lifts between which they first touch, m."""
BEGIN, DOUBLED = 1.6e-4, 4
"""First step, m, and number of steps that double."""
FIRST, LAST, STEP = 0.0122, -0.0278, 0.0025
"""Lifts after those, and their distance, m."""


def rods(accuracy: float = ACCURACY) -> Rods:
    """The two rods; `accuracy`: of the integration."""
    return Rods(np.array([0.0, 0.0, -9.81]), RADII, FRICTION, accuracy)


def placed(lift: float) -> list[dict[str, Any]]:
    """Both in the world, the upper one lifted, m."""
    above = {
        name: ABOVE[name] | {"position": np.add(ABOVE[name]["position"], [0.0, 0.0, lift])}
        for name in ("start", "end")
    }
    return [BELOW, ABOVE | above]


def first_touch(both: Rods) -> tuple[float, Touch]:
    """The lift, m, at which they touch without a force, and their state."""

    def apart(lift: float) -> float:
        cables = placed(lift)
        return both.distance(cables, both.begin(cables, STARTS, ARCS)) - sum(RADII)

    lift = float(brentq(apart, NEAR, FAR, xtol=1e-13))
    return lift, both.begin(placed(lift), STARTS, ARCS)


def lifts(first: float) -> list[float]:
    """All of them, m, from the `first` down and back up to the one after it."""
    down = [first]
    for k in range(DOUBLED):
        down.append(down[-1] - BEGIN * 2**k)
    down += [FIRST - STEP * k for k in range(round((FIRST - LAST) / STEP) + 1)]
    return [*down, *down[-2:0:-1]]


def states(both: Rods) -> Iterator[tuple[float, Touch]]:
    """Lift and state from one to the next."""
    first, last = first_touch(both)
    yield first, last
    for lift in lifts(first)[1:]:
        last = both.step(placed(lift), last)
        yield lift, last


def told(lift: float, state: Touch) -> dict[str, Any]:
    """As the file has it."""
    return {
        "lift": lift, "x": state.x.tolist(), "ends": state.ends.tolist(), "slips": bool(state.slips),
        "normal": state.normal.tolist(), "arms": [arm.tolist() for arm in state.arms],
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help=f"write {DATA}")
    write = parser.parse_args().write
    known = json.loads(DATA.read_text())["states"] if DATA.exists() else []
    out = []
    for k, (lift, state) in enumerate(states(rods())):
        out.append(told(lift, state))
        off = np.abs(state.x - known[k]["x"]).max() if k < len(known) else np.nan
        print(f"{lift:.6f} m  {'slips' if state.slips else 'sticks'}  off by {off:.1e}", flush=True)
    if write:
        DATA.write_text(json.dumps({"friction": FRICTION, "states": out}) + "\n")


if __name__ == "__main__":
    main()
