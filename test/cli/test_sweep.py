# SPDX-License-Identifier: Apache-2.0
"""`cable sweep`: the rows it writes."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from cable_ros import Tracker, batch, load_scene
from cable_ros.cli.main import main
from cable_ros.cli.sweep import grid, same_branch
from cable_ros.joint import joint_torque
from cable_ros.scene import vary
from cable_ros.share import share_file

ARM = str(share_file("config", "space_arm.yaml"))
STRIPS = """
gravity: [0, 0, -9.8]
cables:
  - name: {name}
    length: 0.4
    stiffness: [1.0e-3, 1.0e-3, 7.0e-4]
    linear_density: 0.1
    start: {{position: [0, 0, 0], orientation: [0, 0, 0, 1]}}
    end: {{position: [0.2, 0.1, 0.05], orientation: [0, 0, 0, 1]}}
"""


def _rows(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def fixed(tmp_path):
    path = tmp_path / "fixed.yaml"
    path.write_text(STRIPS.format(name="strip"))
    return str(path)


def test_csv_holds_what_the_tracker_finds(tmp_path, capsys):
    out = tmp_path / "arm.csv"
    assert main(["sweep", ARM, "--joint", "orientation=-10:10:10deg", "--out", str(out)]) == 0
    assert "3 poses, 3 CONVERGED" in capsys.readouterr().out
    rows = _rows(out)
    assert [float(row["orientation"]) for row in rows] == pytest.approx(np.radians([-10, 0, 10]).tolist())
    wrench = Tracker(ARM).solve({"orientation": 0.0})["camera_cable"].end_wrench
    names = [f"end_{kind}_{axis}" for kind in ("force", "moment") for axis in "xyz"]
    # Each is within the default tolerance of 1e-4 of the truth.
    assert [float(rows[1][name]) for name in names] == pytest.approx(wrench.tolist(), rel=1e-3)


def test_joint_load_is_in_tables_and_logs(tmp_path):
    reader = pytest.importorskip("cable_ros.log.reader")
    pytest.importorskip("sensor_msgs", reason="logs hold ROS messages")
    table, log = tmp_path / "arm.csv", tmp_path / "arm.mcap"
    for out in (table, log):
        assert main(["sweep", ARM, "--joint", "orientation=-10:10:10deg", "--out", str(out)]) == 0
    tabled = [float(row["load_orientation"]) for row in _rows(table)]
    with reader.LogReader(log) as opened:
        logged = [message for _, message in opened.decoded(["/cable_node/joint_load"])]
    assert [list(message.name) for message in logged] == [["orientation"]] * 3
    assert [message.position[0] for message in logged] == pytest.approx(np.radians([-10, 0, 10]).tolist())
    tracker = Tracker(ARM)
    for angle, ours, theirs in zip(np.radians([-10, 0, 10]), tabled, logged, strict=True):
        joints = {"orientation": float(angle)}
        wanted = joint_torque(tracker, tracker.solve(joints), joints)
        # Each is within the default tolerance of 1e-4 of the truth.
        assert [ours] == pytest.approx(wanted, rel=1e-3)
        assert theirs.effort[0] == pytest.approx(ours, rel=1e-6)  # the log's polylines ask for finer meshes


def test_a_joint_that_is_not_named_is_0_and_told(tmp_path, capsys):
    out = tmp_path / "arm.csv"
    assert main(["sweep", ARM, "--out", str(out)]) == 0
    assert "cable sweep: 0 for the joint orientation, not named\n" in capsys.readouterr().err
    (row,) = _rows(out)
    assert float(row["orientation"]) == 0.0
    assert main(["sweep", ARM, "--joint", "elbow=1", "--out", str(tmp_path / "other.csv")]) == 2
    assert "'elbow' moves no cable" in capsys.readouterr().err


def test_varied_fields_are_columns_and_multiply(tmp_path, fixed):
    out = tmp_path / "strip.csv"
    varied = ["--vary", "length=0.4,0.45", "--vary", "strip.linear_density=0.05:0.15:0.05"]
    assert main(["sweep", fixed, *varied, "--out", str(out)]) == 0
    pairs = [(float(row["length"]), float(row["strip.linear_density"])) for row in _rows(out)]
    expected = [(length, density) for length in (0.4, 0.45) for density in (0.05, 0.1, 0.15)]
    # A range's values are sums of its step, a few roundings from the decimals.
    assert np.allclose(pairs, expected, rtol=1e-14, atol=0)


def test_untrusted_rows_have_a_status_and_no_numbers(tmp_path, fixed):
    out = tmp_path / "strip.csv"
    assert main(["sweep", fixed, "--vary", "length=0.4,0.1", "--out", str(out)]) == 0
    first, second = _rows(out)
    assert first["status"] == "CONVERGED"
    assert second["status"] == "OUT_OF_REACH"
    assert second["end_force_x"] == second["energy"] == ""


def test_parquet_holds_the_same_as_csv(tmp_path):
    try:
        from pyarrow import parquet
    except ImportError as error:  # not there, or one that needs another NumPy
        pytest.skip(str(error))
    names = [tmp_path / "arm.csv", tmp_path / "arm.parquet"]
    for out in names:
        assert main(["sweep", ARM, "--joint", "orientation=-90:90:10deg", "--out", str(out)]) == 0
    table = parquet.read_table(names[1]).to_pydict()
    for index, row in enumerate(_rows(names[0])):
        for column, text in row.items():
            assert str(table[column][index]) == text


def test_a_failed_sweep_leaves_no_file(tmp_path, capsys, fixed):
    out = tmp_path / "strip.csv"
    assert main(["sweep", fixed, "--vary", "length=0.4,-1", "--out", str(out)]) == 2
    assert "length" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["fixed.yaml"]


def test_unknown_suffix(tmp_path, capsys, fixed):
    assert main(["sweep", fixed, "--out", str(tmp_path / "strip.xlsx")]) == 2
    assert ".csv, .parquet or .mcap" in capsys.readouterr().err


def test_an_installed_scene_needs_no_path(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert (
        main(["sweep", "space_arm.yaml", "--joint", "orientation=0", "--out", "arm.csv", "--jobs", "1"]) == 0
    )
    assert "1 CONVERGED; 1 process," in capsys.readouterr().out
    # one beside the user comes first
    (tmp_path / "space_arm.yaml").write_text("")
    assert main(["sweep", "space_arm.yaml", "--joint", "orientation=0", "--out", "other.csv"]) == 2
    assert "the file is empty" in capsys.readouterr().err


def test_grid_has_its_columns_in_the_tracker_s_order():
    ranges = [("slow", np.array([1.0, 2.0])), ("fast", np.array([5.0, 6.0, 7.0]))]
    paths = grid(ranges, ("fast", "slow"))
    assert [path.tolist() for path in paths] == [[[5, 1], [6, 1], [7, 1]], [[5, 2], [6, 2], [7, 2]]]
    assert grid([], ())[0].shape == (1, 0)


def test_variants_start_on_the_branch_of_the_first(fixed):
    """Without a target twist each would take its own least energy; the first one's twist is handed on."""
    scene = load_scene(fixed)
    scenes = [vary(scene, {"length": length}) for length in (0.4, 0.45)]
    first, second = same_branch(scenes, np.empty(0))
    assert first.cables[0].total_twist is None
    assert second.cables[0].total_twist == Tracker(scene).solve({})["strip"].total_twist
    hinted = [vary(one, {"total_twist": 1.0}) for one in scenes]
    assert [one.cables[0].total_twist for one in same_branch(hinted, np.empty(0))] == [1.0, 1.0]


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mcap"])
def test_nothing_is_overwritten(tmp_path, capsys, suffix):
    if suffix != ".csv":
        pytest.importorskip("pyarrow" if suffix == ".parquet" else "rclpy")
    out = tmp_path / f"arm{suffix}"
    out.write_text("mine")
    assert main(["sweep", ARM, "--joint", "orientation=0", "--out", str(out)]) == 2
    assert "it exists already and is not overwritten; choose another name" in capsys.readouterr().err
    assert out.read_text() == "mine"


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".mcap"])
def test_an_interrupted_sweep_leaves_no_file(tmp_path, monkeypatch, capsys, suffix):
    if suffix != ".csv":
        pytest.importorskip("pyarrow" if suffix == ".parquet" else "rclpy")
    whole = batch.solve_paths

    def interrupted(*arguments):
        yield next(whole(*arguments))
        raise KeyboardInterrupt

    monkeypatch.setattr(batch, "solve_paths", interrupted)
    out = tmp_path / f"arm{suffix}"
    assert main(["sweep", ARM, "--joint", "orientation=0:1:0.5", "--out", str(out)]) == 130
    assert list(tmp_path.iterdir()) == []
    assert "interrupted" in capsys.readouterr().err


def test_limits_are_columns_of_the_scenes_that_have_them(tmp_path, fixed):
    scene = tmp_path / "limited.yaml"
    scene.write_text(STRIPS.format(name="strip") + "    limits: {bend_radius: 0.05}\n")
    tables = []
    for path in (fixed, str(scene)):
        out = tmp_path / f"{len(tables)}.csv"
        assert main(["sweep", path, "--vary", "linear_density=0.1,0.2", "--out", str(out)]) == 0
        tables.append(_rows(out))
    columns = [name for name in tables[1][0] if name not in tables[0][0]]
    quantities = ("bend_radius", "tension", "torsion", "clearance")
    assert columns == [name for quantity in quantities for name in (quantity, f"{quantity}_at")]
    found = Tracker(load_scene(scene)).solve({})["strip"].extremes
    # Each is within the default tolerance of 1e-4 of the truth.
    assert float(tables[1][0]["bend_radius"]) == pytest.approx(found[0].value, rel=1e-3)
    assert 0.0 <= float(tables[1][0]["bend_radius_at"]) <= 0.4
    for one, other in zip(*tables, strict=True):
        assert {name: other[name] for name in one} == one
