"""`cable plot`: what it reads from a log and what it chooses to draw."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("matplotlib")
pytest.importorskip("sensor_msgs")

from cable_ros.batch import solve_many
from cable_ros.cli.main import main
from cable_ros.cli.plot import abscissa_values, chosen_shapes, leading_joint, moving_joints, with_gaps
from cable_ros.log.history import History, Trace, read_history, read_polyline
from cable_ros.plots import Abscissa
from cable_ros.scene import load_scene
from cable_ros.share import share_file

ARM = str(share_file("config", "space_arm.yaml"))


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("sweep") / "arm.mcap"
    assert main(["sweep", ARM, "--joint", "orientation=-90:90:5deg", "--out", str(path)]) == 0
    return path


def _history(names, rows, **more):
    rows = np.array(rows, dtype=float)
    wrenches = {"cable": Trace(np.arange(len(rows)), np.zeros((len(rows), 6)))}
    return History(tuple(names), Trace(np.arange(len(rows)), rows), wrenches, {}, **more)


def test_a_log_gives_back_what_was_solved(log):
    """Bit for bit: a log holds doubles."""
    history = read_history(log)
    angles = np.radians(np.arange(-90, 90.1, 5.0))
    batch = solve_many(load_scene(ARM), history.joints.values, polyline_points=101)
    assert history.joint_names == ("orientation",)
    assert history.joints.values[:, 0] == pytest.approx(angles, rel=1e-14)  # a few roundings of the degrees
    assert np.array_equal(history.end_wrenches["camera_cable"].values, batch.end_wrench[:, 0])
    time = int(history.polyline_times["camera_cable"][7])
    assert np.array_equal(read_polyline(log, "camera_cable", time), batch.points[7, 0])


def test_pictures(log, tmp_path, capsys):
    assert main(["plot", str(log), "--out", str(tmp_path / "pictures")]) == 0
    names = ["arm_shapes.png", "arm_end_wrench.png"]
    assert capsys.readouterr().out.split() == [str(tmp_path / "pictures" / name) for name in names]
    for name in names:
        assert (tmp_path / "pictures" / name).read_bytes().startswith(b"\x89PNG")


def test_shapes_are_at_round_angles(log):
    history = read_history(log)
    shapes = list(chosen_shapes(log, history, "orientation", Abscissa.of_joint("orientation")))
    assert [shape.label for shape in shapes] == ["-90°", "-60°", "-30°", "0°", "30°", "60°", "90°"]
    # The end clamp's place at 0 deg in the scene.
    assert shapes[3].points[-1] == pytest.approx([0.240, 0.145, 0.075], abs=1e-6)


def test_only_joints_that_move_a_clamp_count(log):
    assert moving_joints(log) == {"orientation": "revolute"}


def test_the_leading_joint_is_the_one_that_moves_most():
    history = _history(["wheel", "elbow", "wrist"], [[0, 0, 0], [9, 1, np.nan], [99, 1, 3]])
    assert leading_joint(history, ["elbow", "wrist"]) == "wrist"
    assert leading_joint(_history(["elbow"], [[1], [1]]), ["elbow"]) is None
    assert leading_joint(_history([], np.zeros((2, 0))), []) is None


def test_without_motion_it_is_the_time():
    history = _history(["elbow"], [[1], [1]])
    assert abscissa_values(history, None, np.array([0, 2_000_000_000])).tolist() == [0, 2]


def test_long_silences_are_gaps():
    asked = np.arange(0, 100)
    answered = np.array([0, 1, 2, 40, 41, 43, 44])
    trace = with_gaps(Trace(answered, np.ones((7, 6))), asked)
    assert np.isnan(trace.values).all(axis=1).tolist() == [
        False,
        False,
        False,
        True,
        False,
        False,
        False,
        False,
    ]


def test_a_log_without_wrenches(tmp_path, capsys):
    from cable_ros.log.writer import LogWriter

    with LogWriter(tmp_path / "empty.mcap"):
        pass
    assert main(["plot", str(tmp_path / "empty.mcap")]) == 2
    assert "holds no end wrench" in capsys.readouterr().err


def test_variations_are_no_log(tmp_path, capsys):
    options = ["--joint", "orientation=0", "--vary", "length=0.38,0.4", "--out", str(tmp_path / "arm.mcap")]
    assert main(["sweep", ARM, *options]) == 2
    assert "a log holds one scene" in capsys.readouterr().err
