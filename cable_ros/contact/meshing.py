# SPDX-License-Identifier: Apache-2.0
"""Meshes fitted to contact points (k, COLUMNS); see `contact.points`."""

from __future__ import annotations

import numpy as np

from cable_ros.contact.points import ARC_LENGTH, KIND, LYING, SAMPLE
from cable_ros.rod.elements import Mesh, ReferenceElement

CLOSEST = 0.02
"""Distance from a contact point, L, within which a boundary between elements is replaced by it."""

TOGETHER = 1e-6
"""Distance, L, within which contact points share a boundary."""

LAYERS = 3.0
"""Maximum length of an element beside a contact, in lengths of the layer in which the cable bends there."""


def suited(mesh: Mesh, points: np.ndarray) -> Mesh:
    """The mesh with boundaries at the contact points, without much longer elements."""
    edges = list(np.cumsum(mesh.lengths)[:-1])
    owned: list[float] = []
    for s in boundaries(points):
        bounds = [0.0, *edges, 1.0]
        e = min(int(np.searchsorted(bounds, s)) - 1, len(bounds) - 2)
        free = [edge for edge in edges if edge not in owned]
        near = min(free, key=lambda edge: abs(edge - s), default=s + 1.0)
        if abs(near - s) < 0.2 * (bounds[e + 1] - bounds[e]):
            edges.remove(near)
        edges = sorted([*edges, s])
        owned.append(s)
    return Mesh(mesh.element, np.diff([0.0, *edges, 1.0]))


def fitted(element: ReferenceElement, edges: list[float], points: np.ndarray, spacing: float) -> Mesh:
    """The mesh with inner boundaries at `edges`, moved to the contact points, and more along patches."""
    owned = boundaries(points)
    far = [edge for edge in edges if min((abs(edge - s) for s in owned), default=1.0) >= CLOSEST]
    samples = points[points[:, KIND] == SAMPLE, ARC_LENGTH]
    out: list[float] = []
    edges = sorted(far + owned)
    for low, high in zip([0.0, *edges], [*edges, 1.0], strict=True):
        lies = bool(((samples >= low) & (samples <= high)).any())
        parts = int(np.ceil((high - low) / (LYING * spacing))) if lies else 1
        out += [low + (high - low) * k / parts for k in range(1, parts + 1)]
    return Mesh(element, np.diff([0.0, *out[:-1], 1.0]))


def layered(mesh: Mesh, points: np.ndarray, force: float) -> Mesh:
    """The mesh, with elements halved where a `force` along the cable makes it bend within short lengths.

    Beside contact points and clamps a taut cable bends within 1 / sqrt(force), and straightens beyond.
    """
    layer = LAYERS / np.sqrt(max(force, 1.0))
    owned = np.array([0.0, *boundaries(points), 1.0])
    out: list[float] = []
    waiting = mesh.lengths[::-1].tolist()
    while waiting:
        low, h = sum(out), waiting.pop()
        away = float(np.maximum(low - owned, owned - (low + h)).min())
        if h > layer + max(away, 0.0):
            waiting += [0.5 * h, 0.5 * h]
        else:
            out.append(h)
    return Mesh(mesh.element, np.array(out))


def boundaries(points: np.ndarray) -> list[float]:
    """Where boundaries belong: at the points and the ends of patches, rising."""
    mine = np.unique(points[points[:, KIND] != SAMPLE, ARC_LENGTH])
    apart = np.diff(mine, prepend=-1.0) > TOGETHER
    return [float(s) for s in mine[apart] if 0.0 < s < 1.0]
