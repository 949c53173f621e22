# SPDX-License-Identifier: Apache-2.0
"""Taut-string shortest paths past the obstacles: whether a cable is long enough, and where it can pass."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from cable_ros.compilation import njit
from cable_ros.contact.distance import across, gap

OPTIONS = {"cache": True, "error_model": "numpy"}

SIDES = 6
"""Number of sides on which a string starts; before them a straight one."""
SEGMENTS = 40
"""Number of straight segments of a string."""
CUT = 0.01
"""Maximum depth, L, at which a segment may cut a corner; deeper it goes through the obstacle."""
SWEEPS, CHECK = 240, 8
"""Maximum number of sweeps over the string, and number of sweeps between two checks."""
NARROW = 5e-3
"""Difference, L, below which a path shorter than the cable is computed with more segments."""
FINER = 4
"""Number of those segments over SEGMENTS."""
SLIGHT = 1e-4
"""Difference, L, up to which a path longer than the cable does not count as too long."""
DISTINCT = 0.02
"""Maximum distance, L, of strings that count as one."""
STILL = 3e-6
"""Largest motion in the sweeps since the last check, L, that ends the iteration."""
PULLED_SEGMENTS = 320
"""Number of segments of a string that is pulled tight from a cable's own shape."""
GENTLY = 1e-3
"""Maximum motion of its points at once, L: so they do not pass through a thin obstacle, or a corner."""
CARRIED = 2e-3
"""Maximum motion of clamps and obstacles, L, before such a string is pulled again."""
MOST_CARRIED = 100
"""Maximum number of such motions that are looked at."""
ASIDE = 1e-3
"""Displacement of the string, L, out of the plane of the cable."""
ROUNDS, SETTLED = 8, 1e-6
"""Maximum number of times that it is pulled at each, and what it becomes shorter, L, in the last one."""


@njit(**OPTIONS)
def pull_tight(r: np.ndarray, obstacles: np.ndarray, enough: float, farthest: float) -> float:
    """Move the inner points r (n, 3) of a string until it is not longer than `enough` or as short as it gets.

    Each point in turn goes beyond the middle of its neighbours (over-relaxation), by `farthest` at most along
    each axis, then out of the obstacles. Returns the length; infinity where a part of it goes through one.
    """
    n, directions, bends = np.empty(3), np.empty((2, 3)), np.empty(2)
    last = r.shape[0] - 1
    factor = 2.0 / (1.0 + np.sin(np.pi / last))
    length, moved = np.inf, 0.0
    before = np.empty(3)
    for sweep in range(SWEEPS):
        for i in range(1, last):
            for a in range(3):
                before[a] = r[i, a]
                move = factor * (0.5 * (r[i - 1, a] + r[i + 1, a]) - r[i, a])
                r[i, a] += min(max(move, -farthest), farthest)
            for _ in range(2):
                for o in range(obstacles.shape[0]):
                    inside = gap(obstacles[o], r[i], n, directions, bends)
                    if inside < 0.0:
                        for a in range(3):
                            r[i, a] -= inside * n[a]
            for a in range(3):
                moved = max(moved, abs(r[i, a] - before[a]))
        if sweep % CHECK == CHECK - 1:
            length = 0.0
            for i in range(last):
                length += np.sqrt(np.sum((r[i + 1] - r[i]) ** 2))
            if length <= enough or moved < STILL:
                break
            moved = 0.0
    for i in range(last):
        for x in (0.25, 0.5, 0.75):
            for a in range(3):
                before[a] = (1.0 - x) * r[i, a] + x * r[i + 1, a]
            for o in range(obstacles.shape[0]):
                if gap(obstacles[o], before, n, directions, bends) < -CUT:
                    return np.inf
    return length


@njit(**OPTIONS)
def initial_string(re: np.ndarray, k: int) -> np.ndarray:
    """An initial string (n, 3) from 0 to re (3,) on the k-th of SIDES; straight for k = 0."""
    sides = np.empty((2, 3))
    across(re / max(np.sqrt(np.sum(re**2)), 1e-12), sides)
    r = np.empty((SEGMENTS + 1, 3))
    angle = 2.0 * np.pi * k / SIDES
    for i in range(SEGMENTS + 1):
        x = i / SEGMENTS
        out = 0.6 * np.sin(np.pi * x) if k > 0 else 0.0
        for a in range(3):
            r[i, a] = x * re[a] + out * (np.cos(angle) * sides[0, a] + np.sin(angle) * sides[1, a])
    return r


