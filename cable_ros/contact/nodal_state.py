# SPDX-License-Identifier: Apache-2.0
"""Groups of arguments of a nodal rod's compiled functions: m elements, n nodes, o obstacles.

Units of the cable, start clamp's frame, quaternions scalar first.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cable_ros.rod.rod_state import Evaluation, Grid, Section

ORDER = 2
"""Order of the elements: the grid of contacts limits the accuracy, not the rod."""


class State(NamedTuple):
    """The unknowns; updated in every iteration."""

    q: np.ndarray
    """(n, 4) nodal frames, scalar first."""
    r: np.ndarray
    """(m + 1, 3) positions of the elements' boundaries, L."""
    F: np.ndarray
    """(m, 3) internal force in each element, which the part after it exerts on the part before, EI / L^2."""
    lam: np.ndarray
    """(m + 1, o) normal forces, positive where the obstacle pushes, EI / L^2."""
    tau: np.ndarray
    """(m + 1, o, 2) friction along the two directions of the contact's frame, EI / L^2."""

    @classmethod
    def zeros(cls, elements: int, obstacles: int) -> State:
        """All zero, with `elements` elements and `obstacles` obstacles."""
        n, m = elements * ORDER + 1, elements + 1
        return cls(
            np.zeros((n, 4)), np.zeros((m, 3)), np.zeros((elements, 3)), np.zeros((m, obstacles)),
            np.zeros((m, obstacles, 2)),
        )  # fmt: skip

    def copy(self) -> State:
        """A copy."""
        return State(*(part.copy() for part in self))

    def take(self, other: State) -> None:
        """Copy the other's numbers into this one's arrays."""
        for mine, theirs in zip(self, other, strict=True):
            mine[:] = theirs


class Model(NamedTuple):
    """Section and mesh; never change."""

    f: np.ndarray
    """(3,) zero: the load acts at the boundaries, see `Step.f`."""
    section: Section
    grid: Grid
    compliance: np.ndarray
    """(3,) against shear and tension, L^2 / EI; all 0 for a cable that neither shears nor stretches."""


class Step(NamedTuple):
    """The conditions of a step and the equilibrium that it starts from; changes with every step."""

    qe: np.ndarray
    """(4,) end frame."""
    re: np.ndarray
    """(3,) end position, L."""
    f: np.ndarray
    """(3,) load per length, EI / L^3."""
    obstacles: np.ndarray
    """(o, WIDTH), see `distance.gap`."""
    carried: np.ndarray
    """(m + 1, o, 3) where each boundary would be, L, had it been carried by each obstacle since then."""
    turned: np.ndarray
    """(m + 1, o, 3) the first direction of each contact's frame, likewise carried; unit vectors."""
    tau: np.ndarray
    """(m + 1, o, 2) friction at that equilibrium, EI / L^2."""
    q: np.ndarray
    """(n, 4) frames there."""
    r: np.ndarray
    """(m + 1, 3) positions there, L."""
    drag: float
    """Viscosity of a medium, force per length and motion in the step, EI / L^4; 0: none."""
    normal: float
    """Scale of the projection of normal forces, EI / L^3."""
    tangential: float
    """Scale of the projection of friction, EI / L^3."""
    give: np.ndarray
    """(m + 1, o) compliance of stick, L^3 / EI."""


class Work(NamedTuple):
    """What `residuals` computes, and its workspace; changes with every call."""

    evaluation: Evaluation
    """`g` holds the residual moments, at the first and last node those of the clamps on the cable."""
    mismatch: np.ndarray
    """(m, 3) residuals of the positions, L."""
    balance: np.ndarray
    """(m + 1, 3) residuals of the forces, EI / L^2; the first and the last are not used."""
    kinds: np.ndarray
    """(m + 1, o) OPEN, STICK or SLIP."""
    near: np.ndarray
    """(m + 1, o) whether the contact's forces are unknowns."""
    contact: np.ndarray
    """(m + 1, o, 3) residuals of normal force and friction, EI / L^2."""


class Rows(NamedTuple):
    """Number of the first of each three unknowns in a row; -1: given, or absent."""

    r: np.ndarray
    """(m + 1,) positions of the boundaries."""
    psi: np.ndarray
    """(n,) rotations of the nodes."""
    F: np.ndarray
    """(m,) internal forces."""
    contact: np.ndarray
    """(m, o) normal force and friction at the boundary where each element starts."""


class Band(NamedTuple):
    """The linear system of an iteration, see `linalg.band_lu`."""

    a: np.ndarray
    """(size, columns) the matrix, then its factors; space for all contacts at once."""
    b: np.ndarray
    """(size,) the right-hand side, then the solution."""
    pivots: np.ndarray
    """(size,) the row swaps."""


def spaces(elements: int, obstacles: int) -> tuple[Rows, Band]:
    """Space for the numbering and the linear system of a rod with this number of elements and obstacles."""
    m = elements
    rows = Rows(
        np.zeros(m + 1, np.int64), np.zeros(m * ORDER + 1, np.int64), np.zeros(m, np.int64),
        np.zeros((m, obstacles), np.int64),
    )  # fmt: skip
    block = 6 + 3 * ORDER + 3 * obstacles
    size = m * block + 6
    return rows, Band(np.zeros((size, 3 * (block + 5) + 1)), np.zeros(size), np.zeros(size, np.int64))


def workplace(evaluation: Evaluation, elements: int, obstacles: int) -> Work:
    """`Work` that leaves gradient and totals in the rod's own `evaluation`."""
    m = elements
    return Work(
        evaluation, np.zeros((m, 3)), np.zeros((m + 1, 3)), np.zeros((m + 1, obstacles), np.int64),
        np.zeros((m + 1, obstacles), np.bool_), np.zeros((m + 1, obstacles, 3)),
    )  # fmt: skip
