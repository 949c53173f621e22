# SPDX-License-Identifier: Apache-2.0
"""`cable compile`: what a first start would wait for, at installation."""

from __future__ import annotations

import argparse
import time
from typing import Any

from cable_ros.cli._arguments import add_command
from cable_ros.share import scene_path

EXAMPLE = """examples:
  cable compile
  cable compile config/space_arm.yaml

Run it as the user who will run the node, and again after an update. It is kept beside the package, or, if
that cannot be written, in the user's cache folder; the environment variable NUMBA_CACHE_DIR names another."""


def add_parser(subparsers: argparse._SubParsersAction[Any]) -> None:
    parser = add_command(
        subparsers,
        "compile",
        "compile the solver, at installation",
        "Compile what a scene needs, or without one what any scene may need, and keep it: the first start "
        "of the node would otherwise wait for it. The meshes of a scene's robot are fitted by solids, too.",
        EXAMPLE,
    )
    parser.add_argument(
        "scene",
        metavar="SCENE",
        nargs="?",
        type=scene_path,
        help="scene file (YAML), or the bare name of an installed one (default: what any scene may need)",
    )


def run(args: argparse.Namespace) -> int:
    begin = time.perf_counter()
    from cable_ros.common.compile_watch import COMPILING
    from cable_ros.scene import load_scene
    from cable_ros.tracker import Tracker
    from cable_ros.warm_up import rehearse_all, warm_up

    what = "every effect" if args.scene is None else str(args.scene)
    if args.scene is None:
        rehearse_all()
    else:
        scene = load_scene(args.scene)
        if scene.robot is not None and "<mesh" in scene.robot.urdf:
            from cable_ros.scene.robot_obstacles import fit_meshes

            for sentence in fit_meshes(scene.robot):
                print(sentence)
        warm_up(Tracker(scene))
    seconds = time.perf_counter() - begin
    if COMPILING.seconds:
        print(f"{what}: compiled in {seconds:.1f} s")
    else:
        print(f"{what}: nothing to compile; loaded and tried in {seconds:.1f} s")
    return 0
