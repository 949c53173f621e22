"""Cold start among obstacles where no start settles: they grow into the free cable, which gives way."""

from __future__ import annotations

import numpy as np

from cable_ros.mechanics.effects.contact import gaps
from cable_ros.mechanics.effects.contact_kernels import OFFSET
from cable_ros.statics.search import Conditions, Found, equilibria
from cable_ros.statics.touching import TouchingRod
from cable_ros.statics.walk import End, walk

TRIED = 3
"""So many equilibria of the free cable are led on."""
ROOM = 1e-3
"""The obstacles start this much smaller than what would touch, parts of the length."""


def inflated(
    stiffness: np.ndarray, natural: np.ndarray, conditions: Conditions, hint: float | None, tolerance: float
) -> list[Found]:
    """Stable equilibria among the obstacles of `conditions`, followed from those without; see `equilibria`."""
    assert conditions.obstacles is not None
    free = Conditions(conditions.qe, conditions.re, conditions.f)
    found = equilibria(stiffness, natural, free, hint, tolerance, thorough=False)
    if hint is not None:
        found.sort(key=lambda one: abs(one.twist - hint))
    out = []
    for one in found[:TRIED]:
        rod = TouchingRod(one.rod.mesh, stiffness, natural, tolerance)
        obstacles = conditions.obstacles
        shrunk = obstacles.copy()
        shrunk[:, OFFSET] -= np.maximum(ROOM - _clearance(one, obstacles), 0.0)

        def path(t: float, shrunk: np.ndarray = shrunk) -> Conditions:
            grown = obstacles.copy()
            grown[:, OFFSET] = (1.0 - t) * shrunk[:, OFFSET] + t * obstacles[:, OFFSET]
            return Conditions(conditions.qe, conditions.re, conditions.f, grown)

        rod.set_conditions(conditions.qe, conditions.re, conditions.f, shrunk)
        rod.refactor(one.q, one.F)
        result = walk(rod, one.q, one.F, path, 1e-3 * tolerance, 0.05, 0.1)
        if result.end in (End.ARRIVED, End.SNAPPED) and rod.refactor(result.q, result.F):
            energy, twist = float(rod.totals[3]), float(rod.totals[4])
            out.append(Found(rod, result.q, result.F, energy, twist, one.iterations + result.iterations))
            if hint is not None:
                break
    return sorted(out, key=lambda one: one.energy)


def _clearance(one: Found, obstacles: np.ndarray) -> np.ndarray:
    """(n,) the smallest gap of the shape to each obstacle, negative inside."""
    table = one.rod.mesh.interpolate(one.q, np.linspace(0.0, 1.0, 201))
    w, x, y, z = table.T
    tangents = np.column_stack([2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z])
    steps = 0.5 * (tangents[1:] + tangents[:-1]) / 200.0
    shape = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    return np.min([gaps(obstacles, r) for r in shape[2:-2]], axis=0)
