# SPDX-License-Identifier: Apache-2.0
"""Joint error with and without feed-forward, drawn into docs/feedforward.png.

    python benchmarks/feedforward.py --out docs/feedforward.png

Four processes, as on a robot: cable_node, examples/weak_joint.py, examples/feedforward.py, and this one,
which listens. The controller is started after one period, and cable_node is killed after another.
"""

from __future__ import annotations

import argparse
import os
import random
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

# The processes of one run see each other and nothing else.
os.environ.setdefault("ROS_DOMAIN_ID", str(random.randrange(1, 100)))
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")

import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from cable_ros.share import share_file

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
START_UP = 300.0  # s; a first start compiles


class Run:
    """Starts and ends the processes, and keeps what they publish. Use as a context manager.

    Args:
        period: of the joint's motion, s.
    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._context = Context()
        rclpy.init(context=self._context)
        self._node = Node("feedforward_run", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self.positions: list[tuple[float, float]] = []
        self.targets: list[tuple[float, float]] = []
        self.loads: list[tuple[float, float]] = []
        self.commands: list[tuple[float, float]] = []
        """Time [s] and value [rad, N m]; of a command, the time when it was heard."""
        self._obeyed = 0.0
        self._listen(JointState, "joint_states", self._take_state)
        self._listen(JointState, "target", lambda message: _keep(self.targets, message, message.position))
        self._listen(
            JointState, "cable_node/joint_load", lambda message: _keep(self.loads, message, message.effort)
        )
        self._listen(Float64MultiArray, "effort_controller/commands", self._take_command)

    def _listen(self, kind: type, topic: str, take: Callable[..., None]) -> None:
        self._node.create_subscription(kind, topic, take, QoSProfile(depth=1000))

    def _take_state(self, message: JointState) -> None:
        _keep(self.positions, message, message.position)
        (self._obeyed,) = message.effort

    def _take_command(self, message: Float64MultiArray) -> None:
        self.commands.append((time.time(), message.data[0]))

    def __enter__(self) -> Run:
        scene = str(share_file("config", "space_arm.yaml"))
        self._start("cable_node", "-m", "cable_ros.ros.cable_node", "--ros-args", "-p", f"scene:={scene}")
        joint = [str(EXAMPLES / "weak_joint.py"), "--ros-args", "-p", f"scene:={scene}"]
        self._start("weak_joint", *joint, "-p", f"period:={self._period}")
        try:
            self._wait(lambda: bool(self.loads))
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._processes.values():
            process.terminate()
        for process in self._processes.values():
            process.wait(30.0)
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def _start(self, name: str, *arguments: str) -> None:
        self._processes[name] = subprocess.Popen([sys.executable, *arguments], stdout=subprocess.DEVNULL)

    def kill_under_load(self) -> float:
        """End cable_node without warning, when the feed-forward is 10 N mm or more; returns the time."""
        self._wait(lambda: abs(self.commands[-1][1]) > 0.01)
        return self.kill("cable_node")

    def kill(self, name: str) -> float:
        """End a process without warning; returns the time."""
        process = self._processes.pop(name)
        process.kill()
        process.wait()
        return time.time()

    def start_controller(self) -> None:
        """Until the joint, and we, have heard a command of it."""
        self._start("feedforward", str(EXAMPLES / "feedforward.py"))
        self._wait(lambda: self._obeyed != 0.0 and any(value for _, value in self.commands))

    def _wait(self, done: Callable[[], bool]) -> None:
        deadline = time.monotonic() + START_UP
        while not done():
            if time.monotonic() > deadline or any(one.poll() is not None for one in self._processes.values()):
                raise RuntimeError("a process has ended, or says nothing; its sentence is above")
            self._executor.spin_once(timeout_sec=0.02)

    def listen(self, seconds: float) -> tuple[float, float]:
        """Keep what comes; returns when this began and ended, s."""
        begin = time.time()
        self._wait(lambda: time.time() > begin + seconds)
        return begin, time.time()

    def error(self, begin: float, end: float) -> tuple[np.ndarray, np.ndarray]:
        """Times [s] and joint error [rad]: position less target of the same stamp."""
        targets = dict(self.targets)
        pairs = [
            (at, value - targets[at]) for at, value in self.positions if begin <= at <= end and at in targets
        ]
        times, errors = np.array(pairs).T
        return times, errors


def _keep(kept: list[tuple[float, float]], message: JointState, values: list[float]) -> None:
    stamp = message.header.stamp
    kept.append((stamp.sec + stamp.nanosec * 1e-9, values[0]))


def rms(values: np.ndarray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def draw(run: Run, start: float, end: float, marks: dict[str, float], path: Path) -> None:
    """Joint error, and load and command, from `start` to `end`; `marks`: what happened when."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    from cable_ros.drawing.figures import STYLE

    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.0, 5.2), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True)
        times, errors = run.error(start, end)
        above.plot(times - start, np.degrees(errors), color="#0072B2")
        above.set_title("Joint error: position less target")
        above.set_ylabel("deg")
        for name, sign, records, colour in (
            ("cable on the joint, as cable_node says", 1.0, run.loads, "#D55E00"),
            ("feed-forward command, sign turned", -1.0, run.commands, "#009E73"),
        ):
            kept = np.array([pair for pair in records if start <= pair[0] <= end])
            below.plot(kept[:, 0] - start, 1e3 * sign * kept[:, 1], color=colour, label=name)
        below.set_title("Torque")
        below.set_ylabel("N mm")
        below.set_xlabel("time, s")
        below.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
        above.margins(y=0.15)
        for axes in (above, below):
            for at in marks.values():
                axes.axvline(at - start, color="#888888", linewidth=1.0, linestyle="--")
        for text, at in marks.items():
            above.annotate(text, (at - start, 1.0), (4, -2), xycoords=("data", "axes fraction"),
                           textcoords="offset points", va="top", color="#444444")  # fmt: skip
        figure.savefig(path)


def main() -> None:
    """Run, print, draw."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("feedforward.png"))
    parser.add_argument("--period", type=float, default=8.0, help="of the joint's motion, s")
    arguments = parser.parse_args()
    with Run(arguments.period) as run:
        without = run.listen(arguments.period)
        run.start_controller()
        marks = {"feed-forward on": next(at for at, value in run.commands if value)}
        run.listen(1.0)
        with_it = run.listen(arguments.period)
        marks["cable_node killed"] = run.kill_under_load()
        _, end = run.listen(0.75 * arguments.period)
        errors = [rms(run.error(*part)[1]) for part in (without, with_it)]
        print(f"joint error, root mean square: {np.degrees(errors[0]):.4f} deg without feed-forward, "
              f"{np.degrees(errors[1]):.4f} deg with it; {errors[0] / errors[1]:.0f} times less")  # fmt: skip
        draw(run, without[0], end, marks, arguments.out)


if __name__ == "__main__":
    main()