@njit(**OPTIONS)
def shortest_path(re: np.ndarray, obstacles: np.ndarray, enough: float) -> tuple[float, np.ndarray]:
    """Length of the shortest path found from 0 to re (3,) outside the obstacles, and its points (n, 3).

    The search ends with the first one that is not longer than `enough`.
    """
    best, path = np.inf, np.empty((SEGMENTS + 1, 3))
    for k in range(SIDES + 1):
        r = initial_string(re, k)
        length = pull_tight(r, obstacles, enough, np.inf)
        if length < best:
            best, path = length, r
        if best <= enough:
            break
    return best, path


def taut_strings(re: np.ndarray, obstacles: np.ndarray, reach: float) -> list[np.ndarray]:
    """Strings (n, 3) from 0 to re (3,) past the obstacles (n, WIDTH), pulled tight, the shortest first.

    Each passes the obstacles on another side, and none is longer than `reach`.
    """
    found: list[tuple[float, np.ndarray]] = []
    for k in range(SIDES + 1):
        r = initial_string(re, k)
        length = float(pull_tight(r, obstacles, 0.0, np.inf))
        if length < reach and all(np.abs(r - other).max() > DISTINCT for _, other in found):
            found.append((length, r))
    return [r for _, r in sorted(found, key=_first)]


def _finer(path: np.ndarray, obstacles: np.ndarray) -> tuple[float, np.ndarray]:
    """Length and points of the string `path` (n, 3) in FINER times as many segments."""
    at = np.linspace(0.0, len(path) - 1.0, FINER * (len(path) - 1) + 1)
    r = np.stack([np.interp(at, np.arange(len(path)), path[:, a]) for a in range(3)], axis=1)
    return float(pull_tight(r, obstacles, 0.0, np.inf)), r


def gets_taut(
    shape: np.ndarray, there: Callable[[float], tuple[np.ndarray, np.ndarray]], distance: float, reach: float
) -> bool:
    """Whether, as clamps and obstacles move, the string to which a cable can be pulled gets longer than it.

    The string begins as the cable and passes the obstacles on its side. It is pulled tight in small steps of
    the motion, by small motions of its points, and no friction holds it: where it settles, no path beside it
    is shorter. Its segments cut corners, so that it is too short, never too long. False also if it ends in an
    obstacle, or the motion is too long to tell.

    Args:
        shape: (n, 3) points of the cable at equal arc lengths, outside of the obstacles.
        there: end position (3,) and obstacles (o, WIDTH) at a fraction of the motion.
        distance: of the motion, see `travel`, L.
        reach: length of the cable, L.
    """
    at = np.linspace(0.0, len(shape) - 1.0, PULLED_SEGMENTS + 1)
    r = np.stack([np.interp(at, np.arange(len(shape)), shape[:, a]) for a in range(3)], axis=1)
    # in a plane of symmetry it may be pulled over a ball's top, off which any string slides
    normal = np.linalg.svd(r - r.mean(axis=0))[2][2]
    r += ASIDE * np.sin(np.linspace(0.0, np.pi, len(r)))[:, None] * normal
    steps, enough = max(1, math.ceil(distance / CARRIED)), reach + SLIGHT
    for k in range(1, min(steps, MOST_CARRIED) + 1):
        re, obstacles = there(k / steps)
        r += np.linspace(0.0, 1.0, len(r))[:, None] * (re - r[-1])
        length = np.inf
        for _ in range(ROUNDS):
            before, length = length, float(pull_tight(r, obstacles, enough, GENTLY))
            if length <= enough:
                break
            if before - length < SETTLED:
                return length < np.inf
    return False


def _first(one: tuple[float, np.ndarray]) -> float:
    return one[0]


def too_short(re: np.ndarray, obstacles: np.ndarray, reach: float) -> tuple[float, int] | None:
    """How much longer than `reach` the shortest path past the obstacles (n, WIDTH) is; the nearest to it.

    None if a shorter one was found. Units of the cable, start clamp's frame. Segments that cut a corner
    make the string too short, never too long.
    """
    length, path = shortest_path(re, obstacles, reach - NARROW)
    if reach - NARROW < length <= reach + SLIGHT:
        # coarse strings cut corners
        close = [_finer(one, obstacles) for one in taut_strings(re, obstacles, reach + SLIGHT)]
        length, path = min(close, key=_first, default=(length, path))
    if length <= reach + SLIGHT:
        return None
    if length == np.inf:
        return None
    n, directions, bends = np.empty(3), np.empty((2, 3)), np.empty(2)
    nearest = [min(gap(one, r, n, directions, bends) for r in path[1:-1]) for one in obstacles]
    return float(length) - reach, int(np.argmin(nearest))
