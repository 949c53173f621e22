# SPDX-License-Identifier: Apache-2.0
"""Where a cable touches: its loaded contacts, and `Equilibrium.contacts` in the world, in SI units."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from cable_ros.compilation import njit
from cable_ros.contact.distance import FRICTION_COEFFICIENT
from cable_ros.contact.points import ARC_LENGTH, BEFORE, FORCE, FRICTION, LENGTH, OBSTACLE, SLIPS
from cable_ros.equilibrium import ContactTable
from cable_ros.rod import quaternion
from cable_ros.rod.centreline import curve, position
from cable_ros.rod.elements import ReferenceElement
from cable_ros.rod.loaded_contacts import LoadedContacts
from cable_ros.rod.units import Units

AT_LIMIT = 1e-4
"""Relative distance of friction from its limit at which it counts as sliding: solved again on another mesh,
which is no motion, it sticks there."""


def listed(
    points: np.ndarray, normals: np.ndarray, centreline: Callable[[], np.ndarray],
    grid: tuple[np.ndarray, np.ndarray], obstacles: np.ndarray, rough: bool,
) -> LoadedContacts:  # fmt: skip
    """The loaded contacts of a rod with contact points.

    Args:
        points: (n, COLUMNS), see `contact.points`, with `normals` (n, 3), both in the start clamp's frame.
        centreline: computes its coefficients, see `centreline.curve`.
        grid: lengths and starts (m,) of the elements, L.
        obstacles: (o, WIDTH).
        rough: whether friction counts.
    """
    (h, s0), c = grid, centreline()
    limits = obstacles[:, FRICTION_COEFFICIENT] * rough
    order = np.argsort(points[:, ARC_LENGTH], kind="stable")
    points, normals = points[order], normals[order]
    which, friction = points[:, OBSTACLE].astype(int), points[:, FRICTION:BEFORE]
    cone, size = limits[which] * points[:, FORCE], np.linalg.norm(friction, axis=1)
    arc_lengths = np.ascontiguousarray(points[:, ARC_LENGTH])
    return LoadedContacts(
        arc_lengths=arc_lengths,
        positions=positions(c, h, s0, arc_lengths),
        normals=normals,
        forces=points[:, FORCE, None] * normals + friction,
        obstacles=which,
        sliding=(cone > 0.0) & ((points[:, SLIPS] == 1.0) | (size > (1.0 - AT_LIMIT) * cone)),
        lengths=points[:, LENGTH],
    )


def coefficients(q: np.ndarray, h: np.ndarray, element: ReferenceElement) -> np.ndarray:
    """(m, g + 1, 3) of the centreline of the nodal frames q (n, 4), see `centreline.curve`."""
    c = np.empty((len(h), len(element.points) + 1, 3))
    curve(q, h, element.values, element.tables.primitives, c)
    return c


@njit(cache=True)
def positions(c: np.ndarray, h: np.ndarray, s0: np.ndarray, arc_lengths: np.ndarray) -> np.ndarray:
    """Positions (n, 3) at the arc lengths `arc_lengths` (n,), with c, h, s0 as in `centreline.position`."""
    out = np.empty((arc_lengths.shape[0], 3))
    for i in range(arc_lengths.shape[0]):
        position(c, h, s0, arc_lengths[i], out[i])
    return out


def contact_table(
    contacts: Callable[[], LoadedContacts], names: Sequence[str], start: np.ndarray, units: Units
) -> ContactTable:
    """The contacts in the world, by rising arc length.

    Args:
        contacts: see `Rod.loaded_contacts`.
        names: of the obstacles.
        start: (7,) the start clamp in the world, m, quaternion x y z w.
        units: of the cable.
    """
    loaded, turn = contacts(), quaternion.matrix_from_ros(start[3:]).T
    return ContactTable(
        names=tuple(names),
        obstacle=loaded.obstacles,
        arc_length=loaded.arc_lengths * units.length,
        position=start[:3] + units.length * loaded.positions @ turn,
        normal=loaded.normals @ turn,
        force=units.force * loaded.forces @ turn,
        length=loaded.lengths * units.length,
        sliding=loaded.sliding,
    )
