# SPDX-License-Identifier: Apache-2.0
"""What accuracy costs where the cable touches: over a ball, without and with friction, and on the ground.

Writes docs/precision_contact.csv and .png.

    OMP_NUM_THREADS=1 taskset -c 1 python benchmarks/contact_precision.py

References by other means, at thirteen poses: over the ball, integration of the rod's equations with the
contact forces found anew (`cable_ros.bench.verification`; friction is taken as the tightest solution tells
it); for the hose, its free boundary by collocation to 1e-10 (`test/references/free_boundary.py`).
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot
from scipy.spatial.transform import Rotation

from cable_ros.baselines.result import BaselineResult
from cable_ros.bench.effect_variants import edited, nothing
from cable_ros.bench.machine import describe
from cable_ros.bench.methods import OurTracker, Pose
from cable_ros.bench.precision import FULL, Bench, Row, write_csv
from cable_ros.scene import Scene, load_scene
from cable_ros.share import share_file
from cable_ros.tracker import Tracker

ROOT = Path(__file__).parents[1]
sys.path.append(str(ROOT / "test"))

from references.free_boundary import GROUND, Lying, collocate  # noqa: E402

mpl.use("Agg")
TOLERANCES = tuple(10.0**-k for k in range(2, 9))
REFERENCES = 13
"""Poses with a reference, of a path."""
PLANE = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""From the references' axes, Y upwards, to those of the scene, z upwards."""


def ball(friction: float) -> tuple[Scene, np.ndarray]:
    """The arm over the ball from 40 to 90 degrees, where it touches, in steps of half a degree."""
    scene = load_scene(share_file("config", "space_arm_sphere.yaml"))
    (given,) = scene.obstacles
    shape = {"center": given.shape.center.tolist(), "radius": given.shape.radius}
    obstacle = {"name": "ball", "sphere": shape, "friction": friction}
    return edited(scene, {"obstacles": [obstacle]}, nothing), np.radians(np.arange(40.0, 90.1, 0.5))[:, None]


def hose() -> tuple[Scene, np.ndarray]:
    """The hose whose end is lifted, in steps of 2.5 mm; higher, too much hangs for the reference."""
    return load_scene(share_file("config", "draped.yaml")), np.arange(0.02, 0.1701, 0.0025)[:, None]


def lifted(scene: Scene, poses: Sequence[Pose]) -> Iterator[Pose]:
    """The poses with the references of the planar rod that leaves the ground tangentially.

    Collocation starts at our own solution, which it would otherwise not come near.
    """
    (cable,) = scene.cables
    length, bending = cable.length, float(cable.stiffness[0])
    weight = cable.linear_density * -float(scene.gravity[2]) * length**3 / bending
    unit = bending / length**2
    tracker = Tracker(scene, 1e-8)
    for pose in poses:
        if pose.reference is None:
            yield pose
            continue
        ours = tracker.arrive(pose.joints)[cable.name]
        last = max(ours.contacts, key=lambda contact: contact.arc_length)
        tension = abs(float(ours.end_wrench[0])) / unit
        guess = Lying(0.0, 1.0 - last.arc_length / length, 0.0, tension, 0.0, last.normal_force / unit)
        x, _, z = (pose.cables[0].end[:3] - pose.cables[0].start[:3]) / length
        ends = np.zeros(3), np.array([x, z, 0.5 * np.pi])
        found = collocate(ends, guess, GROUND, weight).case(GROUND, weight).reference
        turn = PLANE @ Rotation.from_quat(found.end[3:]).as_matrix()
        force, moment = turn @ found.end_wrench[:3] * unit, turn @ found.end_wrench[3:] * unit * length
        wrench = np.concatenate([force, moment])  # the end clamp's axes are the world's
        yield dataclasses.replace(
            pose, reference=(dataclasses.replace(pose.reference[0], end_wrench=wrench),)
        )


def measure(name: str, scene: Scene, path: np.ndarray) -> Iterator[Row]:
    """A row for each tolerance; prints how far the references are from our tightest solution."""
    bench = Bench(scene, path, dataclasses.replace(FULL, poses=len(path)), lambda _: None)
    # looser than 1e-10: our own tight solution, which the hose's reference then replaces
    poses = bench.poses(scene, path, REFERENCES, 1e-7 if name == "hose" else 1e-10)
    if name == "hose":
        before, poses = poses, list(lifted(scene, poses))
        pairs = [(a.reference, b.reference) for a, b in zip(before, poses, strict=True) if a.reference]
        print(f"hose: collocation and cable_ros at 1e-9 agree within {max(map(_differ, pairs)):.1e}")
    else:
        print(f"{name}: {bench.provenance}")
    methods = [OurTracker(scene, tolerance) for tolerance in TOLERANCES]
    for row in bench.warm("warm", methods, poses):
        yield dataclasses.replace(row, method=name)


def _differ(pair: tuple[tuple[BaselineResult, ...], tuple[BaselineResult, ...]]) -> float:
    (one,), (other,) = pair
    return float(np.linalg.norm(one.end_wrench - other.end_wrench) / np.linalg.norm(other.end_wrench))


def draw(rows: Sequence[Row], path: Path, facts: str) -> None:
    """Error against time, and error against the tolerance asked for."""
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(10.0, 4.4), sharey=True, layout="constrained")
    for name in dict.fromkeys(row.method for row in rows):
        of = [row for row in rows if row.method == name]
        errors = [row.error for row in of]
        left.loglog([row.seconds * 1e3 for row in of], errors, "o-", markersize=5, label=name)
        right.loglog([row.value for row in of], errors, "o-", markersize=5, label=name)
    right.loglog(TOLERANCES, TOLERANCES, "k:", linewidth=1, label="as asked for")
    left.set_xlabel("median time of a warm step that touches, ms")
    left.set_ylabel("relative error of the end wrench, worst pose")
    right.set_xlabel("tolerance")
    right.legend()
    for axes in (left, right):
        axes.grid(alpha=0.3)
    figure.suptitle("Contact: what each digit costs", x=0.01, ha="left")
    figure.text(0.01, -0.03, facts, fontsize=7, va="top")
    figure.savefig(path, dpi=130, bbox_inches="tight")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=ROOT / "docs", help="folder of the table and the picture")
    args = parser.parse_args()
    facts, rows = describe(), []
    for name, (scene, path) in {
        "ball, no friction": ball(0.0),
        "ball, Coulomb friction 0.35": ball(0.35),
        "hose": hose(),
    }.items():
        for row in measure(name, scene, path):
            rows.append(row)
            print(
                f"{name:28} {row.setting} {row.seconds * 1e6:9.1f} us {row.error:.1e} {row.error_median:.1e}"
            )
    write_csv(args.out / "precision_contact.csv", rows, facts)
    draw(rows, args.out / "precision_contact.png", ", ".join(f"{k} {v}" for k, v in facts.items()))


if __name__ == "__main__":
    main()
