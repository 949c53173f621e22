"""What the compiled functions of a nodal rod work with: m elements, n nodes, o obstacles.

Units of the cable, start clamp's frame.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cable_ros.mechanics.kernels import workspace

ORDER = 2
"""Order of the elements: the grid of contacts limits the accuracy, not the rod."""


class State(NamedTuple):
    """The unknowns."""

    q: np.ndarray
    """(n, 4) nodal frames, scalar first."""
    r: np.ndarray
    """(m + 1, 3) positions of the elements' boundaries."""
    F: np.ndarray
    """(m, 3) internal force in each element."""
    lam: np.ndarray
    """(m + 1, o) normal forces."""
    tau: np.ndarray
    """(m + 1, o, 2) friction along the two directions of the contact's frame."""

    @classmethod
    def zeros(cls, elements: int, obstacles: int) -> State:
        """All zero, to be filled."""
        n, m = elements * ORDER + 1, elements + 1
        return cls(
            np.zeros((n, 4)), np.zeros((m, 3)), np.zeros((elements, 3)), np.zeros((m, obstacles)),
            np.zeros((m, obstacles, 2)),
        )  # fmt: skip

    def copy(self) -> State:
        """A state of its own."""
        return State(*(part.copy() for part in self))

    def take(self, other: State) -> None:
        """Become equal to the other."""
        for mine, theirs in zip(self, other, strict=True):
            mine[:] = theirs


class Model(NamedTuple):
    """What the rod is; never changes."""

    K: np.ndarray
    """(3,) stiffness."""
    natural: np.ndarray
    """(3,) curvature and twist of the unloaded cable."""
    h: np.ndarray
    """(m,) lengths of the elements."""
    s0: np.ndarray
    """(m,) where they start."""
    tables: tuple[np.ndarray, ...]
    """See `ReferenceElement.tables`."""


class Step(NamedTuple):
    """From which equilibrium the rod goes under which conditions; changes with every step."""

    qe: np.ndarray
    """(4,) end frame."""
    re: np.ndarray
    """(3,) end position."""
    f: np.ndarray
    """(3,) load per length."""
    obstacles: np.ndarray
    """(o, WIDTH), see `contact_kernels.gap`."""
    carried: np.ndarray
    """(m + 1, o, 3) where each boundary would be, had it gone with each obstacle since."""
    turned: np.ndarray
    """(m + 1, o, 3) the first direction of each contact's frame, likewise."""
    tau: np.ndarray
    """(m + 1, o, 2) friction at the last equilibrium."""
    q: np.ndarray
    """(n, 4) frames there."""
    r: np.ndarray
    """(m + 1, 3) positions there."""
    drag: float
    """Of a viscous medium, EI / L^4 a step; 0: none."""
    normal: float
    """Scale of the projection of normal forces, EI / L^3."""
    tangential: float
    """Scale of the projection of friction, EI / L^3."""
    give: np.ndarray
    """(m + 1, o) compliance of stick, L^3 / EI."""


class Work(NamedTuple):
    """What `residuals` leaves, and its space; changes with every call."""

    g: np.ndarray
    """(n, 3) residual moments; at the first and last node those of the clamps."""
    radial: np.ndarray
    """(n,) see `mechanics.kernels.gradient`."""
    acc: np.ndarray
    lanes: np.ndarray
    totals: np.ndarray
    """(5,) elastic energy at 3, total twist at 4."""
    way: np.ndarray
    """(m, 3) residuals of the positions."""
    balance: np.ndarray
    """(m + 1, 3) residuals of the forces."""
    kinds: np.ndarray
    """(m + 1, o) OPEN, STICK or SLIP."""
    near: np.ndarray
    """(m + 1, o) whether the contact's forces are unknowns."""
    contact: np.ndarray
    """(m + 1, o, 3) residuals of normal force and friction."""


class Tangents(NamedTuple):
    """Parts of the rod's tangent, see `mechanics.kernels.hessian`."""

    elastic: np.ndarray
    geometric: np.ndarray
    parts: np.ndarray
    C: np.ndarray


class Rows(NamedTuple):
    """Numbers of the first of three unknowns each; -1: given or not there."""

    r: np.ndarray
    """(m + 1,)"""
    psi: np.ndarray
    """(n,) rotations of the nodes."""
    F: np.ndarray
    """(m,)"""
    contact: np.ndarray
    """(m, o)"""


class Band(NamedTuple):
    """The linear system of an iteration, see `linalg.band_lu`."""

    a: np.ndarray
    b: np.ndarray
    pivots: np.ndarray


def spaces(h: np.ndarray, tables: tuple[np.ndarray, ...], obstacles: int) -> tuple[Rows, Band]:
    """Space for the numbering and the linear system of a rod with elements of lengths h (m,)."""
    m = len(h)
    rows = Rows(
        np.zeros(m + 1, np.int64), np.zeros(m * ORDER + 1, np.int64), np.zeros(m, np.int64),
        np.zeros((m, obstacles), np.int64),
    )  # fmt: skip
    block = 6 + 3 * ORDER + 3 * obstacles
    size = m * block + 6
    return rows, Band(np.zeros((size, 3 * (block + 5) + 1)), np.zeros(size), np.zeros(size, np.int64))


def workplace(
    g: np.ndarray, radial: np.ndarray, acc: np.ndarray, totals: np.ndarray, h: np.ndarray,
    tables: tuple[np.ndarray, ...], obstacles: int,
) -> Work:  # fmt: skip
    """`Work` on a rod's own gradient and totals."""
    m = len(h)
    return Work(
        g, radial, acc, workspace(h, tables), totals, np.zeros((m, 3)), np.zeros((m + 1, 3)),
        np.zeros((m + 1, obstacles), np.int64), np.zeros((m + 1, obstacles), np.bool_),
        np.zeros((m + 1, obstacles, 3)),
    )  # fmt: skip
