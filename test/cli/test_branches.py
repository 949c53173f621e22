# SPDX-License-Identifier: Apache-2.0
"""`cable branches`: table, JSON, picture, exit codes."""

from __future__ import annotations

import json

import pytest
import yaml
from zoo_make import cable, turned

pytest.importorskip("matplotlib")

from cable_ros.branch.enumeration import branches
from cable_ros.cli.main import main
from cable_ros.scene import load_scene
from cable_ros.share import share_file

ARM = str(share_file("config", "space_arm.yaml"))


def test_table_and_picture(tmp_path, capsys):
    out = tmp_path / "shapes.png"
    assert main(["branches", ARM, "--joint", "orientation=0", "--out", str(out)]) == 0
    text = capsys.readouterr().out
    assert "stable equilibria" in text
    assert "42.09 mJ" in text
    assert "-157.0 deg" in text
    assert out.read_bytes().startswith(b"\x89PNG")


def test_json_is_what_the_function_finds(tmp_path, capsys):
    arguments = ["branches", ARM, "--joint", "orientation=30deg", "--json", "--out", str(tmp_path / "a.png")]
    assert main(arguments) == 0
    listed = json.loads(capsys.readouterr().out)["camera_cable"]
    expected = branches(load_scene(ARM), {"orientation": 0.5235987755982988})["camera_cable"]
    assert [one["total_twist"] for one in listed] == [one.total_twist for one in expected]


def test_no_equilibrium_is_no_picture(tmp_path, capsys):
    scene, out = tmp_path / "far.yaml", tmp_path / "far.png"
    scene.write_text(yaml.safe_dump(cable(turned([1.05, 0.0, 0.0], [0.0, 0.0, 0.0]))))
    assert main(["branches", str(scene), "--out", str(out)]) == 1
    assert "no stable equilibrium" in capsys.readouterr().out
    assert not out.exists()


def test_a_misspelt_joint_is_a_sentence(capsys):
    assert main(["branches", ARM, "--joint", "orientatoin=0"]) == 2
    assert "orientation" in capsys.readouterr().err
