# SPDX-License-Identifier: Apache-2.0
"""How long the next step of a lying cable is, as the last ones showed."""

from __future__ import annotations

import numpy as np
import pytest
from references.hose_paths import known

from cable_ros import Tracker, load_scene
from cable_ros.contact.touching_rod import TouchingRod
from cable_ros.rod.warm_step import ADVANCED, NOT_CONTRACTING, TOO_FAR
from cable_ros.rod.without_contact import SHORTEST_STEP, WithoutContact


class Lying(WithoutContact):
    """What lies, and touches nothing else."""

    lies = True
    compliance = np.zeros(3)


def after(*steps: tuple[int, float, float]) -> float:
    """Length of the next step after `steps`: code, length, stride."""
    rod = Lying()
    for code, far, stride in steps:
        rod.stride = stride
        rod.note_step(code, far)
    return rod.next_step


def test_a_refused_step_limits_the_next_pose() -> None:
    refused = TOO_FAR, 4e-3, 0.25
    assert after((ADVANCED, 4e-3, 2.0)) == np.inf
    assert after(refused) == pytest.approx(1e-3)
    assert after(refused, (ADVANCED, 1e-3, 1.2)) == pytest.approx(1.2e-3)
    assert after((NOT_CONTRACTING, 4e-3, 2.0)) == pytest.approx(2e-3)


def test_short_steps_that_arrive_do_not_shorten_the_next_pose() -> None:
    assert after((TOO_FAR, 4e-3, 0.25), (ADVANCED, 1e-5, 2.0)) == pytest.approx(1e-3)


def test_it_grows_as_friction_allows_whatever_the_iterations() -> None:
    """Of those rounding decides whether there is one more: they are not asked."""
    refused = TOO_FAR, 4e-3, 0.25
    assert after(refused, (ADVANCED, 1e-3, 2.0)) == pytest.approx(2e-3)


def test_it_does_not_vanish() -> None:
    assert after((TOO_FAR, 3e-5, 0.1)) == SHORTEST_STEP


def test_what_has_left_its_obstacle_forgets_it() -> None:
    rod = Lying()
    rod.next_step, rod.lies = 1e-3, False
    rod.note_step(ADVANCED, 1e-3)
    assert rod.next_step == np.inf


def test_few_steps_of_a_hose_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its end force falls to a third in 0.02 L: each pose began with steps that friction refused, and five
    in a row were not had in time.
    """
    steps: list[int] = []
    advance = TouchingRod.advance

    def counted(self: TouchingRod, *arguments: object) -> tuple[int, int, np.ndarray, np.ndarray]:
        result = advance(self, *arguments)  # type: ignore[arg-type]
        steps.append(result[0])
        return result

    monkeypatch.setattr(TouchingRod, "advance", counted)
    path = known()["lifted_17"]
    tracker = Tracker(load_scene(path.scene(), urdf=path.urdf()))
    trusted = [tracker.solve(state)["hose"].status.trusted for state in path.states()]
    assert np.mean(trusted) > 0.8  # all of them go on: five take more than one call
    assert np.mean([code == TOO_FAR for code in steps]) < 0.2
