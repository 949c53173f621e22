# SPDX-License-Identifier: Apache-2.0
"""Services of a real node, and what it sends only while somebody listens."""

from __future__ import annotations

import math

import numpy as np
import pytest
import yaml

pytest.importorskip("rclpy", reason="rclpy is not on this machine")
pytest.importorskip("pinocchio", reason="the arm's kinematics need Pinocchio")

from observer import ERROR, LOG_ENTRY, OK, Observer, arm_scene
from rclpy.qos import DurabilityPolicy, QoSProfile
from robot import CABLE, NODE

from cable_ros import Tracker
from cable_ros.joint import joint_load
from cable_ros.log.reader import LogReader
from cable_ros.scene.text import parse_yaml

END_WRENCH = f"{CABLE}/end_wrench"
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return arm_scene(tmp_path_factory.mktemp("scene"))


@pytest.fixture(scope="module")
def observer(scene):
    with Observer(scene=scene, diagnostics_rate="20.0") as robot:
        robot.move(0.0)
        robot.listen(END_WRENCH, "geometry_msgs/msg/WrenchStamped")
        robot.listen(f"{NODE}/joint_load", "sensor_msgs/msg/JointState")
        robot.rest()
        yield robot


def wrench(robot):
    """The end wrench (6,) that was heard last."""
    robot.rest(0.1)
    found = robot.messages[END_WRENCH][-1].wrench
    return np.array([getattr(part, axis) for part in (found.force, found.torque) for axis in "xyz"])


def test_a_log_is_started_and_stopped(observer, tmp_path):
    assert observer.trigger("stop_log").message == "There was no log to stop."
    path = tmp_path / "run.mcap"
    observer.set_parameter("log.path", str(path))
    answer = observer.trigger("start_log")
    assert (answer.success, answer.message) == (True, f"Writing {path}.")
    answer = observer.trigger("start_log")
    assert (answer.success, answer.message) == (True, f"Already writing {path}.")
    for i in range(5):
        observer.move(0.01 * i)
    answer = observer.trigger("stop_log")
    assert (answer.success, answer.message) == (True, f"{path} is complete.")
    with LogReader(path) as log:
        assert log.topics[END_WRENCH].count == 5
    # The next log does not overwrite it.
    observer.trigger("start_log")
    observer.move(0.1)
    assert observer.trigger("stop_log").message == f"{tmp_path / 'run-2.mcap'} is complete."
    taken, reason = observer.try_parameter("log.path", str(path))
    assert not taken
    assert "exists already and logs never overwrite" in reason


def test_a_log_that_cannot_be_written_is_told(observer, tmp_path):
    (tmp_path / "file").write_text("")
    observer.set_parameter("log.path", str(tmp_path / "file" / "run.mcap"))
    answer = observer.trigger("start_log")
    assert not answer.success
    assert "not a folder" in answer.message
    assert observer.entry(LOG_ENTRY).level == ERROR
    observer.move(0.1)
    observer.trigger("stop_log")
    assert observer.entry(LOG_ENTRY).level == OK


def test_a_reset_starts_cold_on_the_scenes_branch(observer):
    twists = []
    for _ in range(2):
        observer.move(0.3)
        entry = observer.entry("cable_node: camera_cable", lambda status: len(status.values) > 2)
        twists.append(float({pair.key: pair.value for pair in entry.values}["total twist [rad]"]))
        assert observer.trigger("reset").message == "The next joint state is solved from a cold start."
    assert twists[0] == pytest.approx(twists[1], rel=1e-5)  # six digits are told


