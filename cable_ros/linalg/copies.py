# SPDX-License-Identifier: Apache-2.0
"""Compiled copies, checked by nobody: to check shapes for `a[:] = b`, Numba compiles for a second or two."""

from __future__ import annotations

from cable_ros.compilation import LEAF, njit


@njit(**LEAF)
def copy(source, target):
    """target = source, of two vectors (n,)."""
    for i in range(source.shape[0]):
        target[i] = source[i]


@njit(**LEAF)
def copy_rows(source, target):
    """target = source, of two matrices (n, m)."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            target[i, j] = source[i, j]
