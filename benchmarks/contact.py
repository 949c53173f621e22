# SPDX-License-Identifier: Apache-2.0
"""The arm's cable over a ball, 0 to 90 degrees and back: what contact costs, how smooth it is.

    OMP_NUM_THREADS=1 taskset -c 0,1 python benchmarks/contact.py [--step 0.1]

Everything in one run, each kind of contact in turn, the second time round.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
from pathlib import Path

import numpy as np

os.environ["CABLE_ROS_INTERPRET"] = "0"  # what is timed is compiled

from cable_ros import Equilibrium, Tracker, load_scene
from cable_ros.scene import Scene

SCENE = Path(__file__).parents[1] / "config" / "space_arm_sphere.yaml"


def kinds() -> dict[str, Scene]:
    """The scene without and with contact, and with each model of friction."""
    scene = load_scene(SCENE)
    return {
        "free": dataclasses.replace(scene, effects=("weight",)),
        "frictionless": dataclasses.replace(scene, effects=("weight", "contact")),
        "coulomb": scene,
        "sliding": dataclasses.replace(scene, friction_model="sliding"),
    }


def swept(tracker: Tracker, degrees: np.ndarray) -> list[Equilibrium]:
    return [
        e for d in degrees for e in tracker.solve({tracker.joint_names[0]: float(np.radians(d))}).values()
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--step", type=float, default=0.1, help="deg (default 0.1)")
    step = parser.parse_args().step
    up = np.arange(0.0, 90.0 + 0.5 * step, step)
    heads = ("us, all", "touching", "x free", "touch", "lift", "jump", "bend", "loop")
    print(" " * 14 + "".join(f"{head:>10}" for head in heads))
    free = np.nan
    for name, scene in kinds().items():
        tracker = Tracker(scene)
        swept(tracker, np.concatenate([up, up[::-1]]))
        there, back = swept(tracker, up), swept(tracker, up[::-1])[::-1]
        times = 1e6 * np.array([e.solve_time for e in there + back])
        touching = np.array([bool(e.contacts) for e in there + back])
        wrenches = np.array([e.end_wrench[:3] for e in there])
        size = np.linalg.norm(wrenches, axis=1).mean()
        second = np.linalg.norm(np.diff(wrenches, 2, axis=0), axis=1) / size
        onset = int(np.argmax(touching[: len(up)]))
        inner = np.ones(len(second), bool)
        if touching.any():
            inner[max(0, onset - 3) : onset + 2] = False
        touched = np.median(times[touching]) if touching.any() else np.nan
        free = np.median(times) if name == "free" else free
        first = [
            float(up[np.array([bool(e.contacts) for e in half])].min())
            for half in (there, back)
            if touching.any()
        ]
        loop = max(
            np.linalg.norm(a.end_wrench[:3] - b.end_wrench[:3]) for a, b in zip(there, back, strict=True)
        )
        cost = [np.median(times), touched, (touched if touching.any() else free) / free]
        row = [f"{x:10.0f}" for x in cost[:2]] + [
            f"{x:10.1f}" for x in [cost[2], *(first or [np.nan, np.nan])]
        ]
        row += [f"{x:10.1e}" for x in (second.max(), second[inner].max(), loop / size)]
        print(f"{name:14}" + "".join(row))
    print(
        "touch, lift: first angle of contact on the way there, last on the way back, deg; jump: largest\n"
        "second difference of the end force over its mean, bend: but at first touch; loop: there less back"
    )


if __name__ == "__main__":
    main()
