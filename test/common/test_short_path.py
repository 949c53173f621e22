# SPDX-License-Identifier: Apache-2.0
"""Hilbert's curve visits every place once, by steps to neighbours."""

from __future__ import annotations

import numpy as np
import pytest

from cable_ros.common import short_path
from cable_ros.common.short_path import along_curve, hilbert


@pytest.mark.parametrize(("axes", "bits"), [(1, 6), (2, 4), (3, 3), (6, 1)])
def test_the_curve_goes_from_neighbour_to_neighbour(axes, bits, monkeypatch):
    monkeypatch.setattr(short_path, "BITS", bits)
    grid = np.stack(np.meshgrid(*[np.arange(2**bits)] * axes), axis=-1).reshape(-1, axes)
    digits = hilbert(grid)
    assert digits.shape == (len(grid), bits)
    order = np.lexsort(digits.T[::-1])
    assert (np.abs(np.diff(grid[order], axis=0)).sum(axis=1) == 1).all()


def test_one_axis_is_sorted():
    values = np.random.default_rng(3).permutation(500)[:, None] * 0.01 - 2.0
    assert np.array_equal(along_curve(values), np.argsort(values[:, 0]))


@pytest.mark.parametrize("axes", [2, 3])
def test_a_cloud_becomes_a_short_path(axes):
    points = np.random.default_rng(4).random((4096, axes))
    order = along_curve(points)
    assert sorted(order) == list(range(4096))
    step = np.linalg.norm(np.diff(points[order], axis=0), axis=1).mean()
    # A cell of the grid of as many points has this edge; a path along its cells has steps of about one.
    assert step < 2.0 * 4096 ** (-1.0 / axes)


def test_equal_points_stay_in_order():
    assert along_curve(np.full((5, 3), 0.7)).tolist() == [0, 1, 2, 3, 4]
    assert along_curve(np.array([[1.0], [0.0], [1.0], [0.0]])).tolist() == [1, 3, 0, 2]
