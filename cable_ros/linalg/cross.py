# SPDX-License-Identifier: Apache-2.0
"""The cross product, with the bits of `numpy.cross` and less of its time for small arrays."""

from __future__ import annotations

import numpy as np

ONWARD, BACKWARD = [1, 2, 0], [2, 0, 1]


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a x b along the last axis of (..., 3) each."""
    out: np.ndarray = a[..., ONWARD] * b[..., BACKWARD] - a[..., BACKWARD] * b[..., ONWARD]
    return out


def cross_matrix(v: np.ndarray) -> np.ndarray:
    """(3, 3): v x u is this times u."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
