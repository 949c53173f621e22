# SPDX-License-Identifier: Apache-2.0
"""Bounds on the length of the shortest path past the obstacles, independent of the solver.

A path between the clamps that is shorter than the cable lies in an ellipsoid with the clamps as foci.
Dijkstra's algorithm finds paths on a grid in that ellipsoid. Each is the start of a string that is pulled
taut. A string of nodes r_i at a spacing h, as a fraction of the path, has the energy
sum |r_i+1 - r_i|^2 / 2h. That is at least half its length squared, and equal to it if the nodes are evenly
spaced. Nodes inside an obstacle add the energy of springs. So the minimum energy is at most that of the
shortest path with evenly spaced nodes and no loaded spring. The lower bound is right, except for paths that
no string was started on.
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

POINTS = 40_000
"""Approximate number of grid points."""
AXIS = 1.25
"""Maximum sum of the distances to both clamps of a grid point, lengths of the cable."""
PATHS = 8
"""Maximum number of paths from the grid; each goes through a point that is away from all earlier ones."""
MARGINS = (0.0, 0.5)
"""Maximum depth of a path inside obstacles, cells: gaps narrower than a cell must not be missed."""
AWAY = 3.0
"""Minimum distance of such a point from earlier paths, cells."""
COARSE, FINE = 400, 2000
"""Numbers of segments of a string, at first and if it is among the shortest."""
SAME, LONGER = 0.005, 0.03
"""Distance, L, below which two coarse strings are one; excess length, L, above which one is not refined."""
SPRINGS = (1e7, 1e9)
"""Stiffness of the obstacles per length, one after the other; the tension of the string is about 1."""
STEP = 1e-7
"""Step of the differences for a distance's gradient, fraction of the length."""
TOLERANCE, COARSE_TOLERANCE = 1e-10, 1e-6
"""Predicted decrease of the energy below which a string is at rest."""
STEPS = 200
"""Maximum number of steps with springs of one stiffness."""
ROUNDS, GAIN = 10, 1e-5
"""Maximum number of times a string is respaced and pulled again, since nodes may catch at an edge; minimum
gain of energy for another time."""
PLANAR = 1e-6
"""Distance from a plane, L, of a shape that lies in it: what rounding makes of symmetry, not more."""
CAUGHT = 0.01
"""Relative excess of the bound over the length of a string that is caught inside an obstacle."""
CLEARANCES = (1e-4, 3e-4, 1e-3)
"""Distances, L, that a path keeps from the obstacles to be outside for certain, tried in turn."""
SPLIT = 16
"""Number of points of each segment that are checked for that."""
ROUNDING = 1e-6
"""Excess of a path's length over the cable's, L, that counts as none."""


@dataclass(frozen=True)
class PathBounds:
    """Bounds on the length of the shortest path between two clamps, in lengths of the cable."""

    lower: float
    """No path found is shorter; inf if there is none."""
    upper: float
    """Length of the shortest path found with all points outside the obstacles; inf if there is none."""

    @property
    def too_long(self) -> bool:
        """Whether every path is longer than the cable: then it has no equilibrium."""
        return self.lower > 1.0 + ROUNDING

    @property
    def fits(self) -> bool:
        """Whether a path is shorter than the cable: then its energy has a minimum."""
        return self.upper < 1.0

    def describe(self, length: float) -> str:
        """A clause, for a cable of `length`, m."""
        if self.fits:
            return f"a path {1e3 * (1.0 - self.upper) * length:.4g} mm shorter than the cable was found"
        if not self.too_long:
            return "whether any path is as short as the cable is not known"
        if not math.isfinite(self.lower):
            return "no path at all was found"
        return f"the shortest path found is {1e3 * (self.lower - 1.0) * length:.4g} mm longer than the cable"


