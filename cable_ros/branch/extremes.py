# SPDX-License-Identifier: Apache-2.0
"""The extremes that a scene's `limits` ask for, of a rod at an equilibrium; SI units, world."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cable_ros.contact.clearance import clearance
from cable_ros.contact.distance import placed
from cable_ros.contact.nodal_rod import NodalRod
from cable_ros.contact.touching_rod import TouchingRod
from cable_ros.limits import QUANTITIES, Extreme
from cable_ros.rod.centreline import place
from cable_ros.rod.elements import integrals, reference_element
from cable_ros.rod.kirchhoff import NO_LINES, Rod
from cable_ros.rod.resultants import CURVATURE, ROUGH, TENSION, TWIST, largest, survey
from cable_ros.rod.units import Units
from cable_ros.scene.cable_limits import CableLimits

SPREAD = 4
"""Number of point forces for the pressure at a sample of a patch: 1 has an error of 3e-3 of the curvature
there, 4 one of 1e-4."""
NO_ARC_LENGTHS = np.zeros(0)


class Obstacles(NamedTuple):
    """The obstacles of a scene."""

    local: np.ndarray
    """(n, WIDTH) in the frames of their links, SI; see `distance.placed`."""
    links: np.ndarray
    """(n, 7) these links in the world."""
    names: Sequence[str]
    placed: np.ndarray | None = None
    """(n, WIDTH) as `distance.placed` makes them, if they are known."""


def extremes(
    rod: Rod, q: np.ndarray, F: np.ndarray, start: np.ndarray, unit: Units, limits: CableLimits,
    obstacles: Obstacles,
) -> Reading:  # fmt: skip
    """Computes `Equilibrium.extremes` when called; from copies of what the rod changes.

    Args:
        rod, q, F: at an equilibrium, with its nodal frames (n, 4) and end force (3,), which it keeps.
        start: (7,) the start clamp in the world, m, quaternion x y z w.
        unit: of the cable.
        limits: of the cable.
        obstacles: of the scene, whether or not contact is among the effects.
    """
    c = None
    if rod.soft and isinstance(rod, TouchingRod | NodalRod) and rod.touches:
        c = rod.centreline(q, F)
    loads = F, rod.g[-1].copy(), rod.f, *point_forces(rod, q)
    mesh = rod.h.copy(), rod.s0.copy(), rod.mesh.element.order
    law = rod.K, rod.natural.copy()
    return Reading(q, mesh, law, rod.compliance, loads, start, unit, limits, obstacles, c)


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


@dataclass(eq=False)  # made in a quarter of the time of a frozen one, for each piece of each pose
class Reading:
    """A rod at an equilibrium, whose extremes are computed when they are asked for."""

    q: np.ndarray
    """(n, 4) nodal frames."""
    mesh: tuple[np.ndarray, np.ndarray, int]
    """(m,) lengths of the elements, (m,) arc lengths at which they start, L, and their order."""
    law: tuple[np.ndarray, np.ndarray]
    """Fields of `resultants.Law`."""
    compliance: np.ndarray
    """(3,) of shear and axial strain."""
    loads: tuple[np.ndarray, ...]
    """Fields of `resultants.Loads`."""
    start: np.ndarray
    """(7,) the start clamp in the world, m, quaternion x y z w."""
    unit: Units
    limits: CableLimits
    obstacles: Obstacles
    centreline: np.ndarray | None
    """(m, g + 1, 3) coefficients; None: those of the frames."""

    @cached_property
    def _survey(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The samples and the bounds of `resultants.survey`, those in SI units, and the centreline."""
        (h, s0, order), c, nodes = self.mesh, self.centreline, reference_element(self.mesh[2]).nodes
        stretch = self.compliance, NO_LINES, NO_ARC_LENGTHS, NO_LINES
        if c is None:
            values, primitives, _ = integrals(order)
            stretch = self.compliance, values, reference_element(order, len(values)).points, primitives
            c = np.empty((len(h), len(values) + 1, 3))
        samples, bounds = np.empty((len(h) + len(self.loads[3]), 2 * len(nodes) + 1, 3)), np.empty((2, 3))
        survey((self.q, h, s0, nodes, c), self.law, self.loads, stretch, samples, bounds)
        return samples, bounds * self._scale, c

    @property
    def _scale(self) -> tuple[float, float, float]:
        """What takes squared curvature, tension and twist to SI units."""
        unit = self.unit
        return unit.length**-2, unit.force, 1.0 / unit.length

    @property
    def bounds(self) -> np.ndarray:
        """(2, 3) squared curvature, tension and twist that are reached, and that are not exceeded, SI."""
        return self._survey[1]

    def largest(self, least: Sequence[float]) -> list[list[float]]:
        """Largest curvature, tension and twist, SI, and their arc lengths, L.

        Those that may be above `least` (3,), SI, of the squared curvature; see `resultants.largest`.
        """
        (h, s0, order), out, scale = self.mesh, np.empty((3, 2)), self._scale
        samples, _, c = self._survey
        shape = self.q, h, s0, reference_element(order).nodes, c
        largest(shape, self.law, self.loads, samples, np.divide(least, scale), out)
        found: list[list[float]] = out.tolist()
        for row, unit in zip(found, (scale[TWIST], *scale[TENSION:]), strict=True):
            row[0] *= unit
        return found

    def clearance(self, most: float) -> tuple[float, float, int]:
        """Least distance from the obstacles, m, its arc length, L, and which one it is; see `clearance`."""
        beside, length, (h, s0, _) = self.obstacles, self.unit.length, self.mesh
        obstacles = beside.placed
        if obstacles is None:
            obstacles = placed(beside.local, beside.links, self.start, length)
        least, at, which = clearance(self._survey[2], h, s0, obstacles, most / length)
        return least * length, at, which

    def extreme(self, k: int, value: float, s: float, obstacle: str, before: float) -> Extreme:
        """Of quantity k, at the arc length s, L; a length `before`, m, of the cable comes before the rod."""
        r, at = np.full(3, np.nan), math.nan
        if math.isfinite(value):
            h, s0, _ = self.mesh
            place(self._survey[2], h, s0, s, self.start, self.unit.length, r)
            at = s * self.unit.length + before
        quantity = QUANTITIES[k]
        return Extreme(quantity, value, at, r, getattr(self.limits, quantity.name), obstacle)

    def __call__(self) -> tuple[Extreme, ...]:
        return worst_of([self], [0.0])


