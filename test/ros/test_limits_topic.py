# SPDX-License-Identifier: Apache-2.0
"""A cable's limits in messages: the topic, diagnostics and markers, read by rclpy."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("rclpy")

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.serialization import deserialize_message
from visualization_msgs.msg import Marker, MarkerArray

from cable_ros.branch.results import failed
from cable_ros.equilibrium import Equilibrium, Status
from cable_ros.limits import QUANTITIES, Extreme
from cable_ros.ros.cable_outputs import CableOutputs
from cable_ros.ros.frame_names import Frames
from cable_ros.ros.limits_message import LimitsMessage
from cable_ros.ros.markers import CableMarkers
from cable_ros.scene import load_scene
from cable_ros.share import share_file

LIMITS = (0.04, 20.0, None, 0.01)


def extremes(*values: float) -> tuple[Extreme, ...]:
    """With these values at 0.1, 0.2, ... m."""
    return tuple(
        Extreme(quantity, value, 0.1 * i, np.full(3, float(i)), limit, "ball" if i == 4 else "")
        for i, (quantity, value, limit) in enumerate(zip(QUANTITIES, values, LIMITS, strict=True), 1)
    )


def found(*values: float) -> Equilibrium:
    plain = failed(Status.CONVERGED, "Converged.", 0.0, 2)
    return replace(plain, points=np.zeros((2, 3)), orientations=np.tile([0.0, 0, 0, 1], (2, 1)),
                   _extremes=lambda: extremes(*values))  # fmt: skip


def read(message: LimitsMessage, *values: float) -> list[DiagnosticStatus]:
    array = deserialize_message(message.fill(1_500_000_000, extremes(*values)), DiagnosticArray)
    assert (array.header.stamp.sec, array.header.stamp.nanosec) == (1, 500_000_000)
    return list(array.status)


def test_the_topic_has_an_entry_for_each_quantity():
    message = LimitsMessage("hose", "/cable_node")
    for values in ((0.08, 3.0, 7.0, 0.05), (0.045, 21.0, 7.0, math.inf), (0.081, 3.5, -0.0, 0.05)):
        radius, tension, torsion, clearance = read(message, *values)
        assert [one.name for one in (radius, tension, torsion, clearance)] == [
            "hose: bend radius", "hose: tension", "hose: torsion", "hose: clearance",
        ]  # fmt: skip
        texts = {value.key: value.value for value in tension.values}
        assert float(texts["value [N]"]) == pytest.approx(values[1])
        assert float(texts["at [m]"]) == pytest.approx(0.2)
        assert float(texts["use"]) == pytest.approx(values[1] / 20.0)
        assert float(texts["limit [N]"]) == 20.0
        assert {value.key: value.value for value in torsion.values}["limit [rad/m]"] == "none"
        assert {value.key: value.value for value in clearance.values}["to"] == "ball"
        assert torsion.level == DiagnosticStatus.OK
        expected = DiagnosticStatus.OK if values[1] < 16 else DiagnosticStatus.ERROR
        assert tension.level == expected
        assert radius.level == (DiagnosticStatus.OK if values[0] > 0.05 else DiagnosticStatus.WARN)


@pytest.fixture
def node():
    rclpy.init()
    made = rclpy.create_node("test_limits_topic")
    yield made
    made.destroy_node()
    rclpy.shutdown()


def test_diagnostics_and_topic_of_a_cable(node):
    plain = load_scene(share_file("config", "space_arm.yaml")).cables[0]
    cable = replace(plain, limits=object())
    without, outputs = (CableOutputs(node, one, Frames("", "world"), 2) for one in (plain, cable))
    topic = "/test_limits_topic/camera_cable/limits"
    assert topic in [outlet.topic for outlet in outputs.outlets]
    assert topic not in [outlet.topic for outlet in without.outlets]
    near, fine = found(0.045, 3.0, 7.0, 0.05), found(0.08, 3.0, 7.0, 0.05)
    sent = {outlet.topic: data for outlet, data in outputs.wrenches(0, near)}
    assert deserialize_message(sent[topic], DiagnosticArray).status[0].level == DiagnosticStatus.WARN
    outputs.note(near)
    outputs.note(fine)  # the worst is told
    told = outputs.status("cable_node", "", {})
    assert told.level == DiagnosticStatus.WARN
    assert told.message == "Converged. Bend radius 0.045 m at 0.1 m, 89 % of its limit of 0.04 m."
    values = {value.key: value.value for value in told.values}
    assert (values["tension [N]"], values["tension at [m]"]) == ("3", "0.2")
    outputs.note(fine)
    moved = outputs.status("cable_node", "", {}, "Not quasi-static.")
    assert (moved.level, moved.message) == (DiagnosticStatus.WARN, "Converged. Not quasi-static.")
    outputs.note(found(0.03, 30.0, 7.0, 0.05))
    beyond = outputs.status("cable_node", "", {}, "Not quasi-static.")
    assert beyond.level == DiagnosticStatus.ERROR
    assert "Tension 30 N at 0.2 m, 150 % of its limit of 20 N." in beyond.message
    without.note(failed(Status.CONVERGED, "Converged.", 0.0, 2))
    assert "tension [N]" not in {value.key for value in without.status("cable_node", "", {}).values}


def test_markers_show_where():
    cable = replace(load_scene(share_file("config", "space_arm.yaml")).cables[0], limits=object())
    markers = CableMarkers(cable, "world", 2)
    assert markers.limits(0, found(0.08, 3.0, 7.0, 0.05)) is None
    (balls,) = deserialize_message(markers.limits(0, found(0.045, 30.0, 7.0, 0.05)), MarkerArray).markers
    assert (balls.ns, balls.type, balls.action) == (
        "camera_cable/limits", Marker.SPHERE_LIST, Marker.ADD,
    )  # fmt: skip
    assert [(p.x, p.y, p.z) for p in balls.points] == [(1.0, 1.0, 1.0), (2.0, 2.0, 2.0)]
    assert balls.colors[0].g > balls.colors[1].g  # yellow, then red
    (gone,) = deserialize_message(markers.limits(0, found(0.08, 3.0, 7.0, 0.05)), MarkerArray).markers
    assert gone.action == Marker.DELETE
    assert markers.limits(0, found(0.08, 3.0, 7.0, 0.05)) is None
    assert "camera_cable/limits" in [m.ns for m in deserialize_message(markers.remove(), MarkerArray).markers]
