# SPDX-License-Identifier: Apache-2.0
"""The extremes that a scene's `limits` ask for, of a rod at an equilibrium; SI units, world."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from cable_ros.contact.clearance import clearance
from cable_ros.contact.nodal_rod import NodalRod
from cable_ros.contact.touching_rod import TouchingRod
from cable_ros.limits import QUANTITIES, Extreme
from cable_ros.rod import quaternion
from cable_ros.rod.centreline import position
from cable_ros.rod.elements import integrals, reference_element
from cable_ros.rod.kirchhoff import NO_LINES, Rod
from cable_ros.rod.resultants import CURVATURE, TENSION, TWIST, Law, Loads, Shape, centreline, largest
from cable_ros.rod.units import Units
from cable_ros.scene.cable_limits import CableLimits

SPREAD = 4
"""Number of point forces for the pressure at a sample of a patch: 1 has an error of 3e-3 of the curvature
there, 4 one of 1e-4."""
NO_ARC_LENGTHS = np.zeros(0)


class Obstacles(NamedTuple):
    """The obstacles of a scene."""

    placed: np.ndarray
    """(n, WIDTH) as `distance.placed` makes them."""
    names: Sequence[str]


def extremes(
    rod: Rod, q: np.ndarray, F: np.ndarray, start: np.ndarray, unit: Units, limits: CableLimits,
    obstacles: Obstacles,
) -> Reading:  # fmt: skip
    """Computes `Equilibrium.extremes` when called; from copies, since the rod changes.

    Args:
        rod, q, F: at an equilibrium, with its nodal frames (n, 4) and end force (3,).
        start: (7,) the start clamp in the world, m, quaternion x y z w.
        unit: of the cable.
        limits: of the cable.
        obstacles: of the scene, whether or not contact is among the effects.
    """
    loads = Loads(F.copy(), quaternion.rotate(q[-1], rod.g[-1]), rod.f.copy(), *point_forces(rod, q))
    compliance = rod.compliance
    mesh = rod.h.copy(), rod.s0.copy(), rod.mesh.element.order
    law = Law(rod.K, rod.natural)
    if compliance.any() and isinstance(rod, TouchingRod | NodalRod) and rod.touches:
        c = rod.centreline(q, F)
        judge = partial(_judged, q.copy(), mesh, law, c, loads, start.copy(), unit, limits, obstacles)
        return Reading(judge)
    return Reading(
        partial(_found, q.copy(), mesh, law, compliance, loads, start.copy(), unit, limits, obstacles)
    )


def point_forces(rod: Rod, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Arc lengths (k,), rising, and forces on the rod (k, 3) of its contacts, in units of the cable.

    `q` (n, 4): nodal frames of its equilibrium.

    The pressure at a sample of a patch becomes several forces with the same resultant and moment: a single
    one would cause a kink in the curvature.
    """
    contacts = rod.loaded_contacts(q)
    if contacts is None:
        return NO_ARC_LENGTHS, NO_LINES
    loaded = contacts()
    times = np.where(loaded.lengths > 0.0, SPREAD, 1)
    apart = np.concatenate([(np.arange(count) + 0.5) / count - 0.5 for count in (*times, 1)])[:-1]
    arc_lengths = np.repeat(loaded.arc_lengths, times) + apart * np.repeat(loaded.lengths, times)
    forces = np.repeat(loaded.forces / times[:, None], times, axis=0)
    order = np.argsort(arc_lengths, kind="stable")
    return np.ascontiguousarray(arc_lengths[order]), np.ascontiguousarray(forces[order])


def _found(
    q: np.ndarray, mesh: tuple[np.ndarray, np.ndarray, int], law: Law, compliance: np.ndarray, loads: Loads,
    start: np.ndarray, unit: Units, limits: CableLimits, obstacles: Obstacles,
) -> Judged:  # fmt: skip
    h, s0, order = mesh
    values, primitives, _ = integrals(order)
    points = reference_element(order, len(values)).points
    c = np.empty((len(h), len(values) + 1, 3))
    centreline(q, loads.F, loads.f, compliance, h, s0, values, points, primitives, c)
    return _judged(q, mesh, law, c, loads, start, unit, limits, obstacles)


def _judged(
    q: np.ndarray, mesh: tuple[np.ndarray, np.ndarray, int], law: Law, c: np.ndarray, loads: Loads,
    start: np.ndarray, unit: Units, limits: CableLimits, obstacles: Obstacles,
) -> Judged:  # fmt: skip
    """As `_found`, on the centreline with the coefficients c (m, g + 1, 3)."""
    h, s0, order = mesh
    found = largest(Shape(q, h, s0, reference_element(order).nodes, c), law, loads).tolist()
    least, at, which = clearance(c, h, s0, obstacles.placed)
    curvature, tension, twist = found[CURVATURE], found[TENSION], found[TWIST]
    worst = (
        (unit.length / curvature[0] if curvature[0] > 0.0 else math.inf, curvature[1]),
        (tension[0] * unit.force, tension[1]),
        (twist[0] / unit.length, twist[1]),
        (least * unit.length, at),
    )
    return Judged(worst, (c, h, s0), start, unit, limits, obstacles.names[which] if least < math.inf else "")


@dataclass(frozen=True, eq=False)
class Judged:
    """What `limits.QUANTITIES` are at their worst along one rod."""

    worst: tuple[tuple[float, float], ...]
    """Of each the value, SI, and the arc length, L."""
    curve: tuple[np.ndarray, np.ndarray, np.ndarray]
    """As `centreline.position` takes it."""
    start: np.ndarray
    """(7,) the start clamp in the world, m, quaternion x y z w."""
    unit: Units
    limits: CableLimits
    nearest: str
    """The obstacle to which the clearance is least."""

    def extreme(self, k: int, before: float = 0.0) -> Extreme:
        """Of quantity k, on a cable of which a length `before`, m, comes before this rod."""
        quantity, (value, s) = QUANTITIES[k], self.worst[k]
        r, at = np.full(3, np.nan), math.nan
        if math.isfinite(value):
            position(*self.curve, s, r)
            r = self.start[:3] + self.unit.length * quaternion.matrix_from_ros(self.start[3:]) @ r
            at = s * self.unit.length + before
        near = self.nearest if quantity.name == "clearance" else ""
        return Extreme(quantity, float(value), at, r, getattr(self.limits, quantity.name), near)


class Reading:
    """The extremes of a rod, computed when they are asked for."""

    def __init__(self, judge: Callable[[], Judged]) -> None:
        self._judge = judge

    @cached_property
    def judged(self) -> Judged:
        """The worst of each quantity."""
        return self._judge()

    def __call__(self) -> tuple[Extreme, ...]:
        return tuple(self.judged.extreme(k) for k in range(len(QUANTITIES)))


def worst_of(readings: Sequence[Reading], cuts: Sequence[float]) -> tuple[Extreme, ...]:
    """Of a cable whose pieces are these rods, which begin at the arc lengths `cuts`, m."""
    out = []
    for k, quantity in enumerate(QUANTITIES):
        values = [one.judged.worst[k][0] for one in readings]
        i = values.index(min(values) if quantity.least else max(values))
        out.append(readings[i].judged.extreme(k, cuts[i]))
    return tuple(out)
