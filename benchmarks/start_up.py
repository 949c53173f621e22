# SPDX-License-Identifier: Apache-2.0
"""What a start costs: CPU and wall time to the first wrench and to the end of a path, and memory.

    python benchmarks/start_up.py                        # cold and warm start of three scenes
    python benchmarks/start_up.py --only free --repeat 3
    python benchmarks/start_up.py --node                 # cable_node too, from its start to the first wrench

Cold: with an empty folder of compiled code, interpreted while another process compiles, whose CPU time counts
up to the end of the path; compiled first: the same without the interpreter; warm: once more with what that
has left. Each start is a process of its own. Of a repeated start the fastest is shown: what else runs on the
machine slows some, and makes none faster. With PYTHONPATH another copy of the package can be measured.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("ROS_DOMAIN_ID", str(random.randrange(1, 100)))
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # users have bytecode; without it a start takes 0.15 s more

from cable_ros.bench.machine import describe
from cable_ros.bench.markdown import markdown_table
from cable_ros.share import share_file

PATHS = {
    "free": ("space_arm.yaml", "orientation", [0.0, 0.5]),
    "ball": ("space_arm_sphere.yaml", "orientation", [0.5, 0.8, 1.3, 0.5]),
    "hose": ("", "y", [0.0, -0.03, 0.0]),
}
"""Scene, its joint and where that goes. The hose lies on rough ground that is drawn from under it: its
friction is followed on a grid. It is the one that `cable compile` solves."""
SOLVE = """
import json, sys, time
begin, scene, joint, path = json.loads(sys.argv[1])
from cable_ros import Tracker, load_scene
if scene:
    tracker = Tracker(load_scene(scene))
else:
    from cable_ros.warm_up import _DRAWING, _DRAWN
    tracker = Tracker(load_scene(_DRAWN, urdf=_DRAWING))
times = []
for value in path:
    (found,) = tracker.solve({**dict.fromkeys(tracker.joint_names, 0.0), joint: value}).values()
    assert found.status.trusted, found.message
    times.append(time.time() - begin)
(resident,) = (line.split()[1] for line in open("/proc/self/status") if line.startswith("VmRSS"))
print(json.dumps([times[0], int(resident) / 1024]))
"""
NODE = ["-m", "cable_ros.ros.cable_node", "--ros-args"]
PATIENCE = 1200.0
"""s; a cold start takes minutes on a slow machine."""


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", choices=PATHS, action="append", help="these scenes")
    parser.add_argument("--repeat", type=int, default=1, help="cold starts of each (default 1)")
    parser.add_argument("--node", action="store_true", help="measure cable_node, too; needs ROS 2")
    args = parser.parse_args()
    if args.repeat < 1:
        parser.error("--repeat takes a number from 1 on")
    print("; ".join(f"{name} {value}" for name, value in describe().items()) + "\n")
    head = ["scene", "start", "CPU, s", "wall, s", "first wrench, s", "resident, MB", "kept code, MB"]
    rows = []
    for name in args.only or PATHS:
        found: dict[str, list[list[float]]] = defaultdict(list)
        for _ in range(args.repeat):
            for start in starts():
                times = 3 if start == "warm" else 1
                found[start] += [solve(name) for _ in range(times)]
        rows += [row(name, start, runs) for start, runs in found.items()]
        if args.node and name != "hose":
            rows += node_rows(name)
    command = ["-m", "cable_ros.cli.main", "solve", str(share_file("config", "space_arm.yaml"))]
    for start in starts():
        cpu, wall, _ = run(command)
        rows.append(["`cable solve`, free", start, f"{cpu:.1f}", f"{wall:.1f}", "", "", ""])
    print(markdown_table(head, rows))
    return 0


def starts() -> Iterator[str]:
    """The name of each kind of start, in the environment that makes it."""
    with tempfile.TemporaryDirectory() as empty, tempfile.TemporaryDirectory() as folder:
        kinds = ("cold", empty, "1"), ("compiled first", folder, "0"), ("warm", folder, "0")
        for name, keeps, interprets in kinds:
            os.environ.update(NUMBA_CACHE_DIR=keeps, CABLE_ROS_INTERPRET=interprets)
            yield name


def run(arguments: Sequence[str]) -> tuple[float, float, str]:
    """Run Python: CPU time, s, wall time, s, and what it prints."""
    with tempfile.TemporaryFile("w+") as out:
        begin = time.perf_counter()
        process = subprocess.Popen([sys.executable, *arguments], stdout=out)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        wall = time.perf_counter() - begin
        if status:
            sys.exit(f"a start failed: python {' '.join(arguments[:3])}")
        out.seek(0)
        return usage.ru_utime + usage.ru_stime, wall, out.read()


def solve(name: str) -> list[float]:
    """CPU, wall and time to the first wrench, s, resident memory and size of what is kept, MB."""
    scene, joint, path = PATHS[name]
    file = str(share_file("config", scene)) if scene else ""
    task = json.dumps([time.time(), file, joint, path])
    cpu, wall, said = run(["-c", SOLVE, task])
    first, resident = json.loads(said)
    return [cpu, wall, first, resident, kept(os.environ["NUMBA_CACHE_DIR"])]


def kept(folder: str) -> float:
    """Size of the files in a folder, MB."""
    return sum(file.stat().st_size for file in Path(folder).rglob("*") if file.is_file()) / 1e6


def row(name: str, start: str, runs: Sequence[Sequence[float]]) -> list[str]:
    return [name, start, *(f"{min(values):.1f}" for values in zip(*runs, strict=True))]


def node_rows(name: str) -> list[list[str]]:
    """`cable_node` on the scene, from its start to the first wrench that it publishes."""
    rows = []
    for start in starts():
        cpu, wall, resident = start_node(name)
        rows.append([f"cable_node, {name}", start, f"{cpu:.1f}", "", f"{wall:.1f}", f"{resident:.0f}", ""])
    return rows


def start_node(name: str) -> tuple[float, float, float]:
    """CPU and wall time to the first wrench, s, and resident memory a second later, MB."""
    import rclpy
    from geometry_msgs.msg import WrenchStamped
    from sensor_msgs.msg import JointState

    scene, joint, path = PATHS[name]
    rclpy.init()
    client = rclpy.create_node("start_up")
    answers: list[Any] = []
    client.create_subscription(WrenchStamped, "/cable_node/camera_cable/end_wrench", answers.append, 10)
    publisher = client.create_publisher(JointState, "joint_states", 10)
    others = {"pitch": 0.0, "orientation": 0.0, joint: path[0]}
    begin = time.perf_counter()
    process = subprocess.Popen(
        [sys.executable, *NODE, "-p", f"scene:={share_file('config', scene)}"], stderr=subprocess.DEVNULL
    )
    try:
        while not answers and time.perf_counter() - begin < PATIENCE and process.poll() is None:
            message = JointState(name=list(others), position=list(others.values()))
            message.header.stamp = client.get_clock().now().to_msg()
            publisher.publish(message)
            rclpy.spin_once(client, timeout_sec=0.02)
        if not answers:
            sys.exit("cable_node sent no wrench")
        wall = time.perf_counter() - begin
        fields = Path(f"/proc/{process.pid}/stat").read_text().rsplit(")", 1)[1].split()
        cpu = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
        time.sleep(1.0)
        status = Path(f"/proc/{process.pid}/status").read_text()
        (resident,) = (line.split()[1] for line in status.splitlines() if line.startswith("VmRSS"))
        return cpu, wall, int(resident) / 1024
    finally:
        process.send_signal(signal.SIGINT)
        process.wait()
        client.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    sys.exit(main())
