# SPDX-License-Identifier: Apache-2.0
"""Copies of vectors and matrices, also of slices."""

from __future__ import annotations

import numpy as np

from cable_ros.linalg.copies import copy, copy_rows


def test_all_is_copied_and_nothing_beside() -> None:
    rng = np.random.default_rng(0)
    source, target = rng.normal(size=(4, 5)), np.zeros((3, 4, 5))
    copy_rows(source, target[1])
    copy(source[2], target[2, 3])
    expected = np.zeros((3, 4, 5))
    expected[1], expected[2, 3] = source, source[2]
    np.testing.assert_array_equal(target, expected)
