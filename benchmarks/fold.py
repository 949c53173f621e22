# SPDX-License-Identifier: Apache-2.0
"""Through a fold: an arch snaps over as its end is turned, and back at another angle.

    python benchmarks/fold.py [--out docs]

prints the published states around each snap and writes fold.png.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from cable_ros import Equilibrium, Status, Tracker, load_scene
from cable_ros.bench.carriage import on_carriage

LENGTH, CHORD = 1.0, 0.9
ACROSS = [0.5, 0.5, 0.5, 0.5]
"""A clamp along +X, its y axis up: the rod bends in the XY plane, the soft one."""


def arch() -> tuple[Tracker, dict[str, float]]:
    """A weightless arch, stiff out of its plane, its end clamp on a carriage; and the carriage's home."""
    cable = {
        "name": "arch",
        "length": LENGTH,
        "stiffness": [4.0, 1.0, 4.0],
        "linear_density": 0.0,
        "start": {"position": [0.0, 0.0, 0.0], "orientation": ACROSS},
        "end": {"position": [CHORD, 0.0, 0.0], "orientation": ACROSS},
    }
    scene, urdf, home = on_carriage({"gravity": [0.0, 0.0, 0.0], "cables": [cable]})
    return Tracker(load_scene(scene, urdf=urdf)), home


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("docs"))
    args = parser.parse_args()
    tracker, home = arch()
    there = np.arange(-60.0, 60.5, 1.0)
    angles = np.concatenate([there, there[::-1]])
    first = tracker.solve({**home, "yaw": 0.0})["arch"]
    # whichever side the arch took: turn against it first
    side = math.copysign(1.0, first.points[50, 1])
    found = [tracker.solve({**home, "yaw": side * math.radians(a)})["arch"] for a in angles]
    report(angles, found)
    draw(angles, found, args.out / "fold.png")
    return 0


def report(angles: np.ndarray, found: list[Equilibrium]) -> None:
    print("| turn (deg) | status | energy (J) | total twist (rad) | margin | end moment (N m) |")
    print("| --- | --- | --- | --- | --- | --- |")
    snaps = [i for i, one in enumerate(found) if one.status is Status.SNAPPED]
    for at in snaps:
        for i in range(at - 2, at + 2):
            one = found[i]
            print(
                f"| {angles[i]:g} | {one.status.name} | {one.energy:.4f} | {one.total_twist:+.3f} | "
                f"{one.stability_margin:.3f} | {one.end_wrench[4]:+.3f} |"
            )
    for at in snaps:
        print(f"\n{angles[at]:g} deg: {found[at].message}")


def draw(angles: np.ndarray, found: list[Equilibrium], out: Path) -> None:
    figure, (energy, margin, shape) = plt.subplots(1, 3, figsize=(12, 3.6), layout="constrained")
    half = len(angles) // 2
    for part, label in ((slice(0, half), "there"), (slice(half, None), "and back")):
        energy.plot(angles[part], [one.energy for one in found[part]], label=label)
        margin.plot(angles[part], [one.stability_margin for one in found[part]], label=label)
    energy.set(xlabel="turn of the end clamp (deg)", ylabel="energy (J)")
    margin.set(xlabel="turn of the end clamp (deg)", ylabel="stability margin", ylim=(0, None))
    energy.legend(frameon=False)
    (at, *_) = [i for i, one in enumerate(found) if one.status is Status.SNAPPED]
    for i, label in ((at - 1, "before the snap"), (at, "after it")):
        shape.plot(found[i].points[:, 0], found[i].points[:, 1], label=f"{label}, {angles[i]:g} deg")
    shape.set(xlabel="X (m)", ylabel="Y (m)", aspect="equal")
    shape.legend(frameon=False, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    figure.savefig(out, dpi=120)
    print(f"\n{out}")


if __name__ == "__main__":
    sys.exit(main())
