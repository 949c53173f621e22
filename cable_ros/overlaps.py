"""Where a cable meets itself or another: contact between cables is not modelled, but told."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from cable_ros.compilation import njit
from cable_ros.equilibrium import Equilibrium, Overlap
from cable_ros.scene import Cable

NOT_MODELLED = "Contact of the cable with itself is not modelled"
SPACING = np.pi
"""Parts of the cable nearer than so many diameters along it are neighbours, not a contact."""
OUTLINE = 101
"""Points of a polyline that tell how near cables come."""
LONGEST = 1.1
"""A cable may be stretched to this many lengths."""


def closest_approach(points: np.ndarray, length: float, spacing: float) -> float:
    """Smallest distance of two parts of a polyline (n, 3) that are `spacing` or more apart along it; in m.

    The points are `length` / (n - 1) apart along the cable. Infinite where no parts are so far apart.
    """
    step = length / (len(points) - 1)
    return float(_closest(points, points, step, step, int(np.ceil(spacing / step))))


def closest_between(a: np.ndarray, b: np.ndarray, step_a: float, step_b: float) -> float:
    """Smallest distance of two polylines (n, 3), (m, 3), m.

    `step_a`, `step_b`: the most that neighbouring points may be apart, m.
    """
    return float(_closest(a, b, step_a, step_b, -1))


@njit(cache=True)
def _closest(a, b, step_a, step_b, skip):  # type: ignore[no-untyped-def]
    """Smallest distance of segments; with `skip` >= 0 of those of one polyline, so many points apart.

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
    if not near < np.inf:
        return near
    best, limit = near, near + 0.5 * (step_a + step_b)
    for i in range(a.shape[0]):
        k = 0 if skip < 0 else i + skip
        while k < b.shape[0]:
            d = np.sqrt((b[k, 0] - a[i, 0]) ** 2 + (b[k, 1] - a[i, 1]) ** 2 + (b[k, 2] - a[i, 2]) ** 2)
            if d <= limit:
                for m in range(max(i - 1, 0), min(i + 1, a.shape[0] - 1)):
                    for n in range(max(k - 1, 0), min(k + 1, b.shape[0] - 1)):
                        if skip < 0 or n >= m + 1 + skip:
                            best = min(best, _between(a[m], a[m + 1], b[n], b[n + 1]))
            k += max(1, int((d - limit) / step_b))
    return best


@njit(cache=True)
def _between(p, p_end, q, q_end):  # type: ignore[no-untyped-def]
    """Distance of two segments; Ericson, Real-Time Collision Detection (2005), 5.1.9."""
    u, v, w = p_end - p, q_end - q, p - q
    uu, uv, vv, uw, vw = (u * u).sum(), (u * v).sum(), (v * v).sum(), (u * w).sum(), (v * w).sum()
    across = uu * vv - uv * uv
    s = 0.0
    if across > 1e-12 * uu * vv:  # else parallel: any place will do
        s = min(max((uv * vw - uw * vv) / across, 0.0), 1.0)
    t = (uv * s + vw) / vv if vv > 0.0 else 0.0
    t = min(max(t, 0.0), 1.0)
    s = min(max((uv * t - uw) / uu, 0.0), 1.0) if uu > 0.0 else 0.0
    d = w + s * u - t * v
    return np.sqrt((d * d).sum())


def warning(apart: float, diameter: float) -> str:
    """A sentence where the parts of a cable are only `apart`, m."""
    return (
        f"{NOT_MODELLED} and matters here: two parts of it are "
        f"{apart * 1e3:.3g} mm apart, less than the diameter of {diameter * 1e3:.3g} mm."
    )


class Pairs:
    """The pairs of a scene's cables that have a thickness."""

    def __init__(self, cables: Sequence[Cable]) -> None:
        self._cables = cables
        thick = [i for i, cable in enumerate(cables) if cable.radius]
        self._pairs = [(i, k) for i in thick for k in thick if i < k]
        self._reach = np.array([0.5 * LONGEST * c.length + c.radius for c in cables])

    def mark(
        self, found: dict[str, Equilibrium], poses: np.ndarray, outline: Callable[[int], np.ndarray]
    ) -> None:
        """Put into `found` where its cables overlap, and what their messages then say.

        Args:
            found: equilibria by cable.
            poses: (cables, 2, 7) the clamps in the world.
            outline: gives a cable's polyline (n, 3), world, m, by its number.
        """
        for i, k in self._near(poses[..., :3].mean(axis=1)):
            one, other = self._cables[i], self._cables[k]
            if not (found[one.name].status.trusted and found[other.name].status.trusted):
                continue
            needed = one.radius + other.radius
            apart = self._apart(i, k, outline(i), outline(k), needed)
            if apart < needed:
                found[one.name] = _overlapping(found[one.name], Overlap(other.name, apart, needed))
                found[other.name] = _overlapping(found[other.name], Overlap(one.name, apart, needed))

    def _near(self, middles: np.ndarray) -> list[tuple[int, int]]:
        """Pairs whose bounding spheres meet: half a length about the middle between the clamps."""
        return [
            (i, k)
            for i, k in self._pairs
            if ((middles[i] - middles[k]) ** 2).sum() < (self._reach[i] + self._reach[k]) ** 2
        ]

    def _apart(self, i: int, k: int, a: np.ndarray, b: np.ndarray, needed: float) -> float:
        """Smallest distance of the polylines but for what is beside a clamp that both share."""
        steps = [LONGEST * self._cables[at].length / (len(points) - 1) for at, points in ((i, a), (k, b))]
        bare = [int(np.ceil(SPACING * needed / step)) for step in steps]
        ends = (slice(None), slice(None, None, -1))  # from the start, from the end
        keep_a, keep_b = [0, len(a)], [0, len(b)]
        for p, from_p in enumerate(ends):
            for q, from_q in enumerate(ends):
                if np.linalg.norm(a[from_p][0] - b[from_q][0]) < needed:
                    keep_a[p] = bare[0] if p == 0 else len(a) - bare[0]
                    keep_b[q] = bare[1] if q == 0 else len(b) - bare[1]
        a, b = a[slice(*keep_a)], b[slice(*keep_b)]
        return closest_between(a, b, *steps) if len(a) and len(b) else np.inf


def _overlapping(found: Equilibrium, overlap: Overlap) -> Equilibrium:
    message = (
        f"{found.message} Contact between cables is not modelled and matters here: it comes within "
        f"{overlap.distance * 1e3:.3g} mm of cable '{overlap.other}', less than the sum of their radii, "
        f"{overlap.contact_distance * 1e3:.3g} mm."
    )
    return dataclasses.replace(found, message=message, overlaps=(*found.overlaps, overlap))
