# SPDX-License-Identifier: Apache-2.0
"""The pictures: that they draw what they are given, to scale. How they look is for people to judge."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from cable_ros.drawing.figures import (
    Abscissa,
    Shape,
    load_figure,
    round_values,
    save,
    shapes_figure,
    wrench_figure,
)


def _shape(cable="cable", label="0°", value=0.0, shift=0.0):
    t = np.linspace(0, 1, 5)
    return Shape(cable, label, np.column_stack([0.3 * t + shift, 0.1 * t, -0.2 * t]), value)


def test_projections_are_to_scale():
    """One millimetre is as long in all three panels and both directions, and the shared axes line up."""
    figure = shapes_figure([_shape(), _shape(label="90°", value=90.0, shift=0.1)], "title")
    figure.draw_without_rendering()
    scales = []
    for axes in figure.axes[:3]:
        box = axes.get_window_extent()
        scales += [box.width / np.ptp(axes.get_xlim()), box.height / np.ptp(axes.get_ylim())]
    # A hundredth: the layout engine leaves the panels a few pixels apart in size.
    assert scales == pytest.approx([scales[0]] * 6, rel=1e-2)


def test_projections_hold_the_right_coordinates():
    shape = _shape()
    figure = shapes_figure([shape], "title")
    for axes, columns in zip(figure.axes[:3], ([0, 2], [1, 2], [0, 1]), strict=True):
        assert axes.lines[0].get_xydata() == pytest.approx(shape.points[:, columns] * 1e3)  # mm


def test_long_cables_are_drawn_in_metres():
    shape = Shape("cable", "0°", np.array([[0, 0, 0], [20.0, 0, 0]]), 0.0)
    assert shapes_figure([shape], "title").axes[0].get_xlabel() == "X (m)"


def test_wrench_components_and_units():
    values = np.array([0.0, np.pi / 2])
    wrench = np.array([[3.0, 4.0, 0, 0, 0, 0.012], [0, 0, 5.0, 0, 0, np.nan]])
    figure = wrench_figure(Abscissa.of_joint("elbow"), {"cable": (values, wrench)})
    force, moment = figure.axes
    lines = {line.get_label(): line.get_xydata() for axes in (force, moment) for line in axes.lines}
    assert lines["$F_x$"].tolist() == [[0, 3], [90, 0]]
    assert lines["$|F|$"].tolist() == [[0, 5], [90, 5]]
    assert lines["$M_z$"][0].tolist() == [0, 12]
    assert moment.get_ylabel() == "moment (mN m)"
    assert moment.get_xlabel() == "elbow (deg)"


def test_several_cables_have_a_column_each():
    both = {name: (np.arange(3.0), np.ones((3, 6))) for name in ("left", "right")}
    figure = wrench_figure(Abscissa.of_time(), both)
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["left", "right", "", ""]


def test_all_moments_have_one_unit():
    """Columns that are compared side by side would otherwise be a thousand apart."""
    weak, strong = np.full((2, 6), 0.01), np.full((2, 6), 3.0)
    figure = wrench_figure(
        Abscissa.of_time(), {"weak": (np.arange(2), weak), "strong": (np.arange(2), strong)}
    )
    assert [axes.get_ylabel() for axes in figure.axes[2:]] == ["moment (N m)"] * 2
    assert figure.axes[2].lines[1].get_ydata() == pytest.approx(weak[:, 3])


def test_round_values():
    assert round_values(-90, 90, 7).tolist() == [-90, -60, -30, 0, 30, 60, 90]
    assert round_values(-89.99, 89.99, 7).tolist() == [-90, -60, -30, 0, 30, 60, 90]
    assert np.all(np.diff(round_values(0.013, 0.42, 7)) > 0)


def test_save_makes_the_folder(tmp_path):
    path = save(shapes_figure([_shape()], "title"), tmp_path / "new" / "shapes.png")
    assert path.read_bytes().startswith(b"\x89PNG")


def test_torques_and_forces_have_axes_of_their_own():
    loads = {"elbow": np.array([0.001, np.nan]), "slide": np.array([2.0, 3.0]), "wrist": np.array([0.1, 0.2])}
    figure = load_figure(Abscissa.of_time(), np.array([0.0, 1.0]), loads, ["slide"])
    torque, force = figure.axes
    assert (torque.get_ylabel(), force.get_ylabel()) == ("torque (mN m)", "force (N)")
    lines = {line.get_label(): line.get_ydata() for axes in figure.axes for line in axes.lines}
    assert lines["elbow"][0] == pytest.approx(1.0)
    assert lines["wrist"] == pytest.approx([100.0, 200.0])
    assert lines["slide"].tolist() == [2.0, 3.0]
    (only,) = load_figure(Abscissa.of_time(), np.zeros(2), {"slide": np.ones(2)}, ["slide"]).axes
    assert only.get_ylabel() == "force (N)"
