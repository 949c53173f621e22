# SPDX-License-Identifier: Apache-2.0
"""Free ends that come down on obstacles, rest or lie there, and leave them; see `loose_ends`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields

import numpy as np

from cable_ros.branch.coupling import Loose
from cable_ros.branch.loose_ends import ALONG, PITCH, Z_AXIS, Face, LooseEnd, Surface, Tip
from cable_ros.contact.distance import nearest
from cable_ros.equilibrium import ContactTable
from cable_ros.rod import quaternion

INSIDE, BESIDE = -1e-9, 1e-6
"""Distance, as a fraction of the length, at which a free end touches; and at which it may begin to."""
FLAT = 0.1
"""Sine of the angle with a face below which an end that comes to it is taken to lie there, at first."""
PULLS = 1e-6
"""Force, EI / L^2, and moment, EI / L, with which a face may hold an end that it should let go: rounding."""
LEVEL = 1e-12
"""Minimum sine of the angle by which the cable beside an end goes into a face."""

Touch = tuple[int, bool] | None
"""The number of the obstacle that an end rests on, and whether it lies there; None: it touches nothing."""


def faced(tip: Tip, touch: Touch, rows: np.ndarray | None) -> Tip:
    """A tip on what it touches; `rows` (o, WIDTH): the obstacles in the world, SI."""
    if touch is None or rows is None:
        if tip.face is None:
            return tip
        return tip._replace(face=None, axes=np.eye(3), spins=np.eye(3))
    return tip._replace(face=Face(touch[0], rows[touch[0]], touch[1])).on_face()


def caught(end: LooseEnd, tip: Tip, rows: np.ndarray | None, least: float) -> Touch:
    """What a tip touches if its distance, m, from an obstacle is less than `least`."""
    here = tip.touch
    if not end.free or rows is None:
        return None
    distance, which = nearest(rows, tip.position)
    if distance >= least or (here is not None and here[0] == which):
        return here
    beside = Surface.at(rows[which], tip.position)
    lean = float(quaternion.rotate(tip.turn, Z_AXIS) @ beside.normal)
    return int(which), abs(lean) < FLAT and not beside.bends.any()


def let_go(tip: Tip, loose: Loose, wrench: np.ndarray, unit: tuple[float, float]) -> Touch:
    """What a tip touches at a solution with what it touched.

    Args:
        tip, loose: of the solution.
        wrench: (6,) of the piece on the section.
        unit: EI / L^2 and EI / L of the cable.
    """
    if tip.face is None:
        return None
    out, force, moment = loose.push(wrench), PULLS * unit[0], PULLS * unit[1]
    flat = not Surface.at(tip.face.row, tip.position).bends.any()
    if tip.face.lies:
        # its force is none, and known no better than the pressure beside it; moments are exact
        down = out[PITCH] if tip.which else -out[PITCH]
        return tip.face.obstacle, not down < -moment
    if out[ALONG] < -force:
        return None
    if tip.leans > LEVEL:
        # around what is curved the cable touches before its end
        return (tip.face.obstacle, True) if flat else None
    return tip.face.obstacle, False


def pushed_out(position: np.ndarray, rows: np.ndarray | None) -> np.ndarray:
    """(3,) a point outside of all obstacles near one that may be inside."""
    for _ in range(10):
        if rows is None:
            break
        distance, which = nearest(rows, position)
        if distance >= 0.0:
            break
        beside = Surface.at(rows[which], position)
        position = position - beside.gap * beside.normal
    return position


def touches(faces: Sequence[Touch], tips: Sequence[Tip]) -> bool:
    """Whether tips touch what `faces` say."""
    return all(face == tip.touch for face, tip in zip(faces, tips, strict=True))


def with_tip(
    inner: Callable[[], ContactTable | None] | None, names: Sequence[str], tip: Tip, push: np.ndarray,
    arc: float,
) -> ContactTable | None:  # fmt: skip
    """The contacts `inner` of a piece, and that of a tip on a face.

    Args:
        names: of the obstacles.
        push: (3,) force on the tip along its axes, N.
        arc: arc length of the tip on the piece, m.
    """
    table, face = None if inner is None else inner(), tip.face
    assert face is not None
    rubs = face.grip is not None
    force = tip.axes @ push if rubs else max(push[2], 0.0) * tip.axes[:, 2]
    slides = face.grip is not None and face.grip.slips
    own = ContactTable(
        tuple(names), np.array([face.obstacle]), np.array([arc]), tip.position[None],
        tip.axes[None, :, 2], force[None], np.zeros(1), np.array([slides]),
    )  # fmt: skip
    if table is None:
        return own
    pair = (table, own) if tip.which else (own, table)
    return ContactTable(
        own.names,
        *(np.concatenate([getattr(one, field.name) for one in pair]) for field in fields(own)[1:-1]),
    )
