# SPDX-License-Identifier: Apache-2.0
"""The layouts for RViz and Foxglove and the parameter file name what the node has."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import yaml

pytest.importorskip("rclpy", reason="rclpy is not on this machine")

from robot import CABLE, NODE, PUBLISHED

from cable_ros.ros.parameters import DECLARATIONS
from cable_ros.share import share_file

TOPICS = {
    *PUBLISHED,
    f"{NODE}/markers",
    f"{NODE}/joint_stiffness",
    f"{NODE}/status",
    f"{NODE}/scene",
    "/diagnostics",
    "/robot_description",
}


def test_rviz_shows_topics_that_there_are():
    config = yaml.safe_load(share_file("config", "cable.rviz").read_text())
    displays = config["Visualization Manager"]["Displays"]
    shown = {
        display[key]["Value"]
        for display in displays
        for key in ("Topic", "Description Topic")
        if key in display
    }
    assert f"{NODE}/markers" in shown <= TOPICS
    assert all(display["Class"].startswith("rviz_default_plugins/") for display in displays)
    # A latched topic is only heard by who asks for what was published before.
    latched = {
        display["Name"]
        for display in displays
        for key in ("Topic", "Description Topic")
        if display.get(key, {}).get("Durability Policy") == "Transient Local"
    }
    assert latched == {"Robot", "Centreline"}


def test_foxglove_shows_topics_that_there_are():
    layout = json.loads(share_file("config", "foxglove_layout.json").read_text())
    panels = layout["configById"]
    shown = set(panels["3D!cables"]["topics"]) | {panels["DiagnosticSummary!health"]["topicToRender"]}
    for panel in panels.values():
        shown |= {re.match(r"[\w/]+", path["value"])[0] for path in panel.get("paths", [])}
    assert f"{NODE}/markers" in shown <= TOPICS
    assert set(re.findall(r'"(\w+!\w+)"', json.dumps(layout["layout"]))) == set(panels)


def test_the_readme_lists_every_parameter_and_topic():
    text = (Path(__file__).parents[2] / "README.md").read_text()
    rows = dict(re.findall(r"^\| `([\w.]+)` \| (.*?) \| .* \|$", text, re.M))
    for entry in DECLARATIONS:
        default = str(entry.default).lower() if isinstance(entry.default, bool) else entry.default
        expected = f"{default:g}" if isinstance(default, int | float) else default
        assert rows[entry.name].strip("` ") == expected
        assert entry.description in text
    for topic in TOPICS - {"/robot_description"}:
        name = topic.replace(CABLE, "~/<cable>").replace(NODE, "~")
        assert f"| `{name}` |" in text


def test_the_parameter_file_has_every_parameter_with_its_default():
    (node,) = yaml.safe_load(share_file("config", "cable_node.yaml").read_text()).values()
    values = node["ros__parameters"]
    for entry in DECLARATIONS:
        *groups, leaf = entry.name.split(".")
        place = values
        for group in groups:
            place = place[group]
        value = place.pop(leaf)
        assert type(value) is type(entry.default)
        assert value == entry.default or entry.name == "scene"
    assert values.pop("log") == {}
    assert values == {}
