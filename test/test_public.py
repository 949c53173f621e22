# SPDX-License-Identifier: Apache-2.0
"""What a person sees of the package in an interpreter."""

from __future__ import annotations

from importlib import metadata

import numpy as np

import cable_ros
from cable_ros.batch import solve_many
from cable_ros.share import share_file

BALL = share_file("config", "space_arm_sphere.yaml")


def test_names_are_listed():
    public = {name for name in dir(cable_ros) if not name.startswith("_")}
    assert set(cable_ros.__all__) <= public
    assert "import_module" not in public
    for name in cable_ros.__all__:
        assert getattr(cable_ros, name) is not None
    assert cable_ros.__version__ == metadata.version("cable_ros")


def test_results_are_shown_in_a_line():
    scene = cable_ros.load_scene(BALL)
    assert repr(scene) == f"Scene({BALL}; cables: camera_cable; obstacles: ball)"
    tracker = cable_ros.Tracker(scene, tolerance=1e-3)
    assert repr(tracker) == "Tracker(cables: camera_cable; joints: orientation; tolerance 0.001)"
    found = tracker.solve({"orientation": 0.0})["camera_cable"]
    force = ", ".join(f"{value:.4g}" for value in found.end_wrench[:3])
    assert repr(found).startswith(
        f"Equilibrium(CONVERGED, end force [{force}] N, 101 points, error estimate "
    )
    refused = tracker.solve({})["camera_cable"]
    assert repr(refused).startswith("Equilibrium(INVALID_INPUT, end force [nan, nan, nan] N")
    batch = solve_many(scene, np.array([0.0, 0.1]))
    assert repr(batch) == "Batch(2 poses of camera_cable; 2 can be trusted)"
