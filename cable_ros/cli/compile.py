# SPDX-License-Identifier: Apache-2.0
"""`cable compile`: what a first start would wait for, at installation."""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import os
import time
from collections.abc import Iterator
from typing import Any

from cable_ros.cli._arguments import add_command
from cable_ros.cli.sweep import cores
from cable_ros.share import scene_path

ROOM = 3e9
"""Memory of a machine, bytes, from which on two processes compile: each takes up to 0.9 GB."""
EXAMPLE = """examples:
  cable compile
  cable compile config/space_arm.yaml

colcon build does it by itself. Otherwise run it as the user who will run the node, and again after an
update. It is kept beside the package, or, if that cannot be written, in the user's cache folder; the
environment variable NUMBA_CACHE_DIR names another."""


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
    parser.add_argument(
        "--jobs",
        type=int,
        choices=(1, 2),
        help="processes for what any scene may need (default: 2 on a machine with two cores and 3 GB)",
    )


def run(args: argparse.Namespace) -> int:
    begin = time.perf_counter()
    from cable_ros.common.compile_watch import COMPILING
    from cable_ros.scene import load_scene
    from cable_ros.tracker import Tracker
    from cable_ros.warm_up import rehearse_all, warm_up

    what = "every effect" if args.scene is None else str(args.scene)
    if args.scene is None:
        jobs = args.jobs or (2 if cores() > 1 and _memory() > ROOM else 1)
        with _helped() if jobs > 1 else contextlib.nullcontext():
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


@contextlib.contextmanager
def _helped() -> Iterator[None]:
    """As soon as something is compiled, a second process begins at the other end of the work."""
    from cable_ros.common.compile_watch import COMPILING

    helper = multiprocessing.get_context("spawn").Process(target=_help, daemon=True)
    tell = COMPILING.tell

    def begin() -> None:
        with contextlib.suppress(OSError):
            helper.start()
        if tell is not None:
            tell()

    COMPILING.tell = begin
    try:
        yield
    finally:
        if helper.pid is None:
            COMPILING.tell = tell
        else:
            helper.terminate()
            helper.join()


def _help() -> None:
    """What this process cannot do, the first one comes to as well, and tells."""
    from cable_ros.warm_up import rehearse_all

    with contextlib.suppress(Exception, KeyboardInterrupt):
        rehearse_all(backwards=True)


def _memory() -> float:
    """Bytes of this machine; not known: more than enough."""
    with contextlib.suppress(AttributeError, OSError, ValueError):
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    return float("inf")
