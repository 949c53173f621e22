# SPDX-License-Identifier: Apache-2.0
"""Signals at the moments when rclpy's own answer to them is under way."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest

pytest.importorskip("rclpy", reason="rclpy is not on this machine")

START = """
import os, signal, sys, time
import rclpy
from cable_ros.ros import lifetime as module
from cable_ros.ros.lifetime import Lifetime
"""
TIMEOUT = 60.0  # s; only ever waited for in vain when something is broken


def run(program: str, *options: str, end: int = 0) -> str:
    """What this program prints, which must end like this."""
    process = subprocess.run(
        [sys.executable, "-c", START + program, *options], capture_output=True, text=True, timeout=TIMEOUT
    )
    assert process.returncode == end, process.stderr
    assert "Traceback" not in process.stderr
    return process.stdout


@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_start_and_what_was_started_is_closed_once(stop):
    program = """
with Lifetime() as lifetime:
    rclpy.init()
    node = rclpy.create_node("node")
    print("begun")
    if sys.argv[2] == "started":
        lifetime.started(node, lambda: print("closed"))
    os.kill(os.getpid(), int(sys.argv[1]))
    print("went on")
    rclpy.spin(node)
print("after")
"""
    assert run(program, str(stop.value), "starting").split("\n")[:-1] == ["begun", "after"]
    assert run(program, str(stop.value), "started").split("\n")[:-1] == [
        "begun",
        "went on",
        "closed",
        "after",
    ]


def test_nobody_else_ends_the_context_while_it_is_closed():
    program = """
for _ in range(50):
    seen = []
    def close():
        seen.append(rclpy.ok())
        os.kill(os.getpid(), signal.SIGINT)  # a second Ctrl-C
        time.sleep(0.005)
        seen.append(rclpy.ok())
    with Lifetime() as lifetime:
        rclpy.init()
        lifetime.started(rclpy.create_node("node"), close)
        os.kill(os.getpid(), signal.SIGTERM)  # rclpy's thread begins to end the context
    assert seen[0] == seen[1], seen
"""
    run(program)


def test_other_errors_pass():
    program = """
try:
    with Lifetime() as lifetime:
        rclpy.init()
        lifetime.started(rclpy.create_node("node"), lambda: print("closed"))
        raise ValueError("wrong")
except ValueError as error:
    print(error)
"""
    assert run(program) == "closed\nwrong\n"


def test_a_middleware_that_does_not_let_go_is_left():
    program = """
module._LEAVING = 0.2
class Stuck:
    def destroy_node(self):
        print("leaving", flush=True)
        time.sleep(60)
with Lifetime() as lifetime:
    rclpy.init()
    lifetime.started(Stuck(), lambda: print("closed", flush=True))
"""
    assert run(program, end=-signal.SIGALRM) == "closed\nleaving\n"
