# SPDX-License-Identifier: Apache-2.0
"""Whether there is a way past the obstacles that is as short as a cable, by other means than the solver's.

Any way between the clamps that is shorter than the cable lies in the ellipsoid about them: ways through
places all over it, by Dijkstra's algorithm on a grid, are strings that are then pulled tight. A string of
nodes r_i, a part h of the way apart, has the energy sum |r_i+1 - r_i|^2 / 2h, at least half its length
squared, and equal to it where these are evenly spaced; nodes inside an obstacle add the energy of springs.
So the least energy is at most that of the shortest way itself, with nodes evenly spaced and on no spring:
lengths found are too short, never too long, but for ways that no string was begun on.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.linalg import solveh_banded
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from cable_ros.bench.surfaces import Distance

PLACES = 40_000
"""Nodes of the grid, about."""
AXIS = 1.25
"""Sum of the distances to both clamps within which ways are looked for, lengths of the cable."""
WAYS = 8
"""Most ways taken from the grid; each goes through a place that is off all before."""
MARGINS = (0.0, 0.5)
"""So deep, in cells, may they lead through obstacles: gaps that are narrower than a cell are not missed."""
OFF = 3.0
"""So far, in cells."""
COARSE, PARTS = 400, 2000
"""Parts of a string, at first and where it is among the shortest."""
BESIDE, LONGER = 0.005, 0.03
"""Coarse strings no farther apart than BESIDE become one; those longer by LONGER are not looked at again."""
SPRINGS = (1e7, 1e9)
"""Stiffness of the obstacles per length in turn, where the string's tension is about one."""
STEP = 1e-7
"""Of the differences that make a distance's gradient, parts of the length."""
STILL, ROUGH = 1e-10, 1e-6
"""A string has come to rest where a step promises to take less energy; a coarse one at ROUGH."""
STEPS = 200
"""Most steps on springs of one stiffness."""
ROUNDS, GAIN = 10, 1e-5
"""Nodes may catch at an edge: spaced evenly again, the string is pulled again while that gains so much."""
CAUGHT = 0.01
"""Strings whose energy is that of one so much longer are in an obstacle's inside, not beside it."""
CLEAR = (1e-4, 3e-4, 1e-3)
"""Distances kept to obstacles, in turn, by a way that is to be outside for certain, parts of the length."""
SPLIT = 16
"""So many places of each part are looked at for that."""
ROUNDING = 1e-6
"""A way that is longer than the cable by less than this, parts of the length, is not called longer."""


@dataclass(frozen=True)
class Way:
    """What was found out about the ways between two clamps; lengths in those of the cable."""

    least: float
    """No way found is shorter; inf where there was none at all."""
    outside: float
    """The shortest found of which each point is outside all obstacles; inf where there was none."""

    @property
    def too_long(self) -> bool:
        """Whether the cable is too short for each: then it has no equilibrium."""
        return self.least > 1.0 + ROUNDING

    @property
    def fits(self) -> bool:
        """Whether the cable is long enough for one: then its energy has a minimum."""
        return self.outside < 1.0

    def told(self, length: float) -> str:
        """In words, for a cable of `length`, m."""
        if self.fits:
            return f"a way {1e3 * (1.0 - self.outside) * length:.4g} mm shorter than the cable was found"
        if not self.too_long:
            return "whether a way is as short as the cable could not be told"
        if not math.isfinite(self.least):
            return "no way at all was found"
        return f"the shortest way found is {1e3 * (self.least - 1.0) * length:.4g} mm longer than the cable"


def shortest(start: np.ndarray, end: np.ndarray, length: float, met: Mapping[str, Distance]) -> Way:
    """The shortest ways from `start` to `end` (3,), m, for a cable of `length`, past obstacles by name."""
    goal = (end - start) / length
    chord = float(np.linalg.norm(goal))
    scaled = _Distances(start, length, list(met.values()))
    if min(scaled(np.zeros(3)), scaled(goal)) < -ROUNDING:
        return Way(math.inf, math.inf)
    if chord >= 1.0:
        return Way(chord, math.inf)
    begun = [way for margin in MARGINS for way in _ways(goal, scaled, margin)]
    coarse = [_pull(_evenly(way, COARSE), scaled, 0.0, SPRINGS[:1], ROUGH) for way in begun]
    least = outside = math.inf
    known: list[np.ndarray] = []
    for energy, way in sorted(coarse, key=lambda pair: pair[0]):
        if math.sqrt(2.0 * energy) > least + LONGER:
            break
        evenly = _evenly(way, COARSE)
        if any(np.abs(evenly - other).max() < BESIDE for other in known):
            continue
        known.append(evenly)
        energy, pulled = _tight(way, scaled)
        bound = math.sqrt(2.0 * energy)
        if bound < min(least, (1.0 + CAUGHT) * _length(pulled)):
            least = bound
            outside = min(outside, _outside(pulled, scaled))
    return Way(least, outside)


