# SPDX-License-Identifier: Apache-2.0
"""The extremes that a scene's `limits` ask for, of a rod at an equilibrium; SI units, world."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from cable_ros.contact.clearance import clearance
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
) -> Callable[[], tuple[Extreme, ...]]:  # fmt: skip
    """A function that computes `Equilibrium.extremes` when called; from copies, since the rod changes.

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
    if compliance.any() and isinstance(rod, TouchingRod) and rod.touches:
        rod.trace(q, F)
        return partial(
            _judged, q.copy(), mesh, law, rod.c.copy(), loads, start.copy(), unit, limits, obstacles
        )
    return partial(_found, q.copy(), mesh, law, compliance, loads, start.copy(), unit, limits, obstacles)


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
) -> tuple[Extreme, ...]:  # fmt: skip
    h, s0, order = mesh
    values, primitives, _ = integrals(order)
    points = reference_element(order, len(values)).points
    c = np.empty((len(h), len(values) + 1, 3))
    centreline(q, loads.F, loads.f, compliance, h, s0, values, points, primitives, c)
    return _judged(q, mesh, law, c, loads, start, unit, limits, obstacles)


def _judged(
    q: np.ndarray, mesh: tuple[np.ndarray, np.ndarray, int], law: Law, c: np.ndarray, loads: Loads,
    start: np.ndarray, unit: Units, limits: CableLimits, obstacles: Obstacles,
) -> tuple[Extreme, ...]:  # fmt: skip
    """As `_found`, on the centreline with the coefficients c (m, g + 1, 3)."""
    h, s0, order = mesh
    found = largest(Shape(q, h, s0, reference_element(order).nodes, c), law, loads)
    least, at, which = clearance(c, h, s0, obstacles.placed)
    curvature, tension, twist = found[[CURVATURE, TENSION, TWIST]].tolist()
    worst = (
        (unit.length / curvature[0] if curvature[0] > 0.0 else np.inf, curvature[1]),
        (tension[0] * unit.force, tension[1]),
        (twist[0] / unit.length, twist[1]),
        (least * unit.length, at),
    )
    turn = quaternion.matrix_from_ros(start[3:])
    out = []
    for quantity, (value, s) in zip(QUANTITIES, worst, strict=True):
        r = np.full(3, np.nan)
        if np.isfinite(value):
            position(c, h, s0, s, r)
            r = start[:3] + unit.length * turn @ r
        near = obstacles.names[which] if quantity.name == "clearance" and np.isfinite(value) else ""
        at_s = s * unit.length if np.isfinite(value) else np.nan
        out.append(Extreme(quantity, float(value), at_s, r, getattr(limits, quantity.name), near))
    return tuple(out)
