# SPDX-License-Identifier: Apache-2.0
"""An order of points in which each is near the one before: along Hilbert's space-filling curve."""

from __future__ import annotations

import numpy as np

BITS = 16
"""Of each coordinate: the curve visits 65,536 places along each axis."""


def along_curve(points: np.ndarray) -> np.ndarray:
    """The order (m,) of points (m, n) along the curve through the cube that holds them.

    Points that are as good as equal stay in order.
    """
    low = points.min(axis=0, initial=np.inf)
    extent = float((points - low).max(initial=0.0))
    if extent == 0.0:
        return np.arange(len(points))
    places = np.round((points - low) / extent * (2**BITS - 1)).astype(np.int64)
    return np.lexsort(hilbert(places).T[::-1])


def hilbert(places: np.ndarray) -> np.ndarray:
    """Where on Hilbert's curve places (m, n) are, whole numbers of `BITS` bits each.

    Returns:
        (m, BITS) digits to the base 2**n, the first one most significant.

    Source:
        J. Skilling, Programming the Hilbert curve, AIP Conference Proceedings 707 (2004), 381-387.
    """
    x = places.T.copy()
    n = len(x)
    for bit in reversed(range(1, BITS)):
        q, p = 1 << bit, (1 << bit) - 1
        for i in range(n):
            inverted = (x[i] & q) != 0
            exchanged = np.where(inverted, 0, (x[0] ^ x[i]) & p)
            x[0] ^= np.where(inverted, p, exchanged)
            x[i] ^= exchanged
    for i in range(1, n):
        x[i] ^= x[i - 1]
    parity = np.zeros_like(x[0])
    for bit in reversed(range(1, BITS)):
        parity ^= np.where(x[n - 1] & (1 << bit), (1 << bit) - 1, 0)
    x ^= parity
    weights = 1 << np.arange(n)[::-1, None]
    digits = [(((x >> bit) & 1) * weights).sum(axis=0) for bit in reversed(range(BITS))]
    return np.stack(digits, axis=1)
