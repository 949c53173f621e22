"""Following one branch along a path of conditions, and what happens where it ends."""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cable_ros.solve.trust_region import Options
from cable_ros.statics import compiled
from cable_ros.statics.rod import Rod
from cable_ros.statics.search import Conditions, Found, settle

SHORTEST = 1e-4
"""Smallest part of a joint step, in rad of the section that turns most, before the branch counts as ended."""
MOST_FALLS = 20
"""A way with more falls than this is none."""
GRID = np.linspace(0.0, 1.0, 33)
"""Where shapes are compared."""


class End(enum.Enum):
    """How a walk ended."""

    ARRIVED = enum.auto()
    SNAPPED = enum.auto()
    BEYOND_REACH = enum.auto()
    STUCK = enum.auto()


@dataclass(frozen=True, eq=False)
class Snap:
    """A fall from the end of one branch to another, at the part `at` of the path; in units of the cable."""

    at: float
    energy_before: float
    energy_after: float
    twist_before: float
    twist_after: float


@dataclass(frozen=True, eq=False)
class Walk:
    """Where a walk ended: part of the path, state there, iterations of all steps, falls on the way."""

    end: End
    at: float
    q: np.ndarray
    F: np.ndarray
    iterations: int
    snaps: tuple[Snap, ...] = ()


def walk(
    rod: Rod, q: np.ndarray, F: np.ndarray, path: Callable[[float], Conditions], tolerance: float,
    step: float = 0.25, longest: float = 1.0,
) -> Walk:  # fmt: skip
    """Follow the branch of the factored equilibrium (q, F) along path(0..1), in steps of at most `longest`.

    A step is halved until the warm-started solve converges from it. Where even the smallest does not, the
    cable descends from there to the next stable equilibrium at fixed ends (`fall`). The walk is stuck where
    the rod has no `work` left.
    """
    at, iterations, falls = 0.0, 0, 0
    snaps: list[Snap] = []
    while at < 1.0:
        if rod.work <= 0.0:
            # what is solved anew is there sooner
            rod.refactor(q, F)
            return Walk(End.STUCK, at, q, F, iterations, tuple(snaps))
        target = min(1.0, at + step)
        conditions = path(target)
        code, count, q_new, F_new = rod.advance(
            q, F, conditions.qe, conditions.re, conditions.f, tolerance, 0.35, conditions.obstacles
        )
        iterations += count
        if code == compiled.ADVANCED:
            at, q, F = target, q_new, F_new
            if count <= 3:
                step = min(2.0 * step, longest)
            continue
        if np.linalg.norm(conditions.re) >= 1.0 and step < 0.02:
            return Walk(End.BEYOND_REACH, at, q, F, iterations, tuple(snaps))
        if not rod.refactor(q, F):
            return Walk(End.STUCK, at, q, F, iterations, tuple(snaps))
        if code != compiled.TOO_FAR and step * 0.5 < SHORTEST:
            falls += 1
            if falls > MOST_FALLS:
                return Walk(End.STUCK, at, q, F, iterations, tuple(snaps))
            shape = rod.mesh.interpolate(q, GRID)
            fallen = fall(rod, q, F, path(min(1.0, at + step)))
            if fallen is None:
                return Walk(End.STUCK, at, q, F, iterations, tuple(snaps))
            found, before, twist = fallen
            iterations += found.iterations
            at = min(1.0, at + step)
            if _jumped(shape, rod.mesh.interpolate(found.q, GRID)):
                snaps.append(Snap(at, before, found.energy, twist, found.twist))
            q, F = found.q, found.F
            continue
        step *= 0.5
        if step < 1e-9:
            return Walk(End.STUCK, at, q, F, iterations, tuple(snaps))
    return Walk(End.SNAPPED if snaps else End.ARRIVED, 1.0, q, F, iterations, tuple(snaps))


def fall(rod: Rod, q: np.ndarray, F: np.ndarray, conditions: Conditions) -> tuple[Found, float, float] | None:
    """Descend the energy from (q, F) under the given conditions, in short steps so that no ridge is jumped.

    Returns the stable equilibrium it ends in, and energy and twist of the start; None where none was reached.
    """
    energy, _, _ = rod.linearize(q, F)
    twist = float(rod.totals[4])
    rod.set_conditions(conditions.qe, conditions.re, conditions.f, conditions.obstacles)
    q = q.copy()
    q[-1] = conditions.qe if q[-1] @ conditions.qe > 0.0 else -conditions.qe
    found = settle(rod, q, F, Options(radius=0.1, largest_radius=0.3, iterations=400))
    return None if found is None else (found, energy, twist)


def _jumped(before: np.ndarray, after: np.ndarray) -> bool:
    """Whether some section turned by more than a small step ever would: 0.2 rad."""
    return bool(np.max(1.0 - np.abs(np.sum(before * after, axis=1))) > 0.005)