class _Distances:
    """Distance from the nearest of all obstacles, in lengths of the cable from its start clamp."""

    def __init__(self, start: np.ndarray, length: float, signed: list[Distance]) -> None:
        self.start, self.length, self.signed = start, length, signed

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """(...) at points (..., 3)."""
        return np.asarray(self.each(points).min(axis=0))

    def each(self, points: np.ndarray) -> np.ndarray:
        """(k, ...) from each obstacle."""
        world = self.start + self.length * points
        return np.array([signed(world) for signed in self.signed]) / self.length

    def normals(self, which: int, points: np.ndarray) -> np.ndarray:
        """(n, 3) gradients of one obstacle's distance at points (n, 3), by central differences."""
        world = self.start + self.length * points[:, None, None]
        step = STEP * self.length * np.array([[[1.0]], [[-1.0]]]) * np.eye(3)
        signed = self.signed[which](world + step)
        return np.asarray((signed[:, 0] - signed[:, 1]) / (2.0 * STEP * self.length))


def _ways(goal: np.ndarray, signed: _Distances, margin: float) -> list[np.ndarray]:
    """Ways (n, 3) from 0 to `goal` on a grid of the ellipsoid with foci there and long axis AXIS.

    They may be `margin` cells deep inside obstacles.
    """
    chord = float(np.linalg.norm(goal))
    half = 0.5 * np.array([AXIS, *[math.sqrt(AXIS**2 - chord**2)] * 2])
    cell = (4.0 / 3.0 * math.pi * float(half.prod()) / PLACES) ** (1.0 / 3.0)
    counts = np.ceil(half / cell).astype(int) + 1
    axes = _frame(goal)
    cells = np.stack(np.meshgrid(*[np.arange(-n, n + 1) for n in counts], indexing="ij"), axis=-1)
    places = 0.5 * goal + cell * cells.reshape(-1, 3) @ axes
    around = np.linalg.norm(places, axis=1) + np.linalg.norm(places - goal, axis=1)
    free = np.flatnonzero((around < AXIS) & (signed(places) > -margin * cell))
    places, count = places[free], len(free)
    number = np.full(len(cells.reshape(-1, 3)), -1)
    number[free] = np.arange(count)
    grid = np.pad(number.reshape(cells.shape[:3]), 1, constant_values=-1)
    rows, columns = [], []
    for step in product((-1, 0, 1), repeat=3):
        if step > (0, 0, 0):
            beside = np.roll(grid, [-k for k in step], (0, 1, 2))
            both = (grid >= 0) & (beside >= 0)
            rows.append(grid[both])
            columns.append(beside[both])
    for i, clamp in enumerate((np.zeros(3), goal)):
        near = np.flatnonzero(np.linalg.norm(places - clamp, axis=1) < 2.0 * cell)
        rows.append(near)
        columns.append(np.full(len(near), count + i))
    places = np.vstack([places, np.zeros(3), goal])
    a, b = np.concatenate(rows), np.concatenate(columns)
    open_ = signed(0.5 * (places[a] + places[b])) > -margin * cell
    a, b = a[open_], b[open_]
    lengths = np.linalg.norm(places[a] - places[b], axis=1)
    graph = coo_array((lengths, (a, b)), shape=(count + 2, count + 2)).tocsr()
    far, before = dijkstra(graph, directed=False, indices=[count, count + 1], return_predecessors=True)
    ways: list[np.ndarray] = []
    total = far.sum(axis=0)
    total[count:] = np.inf
    while len(ways) < WAYS and np.isfinite(total.min()):
        middle = int(total.argmin())
        way = places[_traced(before[0], middle)[::-1] + _traced(before[1], middle)[1:]]
        ways.append(way)
        for point in way:
            total[np.linalg.norm(places - point, axis=1) < OFF * cell] = np.inf
    return ways


