# SPDX-License-Identifier: Apache-2.0
"""Where a cable meets itself or another: contact between cables is not modelled, but reported."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np

from cable_ros.compilation import LEAF, LEAF_ENTRY, njit
from cable_ros.equilibrium import Equilibrium, Overlap
from cable_ros.scene import Cable

NOT_MODELLED = "Contact of the cable with itself is not modelled"
SPACING = np.pi
"""Distance along the cable, in diameters, within which parts are neighbours, not a contact."""
OUTLINE = 101
"""Number of points of the polyline with which distances of cables are computed."""
LONGEST = 1.1
"""Maximum length of a stretched cable over its own."""


def closest_approach(points: np.ndarray, length: float, spacing: float) -> float:
    """Smallest distance of two parts of a polyline (n, 3) that are `spacing` or more apart along it; in m.

    The points are `length` / (n - 1) apart along the cable. Infinite where no parts are so far apart.
    """
    step = length / (len(points) - 1)
    return float(_closest(points, points, step, step, int(np.ceil(spacing / step)), np.inf))


class SelfApproach:
    """How near the parts of a cable come to each other, from pose to pose.

    Args:
        length, spacing: as in `closest_approach`.
    """

    def __init__(self, length: float, spacing: float) -> None:
        self._length, self._spacing = length, spacing
        self._points = np.empty((0, 3))
        self._apart = 0.0

    def bound(self, points: np.ndarray, needed: float) -> float:
        """`closest_approach` of a polyline (n, 3), or, if it is not less than `needed`, m, a lower bound.

        Two parts come no nearer to each other than both have moved since that was computed last.
        """
        if len(points) == len(self._points):
            least = self._apart - 2.0 * _farthest(points, self._points)
            if least >= needed:
                return least
        self._points, self._apart = points.copy(), closest_approach(points, self._length, self._spacing)
        return self._apart


@njit(**LEAF_ENTRY)
def _farthest(a, b):  # type: ignore[no-untyped-def]
    """The largest distance of two points of the same number in a and b, (n, 3)."""
    most = 0.0
    for i in range(a.shape[0]):
        most = max(most, (a[i, 0] - b[i, 0]) ** 2 + (a[i, 1] - b[i, 1]) ** 2 + (a[i, 2] - b[i, 2]) ** 2)
    return np.sqrt(most)


def closest_between(
    a: np.ndarray, b: np.ndarray, step_a: float, step_b: float, needed: float = np.inf
) -> float:
    """Smallest distance of two polylines (n, 3), (m, 3), m.

    Args:
        a, b: the polylines.
        step_a, step_b: the most that neighbouring points may be apart, m.
        needed: a distance that is not less than this may come out too large, by half a step of each at most.
    """
    return float(_closest(a, b, step_a, step_b, -1, needed))


@njit(cache=True)
def _closest(a, b, step_a, step_b, skip, needed):  # type: ignore[no-untyped-def]
    """Smallest distance of the segments of two polylines, or of two parts of one; see `closest_between`.

    `a`, `b`, `step_a`, `step_b`, `needed`: as there; `skip`: how many points the parts of one polyline are
    apart at least, negative for two polylines.

    First of points, then of the segments about pairs of points that are little farther apart: the nearest
    points of two segments are within half of each of some of their ends. Points as far apart as d leave out
    those that follow until d can be used up.
    """
    near = np.inf
    for i in range(a.shape[0]):
        k = 0 if skip < 0 else i + skip
        while k < b.shape[0]:
            d = np.sqrt((b[k, 0] - a[i, 0]) ** 2 + (b[k, 1] - a[i, 1]) ** 2 + (b[k, 2] - a[i, 2]) ** 2)
            near = min(near, d)
            k += max(1, int((d - near) / step_b))
    between = 0.5 * (step_a + step_b)
    if not near < needed + between:
        return near
    best = near
    for i in range(a.shape[0]):
        k = 0 if skip < 0 else i + skip
        while k < b.shape[0]:
            limit = best + between
            d = np.sqrt((b[k, 0] - a[i, 0]) ** 2 + (b[k, 1] - a[i, 1]) ** 2 + (b[k, 2] - a[i, 2]) ** 2)
            if d <= limit:
                for m in range(max(i - 1, 0), min(i + 1, a.shape[0] - 1)):
                    for n in range(max(k - 1, 0), min(k + 1, b.shape[0] - 1)):
                        if skip < 0 or n >= m + 1 + skip:
                            best = min(best, _between(a, m, b, n))
            k += max(1, int((d - limit) / step_b))
    return best


@njit(**LEAF)
def _between(a, m, b, n):  # type: ignore[no-untyped-def]
    """Distance of segment m of a (., 3) and segment n of b; Ericson, Real-Time Collision Detection, 5.1.9."""
    u0, u1, u2 = a[m + 1, 0] - a[m, 0], a[m + 1, 1] - a[m, 1], a[m + 1, 2] - a[m, 2]
    v0, v1, v2 = b[n + 1, 0] - b[n, 0], b[n + 1, 1] - b[n, 1], b[n + 1, 2] - b[n, 2]
    w0, w1, w2 = a[m, 0] - b[n, 0], a[m, 1] - b[n, 1], a[m, 2] - b[n, 2]
    uu, vv, uv = u0 * u0 + u1 * u1 + u2 * u2, v0 * v0 + v1 * v1 + v2 * v2, u0 * v0 + u1 * v1 + u2 * v2
    uw, vw = u0 * w0 + u1 * w1 + u2 * w2, v0 * w0 + v1 * w1 + v2 * w2
    across = uu * vv - uv * uv
    s = 0.0
    if across > 1e-12 * uu * vv:  # else parallel: any place will do
        s = min(max((uv * vw - uw * vv) / across, 0.0), 1.0)
    t = min(max((uv * s + vw) / vv, 0.0), 1.0) if vv > 0.0 else 0.0
    s = min(max((uv * t - uw) / uu, 0.0), 1.0) if uu > 0.0 else 0.0
    d0, d1, d2 = w0 + s * u0 - t * v0, w1 + s * u1 - t * v1, w2 + s * u2 - t * v2
    return np.sqrt(d0 * d0 + d1 * d1 + d2 * d2)


@njit(**LEAF_ENTRY)
def _apart(poses, i, k):  # type: ignore[no-untyped-def]
    """Distance of the middles between the clamps of cables i and k, with `poses` (cables, 2, 7)."""
    d = 0.0
    for a in range(3):
        d += (0.5 * (poses[i, 0, a] + poses[i, 1, a] - poses[k, 0, a] - poses[k, 1, a])) ** 2
    return np.sqrt(d)


def warning(apart: float, diameter: float) -> str:
    """A warning that parts of a cable are only `apart`, m."""
    return (
        f"{NOT_MODELLED} and matters here: two parts of it are "
        f"{apart * 1e3:.3g} mm apart, less than the diameter of {diameter * 1e3:.3g} mm."
    )


class Pairs:
    """The pairs of a scene's cables that have a thickness."""

    def __init__(self, cables: Sequence[Cable]) -> None:
        self._cables = cables
        thick = [i for i, cable in enumerate(cables) if cable.radius]
        reach = [0.5 * LONGEST * cable.length + cable.radius for cable in cables]
        # no point of a cable is farther than half its length from the middle between its clamps
        self._pairs = [(i, k, reach[i] + reach[k]) for i in thick for k in thick if i < k]

    def mark(
        self, found: dict[str, Equilibrium], poses: np.ndarray, outline: Callable[[int], np.ndarray]
    ) -> None:
        """Put into `found` where its cables overlap, and what their messages then say.

        Args:
            found: equilibria by cable.
            poses: (cables, 2, 7) the clamps in the world.
            outline: gives a cable's polyline (n, 3), world, m, by its number.
        """
        for i, k, reach in self._pairs:
            if _apart(poses, i, k) >= reach:
                continue
            one, other = self._cables[i], self._cables[k]
            if not (found[one.name].status.trusted and found[other.name].status.trusted):
                continue
            needed = one.radius + other.radius
            apart = self._distance(i, k, outline(i), outline(k), needed)
            if apart < needed:
                found[one.name] = with_overlap(found[one.name], Overlap(other.name, apart, needed))
                found[other.name] = with_overlap(found[other.name], Overlap(one.name, apart, needed))

    def _distance(self, i: int, k: int, a: np.ndarray, b: np.ndarray, needed: float) -> float:
        """Smallest distance of the polylines but for what is beside a clamp that both share."""
        steps = [LONGEST * self._cables[at].length / (len(points) - 1) for at, points in ((i, a), (k, b))]
        bare = [int(np.ceil(SPACING * needed / step)) for step in steps]
        ends = (slice(None), slice(None, None, -1))  # from the start, from the end
        keep_a, keep_b = [0, len(a)], [0, len(b)]
        for p, from_p in enumerate(ends):
            for q, from_q in enumerate(ends):
                if math.dist(a[from_p][0], b[from_q][0]) < needed:
                    keep_a[p] = bare[0] if p == 0 else max(len(a) - bare[0], 0)
                    keep_b[q] = bare[1] if q == 0 else max(len(b) - bare[1], 0)
        a, b = a[slice(*keep_a)], b[slice(*keep_b)]
        return closest_between(a, b, steps[0], steps[1], needed) if len(a) and len(b) else np.inf


def with_overlap(found: Equilibrium, overlap: Overlap, itself: bool = False) -> Equilibrium:
    """A result that tells one more overlap with another cable, or of the cable with itself."""
    if itself:
        sentence = warning(overlap.distance, overlap.contact_distance)
    else:
        sentence = (
            f"Contact between cables is not modelled and matters here: it comes within "
            f"{overlap.distance * 1e3:.3g} mm of cable '{overlap.other}', less than the sum of their radii, "
            f"{overlap.contact_distance * 1e3:.3g} mm."
        )
    overlaps = (*found.overlaps, overlap)
    return dataclasses.replace(found, message=f"{found.message} {sentence}", overlaps=overlaps)