def path_bounds(
    start: np.ndarray, end: np.ndarray, length: float, obstacles: Mapping[str, Distance]
) -> PathBounds:
    """Bounds for a cable of `length`, m, from `start` to `end` (3,), m, past `obstacles` by name."""
    goal = (end - start) / length
    chord = float(np.linalg.norm(goal))
    scaled = _Distances(start, length, list(obstacles.values()))
    if min(scaled(np.zeros(3)), scaled(goal)) < -ROUNDING:
        return PathBounds(math.inf, math.inf)
    if chord >= 1.0:
        return PathBounds(chord, math.inf)
    started = [path for margin in MARGINS for path in _paths(goal, scaled, margin)]
    coarse = [_pull(_respaced(path, COARSE), scaled, 0.0, SPRINGS[:1], COARSE_TOLERANCE) for path in started]
    lower = upper = math.inf
    known: list[np.ndarray] = []
    for energy, path in sorted(coarse, key=lambda pair: pair[0]):
        if math.sqrt(2.0 * energy) > lower + LONGER:
            break
        respaced = _respaced(path, COARSE)
        if any(np.abs(respaced - other).max() < SAME for other in known):
            continue
        known.append(respaced)
        energy, pulled = _taut(path, scaled)
        bound = math.sqrt(2.0 * energy)
        if bound < min(lower, (1.0 + CAUGHT) * _length(pulled)):
            lower = bound
            upper = min(upper, _outside(pulled, scaled))
    return PathBounds(lower, upper)


def pulled_taut(
    shape: np.ndarray, start: np.ndarray, end: np.ndarray, length: float, obstacles: Mapping[str, Distance]
) -> PathBounds:
    """The same for the paths that a cable can be pulled to from its `shape` (n, 3), m, the ends moved.

    A shape in a plane across an axis is pulled within that plane, by symmetry, if nothing pushes it out.
    """
    flat = np.ptp(shape, axis=0) < PLANAR * length
    shape = np.where(flat, start, shape)
    scaled = _Distances(start, length, list(obstacles.values()))
    at = np.linspace(0.0, 1.0, len(shape))[:, None]
    moved = shape + (1.0 - at) * (start - shape[0]) + at * (end - shape[-1])
    energy, string = _taut((moved - start) / length, scaled)
    bound = math.sqrt(2.0 * energy)
    caught = bound >= (1.0 + CAUGHT) * _length(string)
    return PathBounds(0.0, math.inf) if caught else PathBounds(bound, _outside(string, scaled))


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


def _paths(goal: np.ndarray, signed: _Distances, margin: float) -> list[np.ndarray]:
    """Paths (n, 3) from 0 to `goal` on a grid of the ellipsoid with foci there and long axis AXIS.

    They may be `margin` cells deep inside obstacles.
    """
    chord = float(np.linalg.norm(goal))
    half = 0.5 * np.array([AXIS, *[math.sqrt(AXIS**2 - chord**2)] * 2])
    cell = (4.0 / 3.0 * math.pi * float(half.prod()) / POINTS) ** (1.0 / 3.0)
    counts = np.ceil(half / cell).astype(int) + 1
    axes = _frame(goal)
    cells = np.stack(np.meshgrid(*[np.arange(-n, n + 1) for n in counts], indexing="ij"), axis=-1)
    points = 0.5 * goal + cell * cells.reshape(-1, 3) @ axes
    around = np.linalg.norm(points, axis=1) + np.linalg.norm(points - goal, axis=1)
    free = np.flatnonzero((around < AXIS) & (signed(points) > -margin * cell))
    points, count = points[free], len(free)
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
        near = np.flatnonzero(np.linalg.norm(points - clamp, axis=1) < 2.0 * cell)
        rows.append(near)
        columns.append(np.full(len(near), count + i))
    points = np.vstack([points, np.zeros(3), goal])
    a, b = np.concatenate(rows), np.concatenate(columns)
    open_ = signed(0.5 * (points[a] + points[b])) > -margin * cell
    a, b = a[open_], b[open_]
    lengths = np.linalg.norm(points[a] - points[b], axis=1)
    graph = coo_array((lengths, (a, b)), shape=(count + 2, count + 2)).tocsr()
    far, before = dijkstra(graph, directed=False, indices=[count, count + 1], return_predecessors=True)
    paths: list[np.ndarray] = []
    total = far.sum(axis=0)
    total[count:] = np.inf
    while len(paths) < PATHS and np.isfinite(total.min()):
        middle = int(total.argmin())
        path = points[_traced(before[0], middle)[::-1] + _traced(before[1], middle)[1:]]
        paths.append(path)
        for point in path:
            total[np.linalg.norm(points - point, axis=1) < AWAY * cell] = np.inf
    return paths


