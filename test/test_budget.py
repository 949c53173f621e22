"""What a solve among obstacles may cost: it ends by counted work, in an honest report."""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros import Equilibrium, Status, Tracker, follower, load_scene
from cable_ros.bench.carriage import on_carriage
from cable_ros.scene import Scene
from cable_ros.statics.touching import TouchingRod

ALONG = [0.0, 0.0, 0.0, 1.0]


def past_a_ball(radius: float) -> tuple[Scene, dict[str, float]]:
    """A cable of 1 m, 0.8 m from clamp to clamp, past a ball 0.45 m from its start; and the joints there."""
    cable = {
        "name": "cable",
        "length": 1.0,
        "stiffness": [0.01, 0.01, 0.007],
        "linear_density": 0.05,
        "start": {"position": [0.0, 0.0, 0.0], "orientation": ALONG},
        "end": {"position": [0.0, 0.0, 0.8], "orientation": ALONG},
    }
    ball = {"name": "ball", "sphere": {"center": [0.0, 0.0, 0.45], "radius": radius}}
    moved, urdf, home = on_carriage({"gravity": [-9.81, 0.0, 0.0], "cables": [cable], "obstacles": [ball]})
    return load_scene(moved, urdf=urdf), home


def test_a_pose_out_of_reach_is_not_walked_to(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two tangents and an arc are 0.93 m at first, 1.02 m at the pose that is asked for then."""
    scene, home = past_a_ball(0.225)
    tracker = Tracker(scene)
    before = tracker.solve(home)["cable"]
    assert before.status is Status.CONVERGED
    monkeypatch.setattr(follower, "walk", None)  # calling it would raise
    far = tracker.solve({**home, "z": 0.92})["cable"]
    assert far.status is Status.OUT_OF_REACH
    assert "'cable' is too short to get past obstacle 'ball'" in far.message
    # what comes next goes on from the last equilibrium
    again = tracker.solve(home)["cable"]
    assert again.status is Status.CONVERGED
    # the iteration stops at a thousandth of the tolerance of 1e-4
    assert np.abs(again.end_wrench - before.end_wrench).max() < 1e-6 * np.abs(before.end_wrench).max()


def solved(joints: list[dict[str, float]], scene: Scene) -> list[Equilibrium]:
    tracker = Tracker(scene)
    return [tracker.solve(one)["cable"] for one in joints]


def test_a_way_that_takes_too_much_is_solved_anew_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, home = past_a_ball(0.1)
    path = [home, {**home, "z": 0.3, "x": -0.4, "pitch": 1.0}]
    there = solved(path, scene)[-1]
    assert there.status.trusted
    monkeypatch.setattr(follower, "WORK", 0)
    anew = solved(path, scene)[-1]
    assert anew.status is Status.BRANCH_LOST
    assert not anew.converged
    assert "solved anew" in anew.message
    again = solved(path, scene)[-1]
    assert np.array_equal(anew.end_wrench, again.end_wrench)


def test_work_is_counted() -> None:
    """As many as its iterations times its unknowns, whatever the clock says."""
    scene, home = past_a_ball(0.225)
    tracker = Tracker(scene)
    tracker.solve(home)
    rod = tracker._followers[0].rod
    assert isinstance(rod, TouchingRod)
    assert rod.count > 0
    found = tracker.solve({**home, "x": 1e-3})["cable"]
    assert found.status is Status.CONVERGED
    assert found.iterations > 0
    assert follower.WORK - rod.work == found.iterations * rod.elastic.shape[0]
