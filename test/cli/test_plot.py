# SPDX-License-Identifier: Apache-2.0
"""`cable plot`: what it reads from a log and what it chooses to draw."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("matplotlib")
pytest.importorskip("sensor_msgs")

from cable_ros.batch import solve_many
from cable_ros.cli.main import main
from cable_ros.cli.plot import abscissa_values, chosen_shapes, leading_joint, moving_joints, scene_of
from cable_ros.drawing.figures import Abscissa
from cable_ros.log.history import History, read_history, read_polyline
from cable_ros.scene import load_scene
from cable_ros.share import share_file

ARM = share_file("config", "space_arm.yaml")


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("sweep") / "arm.mcap"
    assert main(["sweep", str(ARM), "--joint", "orientation=-90:90:5deg", "--out", str(path)]) == 0
    return path


def _history(names, rows):
    rows = np.array(rows, dtype=float)
    times = 5_000_000_000 + 10_000_000 * np.arange(len(rows))
    return History(tuple(names), times, rows, {"cable": np.zeros((len(rows), 6))}, {})


def test_a_log_gives_back_what_was_solved(log):
    """Bit for bit: a log holds doubles."""
    history = read_history(log)
    angles = np.radians(np.arange(-90, 90.1, 5.0))
    batch = solve_many(load_scene(ARM), history.joints, polyline_points=101)
    assert history.joint_names == ("orientation",)
    assert history.joints[:, 0] == pytest.approx(angles, rel=1e-14)  # a few roundings of the degrees
    assert np.array_equal(history.end_wrenches["camera_cable"], batch.end_wrench[:, 0])
    assert history.polylines["camera_cable"].tolist() == list(range(37))
    assert np.array_equal(read_polyline(log, "camera_cable", int(history.times[7])), batch.points[7, 0])


def test_what_was_not_trusted_is_a_gap(tmp_path):
    scene = tmp_path / "short.yaml"
    text = ARM.read_text().replace("space_arm.urdf", str(ARM.parent / "space_arm.urdf"))
    scene.write_text(text.replace("length: 0.380", "length: 0.315"))  # out of reach around -60 deg
    out = tmp_path / "short.mcap"
    assert main(["sweep", str(scene), "--joint", "orientation=-90:0:10deg", "--out", str(out)]) == 0
    history = read_history(out)
    silent = np.isnan(history.end_wrenches["camera_cable"]).all(axis=1)
    end = {angle: np.linalg.norm(_end_clamp(np.radians(angle))) for angle in range(-90, 1, 10)}
    assert silent.tolist() == [distance > 0.315 for distance in end.values()]
    assert 0 < silent.sum() < 10


def _end_clamp(angle):
    """(47) of the paper, m."""
    s, c = np.sin(angle), np.cos(angle)
    return [0.160 - 0.145 * s + 0.080 * c, 0.080 * s + 0.145 * c, 0.075]


def test_pictures(log, tmp_path, capsys):
    assert main(["plot", str(log), "--out", str(tmp_path / "pictures")]) == 0
    names = ["arm_shapes.png", "arm_end_wrench.png", "arm_joint_load.png"]
    assert capsys.readouterr().out.split() == [str(tmp_path / "pictures" / name) for name in names]
    for name in names:
        assert (tmp_path / "pictures" / name).read_bytes().startswith(b"\x89PNG")


def test_the_joint_load_is_read_with_its_solves(log):
    history = read_history(log)
    batch = solve_many(load_scene(ARM), history.joints, polyline_points=101)
    assert list(history.joint_load) == ["orientation"]
    assert np.array_equal(history.joint_load["orientation"], batch.joint_load[:, 0])


def _drawn(monkeypatch, log, tmp_path, *options):
    """The figures that a command draws, by the ends of their files' names."""
    from cable_ros.drawing import figures

    drawn = {}
    save = figures.save
    monkeypatch.setattr(figures, "save", lambda figure, path: save(drawn.setdefault(path.stem, figure), path))
    assert main(["plot", str(log), "--out", str(tmp_path), *options]) == 0
    return {name.removeprefix(f"{log.stem}_"): figure for name, figure in drawn.items()}


def test_against_the_time(log, tmp_path, monkeypatch):
    drawn = _drawn(monkeypatch, log, tmp_path, "--against", "time")
    assert drawn["end_wrench"].axes[-1].get_xlabel() == "time (s)"
    (load,) = drawn["joint_load"].axes
    assert load.get_xlabel() == "time (s)"
    assert load.lines[1].get_xdata() == pytest.approx(0.01 * np.arange(37))  # a sweep's poses: 10 ms
    labels = [text.get_text() for text in drawn["shapes"].axes[3].get_legend().get_texts()]
    assert labels[:2] == ["0 s", "0.1 s"]