def test_a_scene_is_loaded_again(observer, scene):
    for _ in range(4):  # until an iteration more changes nothing, wherever the cable was before
        observer.move(0.2)
    before, counters = wrench(observer), observer.counters()
    text = scene.read_text()
    changed = parse_yaml(text, "scene")
    changed["cables"][0]["linear_density"] *= 2
    try:
        scene.write_text("cables: []")
        answer = observer.trigger("reload_scene")
        assert not answer.success
        assert answer.message.endswith("; the old scene stays.")
        observer.move(0.2)
        # One more step of an iteration that had converged.
        np.testing.assert_allclose(wrench(observer), before, rtol=1e-9)
        scene.write_text(yaml.safe_dump(changed))
        assert observer.trigger("reload_scene").message == f"{scene} is loaded."
        observer.wait_for_node()
        observer.move(0.2)
        assert np.linalg.norm(wrench(observer)[:3]) > 1.3 * np.linalg.norm(before[:3])
        # The counters go on: what came meanwhile is not forgotten.
        assert observer.counters()["received"] > counters["received"]
    finally:
        scene.write_text(text)
        assert observer.trigger("reload_scene").success
    observer.wait_for_node()
    observer.move(0.2)
    # Cold, so on another way: within the tolerance of the same truth.
    np.testing.assert_allclose(wrench(observer), before, atol=3e-4 * np.linalg.norm(before))


def test_stiffness_is_sent_to_who_listens(observer, scene):
    stiffness = observer.listen(f"{NODE}/joint_stiffness", "trajectory_msgs/msg/JointTrajectory")
    observer.rest()
    angle = 0.25
    observer.move(angle)
    observer.wait(lambda: stiffness)
    load = observer.messages[f"{NODE}/joint_load"][-1]
    tracker = Tracker(str(scene))
    joints = {"orientation": angle}
    expected = joint_load(tracker, tracker.solve(joints), joints)
    assert list(load.name) == ["orientation"]
    assert list(load.position) == [angle]
    assert len(load.velocity) == 0
    # The same tolerance, 1e-4, on another way; a derivative is a little less exact than its function.
    np.testing.assert_allclose(load.effort, expected.torque, rtol=1e-3)
    assert (stiffness[-1].header.stamp, list(stiffness[-1].joint_names)) == (
        load.header.stamp,
        ["orientation"],
    )
    ((last,),) = (point.effort for point in stiffness[-1].points)
    assert last == pytest.approx(expected.stiffness[0, 0], rel=1e-2)
    # It is the derivative of what is published, over a step of 0.01 rad: off by its square and the tolerance.
    efforts = []
    for side in (-0.005, 0.005):
        observer.move(angle + side)
        observer.rest(0.1)
        efforts.append(observer.messages[f"{NODE}/joint_load"][-1].effort[0])
    assert (efforts[1] - efforts[0]) / 0.01 == pytest.approx(last, rel=2e-2)


def test_markers_are_sent_to_who_listens(observer):
    markers = observer.listen(f"{NODE}/markers", "visualization_msgs/msg/MarkerArray")
    observer.rest()
    for i in range(3):
        observer.move(0.1 + 0.01 * i)
        observer.rest(0.1)
    observer.wait(lambda: markers)
    names = {marker.ns for message in markers for marker in message.markers}
    assert names == {f"camera_cable/{part}" for part in ("tube", "end_force", "start_force")}
    assert {marker.header.frame_id for message in markers for marker in message.markers} == {"base"}
    observer.set_parameter("marker_rate", 2.0)
    observer.move(0.1)
    observer.rest(0.6)
    count = len(markers)
    for i in range(20):
        observer.move(0.1 + 0.001 * i)
    observer.rest(0.1)
    assert len(markers) - count <= 4  # two in a second


def test_a_late_joiner_gets_the_last_polyline(observer):
    observer.move(0.4)
    paths = observer.listen(f"{CABLE}/polyline", "nav_msgs/msg/Path", LATCHED)
    observer.wait(lambda: paths)
    last = observer.messages[END_WRENCH][-1].header.stamp
    assert (paths[-1].header.frame_id, paths[-1].header.stamp) == ("base", last)
    ends = [paths[-1].poses[i].pose.position for i in (0, -1)]
    assert [ends[0].x, ends[0].y, ends[0].z] == pytest.approx([0, 0, 0], abs=1e-12)
    s, c = math.sin(0.4), math.cos(0.4)
    # (47) of the paper; the end clamp is met to what the iteration leaves, far below 1e-6 m.
    expected = [0.160 - 0.145 * s + 0.080 * c, 0.080 * s + 0.145 * c, 0.075]
    assert [ends[1].x, ends[1].y, ends[1].z] == pytest.approx(expected, abs=1e-6)
