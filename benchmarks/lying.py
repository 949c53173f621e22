# SPDX-License-Identifier: Apache-2.0
"""Cables that lie along an obstacle: error against tolerance, and a drum turned under a rod with friction.

    python benchmarks/lying.py [--out docs]        # a minute

against the boundary-value solutions of the tests; prints both tables and writes lying.png.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "test"))
import test_friction as friction
import test_lying as lying
from references.free_boundary import stuck
from references.reference import planar_frame

TOLERANCES = 10.0 ** -np.arange(2.0, 8.1, 0.5)
LABELS = {
    "lifted": "lifted from the ground",
    "sagging": "sagging onto the ground",
    "draped": "draped over a drum",
}
STEP = 5e-4
"""Of the drum, rad."""


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("docs"))
    args = parser.parse_args()
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.2), constrained_layout=True)
    accuracy(left)
    loop(right)
    args.out.mkdir(parents=True, exist_ok=True)
    figure.savefig(args.out / "lying.png", dpi=110)
    return 0


def accuracy(ax: plt.Axes) -> None:
    """Error of the end wrench for every tolerance."""
    print("| tolerance | " + " | ".join(LABELS.values()) + " |")
    print("|---" * (len(LABELS) + 1) + "|")
    errors = np.empty((len(TOLERANCES), len(LABELS)))
    estimates = np.empty_like(errors)
    for i, tolerance in enumerate(TOLERANCES):
        for j, name in enumerate(LABELS):
            case = lying.CASES[name]
            _, found = lying.tracker(case, float(tolerance))
            errors[i, j] = lying.error(found.end_wrench, case.reference.end_wrench)
            estimates[i, j] = found.error_estimate
        print(f"| {tolerance:.0e} | " + " | ".join(f"{e:.1e}" for e in errors[i]) + " |")
    for j, label in enumerate(LABELS.values()):
        (line,) = ax.loglog(TOLERANCES, errors[:, j], "o-", ms=4, label=label)
        ax.loglog(TOLERANCES, estimates[:, j], ":", color=line.get_color(), lw=1)
    ax.loglog(TOLERANCES, TOLERANCES, "k--", lw=0.8, label="what was asked for")
    ax.loglog([], [], "k:", lw=1, label="the program's own estimate")
    ax.invert_xaxis()
    ax.set(
        xlabel="tolerance", ylabel="relative error of the end wrench", title="Cables that lie on something"
    )
    ax.legend(fontsize=8)
    ax.grid(alpha=0.3)


def loop(ax: plt.Axes) -> None:
    """Tension at the end clamp while the drum turns there and back, with what sticks and what slips."""
    top = 0.03
    there = np.arange(0.0, top + STEP / 2, STEP)
    turns = np.concatenate([there, there[-2::-1], -there[1:], -there[-2::-1], there[1:]])
    frame = planar_frame(friction.ENDS[1][2])
    found = friction.follow(friction.on_drum(friction.draped(0.0)[1], friction.MU), "turn", turns)
    pulls = np.array([np.linalg.norm(one.end_wrench[:3]) for one in found])
    ax.plot(turns * 1e3, pulls, ".-", ms=3, lw=0.6, color="C0", label="tracker, steps of 0.5 mrad")
    for sign, label in ((1.0, "slides: boundary values"), (-1.0, None)):
        exact = np.linalg.norm(friction.draped(sign * friction.MU)[1].end_wrench[:3])
        ax.axhline(exact, color="C3", lw=0.8, ls="--", label=label)
    worst = 0.0
    for begin, coefficient, at, way in ((0, 0.0, 0.0, 1.0), (len(there) - 1, friction.MU, top, -1.0)):
        state = friction.draped(coefficient)[0]
        ways = np.arange(0.0, 0.0091, STEP)
        exact = [stuck(state, friction.ENDS, friction.DRUM, 20.0, way * turn)[1] for turn in ways]
        ax.plot((at + way * ways) * 1e3, [np.linalg.norm(f) for f in exact], "k-", lw=2.5, alpha=0.3,
                label="sticks: boundary values" if begin == 0 else None)  # fmt: skip
        for k, force in enumerate(exact):
            got = -(frame @ found[begin + k].end_wrench[:3])[:2]
            worst = max(worst, friction.error(got, force))
    plateau = friction.error(found[len(there) - 1].end_wrench, friction.draped(friction.MU)[1].end_wrench)
    print(f"\nend force off the stuck rod's: {worst:.1e} at most; off the sliding rod's: {plateau:.1e}")
    ax.set(
        xlabel="drum's turn (mrad)", ylabel="end force (N)", title="A drum turned under a rod, friction 0.35"
    )
    ax.legend(fontsize=8, loc="lower center", bbox_to_anchor=(0.47, 0.06))
    ax.grid(alpha=0.3)


if __name__ == "__main__":
    sys.exit(main())
