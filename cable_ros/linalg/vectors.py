# SPDX-License-Identifier: Apache-2.0
"""Compiled: the cross product of two vectors."""

from __future__ import annotations

from cable_ros.compilation import LEAF, njit


@njit(**LEAF)
def cross(a, b):
    """The cross product of two vectors a, b (3,), as a tuple."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
