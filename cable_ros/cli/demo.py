# SPDX-License-Identifier: Apache-2.0
"""`cable demo`: the paper's arm, live: node, joint states, log and pictures."""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from cable_ros.cli._arguments import CommandError, add_command

EXAMPLE = """example:
  cable demo --out demo

Writes the log of the run (MCAP) and two pictures made from it, and replaces those of an earlier demo.
Needs the extras 'ros', 'robot' and 'plot', no display and no robot."""

LOG_NAME = "space_arm.mcap"
RATE = 100.0  # joint states per second
START_TIMEOUT = 180.0  # s; a first start compiles the solver, about 15 s on one core
ANSWER_TIMEOUT = 10.0  # s
STOP_TIMEOUT = 15.0  # s


def add_parser(subparsers: argparse._SubParsersAction[Any]) -> None:
    parser = add_command(
        subparsers,
        "demo",
        "run the paper's arm live and log it",
        "Start the cable node on the paper's arm, turn its orientation joint from -90 to "
        "90 deg with real joint states, and draw what the log then holds.",
        EXAMPLE,
    )
    parser.add_argument("--out", metavar="DIR", type=Path, default=Path("demo"), help="folder (default demo)")


def run(args: argparse.Namespace) -> int:
    from cable_ros.cli.plot import draw
    from cable_ros.share import share_file

    args.out.mkdir(parents=True, exist_ok=True)
    log = args.out / LOG_NAME
    for old in args.out.glob(f"{log.stem}*.mcap*"):
        old.unlink()
    # A domain of its own, heard on this machine only: other robots here neither hear nor disturb it.
    os.environ["ROS_DOMAIN_ID"] = str(random.randint(1, 100))
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    angles = np.radians(np.arange(-90, 90.01, 0.5))
    print("Starting the cable node; its first start on a machine compiles the solver.", file=sys.stderr)
    with node_process(share_file("config", "space_arm.yaml"), log) as check:
        drive(angles, check)
    shapes, wrench, load = draw(log, args.out)
    print(f"{log}: {len(angles)} joint states and what answers each: wrenches, polyline, joint load")
    print(f"{shapes}: the cable's shapes in the XOZ, YOZ and XOY planes")
    print(f"{wrench}: the end force and moment against the angle of the joint")
    print(f"{load}: the torque on the joint against its angle")
    return 0


def drive(angles: np.ndarray, check: Callable[[], None]) -> None:
    """Publish the angles (m,), rad, one after the other at RATE, each after the answer to the one before."""
    from tqdm import tqdm

    from cable_ros.ros.joint_driver import JointDriver, NoAnswerError

    try:
        with JointDriver(["camera_cable"], check=check) as driver:
            driver.wait_for_node(START_TIMEOUT)
            due = time.monotonic()
            for angle in tqdm(angles, desc="orientation -90..90 deg", unit="pose"):
                driver.send({"orientation": angle, "pitch": 0.0}, ANSWER_TIMEOUT)
                due += 1 / RATE
                time.sleep(max(0.0, due - time.monotonic()))
    except NoAnswerError as error:
        raise CommandError(str(error)) from None


@contextlib.contextmanager
def node_process(scene: Path, log: Path) -> Iterator[Callable[[], None]]:
    """The real node in a process of its own; gives a function that raises CommandError once it is dead."""
    parameters = {"scene": scene.absolute(), "log.enabled": "true", "log.path": log.absolute()}
    command = [sys.executable, "-m", "cable_ros.ros.cable_node", "--ros-args"]
    command += [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
    with tempfile.TemporaryFile() as output, tempfile.TemporaryDirectory() as ros_log:
        # It compiles first: what is shown is how fast it answers.
        environment = {**os.environ, "ROS_LOG_DIR": ros_log, "CABLE_ROS_INTERPRET": "0"}
        process = subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT, env=environment)

        def check() -> None:
            if process.poll() is not None:
                raise CommandError(f"the node ended with exit code {process.returncode}{_last_words(output)}")

        try:
            yield check
            check()
            process.send_signal(signal.SIGINT)
            try:
                process.wait(STOP_TIMEOUT)
            except subprocess.TimeoutExpired:
                raise CommandError(
                    f"the node did not stop within {STOP_TIMEOUT:.0f} s of being asked to"
                ) from None
            if process.returncode != 0:
                check()
        finally:
            if process.poll() is None:
                process.kill()
                process.wait()


def _last_words(output: Any) -> str:
    output.seek(0)
    lines = output.read().decode(errors="replace").strip().splitlines()
    return f"; its last words: {lines[-1].strip()}" if lines else " without a word"
