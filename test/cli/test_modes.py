# SPDX-License-Identifier: Apache-2.0
"""`cable modes`: what it prints, and what it says where nothing swings."""

from __future__ import annotations

import json

import numpy as np
import pytest

from cable_ros.cli.main import main
from cable_ros.share import share_file

ARM = str(share_file("config", "space_arm.yaml"))
STRIP = """
gravity: [0, 0, 0]
cables:
  - name: strip
    length: 0.4
    stiffness: [1.0e-3, 1.0e-3, 7.0e-4]
    linear_density: {density}
    start: {{position: [0, 0, 0], orientation: [0, 0, 0, 1]}}
    end: {{position: [0.2, 0.1, {z}], orientation: [0, 0, 0, 1]}}
"""


def test_json_has_frequencies_and_shapes(capsys):
    assert main(["modes", ARM, "--joint", "orientation=90deg", "--count", "3", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["camera_cable"]
    # Of an independent computation, three digits.
    assert found["frequencies"][0] == pytest.approx(1.95, rel=3e-3)
    assert np.shape(found["shapes"]) == (3, 101, 3)
    sizes = np.linalg.norm(found["shapes"], axis=2)
    np.testing.assert_allclose(sizes.max(axis=1), 1.0)
    # Clamps stand still.
    np.testing.assert_allclose(sizes[:, [0, -1]], 0.0, atol=1e-9)


def test_a_table_for_a_person(capsys):
    assert main(["modes", ARM, "--joint", "orientation=0", "--count", "2"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("camera_cable: Converged")
    rows = [line.split() for line in lines if line.strip()[:1] in ("1", "2")]
    assert [row[0] for row in rows] == ["1", "2"]
    assert all(sum(float(row[i]) for i in (-6, -4, -2)) == pytest.approx(100.0, abs=2.0) for row in rows)


def test_a_cable_in_a_ring_has_them(tmp_path, capsys):
    path = tmp_path / "strip.yaml"
    ring = "    supports: [{name: eye, ring: {arc_length: 0.2, position: [0.1, 0.05, 0.05]}}]\n"
    path.write_text(STRIP.format(density=0.1, z=0.1) + ring)
    assert main(["modes", str(path), "--count", "2", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["strip"]
    assert 0.0 < found["frequencies"][0] < found["frequencies"][1]
    np.testing.assert_allclose(np.linalg.norm(found["shapes"], axis=2).max(axis=1), 1.0)


def test_what_is_not_known_is_told(tmp_path, capsys):
    """A cable that stretches and rubs on the ground."""
    path = tmp_path / "strip.yaml"
    ground = "obstacles: [{name: ground, plane: {point: [0, 0, -0.01], normal: [0, 0, 1]}, friction: 0.3}]\n"
    rope = STRIP.format(density=0.1, z=0.0).replace("gravity: [0, 0, 0]", "gravity: [0, 0, -9.81]")
    path.write_text(ground + rope + "    axial_stiffness: 100.0\n")
    assert main(["modes", str(path)]) == 0
    assert "stretches where it rubs" in capsys.readouterr().out


def test_without_mass_nothing_swings(tmp_path, capsys):
    path = tmp_path / "strip.yaml"
    path.write_text(STRIP.format(density=0.0, z=0.05))
    assert main(["modes", str(path)]) == 0
    assert "it has no mass" in capsys.readouterr().out
    assert main(["modes", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["strip"] == {"frequencies": [None] * 6, "shapes": None}


def test_what_has_no_equilibrium_is_told(tmp_path, capsys):
    path = tmp_path / "strip.yaml"
    path.write_text(STRIP.format(density=0.1, z=0.5))
    assert main(["modes", str(path)]) == 1
    heard = capsys.readouterr()
    assert heard.out == ""
    assert heard.err.startswith("cable modes: strip: The clamps are ")
    assert main(["modes", ARM, "--count", "0"]) == 2
    assert "'0' is not a whole number from 1 to 1000" in capsys.readouterr().err
