# SPDX-License-Identifier: Apache-2.0
"""What is measured for work against precision: rows, references, table."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from cable_ros.bench.precision import Bench, Size, write_csv
from cable_ros.scene import load_scene
from cable_ros.share import share_file

TINY = Size(
    tolerances=(1e-3, 1e-7),
    bvp_tolerances=(1e-2, 1e-6),
    parts=(40, 160),
    poses=6,
    references=2,
    gravity_numbers=(0.0, 50.0),
    cables=(2,),
)
PATH = np.radians(np.linspace(0.0, 2.5, 6))[:, None]


@pytest.fixture(scope="module")
def scene():
    return load_scene(share_file("config", "space_arm.yaml"))


@pytest.fixture(scope="module")
def measured(scene):
    ticks: list[str] = []
    bench = Bench(scene, PATH, TINY, ticks.append)
    return bench, list(bench.rows()), ticks


def errors(rows, panel, method):
    return [row.error for row in rows if row.panel == panel and row.method == method]


@pytest.mark.parametrize("panel", ["warm", "cold"])
def test_each_method_is_as_accurate_as_it_says(measured, panel):
    _, rows, _ = measured
    for row in rows:
        if row.panel == panel and row.method == "cable_ros":
            assert row.error <= row.value
            assert row.failed == 0
    loose, tight = errors(rows, panel, "solve_bvp")
    assert loose < 1e-2  # its tolerance bounds the residual, of which the wrench sees a part
    assert tight < 1e-6


def test_the_published_differences_converge_at_first_order_at_best(measured):
    _, rows, _ = measured
    coarse, fine = errors(rows, "warm", "published method")
    # four times the parts: a quarter of the error, or more where the valley of |v|^2 stops it early
    assert 0.2 * coarse < fine < coarse


def test_references_lie_far_below_the_plotted_errors(measured):
    bench, rows, _ = measured
    assert bench.agreement < 0.1 * min(row.error for row in rows if row.panel in ("warm", "cold"))


def test_the_rows_of_every_panel_and_a_tick_for_every_stretch(measured):
    bench, rows, ticks = measured
    panels = [row.panel for row in rows]
    assert sorted(set(panels)) == ["cables", "cold", "effect", "gravity", "step", "warm"]
    assert {row.setting for row in rows if row.panel == "gravity"} == {"w L^3/EI = 0", "w L^3/EI = 50"}
    # the progress bar's total is an estimate: effects and references may come and go
    assert len(ticks) == pytest.approx(bench.ticks(), rel=0.25)
    for row in rows:
        assert 0 < row.seconds <= row.seconds_90
        # a baseline may fail at every pose, on some processors: then it has no error
        assert row.failed == row.poses or row.error_median <= row.error


def test_the_tracker_of_several_cables_is_timed_per_cable(measured):
    _, rows, _ = measured
    (two,) = (row for row in rows if row.panel == "cables")
    assert two.setting == "2 cables"
    assert two.error <= 1e-4


def test_csv_has_the_facts_then_the_rows(measured, tmp_path):
    _, rows, _ = measured
    write_csv(tmp_path / "new" / "table.csv", rows, {"processor": "some, or other"})
    lines = (tmp_path / "new" / "table.csv").read_text().splitlines()
    assert lines[0] == "# processor: some, or other"
    table = list(csv.DictReader(lines[1:]))
    assert len(table) == len(rows)
    assert float(table[0]["error"]) == pytest.approx(rows[0].error, rel=1e-3)


def test_references_of_a_cable_that_touches_are_integrated():
    scene = load_scene(share_file("config", "space_arm_sphere.yaml"))
    path = np.radians([[60.0], [60.5], [61.0]])
    bench = Bench(scene, path, TINY, lambda _: None)
    poses = bench.poses(scene, path, 3, 1e-10)
    assert (bench.verified, bench.unverified) == (3, 0)
    # of two programs that share nothing, one at 1e-9: near, and not the same numbers
    assert 0.0 < bench.agreement < 1e-8
    assert all(pose.reference is not None for pose in poses)
    assert "with the friction forces of cable_ros" in bench.provenance
