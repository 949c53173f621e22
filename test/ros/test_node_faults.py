# SPDX-License-Identifier: Apache-2.0
"""What can go wrong around a real node: each fault has its sentence, and answers are right afterwards."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="rclpy is not on this machine")
pytest.importorskip("pinocchio", reason="the arm's kinematics need Pinocchio")

from observer import ERROR, OK, WARN, Observer
from rclpy.qos import QoSProfile, ReliabilityPolicy
from robot import CABLE, NODE
from sensor_msgs.msg import JointState

from cable_ros import Tracker
from cable_ros.ros.parameters import DECLARATIONS
from cable_ros.share import share_file

NAMES = ["pitch", "orientation"]
END_WRENCH = f"{CABLE}/end_wrench"
WRENCH = "geometry_msgs/msg/WrenchStamped"
NAN = math.nan


@pytest.fixture(scope="module")
def observer():
    with Observer(diagnostics_rate="20.0") as robot:
        robot.move(0.0)
        robot.listen(END_WRENCH, WRENCH)
        yield robot


@pytest.fixture(scope="module")
def solved_here():
    tracker = Tracker(str(share_file("config", "space_arm.yaml")))
    return lambda angle: tracker.solve({"orientation": angle})["camera_cable"].end_wrench


def check_answer(robot, solved_here, angle):
    """The node answers this angle, and answers it right."""
    robot.move(angle)
    robot.wait(lambda: robot.messages[END_WRENCH])
    robot.rest(0.1)
    wrench = robot.messages[END_WRENCH][-1].wrench
    found = [getattr(part, axis) for part in (wrench.force, wrench.torque) for axis in "xyz"]
    expected = solved_here(angle)
    # Both are within the tolerance, 1e-4, of the same truth, whatever the way there.
    for part in (slice(0, 3), slice(3, 6)):
        scale = np.linalg.norm(expected[part])
        assert np.linalg.norm(np.subtract(found[part], expected[part])) < 3e-4 * scale


@pytest.mark.parametrize(
    ("names", "position", "sentence"),
    [
        (NAMES, [0.1], "has 1 positions for 2 names; there must be one for each; the message is ignored"),
        (NAMES, [0.1, 0.2, 0.3], "has 3 positions for 2 names"),
        (NAMES, [], "has 0 positions for 2 names"),
        (["orientation"] * 2, [0.1, 0.2], "names 'orientation' twice; each joint may be there once"),
        (NAMES, [0.0, NAN], "has the position nan for 'orientation'; a finite number is needed"),
        (NAMES, [0.0, math.inf], "has the position inf for 'orientation'"),
    ],
)
def test_a_malformed_joint_state_is_told_and_ignored(observer, solved_here, names, position, sentence):
    before = observer.counters()
    answers = len(observer.messages[END_WRENCH])
    observer.send(names, position)
    status = observer.told(sentence)
    assert status.level == WARN
    assert len(observer.messages[END_WRENCH]) == answers
    after = observer.counters()
    assert after["rejected"] - before["rejected"] == 1
    assert after["solved"] == before["solved"]
    check_answer(observer, solved_here, 0.1)
    assert observer.entry().level == OK


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"velocity": [0.0]}, "have 1 velocities for 2 names; the positions are used all the same"),
        ({"effort": [0.0, 1.0, 2.0]}, "have 3 efforts for 2 names; the positions are used all the same"),
    ],
)
def test_what_is_not_needed_may_be_wrong(observer, fields, sentence):
    before = len(observer.messages[END_WRENCH])
    observer.send(NAMES, [0.0, 0.2], **fields)
    assert observer.told(sentence).level == WARN
    observer.wait(lambda: len(observer.messages[END_WRENCH]) > before)


def test_other_joints_and_empty_messages_are_no_fault(observer):
    before = observer.counters()
    observer.send(["gripper", "pitch"], [0.1, 7.0])
    observer.send([], [])
    observer.wait(
        lambda: observer.counters()["without a needed joint"] == before["without a needed joint"] + 2
    )
    after = observer.counters()
    assert (after["solved"], after["rejected"]) == (before["solved"], before["rejected"])
    assert observer.entry().level == OK


def test_a_value_that_no_joint_has_is_not_answered(observer, solved_here):
    before = len(observer.messages[END_WRENCH])
    observer.send(NAMES, [0.0, 1e9])
    status = observer.told("Joint 'orientation' is 1e+09; a finite value", f"{NODE[1:]}: camera_cable")
    assert status.level == ERROR
    assert len(observer.messages[END_WRENCH]) == before
    check_answer(observer, solved_here, 0.0)


def test_the_status_of_every_answer_is_told(observer):
    statuses = observer.listen(f"{NODE}/status", "diagnostic_msgs/msg/DiagnosticArray")
    observer.move(0.2)
    observer.rest()  # the status comes after the load
    loads = observer.heard[f"{NODE}/joint_load"]
    statuses.clear()
    begin = time.time_ns()
    for step, angle in enumerate((0.2, 1e9, 1e9, 0.2)):
        observer.send(NAMES, [0.0, angle], stamp=begin + step * 250_000_000)
        observer.wait(lambda count=step: len(statuses) > count)
    observer.rest()
    assert observer.heard[f"{NODE}/joint_load"] == loads + 2
    found = []
    for step, message in enumerate(statuses):
        stamp = message.header.stamp
        assert stamp.sec * 1_000_000_000 + stamp.nanosec == begin + step * 250_000_000
        (entry,) = message.status
        assert entry.name == "camera_cable"
        values = {pair.key: pair.value for pair in entry.values}
        found.append((values["status"], values["trusted"], float(values["age of the last trusted [s]"])))
        if values["trusted"] == "true":
            assert 0 < float(values["error estimate"]) <= 1e-4
            assert float(values["stability margin"]) > 0
    bad = [("INVALID_INPUT", "false", age) for age in (0.25, 0.5)]
    assert found == [("CONVERGED", "true", 0.0), *bad, ("CONVERGED", "true", 0.0)]


def test_stamps_that_go_back_are_told_and_answered(observer):
    now = time.time_ns()
    for stamp in (now, now - 5_000_000_000):
        before = len(observer.messages[END_WRENCH])
        observer.send(NAMES, [0.0, 0.2], stamp=stamp)
        observer.wait(lambda count=before: len(observer.messages[END_WRENCH]) > count)
        answer = observer.messages[END_WRENCH][-1].header.stamp
        assert answer.sec * 1_000_000_000 + answer.nanosec == stamp
    assert observer.told("went back by 5 s; solved all the same").level == WARN


def test_a_joint_state_without_stamp_gets_the_nodes_time(observer):
    before, begin = len(observer.messages[END_WRENCH]), time.time()
    observer.send(NAMES, [0.0, 0.2], stamp=0)
    observer.wait(lambda: len(observer.messages[END_WRENCH]) > before)
    # A float of seconds is good to a microsecond.
    assert begin - 1e-5 <= observer.messages[END_WRENCH][-1].header.stamp.sec + 1 <= time.time() + 1


def test_two_publishers_with_other_layouts_are_merged(observer, solved_here):
    other = observer.node.create_publisher(JointState, "/joint_states", QoSProfile(depth=10))
    observer.wait(lambda: observer.counters()["publishers"] == 2)
    observer.rest()
    before = observer.counters()
    for i in range(50):
        observer.send(NAMES, [0.0, 0.1 + 0.002 * i])
        other.publish(JointState(name=["gripper", "wheel"], position=[1.0 * i, -1.0]))
        observer.rest(0.005)
    observer.rest()
    after = observer.counters()
    assert after["received"] - before["received"] + after["lost"] - before["lost"] == 100
    assert after["rejected"] == before["rejected"]
    # A pause of the machine may cost a few, which are counted; the rest are told apart by their names.
    assert after["without a needed joint"] - before["without a needed joint"] > 40
    observer.node.destroy_publisher(other)
    check_answer(observer, solved_here, 0.2)


def test_a_storm_is_answered_or_counted(observer, solved_here):
    before = observer.counters()
    count = 0
    for _ in range(3):
        for i in range(900):  # as fast as they can be sent: several times what can be solved
            observer.send(NAMES, [0.0, 0.2 + 0.3 * math.sin(0.01 * i)])
        observer.rest()
        observer.move(0.1)  # what was lost is counted when the next one comes
        count += 901
    after = {name: value - before[name] for name, value in observer.counters().items()}
    assert after["received"] + after["lost"] == count
    assert after["received"] == after["solved"] + after["skipped"]
    assert after["rejected"] == 0
    check_answer(observer, solved_here, 0.0)


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("tolerance", -1.0, "range"),
        ("tolerance", NAN, "tolerance"),
        ("tolerance", "fine", "type"),
        ("polyline_points", 1, "range"),
        ("polyline_points", 10**9, "range"),
        ("scene", "other.yaml", "read-only"),
        ("world_frame", "map", "read-only"),
        ("diagnostics_rate", 50.0, "read-only"),
        ("marker_rate", 0.0, "range"),
        ("log.max_size", -5, "range"),
        ("log.path", "/etc/hostname/../x\0.mcap", None),
    ],
)
def test_parameters_refuse_what_they_cannot_be(observer, name, value, reason):
    taken, why = observer.try_parameter(name, value)
    assert reason is None or (not taken and reason in why.replace("wrong", "type").lower()), why
    observer.move(0.1)


def test_every_parameter_is_described(observer):
    from rcl_interfaces.srv import DescribeParameters

    names = [entry.name for entry in DECLARATIONS]
    request = DescribeParameters.Request(names=names)
    found = observer.call(DescribeParameters, f"{NODE}/describe_parameters", request).descriptors
    assert [descriptor.name for descriptor in found] == names
    for entry, descriptor in zip(DECLARATIONS, found, strict=True):
        assert descriptor.description == entry.description
        assert descriptor.read_only == (not entry.live)
        ranges = descriptor.floating_point_range + descriptor.integer_range
        assert len(ranges) == (entry.low is not None)


def test_live_parameters_take_effect_at_the_next_joint_state(observer):
    path = observer.listen(f"{CABLE}/polyline", "nav_msgs/msg/Path")
    for points in (7, 300, 101):
        observer.set_parameter("polyline_points", points)
        before = len(path)
        observer.move(0.1)
        observer.wait(lambda count=before: len(path) > count)
        assert len(path[-1].poses) == points
    estimates = {}
    for tolerance in (1e-2, 1e-8, 1e-4):
        observer.set_parameter("tolerance", tolerance)
        observer.move(0.1)
        observer.rest(0.2)
        values = {pair.key: pair.value for pair in observer.entry(f"{NODE[1:]}: camera_cable").values}
        if "error estimate" not in values:  # a report with nothing solved since the one before
            observer.move(0.1)
            status = observer.entry(f"{NODE[1:]}: camera_cable", lambda found: len(found.values) > 2)
            values = {pair.key: pair.value for pair in status.values}
        estimates[tolerance] = float(values["error estimate"])
        assert estimates[tolerance] <= tolerance
    assert estimates[1e-8] < estimates[1e-4]


def test_joint_states_of_any_reliability_are_heard(observer):
    qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    other = observer.node.create_publisher(JointState, "/joint_states", qos)
    observer.wait(lambda: observer.counters()["publishers"] == 2)
    observer.rest()
    before = len(observer.messages[END_WRENCH])
    other.publish(JointState(name=NAMES, position=[0.0, 0.15]))
    observer.wait(lambda: len(observer.messages[END_WRENCH]) > before)
    observer.node.destroy_publisher(other)
