# SPDX-License-Identifier: Apache-2.0
"""The cross product beside numpy's."""

from __future__ import annotations

import numpy as np

from cable_ros.linalg.cross import cross


def test_it_has_the_bits_of_numpy():
    a, b = np.random.default_rng(1).normal(size=(2, 7, 3))
    assert cross(a, b).tobytes() == np.cross(a, b).tobytes()
    assert cross(a[0], b[0]).tobytes() == np.cross(a[0], b[0]).tobytes()
    both = cross(a[:, None], b[None])
    assert both.tobytes() == np.cross(a[:, None], b[None]).tobytes()
