# SPDX-License-Identifier: Apache-2.0
"""What rosdep has no package of: where it is missing, every command says so in a line, and what to do."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from cable_ros.cli.main import main
from cable_ros.common.requirements import FROM_PIP, missing
from cable_ros.ros import start

ROOT = Path(__file__).parents[1]


def test_nothing_is_missing_here():
    assert missing() == ""


@pytest.mark.parametrize("names", [["numba"], ["mcap"], ["numba", "mcap"]])
def test_commands_say_what_is_missing(names, monkeypatch, capsys):
    pytest.importorskip("rclpy", reason="rclpy is not on this machine")
    for name in names:
        monkeypatch.setitem(sys.modules, name, None)
    for command in (start.cable_node, start.cable_replay, lambda: main(["solve", "space_arm.yaml"])):
        assert command() == 2
        (line,) = capsys.readouterr().err.splitlines()
        quoted = " and ".join(f"'{name}'" for name in names)
        assert f"the Python package {quoted} is missing" in line
        assert "pip install 'numba>=0.59' 'mcap>=1.5'" in line


def test_nodes_say_that_ros_is_not_sourced(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rclpy", None)
    assert start.cable_node() == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "'rclpy' is missing; source ROS first" in line


def test_the_readme_installs_what_rosdep_does_not():
    text = (ROOT / "README.md").read_text()
    (line,) = re.findall(r"^(?:\. .* && )?pip install (.*?)(?: *#.*)?$", text, re.M)
    assert line == " ".join(f"'{requirement}'" for requirement in FROM_PIP.values())
    # rosdep stops at a key that it does not know, or that stands for pip.
    package = (ROOT / "package.xml").read_text()
    assert not re.findall(r"_depend>(?:python3-numba|.*-pip|mcap-ros2-support)<", package)
