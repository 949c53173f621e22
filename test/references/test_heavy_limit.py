# SPDX-License-Identifier: Apache-2.0
"""The catenary with boundary layers against collocation, with the order of its limit."""

from __future__ import annotations

import numpy as np
import pytest

from references import planar, spatial
from references.boundary_value import solve_planar

NUMBERS = (1e4, 4e4, 1.6e5)


def force_errors(corrected: bool) -> np.ndarray:
    errors = []
    for gamma in NUMBERS:
        limit = spatial.catenary(1.0, 1.0, gamma, (0.6, 0.2), (0.3, 1.9), corrected)
        true = solve_planar(limit)
        errors.append(
            np.linalg.norm((limit.end_wrench - true.end_wrench)[:3]) / np.linalg.norm(true.end_wrench[:3])
        )
    return np.array(errors)


@pytest.mark.parametrize(("corrected", "order"), [(False, 0.5), (True, 1.0)])
def test_catenary_is_reached_with_its_order(corrected: bool, order: float) -> None:
    errors = force_errors(corrected)
    measured = np.log(errors[:-1] / errors[1:]) / np.log(4.0)
    # Between these gravity numbers the next term still bends the slope a little.
    assert measured == pytest.approx([order, order], abs=0.1)


def test_layer_moment_is_reached_with_order_one_half() -> None:
    errors = []
    for gamma in NUMBERS:
        limit = spatial.catenary(1.0, 1.0, gamma, (0.6, 0.2), (0.3, 1.9))
        true = solve_planar(limit)
        errors.append(abs(limit.start_wrench[4] - true.start_wrench[4]) / abs(true.start_wrench[4]))
    measured = np.log(np.array(errors[:-1]) / np.array(errors[1:])) / np.log(4.0)
    assert measured == pytest.approx([0.5, 0.5], abs=0.15)


def test_collocation_finds_the_closed_elastica() -> None:
    exact = planar.elastica(1.0, 1.0, 5.0, 0.5, 0.3, 0.1)
    found = solve_planar(exact)
    # Collocation at 1e-9.
    assert found.end_wrench == pytest.approx(exact.end_wrench, abs=1e-7)
