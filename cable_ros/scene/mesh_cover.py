# SPDX-License-Identifier: Apache-2.0
"""Solids along the axes of a mesh that might stand for parts of it, and the few of them that are enough."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np

from cable_ros.scene.obstacles import SHORTEST_AXIS, Box, Capsule, Cylinder
from cable_ros.scene.solids import Solid, distances

BINS = 100
"""Sections of the mesh along each axis."""
MOST_STEPS = 2
"""Planes along each axis where the extents of the sections change most; others are half way between them."""
MOST_POINTS = 1000
"""About as many points of the surface are enough to compare solids."""
CIRCLE_STEPS = 40
"""To find a small circle about points."""
APART = 8
"""Least distance of planes where extents change, sections."""
STICKS_OUT = 0.01
"""Length, relative to the mesh, by which a point must be beyond a section to belong to a larger one."""
ASIDE = 1e-6
"""Distance of a plane from the points that it must part from others, relative to the mesh."""
THINNEST = 1e-5
"""m; flat parts get this thickness."""
NEARLY = 0.004
"""Distance outside of a solid, relative to the mesh, at which a point still counts as held."""


class Space(NamedTuple):
    """Points in and about a mesh, and how far they are outside."""

    points: np.ndarray
    """(n, 3) m."""
    outside: np.ndarray
    """(n,) distance from the mesh, m, 0 inside it."""


class Candidate(NamedTuple):
    """A solid about what is in a box between planes."""

    outside: float
    """How far it stands out of the mesh, m."""
    holds: int
    """Points of the surface that it holds, a bit each."""
    solid: Solid


def cover(points: np.ndarray, space: Space, most: int) -> list[Solid]:
    """Not more than `most` solids that hold nearly all of a mesh and stand out of it least.

    The smallest distance is sought for which so many are enough.

    Args:
        points: (n, 3) of the mesh's surface, dense.
        space: to see how far solids stand out.
        most: number of solids, 1 at least.
    """
    near = NEARLY * float(np.ptp(points, axis=0).max())
    edges = [[-np.inf, *_planes(points, k), np.inf] for k in range(3)]
    points = points[:: max(len(points) // MOST_POINTS, 1)]
    candidates: list[Candidate] = []
    seen: set[bytes] = set()
    known: set[tuple[float, ...]] = set()

    def consider(solid: Solid) -> float:
        outside = float(space.outside[distances(solid, space.points) <= 0.0].max(initial=0.0))
        held = np.packbits(distances(solid, points) <= near)
        candidates.append(Candidate(outside, int.from_bytes(held.tobytes(), "big"), solid))
        return outside

    for solid in (solid for part in _parts(points, edges, seen) for solid in solids_about(part)):
        if consider(solid) <= near and isinstance(solid, Cylinder):
            for longer in _longer(solid, edges):
                key = tuple(
                    np.round(np.concatenate([longer.start, longer.end, [longer.radius]]) / near).tolist()
                )
                if key not in known:
                    known.add(key)
                    consider(longer)
    everything = int.from_bytes(np.packbits(np.ones(len(points), bool)).tobytes(), "big")
    levels = sorted({one.outside for one in candidates})
    low, high = 0, len(levels)
    best = [max(candidates, key=lambda one: one.holds.bit_count())]  # one about the whole mesh
    while low < high:
        middle = (low + high) // 2
        chosen = _chosen(candidates, levels[middle], everything, most, near)
        if len(chosen) <= most:
            best, high = chosen, middle
        else:
            low = middle + 1
    return [one.solid for one in best]


def _parts(points: np.ndarray, edges: list[list[float]], seen: set[bytes]) -> Iterator[np.ndarray]:
    """The points in each box between planes, each set of them once."""
    place = np.column_stack([np.searchsorted(edges[k][1:-1], points[:, k]) for k in range(3)])
    spans = [list(combinations(range(len(edges[k])), 2)) for k in range(3)]
    for x in spans[0]:
        in_x = (place[:, 0] >= x[0]) & (place[:, 0] < x[1])
        for y in spans[1]:
            in_y = in_x & (place[:, 1] >= y[0]) & (place[:, 1] < y[1])
            for z in spans[2]:
                chosen = in_y & (place[:, 2] >= z[0]) & (place[:, 2] < z[1])
                key = np.packbits(chosen).tobytes()
                if key not in seen and chosen.any():
                    seen.add(key)
                    yield points[chosen]


def solids_about(points: np.ndarray) -> Iterator[Solid]:
    """Box, cylinders and capsules along the axes about points (n, 3)."""
    low, high = points.min(axis=0), points.max(axis=0)
    middle = 0.5 * (low + high)
    yield Box(middle, np.maximum(high - low, THINNEST), np.array([0.0, 0.0, 0.0, 1.0]))
    for k in range(3):
        others = [i for i in range(3) if i != k]
        if min((high - low)[others]) < THINNEST or high[k] - low[k] < SHORTEST_AXIS:
            continue
        centre, squared = _circle(points[:, others], middle[others])
        radius, start, end = float(np.sqrt(squared)), middle.copy(), middle.copy()
        start[others] = end[others] = centre
        start[k], end[k] = low[k], high[k]
        yield Cylinder(start.copy(), end.copy(), radius)
        reach = np.sqrt(np.maximum(squared - np.sum((points[:, others] - centre) ** 2, axis=1), 0.0))
        start[k], end[k] = (points[:, k] + reach).min(), (points[:, k] - reach).max()
        if end[k] - start[k] > SHORTEST_AXIS:
            yield Capsule(start, end, radius)


def _longer(cylinder: Cylinder, edges: list[list[float]]) -> Iterator[Cylinder]:
    """A cylinder along an axis led on to planes beyond its ends: another body may hide how it goes on."""
    k = int(np.argmax(np.abs(cylinder.end - cylinder.start)))
    low, high = cylinder.start[k], cylinder.end[k]
    for start in (low, *(edge for edge in edges[k][1:-1] if edge < low)):
        for end in (high, *(edge for edge in edges[k][1:-1] if edge > high)):
            if start < low or end > high:
                ends = np.array([cylinder.start, cylinder.end])
                ends[:, k] = start, end
                yield Cylinder(ends[0], ends[1], cylinder.radius)


def _chosen(
    candidates: list[Candidate], level: float, everything: int, most: int, good: float
) -> list[Candidate]:
    """Candidates that stand out no farther and hold everything; more than `most` if they cannot.

    Each is the one that holds most of what the others do not, for how far it stands out beyond `good`, m.
    """
    able = [one for one in candidates if one.outside <= level]
    out: list[Candidate] = []
    missing = everything
    while missing and len(out) <= most:
        best = max(
            able, key=lambda one: (one.holds & missing).bit_count() / (good + one.outside), default=None
        )
        if best is None or not best.holds & missing:
            return candidates
        out.append(best)
        missing &= ~best.holds
    for one in list(out):  # what was chosen first may be needless by now
        others = 0
        for other in out:
            others |= other.holds if other is not one else 0
        if others == everything:
            out.remove(one)
    return out


def _circle(points: np.ndarray, centre: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre and squared radius of a small circle about points (n, 2); Badoiu and Clarkson (2003)."""
    best, least = centre, np.inf
    for step in range(1, CIRCLE_STEPS):
        squares = (points[:, 0] - centre[0]) ** 2 + (points[:, 1] - centre[1]) ** 2
        farthest = int(squares.argmax())
        if squares[farthest] < least:
            best, least = centre, float(squares[farthest])
        centre = centre + (points[farthest] - centre) / (step + 1)
    return best, least


