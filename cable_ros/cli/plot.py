# SPDX-License-Identifier: Apache-2.0
"""`cable plot`: the pictures of a logged run."""

from __future__ import annotations

import argparse
import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cable_ros.cli._arguments import CommandError, add_command

if TYPE_CHECKING:
    from cable_ros.drawing.figures import Abscissa, Shape
    from cable_ros.drawing.robot import RobotPose
    from cable_ros.log.history import History
    from cable_ros.scene import Scene

EXAMPLE = """examples:
  cable plot demo/space_arm.mcap --out pictures
  cable plot demo/space_arm.mcap --against time

Writes STEM_shapes.png, the cables' shapes and the robot's links in the XOZ, YOZ and XOY planes,
STEM_end_wrench.png, what the cables exert on their links at the end clamps, STEM_joint_load.png, what
they exert on the joints, and of cables with limits STEM_limits.png, how much of each is in use;
against the joint that moves most, or else the time, or what --against says."""

TIME = "time"
LEAST_MOTION = 1e-6  # rad or m; a joint that moves less stands still
SHAPES = 7


def add_parser(subparsers: argparse._SubParsersAction[Any]) -> None:
    parser = add_command(
        subparsers,
        "plot",
        "pictures of a logged run",
        "Draw a log of the cable node: the cables' shapes, the end wrenches and the joint load.",
        EXAMPLE,
    )
    parser.add_argument("log", metavar="LOG", type=Path, help="log of the node (MCAP)")
    parser.add_argument("--out", metavar="DIR", type=Path, help="folder of the pictures (default: the log's)")
    parser.add_argument(
        "--against", metavar="WHAT", help="'time' or a joint (default: the joint that moves most)"
    )


def run(args: argparse.Namespace) -> int:
    for picture in draw(args.log, args.out or args.log.parent, args.against):
        print(picture)
    return 0


def draw(log: Path, out: Path, against: str | None = None) -> list[Path]:
    """Draw a log's pictures into the folder `out`; gives their paths, the shapes first.

    Args:
        log: of a run.
        out: made if it is missing.
        against: a joint or `time`; None: the joint that moves most, or else the time.

    Raises:
        LogError: the log cannot be read or has no wrenches.
        CommandError: it has no such joint.
    """
    from cable_ros.drawing.figures import (
        Abscissa,
        limits_figure,
        literal,
        load_figure,
        save,
        shapes_figure,
        wrench_figure,
    )
    from cable_ros.log.history import read_history

    history = read_history(log)
    scene = scene_of(log)
    kinds = moving_joints(scene) or dict.fromkeys(history.joint_names, "revolute")
    leading = leading_joint(history, kinds)
    name = leading if against is None else None if against == TIME else against
    if name is not None and name not in history.joint_names:
        known = ", ".join([*history.joint_names, TIME])
        raise CommandError(f"--against {against}: the log has no such joint; there are {known}")
    abscissa = Abscissa.of_joint(name, kinds.get(name) != "prismatic") if name else Abscissa.of_time()
    values = abscissa_values(history, name)
    pictures = []
    if shapes := list(chosen_shapes(log, history, values, abscissa, leading is not None)):
        title = f"Shape of {', '.join(history.polylines)}, world axes"
        # What a link carries is somewhere else at each pose.
        fixed = [obstacle.shape for obstacle in scene.obstacles if obstacle.link is None] if scene else []
        robots = robot_poses(scene, history, values * abscissa.scale, shapes)
        figure = shapes_figure(shapes, title, literal(name or TIME), fixed, robots)
        pictures.append(save(figure, out / f"{log.stem}_shapes.png"))
    figure = wrench_figure(abscissa, {name: (values, rows) for name, rows in history.end_wrenches.items()})
    pictures.append(save(figure, out / f"{log.stem}_end_wrench.png"))
    loads = {joint: load for joint, load in history.joint_load.items() if np.isfinite(load).any()}
    if loads:
        figure = load_figure(abscissa, values, loads, [j for j, kind in kinds.items() if kind == "prismatic"])
        pictures.append(save(figure, out / f"{log.stem}_joint_load.png"))
    if history.limit_use:
        uses = {literal(cable): one for cable, one in history.limit_use.items()}
        pictures.append(save(limits_figure(abscissa, values, uses), out / f"{log.stem}_limits.png"))
    return pictures