def worst_of(readings: Sequence[Reading], cuts: Sequence[float]) -> tuple[Extreme, ...]:
    """Of a cable whose pieces are these rods, which begin at the arc lengths `cuts`, m.

    A piece is looked at closely only where it may be worse than all others.
    """
    reached, exceeded = zip(*(one.bounds.tolist() for one in readings), strict=True)
    least = [max(values) for values in zip(*reached, strict=True)]
    near = [any(b >= a - ROUGH * abs(a) for a, b in zip(least, most, strict=True)) for most in exceeded]
    worst = [(0.0, 0.0, 0), (-math.inf, 0.0, 0), (0.0, 0.0, 0)]  # value, arc length, and which piece
    nearest, at, where, which = math.inf, 0.0, 0, 0
    for i, one in enumerate(readings):
        for k, (value, s) in enumerate(one.largest(least) if near[i] else ()):
            if value > worst[k][0]:
                worst[k] = value, s, i
        value, s, obstacle = one.clearance(nearest)
        if value < nearest:
            nearest, at, where, which = value, s, i, obstacle
    curvature, s, i = worst[CURVATURE]
    worst[CURVATURE] = 1.0 / curvature if curvature > 0.0 else math.inf, s, i
    out = [readings[i].extreme(k, value, s, "", cuts[i]) for k, (value, s, i) in enumerate(worst)]
    name = readings[where].obstacles.names[which] if nearest < math.inf else ""
    return (*out, readings[where].extreme(len(worst), nearest, at, name, cuts[where]))
