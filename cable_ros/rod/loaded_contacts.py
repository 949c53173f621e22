# SPDX-License-Identifier: Apache-2.0
"""The loaded contacts of a rod, in the same form for every kind of rod."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class LoadedContacts(NamedTuple):
    """c contacts by rising arc length, in units of the cable, in its start clamp's frame."""

    arc_lengths: np.ndarray
    """(c,)"""
    positions: np.ndarray
    """(c, 3) on the centreline."""
    normals: np.ndarray
    """(c, 3) unit vectors, away from the obstacle."""
    forces: np.ndarray
    """(c, 3) on the cable, friction included."""
    obstacles: np.ndarray
    """(c,) numbers of the obstacles."""
    sliding: np.ndarray
    """(c,) bool."""
    lengths: np.ndarray
    """(c,) the length along which each force is spread; 0: at a point."""