def robot_poses(
    scene: Scene | None, history: History, drawn: np.ndarray, shapes: Sequence[Shape]
) -> list[RobotPose]:
    """The robot at the pose of each label; none without a robot, or where it cannot be placed.

    Args:
        scene: of the log.
        history: its solves.
        drawn: (m,) their values as `Shape.value` has them.
        shapes: that are drawn.
    """
    from cable_ros.drawing.robot import Skeleton
    from cable_ros.scene import SceneError

    if scene is None or scene.robot is None:
        return []
    try:
        skeleton = Skeleton(scene)
    except SceneError:  # Pinocchio is missing: the log can be drawn without the robot
        return []
    out = []
    for label, value in {shape.label: shape.value for shape in shapes}.items():
        joints = history.joints[int(np.nanargmin(np.abs(drawn - value)))]
        out.append(skeleton.at(dict(zip(history.joint_names, joints.tolist(), strict=True)), label))
    return [pose for pose in out if len(pose.lines)]


def scene_of(log: Path) -> Scene | None:
    """The logged scene; None where the log has none."""
    from cable_ros.log.errors import LogError
    from cable_ros.log.reader import LogReader
    from cable_ros.log.resolve import logged_scene

    try:
        with LogReader(log) as reader:
            return logged_scene(reader)
    except LogError:
        return None


def moving_joints(scene: Scene | None) -> dict[str, str]:
    """Kind by name of the joints that move a clamp of the scene; empty where none does."""
    from cable_ros.scene.urdf import chains

    if scene is None or scene.robot is None:
        return {}
    links = {mount.link: None for cable in scene.cables for mount in cable.all_mounts if mount.link}
    if not links:
        return {}
    joints = ET.fromstring(chains(scene.robot.urdf, scene.robot.source, links)).iter("joint")
    return {joint.get("name", ""): joint.get("type", "") for joint in joints if joint.get("type") != "fixed"}


def leading_joint(history: History, candidates: Collection[str]) -> str | None:
    """The candidate with the widest range of motion; None where all stand still."""
    ranges = {
        name: float(np.ptp(values[np.isfinite(values)]))
        for name, values in zip(history.joint_names, history.joints.T, strict=True)
        if name in candidates and np.isfinite(values).any()
    }
    name = max(ranges, key=lambda key: ranges[key], default=None)
    return name if name is not None and ranges[name] > LEAST_MOTION else None


def abscissa_values(history: History, name: str | None) -> np.ndarray:
    """(m,) positions of the joint, or seconds since the first solve."""
    if name is not None:
        return history.joints[:, history.joint_names.index(name)]
    return (history.times - history.times[0]) * 1e-9


def chosen_shapes(
    log: Path, history: History, values: np.ndarray, abscissa: Abscissa, moves: bool = True
) -> Iterator[Shape]:
    """Each cable's polylines at round values of the joint or the time; the last one where nothing moves."""
    from cable_ros.drawing.figures import Shape, round_values
    from cable_ros.log.history import read_polyline

    for cable, solves in history.polylines.items():
        if not len(solves):
            continue
        drawn = values[solves] * abscissa.scale
        for value in round_values(np.nanmin(drawn), np.nanmax(drawn), SHAPES) if moves else drawn[-1:]:
            index = int(np.nanargmin(np.abs(drawn - value)))
            label = abscissa.text(round(float(drawn[index]), 1 if abscissa.unit == "deg" else 3))
            points = read_polyline(log, cable, int(history.times[solves[index]]))
            yield Shape(cable, label, points, float(drawn[index]))
