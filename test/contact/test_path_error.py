# SPDX-License-Identifier: Apache-2.0
"""What finite steps do to the end force: of second order, fading, and told where a cable is led about."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pytest
from references.hose_paths import known

from cable_ros import Tracker, load_scene
from cable_ros.bench.drawn import drawn_case, refined
from cable_ros.bench.metamorphic import follow
from cable_ros.contact.path_error import (
    FADES,
    FALL_PART,
    LARGEST,
    NONE,
    PART,
    SLID_FADES,
    SLID_PART,
    PathError,
)

RATE = np.array([3.0, -1.0, 2.0])
NOTHING = np.zeros(3)
POSSIBLE = 10.0


def along(force: Callable[[float], np.ndarray], steps: int, length: float) -> PathError:
    """The error along a way of `length`, L, in even steps, of a `force` that is a function of the way."""
    error, where = NONE, np.linspace(0.0, length, steps + 1)
    for a, b in itertools.pairwise(where):
        error = error.after_step(b - a, force(a), force(b), POSSIBLE)
    return error


def test_a_force_that_changes_evenly_is_known_but_for_the_first_step() -> None:
    first = along(lambda s: s * RATE, 1, 0.01)
    assert first.error == pytest.approx(PART * 0.01 * np.linalg.norm(RATE))
    all_of_it = along(lambda s: s * RATE, 50, 0.5)
    assert all_of_it.error == pytest.approx(first.error * np.exp(-FADES * 0.49))


def test_it_is_of_first_order_in_the_steps() -> None:
    """Each adds the square of its length; there are as many more."""
    found = [along(lambda s: s * s * RATE, n, 0.1).error for n in (40, 80, 160, 320)]
    orders = np.log2(np.array(found[:-1]) / found[1:])
    assert orders[-1] == pytest.approx(1.0, abs=0.02)


def test_a_fall_counts_by_what_it_changed_and_foretells_nothing() -> None:
    one = NONE.after_step(0.01, NOTHING, RATE, POSSIBLE)
    fallen = one.after_fall(RATE, 3.0 * RATE, POSSIBLE)
    assert fallen.error - one.error == pytest.approx(FALL_PART * 2.0 * np.linalg.norm(RATE))
    assert fallen.rate is None


def test_of_a_part_that_was_not_followed_what_sticks_remembers_anything() -> None:
    one = NONE.not_followed(POSSIBLE)
    assert one.of_force == POSSIBLE
    held = one.after_step(0.01, RATE, RATE, POSSIBLE).known_but_for(0.3 * POSSIBLE)
    assert held.unknown == 0.3 * POSSIBLE
    assert held.known_but_for(POSSIBLE) == held
    slid = held.known_but_for(0.0)
    assert slid.unknown == 0.0
    assert slid.of_force - held.error - held.slid == pytest.approx(SLID_PART * held.unknown)
    later = slid.after_step(1.0 / SLID_FADES, RATE, RATE, 0.5 * POSSIBLE)
    assert later.slid == pytest.approx(0.5 * np.exp(-1.0) * slid.slid)
    # how far it falls depends on that, and what slips then does not tell
    fallen = held.after_fall(RATE, RATE, POSSIBLE)
    assert fallen.error == held.of_force
    assert fallen.unknown == 0.0


def test_what_moves_by_rounding_stands_still() -> None:
    one = NONE.after_step(0.01, NOTHING, RATE, POSSIBLE)
    assert one.after_step(1e-16, RATE, (1.0 + 1e-9) * RATE, POSSIBLE) == one


def test_what_the_contacts_cannot_bear_any_more_is_forgotten() -> None:
    """As the cable comes slack all forces fall together, by a thousand and in as many steps as it likes."""
    taut = NONE.after_step(0.01, NOTHING, 1e3 * RATE, 1e3 * POSSIBLE)
    for steps in (1, 7, 50):
        error, parts = taut, np.geomspace(1e3, 1.0, steps + 1)
        for a, b in itertools.pairwise(parts):
            error = error.after_step(0.01 / steps, a * RATE, b * RATE, b * POSSIBLE)
        assert error.error == pytest.approx(1e-3 * taut.error * np.exp(-FADES * 0.01))


def test_no_more_is_amiss_than_all_friction_turned_round() -> None:
    assert NONE.after_step(0.01, NOTHING, 1e6 * RATE, POSSIBLE).error == LARGEST * POSSIBLE


def test_what_comes_to_rest_is_off_by_a_part_of_its_change_as_if_it_turned_back() -> None:
    fast = NONE.after_step(0.01, NOTHING, RATE, POSSIBLE)
    slow = fast.after_step(0.01, RATE, 1.001 * RATE, POSSIBLE)
    faded = fast.error * np.exp(-FADES * 0.01)
    assert slow.error - faded == pytest.approx(2.0 * PART * 1e-3 * np.linalg.norm(RATE))


def test_units_of_force() -> None:
    one = NONE.after_step(0.01, NOTHING, RATE, POSSIBLE).in_units(4.0)
    other = NONE.after_step(0.01, NOTHING, RATE / 4.0, POSSIBLE / 4.0)
    assert one.error == pytest.approx(other.error)
    assert one.rate == pytest.approx(other.rate)
    assert one.possible == other.possible


@pytest.mark.parametrize("name", ["sideways_7", "lifted_17", "round_46"])
def test_hoses_say_how_far_off_they_are(name: str) -> None:
    """The three that are farthest off, by 2 to 4 % at one pose.

    Told in 16 times as many poses the first is still 1.5 % off where it was 2.0 %: that is not of its steps.
    """
    path = known()[name]
    tracker = Tracker(load_scene(path.scene(), urdf=path.urdf()))
    off, told = [], []
    for state, exact in zip(path.states(), path.end_wrench[:, :3], strict=True):
        found = tracker.arrive(state)["hose"]
        assert found.status.trusted, found.message
        off.append(np.linalg.norm(found.end_wrench[:3] - exact) / np.linalg.norm(exact))
        told.append(found.error_estimate)
        assert ("followed in steps" in found.message) == (found.error_estimate > tracker.tolerance)
    beyond = np.array(off) - told - path.error
    assert beyond.max() < 0.015, int(beyond.argmax())
    assert max(off) > 0.01


def test_a_cable_that_has_been_taut_says_what_it_is_off_now() -> None:
    """On a rough tray, drawn to a force of 70 EI / L^2 and back to a tenth of that: it said 18 % there."""
    case = drawn_case(156, 12, 1e-4, "tray")
    found, finer = follow(case).found, follow(case, refined(case.path, 2))
    told = np.array([one.error_estimate for one in found])
    off = [finer.difference(a, b, i) for i, (a, b) in enumerate(zip(found, finer.found[::2], strict=True))]
    assert all(one.status.trusted for one in found)
    assert (np.array(off) < told).all()
    assert told.max() < 0.05
