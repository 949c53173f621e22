# SPDX-License-Identifier: Apache-2.0
"""A hose from forearm to flange of a UR10 among the robot's own links, through a pick-and-place.

python benchmarks/dress_pack.py           counts, depths, times
python benchmarks/dress_pack.py --plot F  and a picture of some poses in the file F
python benchmarks/dress_pack.py --rate 500  ten seconds of examples/dress_pack.py, with clips and a ring

The arm with its meshes is that of example-robot-data: pip install -e '.[robot,plot,mesh,benchmarks]'
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from cable_ros import Tracker, load_scene
from cable_ros.bench.markdown import markdown_table
from cable_ros.joint import joint_torque
from examples import dress_pack
from examples.dress_pack import depth, poses, urdf

POSES = 75


def scene(robot: dict[str, Any] | None) -> dict[str, Any]:
    """The hose, with the robot's links as obstacles where `robot` says which."""
    hose = {
        "name": "hose", "length": 0.95, "linear_density": 0.25, "outer_diameter": 0.016,
        "stiffness": [0.15, 0.15, 0.12], "total_twist": 0.0,
        "start": {"link": "forearm_link", "position": [-0.1, 0.0, 0.3], "rpy": [0, 0, 0]},
        "end": {"link": "wrist_3_link", "position": [-0.09, 0.1, 0.0], "rpy": [0, np.pi / 2, 0]},
    }  # fmt: skip
    values: dict[str, Any] = {"robot": {"urdf": str(urdf())}, "gravity": [0, 0, -9.80665], "cables": [hose]}
    return values | ({"obstacles": [{"robot": robot}]} if robot is not None else {})


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--plot", help="file of the picture")
    parser.add_argument("--rate", type=float, help="joint states in a second of the example's path")
    parser.add_argument("--links-friction", type=float, default=0.0, help="of the links there (default 0)")
    args = parser.parse_args()
    if args.rate:
        supported(poses(round(10.0 * args.rate)), args.links_friction)
        return
    begin = time.perf_counter()
    judge = Tracker(load_scene(scene(None)))
    print(f"fits {time.perf_counter() - begin:.1f} s, solids beside: {len(judge.robot_overlaps._obstacles)}")
    shapes: dict[str, list[Any]] = {}
    for name, robot in (("free", None), ("links", {"friction": 0.0}), ("friction", {"friction": 0.2})):
        loaded = load_scene(scene(robot))
        if name == "links":
            print("\n".join(loaded.notes), len(loaded.obstacles), "solids")
        tracker = Tracker(loaded)
        times, statuses, clear, worst = [], {}, 0, 0.0
        for joints in poses(POSES):
            begin = time.perf_counter()
            found = tracker.arrive(joints)["hose"]
            times.append(time.perf_counter() - begin)
            statuses[found.status.name] = statuses.get(found.status.name, 0) + 1
            if not found.status.trusted and statuses[found.status.name] == 1:
                print("   ", found.message)
            shapes.setdefault(name, []).append((joints, found))
            if found.status.trusted:
                inside = depth(judge, found, joints)
                worst, clear = max(worst, inside), clear + (inside < 1e-5)
        print(
            f"{name}: {statuses}, clear of all solids {clear} of {POSES}, deepest {worst * 1e3:.2f} mm, "
            f"median {np.median(times) * 1e3:.2f} ms, largest {max(times):.2f} s"
        )
    if args.plot:
        draw(judge, shapes, args.plot)


def supported(path: list[dict[str, float]], links: float) -> None:
    """Print processor times of what the node computes for each joint state; `links`: their friction."""
    values = dress_pack.scene(links=links)
    tracker = Tracker(load_scene(values))
    judge = Tracker(load_scene({key: value for key, value in values.items() if key != "obstacles"}))
    found = tracker.arrive(path[0])
    assert found["hose"].extremes  # what is compiled, or loaded, is not counted
    joint_torque(tracker, found, path[0])
    tracker.arrive(path[1])
    tracker.arrive(path[0])
    statuses: Counter[str] = Counter()
    deepest, times = 0.0, []
    for joints in path:
        begin = time.thread_time()
        found = tracker.solve(joints)
        solved = time.thread_time()
        assert found["hose"].extremes or not found["hose"].status.trusted
        limited = time.thread_time()
        joint_torque(tracker, found, joints)
        times.append((solved - begin, limited - solved, time.thread_time() - limited))
        statuses[found["hose"].status.name] += 1
        deepest = max(deepest, depth(judge, found["hose"], joints))
    spent = 1e3 * np.array(times)
    rows = [
        [name, *(f"{value:.2f} ms" for value in np.percentile(column, [50, 90, 99, 99.9, 100]))]
        for name, column in zip(("solve", "limits", "joint load"), spent.T, strict=True)
    ]
    rows.append(["all", *(f"{v:.2f} ms" for v in np.percentile(spent.sum(axis=1), [50, 90, 99, 99.9, 100]))])
    print(f"{dict(statuses)}, deepest in a solid {deepest * 1e3:.4f} mm")
    print(markdown_table(["processor time", "median", "90 %", "99 %", "99.9 %", "most"], rows))


def draw(judge: Tracker, shapes: dict[str, list[Any]], file: str) -> None:
    """Hose and the points of the links' solids at six poses, seen along y."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    from cable_ros.drawing.robot import moved
    from cable_ros.drawing.silhouettes import silhouette

    figure, axes = plt.subplots(2, 3, figsize=(18, 12))
    robot = judge.robot_overlaps
    for axis, index in zip(axes.flat, np.linspace(0, POSES - 1, 6).astype(int), strict=True):
        joints = shapes["free"][index][0]
        links = robot._kinematics.obstacle_poses(np.array([joints[n] for n in robot._kinematics.joint_names]))
        for obstacle, pose in zip(robot._obstacles, links, strict=True):
            corners = silhouette(moved(obstacle.shape, pose), 0, 2, np.zeros(3), np.ones(3))
            axis.fill(*corners.T, color="0.6", alpha=0.3)
        for name, colour in (("free", "C3"), ("links", "C0")):
            axis.plot(*shapes[name][index][1].points[:, [0, 2]].T, colour, label=name)
        axis.set(aspect="equal", title=f"pose {index}", xlabel="x [m]", ylabel="z [m]")
        axis.legend()
    figure.savefig(file, dpi=60)


if __name__ == "__main__":
    main()
