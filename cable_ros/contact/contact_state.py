# SPDX-License-Identifier: Apache-2.0
"""Groups of arguments of an active-set rod's compiled functions: m elements, n nodes, o obstacles.

Units of the cable, start clamp's frame, quaternions scalar first.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cable_ros.compilation import INNER, LEAF, njit
from cable_ros.linalg.bordered import Factors
from cable_ros.rod.rod_state import ConstraintRows, Evaluation, Grid, Tangents, grid_of


class Shape(NamedTuple):
    """Where the cable is; changes in every iteration."""

    q: np.ndarray
    """(n, 4) nodal frames."""
    c: np.ndarray
    """(m, g + 1, 3) coefficients of the centreline, see `centreline.curve`; with a fourth column, the arc
    length of the stretched cable, if it stretches."""
    grid: Grid
    """The mesh."""


class Surface(NamedTuple):
    """What `interfaces.gap_at` finds; workspace."""

    r: np.ndarray
    """(3,) position on the centreline, L."""
    dr: np.ndarray
    """(3,) its derivative by the arc length: between Gauss points it is not quite the tangent."""
    t: np.ndarray
    """(3,) tangent."""
    dt: np.ndarray
    """(3,) curvature vector, 1 / L."""
    n: np.ndarray
    """(3,) the obstacle's normal."""
    directions: np.ndarray
    """(2, 3) principal directions of the gap's Hessian."""
    bends: np.ndarray
    """(2,) its eigenvalues, 1 / L."""


class ContactSet(NamedTuple):
    """The contact points; change with the active set and in every iteration."""

    points: np.ndarray
    """(CAPACITY, COLUMNS), see `contact.points`."""
    gaps: np.ndarray
    """(rows,) what the constraints after the end position are off, see `assembly.assemble_kkt`."""
    normals: np.ndarray
    """(CAPACITY, 3) normals of the obstacles at the contact points."""


class History(NamedTuple):
    """What friction opposes: the motion since the last equilibrium; changes with every step."""

    model: int
    """FRICTIONLESS, COULOMB or SLIDING, see `friction_kernels`."""
    direction: np.ndarray
    """(3,) direction in which the end goes, times the mobilised fraction of the friction; for SLIDING."""
    presliding: float
    """Motion, L, that changes friction by all that is possible; 0: as little as stick allows."""
    bedding: float
    """Stiffness of stick per length along a patch, EI / L^4."""
    still: bool
    """Whether nothing but the mesh has changed: what slips then goes on in its direction."""
    step: float
    """Length of the step, L, in which slip that turns goes on turning; 0: only the mesh changes."""
    c: np.ndarray
    """(m, g + 1, 3) the centreline of the last equilibrium."""
    closed: np.ndarray
    """(m, g + 3, 3) the same by `centreline.close_curve`: more accurate beside the ends of elements."""
    h: np.ndarray
    """(m,) lengths of its elements, L."""
    s0: np.ndarray
    """(m,) arc lengths at which they start, L."""
    obstacles: np.ndarray
    """(o, WIDTH) the obstacles there."""


class Last(NamedTuple):
    """The equilibrium that a step starts from; changes with every step."""

    q: np.ndarray
    """(n, 4) nodal frames."""
    F: np.ndarray
    """(3,) end force, EI / L^2."""
    f: np.ndarray
    """(3,) load per length there, EI / L^3."""
    obstacles: np.ndarray
    """(o, WIDTH) the obstacles there."""
    size: int
    """Number of its contact points."""
    rows: int
    """Number of its constraint rows."""
    ready: bool
    """Whether the factors are those of this equilibrium, or of an earlier one with the same rows."""
    known: bool
    """Whether its gradient is still there."""
    ratio: float
    """The cable's length then over that now."""
    shift: float
    """Arc length now, L, of what was the cable's start."""
    q_then: np.ndarray
    """(k, 4) its nodal frames on the mesh on which it was found: what sticks has its place by these."""
    h_then: np.ndarray
    """(j,) lengths of that mesh's elements, L."""
    s0_then: np.ndarray
    """(j,) arc lengths at which they start, L."""


