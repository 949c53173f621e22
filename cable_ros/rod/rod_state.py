# SPDX-License-Identifier: Apache-2.0
"""Groups of arguments of a rod's compiled functions: m elements of order p with g Gauss points, n nodes.

b = 3 (p + 1) is the number of rotations of an element. Units of the cable, start clamp's frame, quaternions
scalar first. Python passes these groups as plain tuples, see `entry_points`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cable_ros.compilation import LEAF, njit
from cable_ros.linalg.bordered import Factors

ENERGY, TWIST = 3, 4
"""Slots of `Evaluation.totals` after the end position."""


class Section(NamedTuple):
    """The cable's cross section; changes with the cable's properties only."""

    K: np.ndarray
    """(3,) stiffness about the section's axes, EI."""
    natural: np.ndarray
    """(3,) curvature and twist of the unloaded cable, 1 / L."""


class Tables(NamedTuple):
    """Shape functions and quadrature of the reference element on [0, 1]; never change."""

    values: np.ndarray
    """(g, p + 1) shape functions at the Gauss points."""
    slopes: np.ndarray
    """(g, p + 1) their derivatives."""
    values3: np.ndarray
    """(g, b) `values` with every column three times."""
    slopes3: np.ndarray
    """(g, b) `slopes` with every column three times."""
    points: np.ndarray
    """(g,) Gauss points."""
    weights: np.ndarray
    """(g,) their weights."""
    by_point: np.ndarray
    """(2, blocks, p + 1, LANES) values and slopes at LANES points side by side."""
    by_node: np.ndarray
    """(2, g, p + 1 and zeros up to whole LANES) values and slopes times the weights."""
    nodes: np.ndarray
    """(p + 1,) nodes."""
    primitives: np.ndarray
    """(g, g) integrals of the polynomials through the Gauss points, see `elements.primitives`."""


class Grid(NamedTuple):
    """The mesh; contact moves the boundaries between elements, so that h and s0 change in place."""

    h: np.ndarray
    """(m,) lengths of the elements, L."""
    s0: np.ndarray
    """(m,) arc lengths at which they start, L."""
    tables: Tables
    """The reference element."""


class Evaluation(NamedTuple):
    """What `energy_kernels.gradient` computes; changes with every evaluation."""

    acc: np.ndarray
    """(n, 4) comes with what else pulls at the nodal quaternions, and is used up."""
    g: np.ndarray
    """(n, 3) gradient of the Lagrangian by the nodal rotations, EI / L."""
    radial: np.ndarray
    """(n,) a quarter of the derivative along each nodal quaternion: what the curvature of the unit sphere
    adds to the Hessian."""
    totals: np.ndarray
    """(5,) end position (3), L; elastic energy less the weight's work, EI / L; total twist, rad."""
    lanes: np.ndarray
    """Workspace, see `energy_kernels.workspace`."""


class Tangents(NamedTuple):
    """What `energy_kernels.hessian` computes; changes with every new tangent."""

    elastic: np.ndarray
    """(3n, b) second derivative of the elastic energy by the nodal rotations, lower band."""
    geometric: np.ndarray
    """(3n, b) that of the forces' potential."""
    dchord: np.ndarray
    """(m, 3, b) derivative of each element's chord by its own nodes' rotations, L."""
    C: np.ndarray
    """(3, 3n) derivative of the end position, the sum of all chords, by the nodal rotations, L."""


class Conditions(NamedTuple):
    """What a step leads to; changes with every step."""

    qe: np.ndarray
    """(4,) end frame."""
    re: np.ndarray
    """(3,) end position, L."""
    f: np.ndarray
    """(3,) load per length, EI / L^3."""


class StepControl(NamedTuple):
    """When a step ends, fails, and refactors; changes with every step."""

    tolerance: float
    """Of what is left of nodal rotation, rad, and relative end force."""
    limit: float
    """Maximum rotation of a section, rad."""
    rotation: float
    """Maximum rotation of a section since the last factorisation, rad."""
    refactor_at: float
    """`rotation` above which the factors are made again, rad."""


