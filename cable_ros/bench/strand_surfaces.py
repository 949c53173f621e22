# SPDX-License-Identifier: Apache-2.0
"""A cable's own other strand as an obstacle of verification, where both touch: frozen as it was reported."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np

from cable_ros.bench.contact_checks import Surface
from cable_ros.bench.surfaces import Distance
from cable_ros.equilibrium import Contact, ContactTable, Equilibrium

BETWEEN = 1e-6
"""Maximum difference of the strands' distance and the diameter, parts of the length."""


def line(point: np.ndarray, tangent: np.ndarray, apart: float) -> Distance:
    """Signed distance to the cylinder of radius `apart`, m, about the line through a point (3,)."""

    def signed(at: np.ndarray) -> np.ndarray:
        away = np.asarray(at, float) - point
        across = away - (away @ tangent)[..., None] * tangent
        return np.asarray(np.linalg.norm(across, axis=-1) - apart)

    return signed


def with_strands(
    claim: Equilibrium, name: str, length: float, diameter: float
) -> tuple[Equilibrium, dict[str, Surface], str]:
    """The answer with a name of its own for each contact of the cable with itself; these as surfaces, without
    friction; and what is wrong with them, a sentence, or empty.

    Args:
        claim: the answer.
        name, length, diameter: of the cable.
    """
    table = claim._touching() if claim._touching is not None else None
    if table is None or name not in table.names:
        return claim, {}, ""
    contacts, surfaces = table.contacts(), {}
    names, which = list(table.names), table.obstacle.copy()
    for k, one in enumerate(contacts):
        if one.obstacle != name:
            continue
        other = _other(contacts, one, length)
        if other is None:
            return claim, {}, f"the contact with itself at {one.arc_length / length:.4f} L has no other side"
        off = abs(float(np.linalg.norm(one.position - other.position)) - diameter) / length
        if off > BETWEEN:
            return claim, {}, f"strands that touch are {off:.1e} L farther or nearer than the diameter"
        if float(np.linalg.norm(one.force + other.force)) > 1e-4 * float(np.linalg.norm(one.force)):
            return claim, {}, "the forces of two strands on each other are not opposite"
        fraction = other.arc_length / length * (len(claim.points) - 1)
        low = min(int(fraction), len(claim.points) - 2)
        along = claim.points[low + 1] - claim.points[low]
        tangent = along - (along @ one.normal) * one.normal
        label = f"{name}, strand {k}"
        surfaces[label] = Surface(
            line(other.position, tangent / np.linalg.norm(tangent), diameter), 0.0, solid=False
        )
        which[k] = len(names)
        names.append(label)
    told = replace(table, names=tuple(names), obstacle=which)
    return replace(claim, _touching=partial(_table, told)), surfaces, ""


def _table(table: ContactTable) -> ContactTable:
    return table


def _other(contacts: tuple[Contact, ...], one: Contact, length: float) -> Contact | None:
    """The other side of a contact of a cable with itself."""
    at = one.other_arc_length
    if at is None:
        return None
    near = [other for other in contacts if other.obstacle == one.obstacle and other is not one]
    best = min(near, key=lambda other: abs(other.arc_length - at), default=None)
    return best if best is not None and math.isclose(best.arc_length, at, abs_tol=1e-6 * length) else None