def test_against_a_joint(log, tmp_path, monkeypatch, capsys):
    drawn = _drawn(monkeypatch, log, tmp_path, "--against", "orientation")
    assert drawn["end_wrench"].axes[-1].get_xlabel() == "orientation (deg)"
    assert main(["plot", str(log), "--against", "elbow"]) == 2
    assert (
        "--against elbow: the log has no such joint; there are orientation, time" in capsys.readouterr().err
    )


def test_what_a_link_carries_is_drawn_where_it_is(tmp_path, monkeypatch):
    """A ball on the turret, beside the cable: at each pose the turret's axis has moved it on its circle."""
    scene = tmp_path / "carrying.yaml"
    text = ARM.read_text().replace("space_arm.urdf", str(ARM.parent / "space_arm.urdf"))
    ball = "{name: ball, link: turret, sphere: {center: [0.1, 0.0, 0.2], radius: 0.02}}"
    scene.write_text(f"{text}\nobstacles: [{ball}]\n")
    log = tmp_path / "carrying.mcap"
    assert main(["sweep", str(scene), "--joint", "orientation=0,90deg", "--out", str(log)]) == 0
    xoy = _drawn(monkeypatch, log, tmp_path)["shapes"].axes[2]
    centres = [patch.get_path().vertices[:-1].mean(axis=0) for patch in xoy.patches]
    assert len(centres) >= 2
    # The turret turns about z through (160, 0) mm.
    assert centres[0] == pytest.approx([260, 0], abs=0.1)
    assert centres[-1] == pytest.approx([160, 100], abs=0.1)


def test_shapes_are_at_round_angles(log):
    history = read_history(log)
    shapes = list(chosen_shapes(log, history, history.joints[:, 0], Abscissa.of_joint("orientation")))
    assert [shape.label for shape in shapes] == ["-90°", "-60°", "-30°", "0°", "30°", "60°", "90°"]
    # The end clamp's place at 0 deg in the scene.
    assert shapes[3].points[-1] == pytest.approx([0.240, 0.145, 0.075], abs=1e-6)


def test_only_joints_that_move_a_clamp_count(log):
    assert moving_joints(scene_of(log)) == {"orientation": "revolute"}


def test_the_leading_joint_is_the_one_that_moves_most():
    history = _history(["wheel", "elbow", "wrist"], [[0, 0, 0], [9, 1, np.nan], [99, 1, 3]])
    assert leading_joint(history, ["elbow", "wrist"]) == "wrist"
    assert leading_joint(_history(["elbow"], [[1], [1]]), ["elbow"]) is None
    assert leading_joint(_history([], np.zeros((2, 0))), []) is None


def test_without_motion_it_is_the_time():
    assert abscissa_values(_history(["elbow"], [[1], [1]]), None).tolist() == [0, 0.01]


def test_a_log_without_wrenches(tmp_path, capsys):
    from cable_ros.log.writer import LogWriter

    with LogWriter(tmp_path / "empty.mcap"):
        pass
    assert main(["plot", str(tmp_path / "empty.mcap")]) == 2
    assert "holds no wrench" in capsys.readouterr().err


def test_variations_are_no_log(tmp_path, capsys):
    options = ["--joint", "orientation=0", "--vary", "length=0.38,0.4", "--out", str(tmp_path / "arm.mcap")]
    assert main(["sweep", str(ARM), *options]) == 2
    assert "a log holds one scene" in capsys.readouterr().err


def test_limits_are_logged_and_drawn(tmp_path, capsys):
    scene = tmp_path / "limited.yaml"
    text = ARM.read_text().replace("space_arm.urdf", str(ARM.parent / "space_arm.urdf"))
    scene.write_text(f"{text}\n    limits: {{bend_radius: 0.04, tension: 0.3}}\n")
    out = tmp_path / "limited.mcap"
    assert main(["sweep", str(scene), "--joint", "orientation=-90:90:30deg", "--out", str(out)]) == 0
    history = read_history(out)
    batch = solve_many(load_scene(scene), history.joints, polyline_points=101)
    uses = history.limit_use["camera_cable"]
    assert list(uses) == ["bend radius", "tension"]
    # Six digits are logged.
    np.testing.assert_allclose(uses["bend radius"], 0.04 / batch.extremes[:, 0, 0, 0], rtol=1e-5)
    np.testing.assert_allclose(uses["tension"], batch.extremes[:, 0, 1, 0] / 0.3, rtol=1e-5)
    capsys.readouterr()
    assert main(["plot", str(out)]) == 0
    assert str(tmp_path / "limited_limits.png") in capsys.readouterr().out.splitlines()
    assert (tmp_path / "limited_limits.png").stat().st_size > 10_000


def test_a_log_without_limits_draws_none(log, tmp_path, capsys):
    assert read_history(log).limit_use == {}
    assert main(["plot", str(log), "--out", str(tmp_path)]) == 0
    assert "arm_limits.png" not in capsys.readouterr().out