def _traced(before: np.ndarray, place: int) -> list[int]:
    out = [place]
    while before[out[-1]] >= 0:
        out.append(int(before[out[-1]]))
    return out


def _frame(goal: np.ndarray) -> np.ndarray:
    """(3, 3) orthonormal rows, the first along `goal`."""
    along = goal / np.linalg.norm(goal)
    _, _, axes = np.linalg.svd(along[None, :])
    axes[0] = along
    return np.asarray(axes)


def _evenly(way: np.ndarray, parts: int) -> np.ndarray:
    """(parts + 1, 3) points of the polyline, evenly spaced."""
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
    return np.column_stack([np.interp(np.linspace(0.0, at[-1], parts + 1), at, x) for x in way.T])


def _length(way: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())


def _tight(way: np.ndarray, signed: _Distances) -> tuple[float, np.ndarray]:
    """The least energy of a string begun as `way`, and its nodes (PARTS + 1, 3)."""
    best, r = _pull(_evenly(way, PARTS), signed, 0.0)
    for _ in range(ROUNDS):
        energy, again = _pull(_evenly(r, PARTS), signed, 0.0)
        gain = best - energy
        if gain > 0.0:
            best, r = energy, again
        if gain < GAIN:
            break
    return best, r


def _pull(
    way: np.ndarray,
    signed: _Distances,
    clear: float,
    springs: tuple[float, ...] = SPRINGS,
    still: float = STILL,
) -> tuple[float, np.ndarray]:
    """Energy and nodes (n, 3) of the string at rest, by Gauss-Newton steps with halving."""
    r, parts = way.copy(), len(way) - 1
    inner = len(way) - 2

    def energy(r: np.ndarray, spring: float) -> float:
        inside = np.minimum(signed.each(r[1:-1]) - clear, 0.0)
        return 0.5 * (
            parts * float(np.sum(np.diff(r, axis=0) ** 2)) + spring / parts * float(np.sum(inside**2))
        )

    for spring in springs:
        value = energy(r, spring)
        for _ in range(STEPS):
            inside = np.minimum(signed.each(r[1:-1]) - clear, 0.0)
            g = parts * (2.0 * r[1:-1] - r[:-2] - r[2:])
            H = np.zeros((inner, 3, 3)) + 2.0 * parts * np.eye(3)
            for o in range(len(inside)):
                at = np.flatnonzero(inside[o] < 0.0)
                normals = signed.normals(o, r[at + 1])
                g[at] += spring / parts * inside[o, at, None] * normals
                H[at] += spring / parts * normals[:, :, None] * normals[:, None, :]
            ab = np.zeros((4, 3 * inner))
            ab[3] = -1.0 * parts  # the neighbours' coupling
            for k in range(3):
                for j in range(k + 1):
                    ab[k - j, j::3] = H[:, k, j]
            move = solveh_banded(ab, -g.ravel(), lower=True).reshape(inner, 3)
            gain = -float(np.vdot(g, move))
            if gain < still:
                break
            part = 1.0
            while part > 1e-6:
                trial = r.copy()
                trial[1:-1] += part * move
                new = energy(trial, spring)
                if new <= value - 1e-4 * part * gain:
                    break
                part *= 0.5
            else:
                break
            r, value = trial, new
    return value, r


def _outside(way: np.ndarray, signed: _Distances) -> float:
    """Length of a way beside the string `way` that is outside for certain; inf where it comes to none."""
    for clear in CLEAR:
        _, beside = _pull(way, signed, clear, SPRINGS[-1:])
        if _is_outside(beside, signed):
            return _length(beside)
    return math.inf


def _is_outside(way: np.ndarray, signed: _Distances) -> bool:
    """Whether all of the polyline is outside: a distance grows by no more than the way gone."""
    x = np.arange(SPLIT) / SPLIT
    points = (way[:-1, None] + x[None, :, None] * np.diff(way, axis=0)[:, None]).reshape(-1, 3)
    points = np.vstack([points, way[-1]])
    gaps = signed(points)
    apart = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return bool(np.all(gaps[1:] + gaps[:-1] > apart))
