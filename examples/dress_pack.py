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
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cable_ros import Tracker, load_scene
from cable_ros.equilibrium import Equilibrium
from cable_ros.scene.kinematics import Kinematics
from cable_ros.scene.obstacles import Obstacle, Sphere

FOLDER = "cmeel.prefix/share/example-robot-data/robots/ur_description/urdf"
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
STOPS = np.array([
    [0.0, -1.2, 1.6, -1.9, -1.57, 0.0], [0.0, -0.9, 1.7, -2.3, -1.57, np.pi],
    [0.8, -1.2, 1.5, -1.8, -1.57, 0.0], [1.6, -0.9, 1.7, -2.3, -1.57, -np.pi],
    [0.8, -1.3, 1.6, -1.8, -1.2, 0.0], [0.0, -1.2, 1.6, -1.9, -1.57, 0.0],
])  # fmt: skip
"""Joint values at the corners of the path, rad."""
VIEW = np.radians([-25.0, 12.0])
"""From where it is drawn: about the vertical from the arm's side, and from above, rad."""
LINKS = ["forearm_link", "wrist_1_link", "wrist_2_link", "wrist_3_link"]
"""Links that the hose can reach."""


def urdf() -> Path:
    """Path of the UR10's URDF. Raises FileNotFoundError if the package is missing."""
    for place in sys.path:
        path = Path(place, FOLDER, "ur10_robot.urdf")
        if path.is_file():
            return path
    raise FileNotFoundError("the arm is missing: pip install example-robot-data")


def scene(friction: float = 0.2, links: float = 0.0) -> dict[str, Any]:
    """The hose on the arm; `friction` of the ring, and of the `links`."""
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
        "obstacles": [{"robot": {"links": LINKS, "friction": links}}],
    }


def poses(count: int, stops: np.ndarray = STOPS) -> list[dict[str, float]]:
    """So many joint states along the way from stop to stop; `stops` (n, 6), rad."""
    at = np.linspace(0.0, len(stops) - 1, count)
    values = np.column_stack([np.interp(at, np.arange(len(stops)), column) for column in stops.T])
    names = [f"{joint}_joint" for joint in JOINTS]
    return [dict(zip(names, row, strict=True)) for row in values.tolist()]


def depth(judge: Tracker, found: Equilibrium, joints: dict[str, float]) -> float:
    """How deep the hose is in a solid of a link that it can reach, m."""
    marked = {"hose": dataclasses.replace(found, overlaps=())}
    judge.robot_overlaps.mark(marked, joints, lambda _: found.points)
    return max((one.contact_distance - one.distance for one in marked["hose"].overlaps), default=0.0)


def run(friction: float, path: Sequence[dict[str, float]], links: float = 0.0) -> list[Equilibrium]:
    """Solve the path with the `friction` of the ring and that of the `links`, and print what came out."""
    values = scene(friction, links)
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


def link_meshes(robot: Path) -> list[tuple[str, Any]]:
    """Each link of the URDF with its collision mesh in its own frame."""
    import trimesh

    folder, out = robot.parents[2], []
    for link in ET.parse(robot).getroot().iter("link"):
        for collision in link.iter("collision"):
            mesh, origin = collision.find("geometry/mesh"), collision.find("origin")
            if mesh is None:
                continue
            place = np.eye(4)
            if origin is not None:
                turn = [float(part) for part in origin.get("rpy", "0 0 0").split()]
                place[:3, :3] = Rotation.from_euler("xyz", turn).as_matrix()
                place[:3, 3] = [float(part) for part in origin.get("xyz", "0 0 0").split()]
            file = mesh.get("filename", "").removeprefix("package://example-robot-data/robots/")
            shape = trimesh.load(folder / file, force="mesh")
            out.append((link.get("name", ""), shape.apply_transform(place)))
    return out


