# SPDX-License-Identifier: Apache-2.0
"""Where supports' sections are at the next pose: against a motion in closed form, and by what it saves."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from test_supports import supported_arm

from cable_ros import Tracker
from cable_ros.branch.coupled_state import Shared
from cable_ros.branch.prediction import Step, predicted
from cable_ros.equilibrium import Status

ALONG = np.array([1.0, -0.5])
"""Direction in which two joints move."""


def rolling(t: float) -> Shared:
    """A section that turns about an axis which turns itself, and slides."""
    turn = Rotation.from_rotvec([0.0, 0.3 * np.sin(t), 0.2]) * Rotation.from_rotvec([0.7 * np.cos(t), t, 0.0])
    return Shared(turn.as_quat(scalar_first=True)[None], np.array([0.5 + 0.1 * np.sin(2.0 * t)]))


def steps(times: list[float]) -> tuple[Step, ...]:
    pairs = itertools.pairwise(times)
    return tuple(Step((b - a) * ALONG, rolling(a).step_to(rolling(b))) for a, b in pairs)[::-1]


@pytest.mark.parametrize(("known", "order"), [(1, 2), (2, 3)])
def test_the_error_is_of_the_order_that_the_known_steps_allow(known, order):
    errors = []
    for h in (0.02, 0.01):
        times = [1.0 - 1.5 * h, 1.0 - h, 1.0][-known - 1 :]  # steps of different lengths
        change = predicted(steps(times), 1.2 * h * ALONG)
        assert change is not None
        at = rolling(1.0).moved(change)
        errors.append(np.abs(at.step_to(rolling(1.0 + 1.2 * h))).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.15)


@pytest.mark.parametrize(
    "motion", [-0.01 * ALONG, 0.03 * ALONG, 0.01 * np.array([0.5, 1.0])], ids=["back", "far", "aside"]
)
def test_a_motion_that_does_not_go_on_is_not_predicted(motion):
    assert predicted(steps([0.98, 0.99, 1.0]), motion) is None
    assert predicted((), motion) is None


def test_a_kink_is_led_on_by_the_last_step_alone():
    last = Step(0.01 * ALONG, np.array([0.0, 0.0, 0.02, 0.003]))
    change = predicted((last, Step(0.01 * ALONG, np.zeros(4))), 0.01 * ALONG)
    np.testing.assert_allclose(change, last.change, rtol=1e-12)


def test_on_a_smooth_path_each_piece_is_solved_once_a_pose():
    tracker = Tracker(supported_arm("ring", None))
    iterations = []
    for gamma in np.arange(0.0, 0.2, 0.002):
        (found,) = tracker.solve({"orientation": gamma, "pitch": 0.0}).values()
        assert found.status is Status.CONVERGED
        iterations.append(found.iterations)
    assert set(iterations[10:]) == {2}  # by the last step alone every third pose takes another one
