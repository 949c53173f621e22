# SPDX-License-Identifier: Apache-2.0
"""`cable bench`: its table and picture, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros.bench import precision
from cable_ros.cli.bench import joint_path
from cable_ros.cli.main import main

TINY = precision.Size(
    tolerances=(1e-3,),
    bvp_tolerances=(1e-2,),
    parts=(40,),
    poses=4,
    references=2,
    gravity_numbers=(10.0,),
    cables=(1,),
)


def test_precision_writes_table_and_picture(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(precision, "QUICK", TINY)
    path = ["--joint", "orientation=0:3:1deg"]
    assert main(["bench", "precision", "--quick", "--out", str(tmp_path), *path]) == 0
    out = capsys.readouterr().out
    assert "processor" in out
    assert "numpy" in out
    for panel in ("warm", "cold", "effect", "gravity", "step", "cables"):
        assert f"\n{panel:8} cable_ros" in out
    assert (tmp_path / "precision.csv").read_text().startswith("# processor: ")
    assert (tmp_path / "precision.png").stat().st_size > 10_000


def test_unknown_joint_is_one_sentence(tmp_path, capsys):
    assert main(["bench", "precision", "--joint", "elbow=0:1:0.5", "--out", str(tmp_path)]) == 2
    err = capsys.readouterr().err
    assert "elbow" in err
    assert err.count("\n") == 1


def test_joints_move_together():
    path = joint_path([("a", np.array([0.0, 1.0])), ("b", np.array([0.0, 1.0, 4.0]))], ("b", "a"))
    assert path == pytest.approx(np.array([[0.0, 0.0], [2.0, 0.5], [4.0, 1.0]]))


def test_every_joint_goes_from_end_to_end_by_default():
    path = joint_path([], ("a", "b"))
    assert path.shape == (361, 2)
    assert path[0] == pytest.approx(np.radians([-90, -90]))
    assert np.diff(path, axis=0) == pytest.approx(np.radians(0.5))


def test_a_path_without_equilibrium_is_one_sentence(tmp_path, capsys):
    scene = tmp_path / "short.yaml"
    scene.write_text(
        "cables: [{name: a, length: 0.1, stiffness: [1e-3, 1e-3, 1e-3], linear_density: 0.1,\n"
        "  start: {position: [0, 0, 0], orientation: [0, 0, 0, 1]},\n"
        "  end: {position: [0.2, 0, 0], orientation: [0, 0, 0, 1]}}]\n"
        "gravity: [0, 0, -9.8]\n"
    )
    assert main(["bench", "precision", str(scene), "--quick", "--out", str(tmp_path)]) == 2
    err = capsys.readouterr().err
    assert "no equilibrium is found at the path's first pose" in err


def test_a_scene_without_joints_and_one_with_obstacles(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(precision, "QUICK", TINY)
    fixed = tmp_path / "fixed.yaml"
    fixed.write_text(
        "cables: [{name: a, length: 0.4, stiffness: [1.0e-3, 1.0e-3, 1.0e-3], linear_density: 0.1,\n"
        "  start: {position: [0, 0, 0], orientation: [0, 0, 0, 1]},\n"
        "  end: {position: [0.2, 0.1, 0.05], orientation: [0, 0, 0, 1]}}]\n"
        "gravity: [0, 0, -9.8]\n"
        "obstacles: [{name: ball, sphere: {center: [5, 5, 5], radius: 0.1}}]\n"
    )
    assert main(["bench", "precision", str(fixed), "--quick", "--out", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "solve_bvp" not in out
    assert "\nstep " not in out
    assert "integration of the rod's equations and cable_ros at 1e-09 agree within" in out
    assert (tmp_path / "precision.png").exists()
