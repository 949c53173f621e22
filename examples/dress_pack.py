# SPDX-License-Identifier: Apache-2.0
"""A hose on a UR10, with clips on forearm and wrist and a ring between them, through a pick-and-place.

    pip install 'cable_ros[robot,plot,mesh]' example-robot-data
    python3 examples/dress_pack.py                 # 75 poses
    python3 examples/dress_pack.py --poses 5000    # ten seconds of joint states at 500 Hz
    python3 examples/dress_pack.py --plot F        # and a picture of six poses in the file F

The hose touches the robot's own links; wrist 3 turns by 180 degrees both ways. Printed are what the solves
say, how deep the hose is in a link, what the ring carries, how much of its limits the hose uses, and the time
of a solve. The first run fits solids to the arm's meshes, which takes some minutes.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cable_ros import Tracker, load_scene
from cable_ros.equilibrium import Equilibrium

FOLDER = "cmeel.prefix/share/example-robot-data/robots/ur_description/urdf"
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
STOPS = np.array([
    [0.0, -1.2, 1.6, -1.9, -1.57, 0.0], [0.0, -0.9, 1.7, -2.3, -1.57, np.pi],
    [0.8, -1.2, 1.5, -1.8, -1.57, 0.0], [1.6, -0.9, 1.7, -2.3, -1.57, -np.pi],
    [0.8, -1.3, 1.6, -1.8, -1.2, 0.0], [0.0, -1.2, 1.6, -1.9, -1.57, 0.0],
])  # fmt: skip
"""Joint values at the corners of the path, rad."""
LINKS = ["forearm_link", "wrist_1_link", "wrist_2_link", "wrist_3_link"]
"""Links that the hose can reach."""


def urdf() -> Path:
    """Path of the UR10's URDF. Raises FileNotFoundError if the package is missing."""
    for place in sys.path:
        path = Path(place, FOLDER, "ur10_robot.urdf")
        if path.is_file():
            return path
    raise FileNotFoundError("the arm is missing: pip install example-robot-data")


def scene(friction: float = 0.2) -> dict[str, Any]:
    """The hose on the arm; `friction` of the ring."""
    straight, along = [0.0, 0.0, 0.0], [0.0, np.pi / 2, 0.0]
    supports = [
        {"name": "forearm_clip", "clip": {
            "link": "forearm_link", "arc_length": 0.205, "position": [-0.115, 0.0, 0.2], "rpy": straight,
        }},
        {"name": "ring", "ring": {
            "link": "forearm_link", "arc_length": 0.55, "position": [-0.14, 0.0, 0.5], "friction": friction,
        }},
        {"name": "wrist_clip", "clip": {
            "link": "wrist_3_link", "arc_length": 1.355, "position": [-0.09, 0.1, 0.0], "rpy": along,
        }},
    ]  # fmt: skip
    hose = {
        "name": "hose", "length": 1.485, "linear_density": 0.25, "outer_diameter": 0.016,
        "stiffness": [0.15, 0.15, 0.12], "limits": {"bend_radius": 0.03, "tension": 30.0},
        "start": {"link": "forearm_link", "position": [-0.115, 0.0, 0.0], "rpy": straight},
        "end": {"link": "wrist_3_link", "position": [0.03, 0.1, 0.0], "rpy": along},
        "supports": supports,
    }  # fmt: skip
    return {
        "robot": {"urdf": str(urdf())},
        "gravity": [0.0, 0.0, -9.80665],
        "cables": [hose],
        "obstacles": [{"robot": {"links": LINKS}}],
    }


def poses(count: int) -> list[dict[str, float]]:
    """So many joint states along the way from stop to stop."""
    at = np.linspace(0.0, len(STOPS) - 1, count)
    values = np.column_stack([np.interp(at, np.arange(len(STOPS)), column) for column in STOPS.T])
    names = [f"{joint}_joint" for joint in JOINTS]
    return [dict(zip(names, row, strict=True)) for row in values.tolist()]


def depth(judge: Tracker, found: Equilibrium, joints: dict[str, float]) -> float:
    """How deep the hose is in a solid of a link that it can reach, m."""
    marked = {"hose": dataclasses.replace(found, overlaps=())}
    judge.robot_overlaps.mark(marked, joints, lambda _: found.points)
    return max((one.contact_distance - one.distance for one in marked["hose"].overlaps), default=0.0)