def _traced(before: np.ndarray, point: int) -> list[int]:
    """The points before `point`, from it back to the start of the search."""
    out = [point]
    while before[out[-1]] >= 0:
        out.append(int(before[out[-1]]))
    return out


def _frame(goal: np.ndarray) -> np.ndarray:
    """(3, 3) orthonormal rows, the first along `goal`."""
    along = goal / np.linalg.norm(goal)
    _, _, axes = np.linalg.svd(along[None, :])
    axes[0] = along
    return np.asarray(axes)


def _respaced(path: np.ndarray, segments: int) -> np.ndarray:
    """(segments + 1, 3) points of the polyline, evenly spaced."""
    at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    return np.column_stack([np.interp(np.linspace(0.0, at[-1], segments + 1), at, x) for x in path.T])


def _length(path: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def _taut(path: np.ndarray, signed: _Distances) -> tuple[float, np.ndarray]:
    """The minimum energy of a string started as `path`, and its nodes (FINE + 1, 3)."""
    best, r = _pull(_respaced(path, FINE), signed, 0.0)
    for _ in range(ROUNDS):
        energy, again = _pull(_respaced(r, FINE), signed, 0.0)
        gain = best - energy
        if gain > 0.0:
            best, r = energy, again
        if gain < GAIN:
            break
    return best, r


def _pull(
    path: np.ndarray,
    signed: _Distances,
    clear: float,
    springs: tuple[float, ...] = SPRINGS,
    tolerance: float = TOLERANCE,
) -> tuple[float, np.ndarray]:
    """Energy and nodes (n, 3) of the string at rest, by Gauss-Newton steps with halving."""
    r, segments = path.copy(), len(path) - 1
    inner = len(path) - 2

    def energy(r: np.ndarray, spring: float) -> float:
        inside = np.minimum(signed.each(r[1:-1]) - clear, 0.0)
        return 0.5 * (
            segments * float(np.sum(np.diff(r, axis=0) ** 2)) + spring / segments * float(np.sum(inside**2))
        )

    for spring in springs:
        value = energy(r, spring)
        for _ in range(STEPS):
            inside = np.minimum(signed.each(r[1:-1]) - clear, 0.0)
            g = segments * (2.0 * r[1:-1] - r[:-2] - r[2:])
            H = np.zeros((inner, 3, 3)) + 2.0 * segments * np.eye(3)
            for o in range(len(inside)):
                at = np.flatnonzero(inside[o] < 0.0)
                normals = signed.normals(o, r[at + 1])
                g[at] += spring / segments * inside[o, at, None] * normals
                H[at] += spring / segments * normals[:, :, None] * normals[:, None, :]
            ab = np.zeros((4, 3 * inner))
            ab[3] = -1.0 * segments  # the neighbours' coupling
            for k in range(3):
                for j in range(k + 1):
                    ab[k - j, j::3] = H[:, k, j]
            move = solveh_banded(ab, -g.ravel(), lower=True).reshape(inner, 3)
            gain = -float(np.vdot(g, move))
            if gain < tolerance:
                break
            fraction = 1.0
            while fraction > 1e-6:
                trial = r.copy()
                trial[1:-1] += fraction * move
                new = energy(trial, spring)
                if new <= value - 1e-4 * fraction * gain:
                    break
                fraction *= 0.5
            else:
                break
            r, value = trial, new
    return value, r


def _outside(path: np.ndarray, signed: _Distances) -> float:
    """Length of a path beside the string `path` that is outside for certain; inf if none is found."""
    for clear in CLEARANCES:
        _, beside = _pull(path, signed, clear, SPRINGS[-1:])
        if _is_outside(beside, signed):
            return _length(beside)
    return math.inf


def _is_outside(path: np.ndarray, signed: _Distances) -> bool:
    """Whether all of the polyline is outside: a distance changes by at most the length of the path."""
    x = np.arange(SPLIT) / SPLIT
    points = (path[:-1, None] + x[None, :, None] * np.diff(path, axis=0)[:, None]).reshape(-1, 3)
    points = np.vstack([points, path[-1]])
    gaps = signed(points)
    apart = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return bool(np.all(gaps[1:] + gaps[:-1] > apart))