class Path(NamedTuple):
    """The last equilibria of `warm_step.advance` on this mesh, latest first; changes with every step."""

    shapes: np.ndarray
    """(3, n, 4) nodal frames."""
    forces: np.ndarray
    """(3, 3) end forces, EI / L^2."""
    conditions: np.ndarray
    """(3, 10) end frame, end position, load."""


class System(NamedTuple):
    """The linear system of a step; changes as its members do."""

    evaluation: Evaluation
    """Right-hand side."""
    tangents: Tangents
    """Matrix."""
    factors: Factors
    """Its factors."""


class ConstraintRows(NamedTuple):
    """Constraint rows, of which the first three are the end position's; change with every new tangent."""

    V: np.ndarray
    """(rows, 3n) derivatives of the constraints by the nodal rotations."""
    W: np.ndarray
    """(rows, 3n) directions in which the multipliers act: V, but for friction that follows a normal force."""
    delta: np.ndarray
    """(rows,) compliances of the constraints, 0 for an equality, L^3 / EI."""
    lines: np.ndarray
    """(rows, 3) direction along which each row reads a position."""
    upto: np.ndarray
    """(rows,) number of whole elements before that position."""
    owners: np.ndarray
    """(rows,) which contact point's position it is; of the first three, the number of points."""
    movers: np.ndarray
    """(rows,) number of the row whose multiplier moves that point along the cable, where its slip or stick
    changes with it; else 0."""
    shifts: np.ndarray
    """(rows,) change of the constraint by that multiplier, L^2 / EI."""


class Enrichment(NamedTuple):
    """One polynomial more an element, for the error estimate; see `elements.enrichment`."""

    tables: Tables
    """The same element with two more Gauss points."""
    bubble: np.ndarray
    """(2, g) values and slopes of the added polynomial at them."""


class Estimate(NamedTuple):
    """What `error_estimate.error` works with; changes with every estimate."""

    boundaries: np.ndarray
    """(m + 1, 3) positions of the elements' boundaries, L; empty without contact."""
    residual: np.ndarray
    """(3n,) comes with the moments of point forces inside elements, and is used up, EI / L."""
    shares: np.ndarray
    """(m,) receives each element's part of the error in energy, EI / L."""


class Stretch(NamedTuple):
    """Compliance of a rod that stretches and shears, and what it adds to the evaluation and the tangent."""

    compliance: np.ndarray
    """(3,) 1 / GAx, 1 / GAy, 1 / EA, L^2 / EI."""
    reach: np.ndarray
    """(3, 3) derivative of the end position by the end force, L^3 / EI."""
    totals: np.ndarray
    """(4,) displacement of the end by the stretch, L, and its energy, EI / L."""


class Sampling(NamedTuple):
    """Where on a mesh the c equally spaced points of a polyline lie; changes with the mesh."""

    element: np.ndarray
    """(c,) the element of each."""
    values: np.ndarray
    """(c, p + 1) shape functions there."""
    weights: np.ndarray
    """(c + 1, j) weights of the tangents at j points for the displacement from the element's start; the
    last row is for the whole element."""
    quadrature: np.ndarray
    """(j, p + 1) shape functions at those points."""
    points: np.ndarray
    """(j,) those points, on [0, 1]."""


@njit(inline="always", **LEAF)
def grid_of(grid):  # type: ignore[no-untyped-def]
    """`Grid` of the tuple `grid`: lengths, starts, and the fields of `Tables`."""
    h, s0, tables = grid
    return Grid(h, s0, Tables(*tables))


@njit(inline="always", **LEAF)
def system_of(system):  # type: ignore[no-untyped-def]
    """`System` of the tuple `system`: the fields of `Evaluation`, of `Tangents`, and of `Factors`."""
    evaluation, tangents, factors = system
    return System(Evaluation(*evaluation), Tangents(*tangents), Factors(*factors))
