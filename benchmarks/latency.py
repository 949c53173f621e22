# SPDX-License-Identifier: Apache-2.0
"""Round trip of a joint state through cable_node, beside that through a node that solves nothing.

    python benchmarks/latency.py                    # 30 s at 1 kHz through each, two cores, log on
    python benchmarks/latency.py --memory 600       # memory of the node over ten minutes at 1 kHz
    python benchmarks/latency.py --dress-pack --rate 500    # the hose of examples/dress_pack.py on a UR10

A client in a process of its own publishes joint states and receives wrenches; blocks with either node
alternate, so that both see the same machine. Every joint state is answered, or was counted by the node as
skipped or lost.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import random
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

# The processes of one run see each other and nothing else.
os.environ.setdefault("ROS_DOMAIN_ID", str(random.randrange(1, 100)))
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ["CABLE_ROS_INTERPRET"] = "0"  # what is timed is compiled

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from tqdm import tqdm

from cable_ros.ros.cdr_template import Template
from cable_ros.share import share_file

sys.path.insert(0, str(Path(__file__).parents[1]))
from examples import dress_pack

BLOCK = 3.0  # s
Process = subprocess.Popen[bytes]
BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
ANSWERS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)  # the client loses none itself
_STAMP = struct.Struct("<iI")


@dataclass(frozen=True)
class Motion:
    """A robot that moves: which joints, where they are at each joint state, and the cable that is timed."""

    joints: list[str]
    at: Callable[[int], list[float]]
    cable: str


def arm(rate: float) -> Motion:
    """The space arm's last joint goes to and fro at 0.5 rad/s."""
    step = 0.5 / rate
    return Motion(
        ["pitch", "orientation"], lambda i: [0.0, abs((i * step + np.pi) % (2 * np.pi) - np.pi) - np.pi / 2],
        "camera_cable",
    )  # fmt: skip


def pick_and_place(rate: float) -> Motion:
    """The path of examples/dress_pack.py in ten seconds, again and again."""
    path = dress_pack.poses(round(10.0 * rate))
    values = [list(joints.values()) for joints in path]
    return Motion(list(path[0]), lambda i: values[i % len(values)], "hose")


class Client:
    """Publishes joint states on one topic and times the wrenches that come back on another."""

    def __init__(self, name: str, request: str, answer: str, motion: Motion) -> None:
        self._motion = motion
        self.node = rclpy.create_node(name)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._publisher = self.node.create_publisher(JointState, request, BEST_EFFORT)
        self.node.create_subscription(WrenchStamped, answer, self._receive, ANSWERS, raw=True)
        self._message = Template(JointState(name=motion.joints, position=[0.0] * len(motion.joints)))
        self._positions = self._message.view("position[0]", len(motion.joints))
        self.sent = 0
        self.round_trips: list[float] = []
        self._moved = 0

    def _receive(self, data: bytes) -> None:
        now = time.time_ns()
        seconds, nanoseconds = _STAMP.unpack_from(data, 4)
        self.round_trips.append((now - seconds * 1_000_000_000 - nanoseconds) * 1e-9)

    def wait(self) -> None:
        """Wait until the other side is there and answers."""
        deadline = time.monotonic() + 60
        while not self.round_trips:
            if time.monotonic() > deadline:
                sys.exit("There is no answer from the node.")
            self._publish()
            self._spin_until(time.monotonic() + 0.1)
        self._spin_until(time.monotonic() + 0.5)

    def run(self, rate: float, seconds: float) -> None:
        """Publish at `rate` for so long, going on from where the robot is."""
        start = time.monotonic()
        for i in range(round(rate * seconds)):
            self._spin_until(start + i / rate)
            self._moved += 1
            self._publish()
        self._spin_until(time.monotonic() + 0.2)

    def counters(self) -> np.ndarray:
        """What the cable node counted as solved, skipped and lost (3,), from its second next diagnostics."""
        found: list[np.ndarray] = []

        def read(message: DiagnosticArray) -> None:
            for status in message.status:
                if status.name.endswith(": joint states"):
                    values = {value.key: value.value for value in status.values}
                    found.append(np.array([int(values[name]) for name in ("solved", "skipped", "lost")]))

        subscription = self.node.create_subscription(DiagnosticArray, "/diagnostics", read, 10)
        deadline = time.monotonic() + 10
        while len(found) < 2:
            if time.monotonic() > deadline:
                sys.exit("There are no diagnostics from the node.")
            self._executor.spin_once(timeout_sec=0.1)
        self.node.destroy_subscription(subscription)
        return found[-1]

    def _publish(self) -> None:
        self._positions[:] = self._motion.at(self._moved)
        self._message.stamp(*divmod(time.time_ns(), 1_000_000_000))
        self._publisher.publish(self._message.to_bytes())
        self.sent += 1

    def _spin_until(self, deadline: float) -> None:
        while (left := deadline - time.monotonic()) > 0:
            self._executor.spin_once(timeout_sec=left)


def start(module: list[str], *parameters: str) -> Process:
    """Start a node."""
    values = [word for parameter in parameters for word in ("-p", parameter)]
    return subprocess.Popen([sys.executable, *module, "--ros-args", *values])


