# SPDX-License-Identifier: Apache-2.0
"""The launch file, against stand-ins for launch and launch_ros: the ROS wheels lack both."""

from __future__ import annotations

import runpy
import sys
from types import ModuleType, SimpleNamespace

import pytest
import yaml

pytest.importorskip("rclpy", reason="rclpy is not on this machine")

from cable_ros.ros.parameters import DECLARATIONS
from cable_ros.share import share_file


def record(kind):
    def make(*positional, **named):
        return SimpleNamespace(kind=kind, positional=positional, **named)

    return make


@pytest.fixture
def launch_file(monkeypatch):
    names = {
        "launch": ["LaunchContext", "LaunchDescription"],
        "ament_index_python": [],
        "ament_index_python.packages": ["get_package_prefix"],
        "launch.actions": ["DeclareLaunchArgument", "OpaqueFunction"],
        "launch.substitutions": ["PathJoinSubstitution"],
        "launch_ros": [],
        "launch_ros.actions": ["Node"],
        "launch_ros.substitutions": ["FindPackageShare"],
    }
    for module_name, members in names.items():
        module = ModuleType(module_name)
        for member in members:
            setattr(module, member, record(member))
        monkeypatch.setitem(sys.modules, module_name, module)
    sys.modules["ament_index_python.packages"].PackageNotFoundError = KeyError
    return runpy.run_path(str(share_file("launch", "cable.launch.py")))


def nodes(launch_file, **given):
    values = dict.fromkeys(launch_file["ARGUMENTS"], "") | given
    return launch_file["_nodes"](SimpleNamespace(launch_configurations=values))


def test_its_arguments_are_the_nodes_parameters(launch_file):
    known = {entry.name for entry in DECLARATIONS} | {"use_sim_time"}
    assert set(launch_file["PARAMETERS"].values()) <= known
    (entities,) = launch_file["generate_launch_description"]().positional
    declared = [entity.positional[0] for entity in entities if entity.kind == "DeclareLaunchArgument"]
    assert declared == list(launch_file["ARGUMENTS"])


def test_what_is_not_given_is_left_to_the_parameter_file(launch_file):
    (node,) = nodes(launch_file)
    file, values = node.parameters
    assert (node.package, node.executable, values) == ("cable_ros", "cable_node", {})
    assert file.positional[0][1:] == ["config", "cable_node.yaml"]
    assert share_file(*file.positional[0][1:]).is_file()


def test_what_is_given_has_its_type(launch_file):
    node, rviz = nodes(
        launch_file, scene="a.yaml", log="True", log_path="/tmp/logs", use_sim_time="true", rviz="true"
    )
    expected = {"scene": "a.yaml", "log.enabled": True, "log.path": "/tmp/logs", "use_sim_time": True}
    assert node.parameters[1] == expected
    layout = rviz.arguments[1].positional[0]
    assert share_file(*layout[1:]).is_file()
    assert rviz.parameters == [{"use_sim_time": True}]


def test_every_argument_tells_what_holds_without_it(launch_file):
    (entities,) = launch_file["generate_launch_description"]().positional
    for entity in entities[:-1]:
        assert "Without it: " in entity.description or "In the package's file: " in entity.description
    file = yaml.safe_load(share_file("config", "cable_node.yaml").read_text())["/**"]["ros__parameters"]
    told = launch_file["ARGUMENTS"]
    assert told["scene"].endswith(f"In the package's file: {file['scene']}.")
    assert told["log"].endswith(f"In the package's file: {str(file['log']['enabled']).lower()}.")


def test_the_joint_states_are_remapped(launch_file):
    (node,) = nodes(launch_file, joint_states="/left/joint_states")
    assert node.remappings == [("joint_states", "/left/joint_states")]
    (node,) = nodes(launch_file)
    assert node.remappings == []


def test_without_rviz_nothing_starts(launch_file, monkeypatch):
    def missing(name):
        raise KeyError(name)

    monkeypatch.setitem(launch_file["_check_rviz"].__globals__, "get_package_prefix", missing)
    with pytest.raises(RuntimeError, match=r"rviz2 is not installed: sudo apt install ros-jazzy-rviz2"):
        nodes(launch_file, rviz="true")
    assert len(nodes(launch_file)) == 1


def test_a_switch_that_is_neither_on_nor_off_is_refused(launch_file):
    with pytest.raises(ValueError, match="launch argument log is 'maybe'; it must be true or false"):
        nodes(launch_file, log="maybe")