def draw(path: Sequence[dict[str, float]], found: Sequence[Equilibrium], file: str) -> None:
    """The arm's meshes, the hose and what holds it at six poses, from its side, as one would see them."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.collections import PolyCollection

    loaded, meshes = load_scene(scene()), link_meshes(urdf())
    radius, tracker = loaded.cables[0].radius, Tracker(loaded)
    points = tuple(Obstacle(link, Sphere(np.zeros(3), 0.0), link=link) for link, _ in meshes)
    links = Kinematics(dataclasses.replace(loaded, obstacles=points))
    light = np.array([0.3, -0.8, 0.5]) / np.linalg.norm([0.3, -0.8, 0.5])
    figure, axes = plt.subplots(2, 3, figsize=(15, 8), layout="constrained", sharex=True, sharey=True)
    for axis, index in zip(axes.flat, np.linspace(0, len(path) - 1, 6).astype(int), strict=True):
        joints = path[index]
        # turned back about the vertical, and looked at from a little to the front and above
        view = Rotation.from_euler("zx", [-joints["shoulder_pan_joint"] + VIEW[0], VIEW[1]])
        q = np.array([joints[name] for name in links.joint_names])
        triangles, colours = [], []
        for (_, mesh), pose in zip(meshes, links.obstacle_poses(q), strict=True):
            turn = view * Rotation.from_quat(pose[3:])
            corners = turn.apply(np.array(mesh.vertices)) + view.apply(pose[:3])
            shade = 0.55 + 0.4 * np.clip(turn.apply(np.array(mesh.face_normals)) @ light, 0.0, 1.0)
            triangles.append(corners[mesh.faces])
            colours.append(np.repeat(shade[:, None], 3, axis=1))
        line = view.apply(found[index].points)
        along = np.gradient(line[:, [0, 2]], axis=0)
        across = (
            radius * np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1)[:, None]
        )
        sides = np.stack([line, line], axis=1)
        sides[:, 0, [0, 2]] += across
        sides[:, 1, [0, 2]] -= across
        sides[:, :, 1] -= radius  # its nearest point
        quads = np.stack([sides[:-1, 0], sides[1:, 0], sides[1:, 1], sides[:-1, 1]], axis=1)
        shapes = [*np.concatenate(triangles), *quads]
        paint = [*np.concatenate(colours), *np.tile([0.12, 0.35, 0.75], (len(quads), 1))]
        # painted from the back to the front
        order = np.argsort([-shape[:, 1].mean() for shape in shapes])
        axis.add_collection(
            PolyCollection(
                [shapes[i][:, [0, 2]] for i in order],
                facecolors=[paint[i] for i in order],
                edgecolors=[paint[i] for i in order],
                linewidths=0.3,
            )
        )
        held = tracker.kinematics.poses(np.array([joints[name] for name in tracker.joint_names]))
        places = view.apply(np.concatenate([held[:, 0, :3], held[-1:, 1, :3]]))
        axis.plot(places[:, 0], places[:, 2], "o", color="C3", markersize=5)
        axis.set(aspect="equal", title=f"wrist 3 at {np.degrees(joints['wrist_3_joint']):.0f} degrees")
        axis.set(xlabel="m", ylabel="m")
    axes[0, 0].autoscale_view()
    figure.savefig(file, dpi=60)


def main() -> None:
    parser = argparse.ArgumentParser(description="a hose with clips and a ring on a UR10")
    parser.add_argument("--poses", type=int, default=75, help="number of poses (default 75)")
    parser.add_argument("--friction", type=float, default=0.2, help="of the ring (default 0.2)")
    parser.add_argument("--links-friction", type=float, default=0.0, help="of the robot's links (default 0)")
    parser.add_argument("--plot", help="file of the picture")
    args = parser.parse_args()
    path = poses(args.poses)
    found = run(args.friction, path, args.links_friction)
    if args.plot:
        draw(path, found, args.plot)


if __name__ == "__main__":
    main()
