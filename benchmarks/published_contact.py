# SPDX-License-Identifier: Apache-2.0
"""The published contact with a sphere beside ours: end force, contact force, depth, and where it presses.

    python benchmarks/published_contact.py --out docs/published_contact.png      # a minute or two

The scene is config/space_arm_sphere.yaml without friction; ours is tracked, the published scheme starts at
every angle from our equilibrium without the ball.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

os.environ["CABLE_ROS_INTERPRET"] = "0"  # what is timed is compiled

from cable_ros import Equilibrium, Tracker, load_scene
from cable_ros.baselines.published import GaussNewton
from cable_ros.baselines.published_contact import ContactResult, solve_contact
from cable_ros.baselines.result import ClampedCable, from_equilibrium
from cable_ros.drawing import figures
from cable_ros.scene import Scene
from cable_ros.scene.obstacles import Sphere
from cable_ros.scene.text import parse_yaml
from cable_ros.share import share_file

DEGREES = np.arange(30.0, 81.0, 1.0)
CLOSE = 60.0
"""The angle whose contact forces are drawn along the cable, degrees."""
PARTS = {20: "#BBBBBB", 40: "#888888", 80: "#444444"}
OURS = "#0072B2"


@dataclass(frozen=True)
class Point:
    """What one method says at one angle."""

    end_force: float
    """N."""
    contact_force: float
    """Sum of the normal forces, N."""
    depth: float
    """How far the centreline runs inside the ball at worst, m; 0: clear."""
    seconds: float
    settled: bool


def frictionless(scene: Scene, obstacles: bool) -> Scene:
    """The scene with smooth obstacles, or with none."""
    values = parse_yaml(scene.text, scene.source)
    smooth = [{**obstacle, "friction": 0.0} for obstacle in values.pop("obstacles")]
    if obstacles:
        values["obstacles"] = smooth
    assert scene.robot is not None
    return load_scene(values, urdf=scene.robot.urdf)


def depth(points: np.ndarray, ball: Sphere) -> float:
    return max(0.0, ball.radius - float(np.linalg.norm(points - ball.center, axis=1).min()))


def ours(equilibrium: Equilibrium, ball: Sphere) -> Point:
    return Point(
        float(np.linalg.norm(equilibrium.end_wrench[:3])),
        sum(contact.normal_force for contact in equilibrium.contacts),
        depth(equilibrium.points, ball),
        equilibrium.solve_time,
        equilibrium.status.trusted,
    )


def published(result: ContactResult, ball: Sphere, seconds: float) -> Point:
    return Point(
        float(np.linalg.norm(result.rod.end_wrench[:3])),
        result.total_force,
        depth(result.rod.points, ball),
        seconds,
        result.rod.converged,
    )


def run(scene: Scene) -> tuple[dict[str, list[Point]], Equilibrium, dict[int, ContactResult]]:
    """All methods over DEGREES; at CLOSE, the results themselves."""
    ball = scene.obstacles[0].shape
    assert isinstance(ball, Sphere)
    cable = scene.cables[0]
    load = cable.linear_density * scene.gravity
    with_ball = Tracker(frictionless(scene, True), 1e-4, 1001)
    free = Tracker(frictionless(scene, False), 1e-6, 201)
    options = GaussNewton(step_tolerance=1e-4)
    points: dict[str, list[Point]] = {name: [] for name in ("ball", "free", *map(str, PARTS))}
    close: dict[int, ContactResult] = {}
    for angle in np.arange(-30.0, DEGREES[0], 0.5):
        for tracker in (with_ball, free):
            tracker.solve({"orientation": np.radians(angle)})
    for degrees in tqdm(DEGREES, unit=" poses", disable=None):
        joints = {"orientation": float(np.radians(degrees))}
        touched, loose = (next(iter(tracker.solve(joints).values())) for tracker in (with_ball, free))
        points["ball"].append(ours(touched, ball))
        points["free"].append(ours(loose, ball))
        (clamps,) = free.kinematics.poses(np.array([joints["orientation"]]))
        problem = ClampedCable(cable.length, cable.stiffness, load, *clamps)
        for parts in PARTS:
            begin = time.perf_counter()
            result = solve_contact(problem, ball, parts, from_equilibrium(loose, problem), options=options)
            points[str(parts)].append(published(result, ball, time.perf_counter() - begin))
            if degrees == CLOSE:
                close[parts] = result
        if degrees == CLOSE:
            at_close = touched
    return points, at_close, close


def draw(points: dict[str, list[Point]], at_close: Equilibrium, close: dict[int, ContactResult]) -> Figure:
    with mpl.rc_context(figures.STYLE):
        picture = Figure(figsize=(10.5, 7.6), layout="constrained")
        picture.suptitle(
            "A ball in the way: the published contact scheme and ours, without friction", x=0.01, ha="left"
        )
        force, contact, deep, along = picture.subplots(2, 2).ravel()
        for axes, field, scale in (
            (force, "end_force", 1.0),
            (contact, "contact_force", 1.0),
            (deep, "depth", 1e3),
        ):
            for name, colour in ((str(parts), colour) for parts, colour in PARTS.items()):
                values = [scale * getattr(point, field) for point in points[name]]
                axes.plot(
                    DEGREES,
                    values,
                    "-",
                    lw=1.0,
                    marker="o",
                    ms=2.5,
                    color=colour,
                    label=f"published, n = {name}",
                )
            axes.plot(
                DEGREES,
                [scale * getattr(p, field) for p in points["ball"]],
                color=OURS,
                lw=2.4,
                label="cable_ros",
            )
            axes.set_xlabel("orientation (deg)")
        free = [point.end_force for point in points["free"]]
        force.plot(DEGREES, free, "--", color=OURS, lw=1.2, label="cable_ros without the ball")
        force.set_title("Force on the end clamp (N)")
        force.set_ylim(0.0, 1.4 * max(free))
        force.legend(fontsize=8.5, ncols=2, loc="lower center")
        contact.set_title("Sum of the contact forces (N); below 0 the ball pulls")
        contact.set_ylim(-0.1, 0.5)
        deep.set_title("Centreline inside the ball (mm)")
        for parts, result in close.items():
            step = result.rod.arc_length[1]
            along.plot(1e3 * step * result.nodes, step * result.force, "o-", ms=4, lw=0.8, color=PARTS[parts])
        arcs = [1e3 * one.arc_length for one in at_close.contacts]
        along.vlines(arcs, 0.0, [one.normal_force for one in at_close.contacts], color=OURS, lw=2.4)
        along.plot(arcs, [one.normal_force for one in at_close.contacts], "o", ms=6, color=OURS)
        along.axhline(0.0, color="#888888", lw=0.8)
        along.set_title(f"Contact forces at {CLOSE:g} degrees (N)")
        along.set_xlabel("arc length (mm)")
    return picture


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("published_contact.png"))
    args = parser.parse_args()
    points, at_close, close = run(load_scene(share_file("config", "space_arm_sphere.yaml")))
    columns = (
        "came to rest",
        "ms, median",
        "mm deepest",
        "N least contact force",
        "N largest jump of end force in 1 deg",
    )
    print(f"| | {' | '.join(columns)} |")
    print("|---" * (len(columns) + 1) + "|")
    for name, series in points.items():
        if name == "free":
            continue
        cells = [
            "cable_ros" if name == "ball" else f"published, n = {name}",
            f"{sum(point.settled for point in series)}/{len(series)}",
            f"{1e3 * np.median([point.seconds for point in series]):.3g}",
            f"{1e3 * max(point.depth for point in series):.2g}",
            f"{min(point.contact_force for point in series):.2g}",
            f"{np.abs(np.diff([point.end_force for point in series])).max():.2g}",
        ]
        print(f"| {' | '.join(cells)} |")
    print(figures.save(draw(points, at_close, close), args.out))
    return 0


if __name__ == "__main__":
    sys.exit(main())
