# SPDX-License-Identifier: Apache-2.0
"""Properties of any cable, by hypothesis with a fixed budget: verified or reported, never silently wrong."""

from __future__ import annotations

import math
import re

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from zoo_make import ARM

from cable_ros import Status, Tracker, load_scene
from cable_ros.bench.cases import Case, run_case
from cable_ros.bench.contact_fuzz import contact_case
from cable_ros.bench.fuzz import cold_case, tracked_case

# The same examples in every run, so that CI cannot fail by chance; `cable bench robustness` looks further.
budget = settings(
    max_examples=40,
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)

directions = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1)
rotations = st.tuples(*[st.floats(-3.1, 3.1)] * 3).map(lambda v: Rotation.from_rotvec(v).as_quat().tolist())


@st.composite
def scenes(draw: st.DrawFn) -> dict:
    """Any cable between any clamps: hypothesis shrinks a failure to a simple one."""
    length = draw(st.sampled_from([0.05, 0.38, 1.0, 20.0]))
    bending = draw(st.sampled_from([1e-5, 1e-3, 1.0]))
    ratio = draw(st.floats(0.3, 3.0))
    gravity_number = draw(st.floats(0, 300))
    chord = draw(st.floats(0.05, 0.98))
    towards = np.array(draw(directions))
    down = np.array(draw(directions))
    end = chord * length * towards / np.linalg.norm(towards)
    weight = gravity_number * bending / length**3 * down / np.linalg.norm(down)
    cable = {
        "name": "cable",
        "length": length,
        "stiffness": [bending, bending, ratio * bending],
        "linear_density": 1.0,
        "start": {"position": [0.0, 0.0, 0.0], "orientation": draw(rotations)},
        "end": {"position": end.tolist(), "orientation": draw(rotations)},
    }
    twist = draw(st.none() | st.floats(-2 * math.pi, 2 * math.pi))
    if twist is not None:
        cable["total_twist"] = twist
    return {"gravity": weight.tolist(), "cables": [cable]}


@budget
@given(scenes())
def test_any_cold_start_is_a_verified_equilibrium(scene: dict) -> None:
    outcome = run_case(Case("any", "verified", scene))
    assert outcome.passed, outcome.fault


@budget
@given(st.integers(0, 10**6))
def test_random_cables_of_the_fuzz_run(index: int) -> None:
    outcome = run_case(cold_case(11, index, 1e-4))
    assert outcome.passed, outcome.fault


@settings(budget, max_examples=8)
@given(st.integers(0, 10**6))
def test_random_paths_of_the_fuzz_run(index: int) -> None:
    outcome = run_case(tracked_case(11, index, 1e-4, steps=40))
    assert outcome.passed, outcome.fault


@settings(budget, max_examples=25)
@given(scenes(), st.sampled_from([1e-2, 1e-4, 1e-6, 1e-8]))
def test_any_tolerance_is_kept(scene: dict, tolerance: float) -> None:
    outcome = run_case(Case("any", "verified", scene, tolerance=tolerance))
    assert outcome.passed, outcome.fault


@settings(budget, max_examples=10)
@given(st.integers(0, 10**6))
def test_random_scenes_with_obstacles_say_what_they_touch(index: int) -> None:
    # What is published among obstacles: finite, pushes only, inside the cone, on the surface, nothing inside.
    outcome = run_case(contact_case(11, index, 1e-4, steps=3))
    assert len(outcome.steps) == 3, outcome.fault
    for step in outcome.steps:
        if step.equilibrium.status.trusted:
            assert not re.search("pull|cone|off the surface|inside|finite|normal", step.fault or ""), (
                step.fault
            )


values = st.floats(allow_nan=True, allow_infinity=True) | st.none() | st.text(max_size=3) | st.floats(-4, 4)


@settings(budget, max_examples=15)
@given(st.lists(st.dictionaries(st.sampled_from(["orientation", "pitch", "x"]), values), max_size=6))
def test_no_joint_state_raises_or_publishes_nonsense(path: list[dict]) -> None:
    tracker = Tracker(load_scene(ARM))
    for joints in [*path, {"orientation": 0.2}]:
        (found,) = tracker.solve(joints).values()
        if found.status.trusted:
            assert np.all(np.isfinite(found.end_wrench))
            assert np.all(np.isfinite(found.points))
            assert np.isfinite(float(joints["orientation"]))
        else:
            assert found.message
    # The pose of the arm's everyday range is solved, whatever came before.
    assert found.status in (Status.CONVERGED, Status.SNAPPED)