class Options(NamedTuple):
    """How exactly contact is resolved; change with the tolerance and the mesh."""

    model: int
    """FRICTIONLESS, COULOMB or SLIDING, see `friction_kernels`."""
    direction: np.ndarray
    """(3,) see `History.direction`."""
    presliding: float
    bedding: float
    still: bool
    step: float
    """See `History`; so are presliding to still."""
    softest: float
    """Presliding, L, that a step begins with, to be halved again and again; 0: none but what is asked for."""
    samples: np.ndarray
    """(k,) equally spaced arc lengths at which contact is looked for."""
    depth: float
    """Depth up to which a point may be inside an obstacle, L."""
    give: float
    """The same beside contact patches and within them, L."""
    finest: float
    """Spacing that measures elements along patches, L."""
    bubbles: np.ndarray
    """(2, g + 2) see `elements.end_bubbles`."""
    drag: float
    """Of a viscous medium that resists the rotations in this step, over the elastic stiffness; mostly 0."""
    carried: bool
    """Whether it does not resist the tangent step, which follows the conditions."""
    least: float
    """Force, EI / L^2, that counts as nothing beside the end force; see `Rod.least`."""
    work: float
    """Left for the solve, as `newton.iteration_work` counts it."""


class Strain(NamedTuple):
    """What gives way; all but compliance and `give` is empty for a cable that keeps its length."""

    compliance: np.ndarray
    """(3,) of `rod_state.Stretch`, 0 against shear, L^2 / EI."""
    G: np.ndarray
    """(m, g, 3) internal force at the Gauss points, EI / L^2; changes in every iteration."""
    reach: np.ndarray
    """(rows, rows) how far each row's constraint gives way to each multiplier, L^3 / EI; changes with every
    new tangent."""
    skew: np.ndarray
    """(rows, rows) the same with friction: where it slips it goes along with the normal force, as in `W`, and
    it moves along the cable with its point."""
    give: np.ndarray
    """(3, 3) how far the end position gives way to changes of the end force, L^3 / EI."""


class KKT(NamedTuple):
    """The bordered system of an iteration; changes as its members do."""

    evaluation: Evaluation
    """Right-hand side."""
    tangents: Tangents
    """Matrix."""
    rows: ConstraintRows
    """Its constraint rows."""
    factors: Factors
    """Its factors."""
    strain: Strain
    """What gives way."""


class PointTerms(NamedTuple):
    """What the equations need to know of each of k contact points; workspace of `assembly`."""

    directions: np.ndarray
    """(k, 2, 3) principal directions of the surface."""
    bends: np.ndarray
    """(k, 2) its curvatures along them, 1 / L."""
    curvature: np.ndarray
    """(k,) curvature of the gap along the cable, at points; 0 in patches."""
    slopes: np.ndarray
    """(k, 3) derivative of the gap's slope along the cable by the position, 1 / L."""
    tilts: np.ndarray
    """(k,) slope of the gap along the cable."""
    tangents: np.ndarray
    """(k, friction_kernels.TANGENT) tangents of friction."""
    misfits: np.ndarray
    """(k, 3) how far the spring of what sticks is off its force, L."""
    t: np.ndarray
    """(k, 3) tangents of the cable."""
    dt: np.ndarray
    """(k, 3) curvature vectors of the cable, 1 / L."""
    drift: np.ndarray
    """(k, 3) derivative by the arc length of how far the cable has moved over the obstacle in the step."""
    creep: np.ndarray
    """(k, 3) change since the last equilibrium of the position's derivative by the arc length, just before
    the point; 0 for a cable that keeps its length."""


@njit(**INNER)
def surface() -> Surface:
    """A new `Surface`."""
    return Surface(
        np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty((2, 3)), np.empty(2)
    )


@njit(inline="always", **LEAF)
def shape_of(shape):  # type: ignore[no-untyped-def]
    """`Shape` of the tuple `shape`: q, c, and the fields of `Grid`."""
    q, c, grid = shape
    return Shape(q, c, grid_of(grid))


@njit(inline="always", **LEAF)
def kkt_of(kkt):  # type: ignore[no-untyped-def]
    """`KKT` of the tuple `kkt`: the fields of each of its groups."""
    evaluation, tangents, rows, factors, strain = kkt
    return KKT(
        Evaluation(*evaluation),
        Tangents(*tangents),
        ConstraintRows(*rows),
        Factors(*factors),
        Strain(*strain),
    )
