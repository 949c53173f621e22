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
