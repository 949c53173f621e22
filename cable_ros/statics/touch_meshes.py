"""Meshes that hold contact points (k, COLUMNS) well; see `touch_points`."""

from __future__ import annotations

import numpy as np

from cable_ros.mechanics.elements import Mesh, ReferenceElement
from cable_ros.statics.touch_points import FLAT, LYING, PLACE

CLOSEST = 0.02
"""A boundary is put no nearer than this to another, parts of the length."""


def suited(mesh: Mesh, points: np.ndarray) -> Mesh:
    """The mesh with boundaries where the sliding points are, none of its elements much longer for it."""
    edges = np.cumsum(mesh.lengths)[:-1]
    for s in np.sort(points[points[:, FLAT] == 0.0, PLACE]):
        bounds = np.concatenate([[0.0], edges, [1.0]])
        k = int(np.argmin(np.abs(bounds - s)))
        e = min(int(np.searchsorted(bounds, s)) - 1, len(bounds) - 2)
        if 0 < k < len(bounds) - 1 and abs(bounds[k] - s) < 0.2 * (bounds[e + 1] - bounds[e]):
            edges[k - 1] = s
        elif CLOSEST < s < 1.0 - CLOSEST:
            edges = np.sort(np.append(edges, s))
    return Mesh(mesh.element, np.diff(np.concatenate([[0.0], edges, [1.0]])))


def fitted(element: ReferenceElement, edges: list[float], points: np.ndarray, spacing: float) -> Mesh:
    """The mesh with inner boundaries at `edges`, moved to sliding points, and enough along stretches."""
    for s in points[points[:, FLAT] == 0.0, PLACE]:
        near = [edge for edge in edges if abs(edge - s) < CLOSEST]
        edges = sorted([edge for edge in edges if edge not in near] + [float(s)])
    flat = points[points[:, FLAT] == 1.0, PLACE]
    out: list[float] = []
    for low, high in zip([0.0, *edges], [*edges, 1.0], strict=True):
        lies = bool(((flat >= low) & (flat <= high)).any())
        parts = int(np.ceil((high - low) / (LYING * spacing))) if lies else 1
        out += [low + (high - low) * k / parts for k in range(1, parts + 1)]
    return Mesh(element, np.diff([0.0, *out[:-1], 1.0]))
