# SPDX-License-Identifier: Apache-2.0
"""Every case of the zoo ends as it must, and every answer on the way is verified."""

from __future__ import annotations

import pytest

from cable_ros.bench.cases import Case, run_case
from zoo import CASES


def test_names_are_unique() -> None:
    names = [case.name for case in CASES]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_case(case: Case) -> None:
    outcome = run_case(case)
    assert outcome.passed, outcome.fault