def _planes(points: np.ndarray, k: int) -> list[float]:
    """Coordinates along axis k, rising, between which the sections are alike."""
    others = [i for i in range(3) if i != k]
    low, high = points[:, k].min(), points[:, k].max()
    size = float(np.ptp(points, axis=0).max())
    count = max(int(BINS * (high - low) / size), 2)
    section = np.minimum(((points[:, k] - low) / max(high - low, 1e-12) * count).astype(int), count - 1)
    extents = np.full((count, 4), np.nan)
    for b in range(count):
        inside = points[section == b][:, others]
        if len(inside):
            extents[b] = [*-inside.min(axis=0), *inside.max(axis=0)]
        elif b:
            extents[b] = extents[b - 1]
    change = np.abs(np.diff(extents, axis=0)).sum(axis=1)
    chosen: list[int] = []
    for b in np.argsort(-change, kind="stable").tolist():
        if (
            change[b] > STICKS_OUT * size
            and all(abs(b - c) >= APART for c in chosen)
            and len(chosen) < MOST_STEPS
        ):
            chosen.append(b)
    out = []
    for b in chosen:
        smaller = b if extents[b].sum() < extents[b + 1].sum() else b + 1
        beside = points[(section == b) | (section == b + 1)]
        reach = np.column_stack([-beside[:, others], beside[:, others]])
        beyond = beside[(reach > extents[smaller] + STICKS_OUT * size).any(axis=1), k]
        if len(beyond):
            aside = ASIDE * size
            out.append(float(beyond.min() - aside if smaller == b else beyond.max() + aside))
    ends = sorted({low, *out, high})
    return sorted({*out, *(0.5 * (one + other) for one, other in pairwise(ends))})
