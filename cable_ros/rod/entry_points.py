# SPDX-License-Identifier: Apache-2.0
"""Compiled: what a rod calls from Python.

Each function is the one of its name elsewhere, but takes the groups of `rod_state` as plain tuples: Numba
takes a NamedTuple from Python field by field, by name, which costs ten times as much. Tuples that stand for a
group have its fields in order. Kernels that only Python calls take tuples themselves, and say so.
"""

from __future__ import annotations

from cable_ros.compilation import njit
from cable_ros.linalg import bordered
from cable_ros.linalg.bordered import Factors
from cable_ros.rod import extensible_kernels, extensible_step
from cable_ros.rod.energy_kernels import gradient, hessian
from cable_ros.rod.rod_state import (
    Section,
    Stretch,
    grid_of,
    system_of,
)
from cable_ros.rod.warm_step import spread

OPTIONS = {"cache": True, "error_model": "numpy"}


@njit(**OPTIONS)
def linearize(q, F, f, section, grid, system, full):
    """Gradient and, if `full`, Hessian of a free rod, see `energy_kernels`.

    Args:
        q, F: (n, 4) nodal frames, (3,) end force.
        f: (3,) load per length.
        section, grid: of `Section` and `Grid`.
        system: of `System`; evaluation and tangents are overwritten.
        full: whether to compute the Hessian.
    """
    section, grid, system = Section(*section), grid_of(grid), system_of(system)
    Fe = spread(F, grid.h)
    system.evaluation.acc[:] = 0.0
    gradient(q, Fe, f, section, grid, system.evaluation)
    if full:
        hessian(q, Fe, f, section, grid, system.evaluation.radial, system.tangents)


@njit(**OPTIONS)
def factor(mu, order, system):
    """See `bordered.factor`."""
    system = system_of(system)
    return bordered.factor(system.tangents, mu, order, system.factors)


@njit(**OPTIONS)
def saddle_step(g, c, order, system, s, dF):
    """See `bordered.saddle_step`."""
    system = system_of(system)
    bordered.saddle_step(g, c, system.tangents.C, order, system.factors, s, dF)


@njit(**OPTIONS)
def kkt_factor(mu, system, rows, skew, reach, give, count, equalities):
    """See `bordered.kkt_factor`."""
    system = system_of(system)
    order = system.tangents.elastic.shape[1] // 3 - 1
    V, W, delta = rows
    return bordered.kkt_factor(
        system.tangents, mu, order, system.factors, V, W, skew, delta, reach, give, count, equalities
    )


@njit(**OPTIONS)
def kkt_step(g, c, V, count, order, factors, s, y):
    """See `bordered.kkt_step`."""
    bordered.kkt_step(g, c, V, count, order, Factors(*factors), s, y)


@njit(**OPTIONS)
def stretch_linearize(q, F, f, section, stretch, grid, system, full):
    """See `extensible_step.stretch_linearize`."""
    extensible_step.stretch_linearize(
        q, F, f, Section(*section), Stretch(*stretch), grid_of(grid), system_of(system), full
    )


@njit(**OPTIONS)
def stretch_factor(system, reach, mu, order):
    """See `extensible_step.stretch_factor`."""
    return extensible_step.stretch_factor(system_of(system), reach, mu, order)


@njit(**OPTIONS)
def stretch_gradient(q, Fe, f, grid, stretch, acc):
    """See `extensible_kernels.stretch_gradient`; without point forces inside elements."""
    grid = grid_of(grid)
    G = extensible_kernels.internal_forces(Fe, f, grid)
    extensible_kernels.stretch_gradient(q, G, f, grid, Stretch(*stretch), acc)


@njit(**OPTIONS)
def strain_gradient(q, G, f, grid, stretch, acc):
    """See `extensible_kernels.stretch_gradient`; G (m, g, 3) at the Gauss points."""
    extensible_kernels.stretch_gradient(q, G, f, grid_of(grid), Stretch(*stretch), acc)
