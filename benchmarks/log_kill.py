# SPDX-License-Identifier: Apache-2.0
"""SIGKILL at random moments: what the log still holds after recovery.

    python benchmarks/log_kill.py         # 50 kills of a process that logs as the node does at 1 kHz
    python benchmarks/log_kill.py --node  # of cable_node itself, driven as fast as it answers

Loss is the time from the last message that was recovered to the kill. Every recovered log is read in full
with checksums on, and must hold every message up to its last one.
"""

from __future__ import annotations

import argparse
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from tqdm import tqdm

from cable_ros.log.reader import LogReader
from cable_ros.log.recover import recover
from cable_ros.log.writer import LogWriter
from cable_ros.share import share_file

SCENE = share_file("config", "space_arm.yaml")
WRENCH = "/cable_node/camera_cable/end_wrench"
RATE = 1000.0  # Hz
# What the node logs for one joint state: two joint states, two wrenches, joint load, and a polyline that, as
# random numbers do, hardly compresses.
SIZES = {
    "/joint_states": ("sensor_msgs/msg/JointState", 84),
    "/cable_node/solved_joints": ("sensor_msgs/msg/JointState", 76),
    WRENCH: ("geometry_msgs/msg/WrenchStamped", 88),
    "/cable_node/camera_cable/start_wrench": ("geometry_msgs/msg/WrenchStamped", 88),
    "/cable_node/joint_load": ("sensor_msgs/msg/JointState", 84),
    "/cable_node/camera_cable/polyline": ("nav_msgs/msg/Path", 8120),
}


def write_forever(path: Path) -> None:
    """The process that is killed."""
    noise = random.Random(1).randbytes(1 << 20)
    log = LogWriter(path, attachments={"scene.yaml": SCENE.read_text()})
    due = time.monotonic()
    count = 0
    while True:
        for topic, (kind, size) in SIZES.items():
            start = (count * 4099) % (len(noise) - size)
            log.write(topic, kind, noise[start : start + size], time.time_ns())
        count += 1
        due += 1 / RATE
        time.sleep(max(0.0, due - time.monotonic()))


@contextmanager
def writer(path: Path) -> Iterator[subprocess.Popen[bytes]]:
    """`write_forever` in a process of its own."""
    with subprocess.Popen([sys.executable, __file__, "--write", str(path)]) as process:
        try:
            while not path.with_name(path.name + ".part").exists():
                time.sleep(0.01)
            yield process
        finally:
            process.kill()


@contextmanager
def node(path: Path) -> Iterator[subprocess.Popen[bytes]]:
    """cable_node with its log on."""
    command = [sys.executable, "-m", "cable_ros.ros.cable_node", "--ros-args"]
    for parameter in (f"scene:={SCENE}", "log.enabled:=true", f"log.path:={path}"):
        command += ["-p", parameter]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            yield process
        finally:
            process.kill()


def drive(seconds: float) -> None:
    """Joint states to the node for so long, each after the answer to the one before."""
    from cable_ros.ros.joint_driver import JointDriver

    with JointDriver(["camera_cable"]) as driver:
        driver.wait_for_node(60.0)
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            driver.send({"orientation": np.sin(left), "pitch": 0.0}, 10.0)


def one_kill(path: Path, of_node: bool, seconds: float) -> tuple[float, int, int]:
    """Loss in s, messages recovered, bytes given up."""
    with (node if of_node else writer)(path) as process:
        if of_node:
            drive(seconds)
        else:
            time.sleep(seconds)
        killed = time.time_ns()
        process.kill()
    saved = recover(path.with_name(path.name + ".part"))
    with LogReader(path) as log:
        assert "cables" in log.scene_text
        numbers: dict[str, list[int]] = {}
        last = 0
        for message in log.messages(as_written=True):
            numbers.setdefault(message.topic, []).append(message.sequence)
            last = max(last, message.log_time)
    assert all(found == list(range(len(found))) for found in numbers.values()), "a message is missing"
    # What was killed before its first chunk was closed has nothing to recover: all of it counts as lost.
    loss = (killed - last) / 1e9 if last else seconds
    return loss, sum(saved.messages.values()), saved.lost_bytes


def main() -> int:
    """Exit code 1 where more than a second was lost."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--node", action="store_true", help="kill cable_node itself")
    parser.add_argument("--folder", type=Path, help="where the logs go (default: a temporary folder)")
    parser.add_argument("--write", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.write:
        write_forever(args.write)
    os.environ.setdefault("ROS_DOMAIN_ID", str(random.randrange(1, 100)))
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    moments = random.Random(args.seed)
    results = []
    with tempfile.TemporaryDirectory(dir=args.folder) as folder:
        for i in tqdm(range(args.kills), unit="kill", disable=None):
            path = Path(folder, f"kill_{i}.mcap")
            results.append(one_kill(path, args.node, moments.uniform(0.1, 3.0)))
            for file in Path(folder).iterdir():
                file.unlink()
    loss, messages, given_up = map(np.array, zip(*results, strict=True))
    print(
        f"{args.kills} kills, {messages.sum()} messages recovered, {given_up.sum() / 1e6:.2f} MB given up\n"
        f"loss in s: median {np.median(loss):.3f}, largest {loss.max():.3f}"
    )
    return 0 if loss.max() <= 1.0 else 1


if __name__ == "__main__":
    sys.exit(main())
