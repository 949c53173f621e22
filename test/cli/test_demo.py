# SPDX-License-Identifier: Apache-2.0
"""`cable demo` with the real node in a process of its own, and what it says when the node fails."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("matplotlib")

from cable_ros import Tracker
from cable_ros.cli._arguments import CommandError
from cable_ros.cli.demo import drive, node_process
from cable_ros.cli.main import main
from cable_ros.log.history import read_history
from cable_ros.ros.joint_driver import JointDriver, NoAnswerError
from cable_ros.share import share_file

ARM = share_file("config", "space_arm.yaml")


@pytest.fixture
def domain(monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")


@pytest.mark.usefixtures("domain")
def test_demo_writes_a_log_and_its_pictures(tmp_path, capsys):
    out = tmp_path / "demo"
    for _ in range(2):  # the second one replaces what the first one wrote
        assert main(["demo", "--out", str(out)]) == 0
        lines = capsys.readouterr().out.strip().splitlines()
        written = ["space_arm.mcap", "space_arm_shapes.png", "space_arm_end_wrench.png"]
        written.append("space_arm_joint_load.png")
        assert [line.partition(":")[0] for line in lines] == [str(out / name) for name in written]
        assert sorted(path.name for path in out.iterdir()) == sorted(written)
    history = read_history(out / "space_arm.mcap")
    angles = history.joints[:, history.joint_names.index("orientation")]
    assert np.array_equal(angles, np.radians(np.arange(-90, 90.01, 0.5)))
    wrenches = history.end_wrenches["camera_cable"]
    assert np.isfinite(wrenches).all()  # each joint state is answered
    zero = Tracker(ARM).solve({"orientation": 0.0})["camera_cable"].end_wrench
    logged = wrenches[np.argmin(np.abs(angles))]
    # Both are within the default tolerance of 1e-4 of the truth.
    assert logged == pytest.approx(zero, rel=0, abs=2e-4 * np.linalg.norm(zero[:3]))


@pytest.mark.usefixtures("domain")
def test_a_node_that_dies_is_told_with_its_last_words(tmp_path):
    with (
        pytest.raises(
            CommandError, match=r"the node ended with exit code \d+; its last words: .*nowhere\.yaml"
        ),
        node_process(Path("/nowhere.yaml"), tmp_path / "log.mcap") as check,
    ):
        drive(np.zeros(1), check)


@pytest.mark.usefixtures("domain")
def test_no_node_is_told():
    with JointDriver(["camera_cable"]) as driver:
        with pytest.raises(NoAnswerError, match="/cable_node did not come up"):
            driver.wait_for_node(0.2)
        with pytest.raises(NoAnswerError, match=r"/cable_node did not answer orientation = 0\.5 within"):
            driver.send({"orientation": 0.5}, 0.2)