def resident(process: Process) -> float:
    """Resident memory of a process, MB."""
    return int(Path(f"/proc/{process.pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def cpu(process: Process) -> float:
    """CPU time of a process so far, s."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def latency(
    cable: subprocess.Popen[bytes], echo: subprocess.Popen[bytes], motion: Motion, rate: float, seconds: float
) -> None:
    """Measure and print both round trips and their ratios."""
    clients = {
        "echo": Client("echo_client", "echo/joint_states", "/echo_node/wrench", motion),
        "cable_node": Client(
            "cable_client", "joint_states", f"/cable_node/{motion.cable}/end_wrench", motion
        ),
    }
    processes = {"echo": echo, "cable_node": cable}
    for client in clients.values():
        client.wait()
        client.round_trips.clear()
        client.sent = 0
    before, used = clients["cable_node"].counters(), dict.fromkeys(clients, 0.0)
    for _ in tqdm(range(max(1, round(seconds / BLOCK))), desc=f"blocks of {BLOCK:g} s", file=sys.stderr):
        for name, client in clients.items():
            start_cpu = cpu(processes[name])
            client.run(rate, min(BLOCK, seconds))
            used[name] += cpu(processes[name]) - start_cpu
    solved, skipped, lost = clients["cable_node"].counters() - before
    print(
        f"{'':12}{'sent':>8}{'answered':>10}{'median':>10}{'90 %':>10}{'99 %':>10}{'largest':>10}{'CPU':>12}"
    )
    figures = {}
    for name, client in clients.items():
        times = np.array(client.round_trips) * 1e3
        figures[name] = np.percentile(times, [50, 90, 99, 100])
        columns = "".join(f"{value:7.3f} ms" for value in figures[name])
        share = used[name] / client.sent * 1e6
        print(f"{name:12}{client.sent:8}{len(times):10}{columns}{share:6.0f} us/msg")
    ratios = figures["cable_node"] / figures["echo"]
    print(f"ratio to echo: median {ratios[0]:.2f} (at most 1.5), 99 % {ratios[2]:.2f} (at most 2)")
    client = clients["cable_node"]
    share = 100 * (skipped + lost) / client.sent
    print(f"node: {solved} solved, {skipped} skipped, {lost} lost on the way ({share:.3f} %, below 0.1 %)")
    print(f"neither answered nor counted: {client.sent - len(client.round_trips) - skipped - lost}")


def memory(cable: Process, motion: Motion, rate: float, seconds: float) -> None:
    """Print the node's resident memory twenty times."""
    client = Client("cable_client", "joint_states", f"/cable_node/{motion.cable}/end_wrench", motion)
    client.wait()
    print(f"{'s':>8}{'resident':>12}")
    print(f"{0:8.0f}{resident(cable):9.1f} MB")
    for block in range(1, 21):
        client.run(rate, seconds / 20)
        client.round_trips.clear()
        print(f"{block * seconds / 20:8.0f}{resident(cable):9.1f} MB", flush=True)


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rate", type=float, default=1000.0, help="joint states in a second (1000)")
    parser.add_argument("--seconds", type=float, default=30.0, help="time through each node (30)")
    parser.add_argument("--cores", type=int, default=2, help="cores that all processes share (2)")
    parser.add_argument("--no-log", action="store_true", help="with the log off")
    parser.add_argument("--memory", type=float, metavar="SECONDS", help="measure memory for so long instead")
    parser.add_argument("--dress-pack", action="store_true", help="a UR10 with a hose, not the space arm")
    parser.add_argument("--links-friction", type=float, default=0.0, help="of the UR10's links (0)")
    parser.add_argument(
        "-p", "--parameter", action="append", default=[], help="further parameter, NAME:=VALUE"
    )
    args = parser.parse_args()
    os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[: args.cores])
    print(f"{platform.machine()}, {args.cores} cores, Python {platform.python_version()}, {args.rate:g} Hz")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["ROS_LOG_DIR"] = folder
        scene, motion = share_file("config", "space_arm.yaml"), arm(args.rate)
        if args.dress_pack:
            scene, motion = Path(folder, "dress_pack.yaml"), pick_and_place(args.rate)
            scene.write_text(json.dumps(dress_pack.scene(links=args.links_friction)))  # JSON is YAML
        enabled = str(not args.no_log).lower()
        cable = start(
            ["-m", "cable_ros.ros.cable_node"], f"scene:={scene}", f"log.enabled:={enabled}", *args.parameter
        )
        echo = subprocess.Popen(
            [sys.executable, str(Path(__file__).with_name("echo_node.py"))]
            + ["--ros-args", "-r", "joint_states:=echo/joint_states"]
        )
        rclpy.init()
        try:
            if args.memory:
                memory(cable, motion, args.rate, args.memory)
            else:
                latency(cable, echo, motion, args.rate, args.seconds)
        finally:
            for process in (cable, echo):
                process.terminate()
            for process in (cable, echo):
                process.wait(20)
            rclpy.try_shutdown()


if __name__ == "__main__":
    main()
