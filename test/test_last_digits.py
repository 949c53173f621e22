# SPDX-License-Identifier: Apache-2.0
"""Joints changed in their twelfth digit: the same answer, also of a search that passes many others."""

from __future__ import annotations

from dataclasses import replace

import pytest
from zoo_hose import either_side

from cable_ros.bench.cases import Case
from cable_ros.bench.contact_fuzz import contact_case
from cable_ros.bench.drawn import drawn_case
from cable_ros.bench.metamorphic import TOLERANCES, follow, nudged

ARCH = either_side()[0]


@pytest.mark.parametrize(
    ("case", "poses"),
    [
        pytest.param(contact_case(11, 4, 1e-4), 1, id="a descent of fifty zigzags"),
        pytest.param(contact_case(19, 24, 1e-4), 1, id="a clamp that moves 30 times as far as that digit"),
        pytest.param(drawn_case(11, 57, 1e-4), 1, id="four images of one energy, of which some are found"),
        pytest.param(contact_case(77, 4, 1e-4), 2, id="a point beside a smooth patch, not far from friction"),
        pytest.param(ARCH, 2, id="a snap-through that takes a call's budget"),
        pytest.param(drawn_case(15, 17, 1e-4), 7, id="a heavy cable on the ground, on which its clamp rests"),
        pytest.param(drawn_case(15, 51, 1e-4), 1, id="the same, with a diameter"),
        pytest.param(drawn_case(18, 83, 1e-4), 1, id="a weightless one, that turns freely"),
        pytest.param(drawn_case(17, 99, 1e-4), 1, id="a heavy cable over a beam, not found by descents"),
        pytest.param(drawn_case(19, 38, 1e-4), 13, id="a lift that snaps flat, on short elements"),
        pytest.param(drawn_case(30, 241, 1e-4), 11, id="two points that are found anew in a long step"),
        pytest.param(drawn_case(25, 58, 1e-4), 6, id="a lift that leaves its plane, beside the fork"),
        pytest.param(drawn_case(25, 32, 1e-4), 8, id="a hose that falls, or a grid would take over before"),
    ],
)
def test_same_answer(case: Case, poses: int) -> None:
    case = replace(case, path=case.path[:poses])
    first = follow(case)
    for seed in (30, 102, 103, 105):
        other = follow(nudged(case, seed))
        for i, (a, b) in enumerate(zip(first.found, other.found, strict=True)):
            assert a.status is b.status, (i, a.message, b.message)
            assert first.difference(a, b, i) < TOLERANCES * case.tolerance, (i, seed)
