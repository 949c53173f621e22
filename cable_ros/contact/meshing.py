# SPDX-License-Identifier: Apache-2.0
"""Meshes that hold contact points (k, COLUMNS) well; see `contact.points`."""

from __future__ import annotations

import numpy as np

from cable_ros.contact.points import ARC_LENGTH, KIND, LYING, SAMPLE
from cable_ros.rod.elements import Mesh, ReferenceElement

CLOSEST = 0.02
"""A boundary between elements that is this near to a contact point gives way to it, parts of the length."""

TOGETHER = 1e-6
"""Contact points this near to each other share a boundary."""

LAYERS = 3.0
"""An element that bends beside a contact is no longer than so many of the lengths within which it does."""


def suited(mesh: Mesh, points: np.ndarray) -> Mesh:
    """The mesh with boundaries where the contact points are, none of its elements much longer for it."""
    edges = list(np.cumsum(mesh.lengths)[:-1])
    held: list[float] = []
    for s in places(points):
        bounds = [0.0, *edges, 1.0]
        e = min(int(np.searchsorted(bounds, s)) - 1, len(bounds) - 2)
        free = [edge for edge in edges if edge not in held]
        near = min(free, key=lambda edge: abs(edge - s), default=s + 1.0)
        if abs(near - s) < 0.2 * (bounds[e + 1] - bounds[e]):
            edges.remove(near)
        edges = sorted([*edges, s])
        held.append(s)
    return Mesh(mesh.element, np.diff([0.0, *edges, 1.0]))


def fitted(element: ReferenceElement, edges: list[float], points: np.ndarray, spacing: float) -> Mesh:
    """The mesh with inner boundaries at `edges`, moved to the contact points, and enough along stretches."""
    held = places(points)
    far = [edge for edge in edges if min((abs(edge - s) for s in held), default=1.0) >= CLOSEST]
    samples = points[points[:, KIND] == SAMPLE, ARC_LENGTH]
    out: list[float] = []
    edges = sorted(far + held)
    for low, high in zip([0.0, *edges], [*edges, 1.0], strict=True):
        lies = bool(((samples >= low) & (samples <= high)).any())
        parts = int(np.ceil((high - low) / (LYING * spacing))) if lies else 1
        out += [low + (high - low) * k / parts for k in range(1, parts + 1)]
    return Mesh(element, np.diff([0.0, *out[:-1], 1.0]))


def layered(mesh: Mesh, points: np.ndarray, force: float) -> Mesh:
    """The mesh, its elements halved where the `force` along the cable leaves it short lengths to bend in.

    Beside contact points and clamps a taut cable bends within 1 / sqrt(force), and straightens beyond.
    """
    layer = LAYERS / np.sqrt(max(force, 1.0))
    held = np.array([0.0, *places(points), 1.0])
    out: list[float] = []
    waiting = mesh.lengths[::-1].tolist()
    while waiting:
        low, h = sum(out), waiting.pop()
        away = float(np.maximum(low - held, held - (low + h)).min())
        if h > layer + max(away, 0.0):
            waiting += [0.5 * h, 0.5 * h]
        else:
            out.append(h)
    return Mesh(mesh.element, np.array(out))


def places(points: np.ndarray) -> list[float]:
    """Where boundaries belong: at the points and the ends of stretches, rising."""
    mine = np.unique(points[points[:, KIND] != SAMPLE, ARC_LENGTH])
    apart = np.diff(mine, prepend=-1.0) > TOGETHER
    return [float(s) for s in mine[apart] if 0.0 < s < 1.0]
