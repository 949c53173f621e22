# SPDX-License-Identifier: Apache-2.0
"""Contacts that depend on each other: nobody knows what each bears, and the answer says so."""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros import Status, Tracker
from cable_ros.bench.cases import case_scene
from cable_ros.bench.drawn import drawn_case
from cable_ros.rod import error_estimate


def test_an_error_that_is_not_known_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two points at one place made a singular matrix of the estimate, which `solve` raised."""
    case = drawn_case(165, 696, 1e-4)
    tracker = Tracker(case_scene(case))
    first, second = case.path[:2]
    assert tracker.arrive(first)["cable"].status is Status.CONVERGED

    def singular(*_: object) -> np.ndarray:
        raise np.linalg.LinAlgError("a singular matrix")

    with monkeypatch.context() as patch:
        patch.setattr(error_estimate, "error", singular)
        found = tracker.arrive(second)["cable"]
    assert not found.status.trusted
    assert "error" in found.message
    assert tracker.arrive(first)["cable"].status.trusted