def run(friction: float, path: Sequence[dict[str, float]]) -> list[Equilibrium]:
    """Solve the path, and print what came out."""
    values = scene(friction)
    loaded = load_scene(values)
    print("\n".join(loaded.notes))
    tracker = Tracker(loaded)
    judge = Tracker(load_scene({key: value for key, value in values.items() if key != "obstacles"}))
    found, times, deepest, use, rings = [], [], 0.0, {}, []
    for joints in path:
        begin = time.perf_counter()
        one = tracker.arrive(joints)["hose"]
        times.append(1e3 * (time.perf_counter() - begin))
        found.append(one)
        if one.status.trusted:
            deepest = max(deepest, depth(judge, one, joints))
            rings.append(float(np.linalg.norm(one.support_wrenches["ring"][:3])))
            for extreme in one.extremes:
                if extreme.limit is not None:
                    use[extreme.quantity.name] = max(use.get(extreme.quantity.name, 0.0), extreme.use)
    print(", ".join(f"{number} {name}" for name, number in Counter(one.status.name for one in found).items()))
    print(
        f"touches a link at {sum(bool(one.contacts) for one in found)} poses, deepest {deepest * 1e3:.3f} mm"
    )
    print(f"the ring carries {min(rings):.2f} to {max(rings):.2f} N")
    print("; ".join(f"{name}: up to {100 * part:.0f} % of its limit" for name, part in use.items()))
    print(f"first {times[0]:.0f} ms, then {np.median(times[1:]):.2f} ms in the median, "
          f"99 % within {np.percentile(times[1:], 99):.1f} ms")  # fmt: skip
    return found


def draw(path: Sequence[dict[str, float]], found: Sequence[Equilibrium], file: str) -> None:
    """Hose, supports and the links' solids at six poses, seen from the side."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    from cable_ros.drawing.robot import moved
    from cable_ros.drawing.silhouettes import silhouette
    from cable_ros.rod.quaternion import from_ros, multiply, rotate, to_ros

    tracker = Tracker(load_scene(scene()))
    obstacles, kinematics = tracker.scene.obstacles, tracker.kinematics
    figure, axes = plt.subplots(2, 3, figsize=(15, 9), layout="constrained")
    for axis, index in zip(axes.flat, np.linspace(0, len(path) - 1, 6).astype(int), strict=True):
        values = np.array([path[index][name] for name in tracker.joint_names])
        # turned back about the vertical: the arm is always seen from its side
        half = -0.5 * path[index]["shoulder_pan_joint"]
        back = np.array([np.cos(half), 0.0, 0.0, np.sin(half)])
        for obstacle, pose in zip(obstacles, kinematics.obstacle_poses(values), strict=True):
            turned = np.concatenate([rotate(back, pose[:3]), to_ros(multiply(back, from_ros(pose[3:])))])
            corners = silhouette(moved(obstacle.shape, turned), 0, 2, np.zeros(3), np.ones(3))
            axis.fill(*corners.T, color="0.5", alpha=0.25)
        points = np.array([rotate(back, point) for point in found[index].points])
        axis.plot(points[:, 0], points[:, 2], "C0", linewidth=3)
        held = kinematics.poses(values)
        for place in (*held[:, 0, :3], held[-1, 1, :3]):
            x, _, z = rotate(back, place)
            axis.plot(x, z, "C3o")
        degrees = np.degrees(path[index]["wrist_3_joint"])
        axis.set(aspect="equal", title=f"wrist 3 at {degrees:.0f} degrees", xlabel="m", ylabel="m")
    figure.savefig(file, dpi=70)


def main() -> None:
    parser = argparse.ArgumentParser(description="a hose with clips and a ring on a UR10")
    parser.add_argument("--poses", type=int, default=75, help="number of poses (default 75)")
    parser.add_argument("--friction", type=float, default=0.2, help="of the ring (default 0.2)")
    parser.add_argument("--plot", help="file of the picture")
    args = parser.parse_args()
    path = poses(args.poses)
    found = run(args.friction, path)
    if args.plot:
        draw(path, found, args.plot)


if __name__ == "__main__":
    main()
