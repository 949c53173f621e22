"""Where a cable comes so near to itself that contact with itself, which is not modelled, would matter."""

from __future__ import annotations

import numpy as np

from cable_ros.compilation import njit

NOT_MODELLED = "Contact of the cable with itself is not modelled"
SPACING = np.pi
"""Parts of the cable nearer than so many diameters along it are neighbours, not a contact."""


def closest_approach(points: np.ndarray, length: float, spacing: float) -> float:
    """Smallest distance of two points (n, 3) that are `spacing` or more apart along the `length`; all in m.

    Infinite where none are.
    """
    return float(_closest(points, int(np.ceil(spacing / (length / (len(points) - 1))))))


@njit(cache=True)
def _closest(points: np.ndarray, skip: int) -> float:
    best = np.inf
    for i in range(points.shape[0] - skip):
        for k in range(i + skip, points.shape[0]):
            d = 0.0
            for a in range(3):
                d += (points[k, a] - points[i, a]) ** 2
            best = min(best, d)
    return float(np.sqrt(best))


def warning(apart: float, diameter: float) -> str:
    """A sentence where the parts are only `apart`, m."""
    return (
        f"{NOT_MODELLED} and matters here: two parts of it are "
        f"{apart * 1e3:.3g} mm apart, less than the diameter of {diameter * 1e3:.3g} mm."
    )
