# SPDX-License-Identifier: Apache-2.0
"""A cable drawn taut over rough rollers: each bit of slip over them tells, it gives way to nothing else.

What sticks along a patch yields a little, so that Newton's method finds its way. A cable at 7e4 EI / L^2
resists its clamps with 1e7 EI / L^3: its end force was a quarter to two fifths too small, alike in 1, 4 and
16 times as many poses.
"""

from __future__ import annotations

import numpy as np
import pytest
from test_told_finer import told

from cable_ros import Status
from cable_ros.bench.drawn import drawn_case
from cable_ros.bench.metamorphic import follow, nudged

ROLLERS = (155, 7, "rollers")
TAUT = {2: 77.0, 3: 3.37, 6: 97.2}
"""Pose -> end force, N, by test/references/coulomb_rod.py along the whole path in steps of 2e-3 lengths: with
600 segments 67.9, 3.34 and 83.6, with 1200 74.7, 3.36 and 93.8, so extrapolated by their square."""
REFERENCE = 0.04
"""Its own error: what the extrapolation adds."""


@pytest.mark.parametrize("parts", [1, 4])
def test_end_force_of_a_discrete_rod(parts: int) -> None:
    found = told(ROLLERS, max(TAUT) + 1, parts)[::parts]
    assert all(one.status.trusted for one in found)
    for pose, force in TAUT.items():
        assert np.linalg.norm(found[pose].end_wrench[:3]) == pytest.approx(force, rel=REFERENCE)


def test_the_tolerance_does_not_matter() -> None:
    """With it goes by how much what sticks yields."""
    coarse, fine = (told(ROLLERS, max(TAUT) + 1, 4, tolerance)[::4] for tolerance in (1e-4, 1e-6))
    for pose in TAUT:
        force = np.linalg.norm(fine[pose].end_wrench[:3])
        assert np.linalg.norm(coarse[pose].end_wrench[:3]) == pytest.approx(force, rel=0.03)


@pytest.mark.parametrize("digits", [127, 128])
def test_a_cable_drawn_taut_is_led_back(digits: int) -> None:
    """All steps of a call failed from 2,000 N: those of the next, as long, did, too, also on the way back."""
    case = drawn_case(25, 102, 1e-4)
    first, other = follow(case), follow(nudged(case, digits))
    assert Status.NOT_CONVERGED in {one.status for one in first.found}
    for one in (first.found[-1], other.found[-1]):
        assert one.status is Status.CONVERGED, one.message
    assert first.difference(first.found[-1], other.found[-1], -1) < case.tolerance


def test_what_was_not_followed_is_not_known_again_until_it_slips() -> None:
    """Led on until it is taut, and back: how far it got decides what sticks; the next pose was 40 % off."""
    case = drawn_case(167, 694, 1e-4)
    found = follow(case).found
    last_taut = max(i for i, one in enumerate(found) if "rises steeply" in one.message)
    assert not found[last_taut + 1].status.trusted
    assert "could not be followed: what friction holds" in found[last_taut + 1].message
    assert found[-1].status.trusted


def test_where_no_step_leads_on_from_there_it_is_taut_not_lost() -> None:
    """At 1.5e6 EI / L^2 no step arrived, to either side: the branch was lost for 118 poses."""
    found = told((188, 65), 90, 1)
    assert {one.status for one in found} == {Status.CONVERGED, Status.NOT_CONVERGED}
    assert "taut around obstacle 'drum'" in found[-1].message
