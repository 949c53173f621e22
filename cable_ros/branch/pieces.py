# SPDX-License-Identifier: Apache-2.0
"""A cable with clips: its pieces are solved apart, and their results are one result."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from cable_ros.contact.overlaps import SPACING, closest_approach, warning
from cable_ros.equilibrium import ContactTable, Equilibrium, Modes, Overlap, Status
from cable_ros.limits import Extreme
from cable_ros.scene import Cable

SEVERITY = (
    Status.CONVERGED, Status.SNAPPED, Status.UNFINISHED, Status.BRANCH_LOST, Status.NOT_CONVERGED,
    Status.OUT_OF_REACH, Status.INVALID_INPUT,
)  # fmt: skip
"""From the best to the worst: a cable is as well as its worst piece."""


def shares(cable: Cable, count: int) -> list[np.ndarray]:
    """For each piece of the cable, which of `count` equal arc lengths are on it, as fractions of its length.

    A point at a clip belongs to the piece that begins there, the last one to the last piece.
    """
    at = cable.length * np.arange(count) / (count - 1)
    out, begin = [], 0.0
    for i, piece in enumerate(cable.pieces):
        last = i == len(cable.supports)
        end = cable.length if last else cable.supports[i].arc_length
        own = at[(at >= begin) & ((at < end) | last)]
        out.append(np.clip((own - begin) / piece.length, 0.0, 1.0))
        begin = end
    return out


def joined(cable: Cable, found: Sequence[Equilibrium], outline: Callable[[], np.ndarray]) -> Equilibrium:
    """The result of a cable with clips.

    Args:
        cable: of the scene.
        found: of its pieces, with their parts of the polyline.
        outline: gives a polyline (n, 3) of the whole cable, world, m.
    """
    status = max((one.status for one in found), key=SEVERITY.index)
    first, last = found[0], found[-1]
    message, overlaps = _message(cable, found), _overlaps(found)
    diameter = 2.0 * cable.radius
    if diameter and status.trusted and not overlaps:
        apart = closest_approach(outline(), cable.length, SPACING * diameter)
        if apart < diameter:
            overlaps = (Overlap(cable.name, apart, diameter),)
            message = f"{message} {warning(apart, diameter)}"
    mounts = None
    if status.trusted:
        mounts = np.stack([_axes(first, 0), _axes(last, 1)])
    return Equilibrium.of(
        status=status, message=message, converged=all(one.converged for one in found),
        stable=all(one.stable for one in found),
        stability_margin=float(np.min([one.stability_margin for one in found])),
        end_wrench=last.end_wrench, start_wrench=first.start_wrench,
        points=np.concatenate([one.points for one in found]),
        orientations=np.concatenate([one.orientations for one in found]),
        total_twist=float(np.sum([one.total_twist for one in found])),
        energy=float(np.sum([one.energy for one in found])),
        error_estimate=float(np.max([one.error_estimate for one in found])),
        iterations=sum(one.iterations for one in found), solve_time=sum(one.solve_time for one in found),
        overlaps=overlaps, _pieces=tuple(found),
        _support_names=tuple(clip.name for clip in cable.supports), _mounts=mounts,
        _tangent=Together(cable, found), _touching=partial(_contacts, cable, found),
        _extremes=partial(_extremes, cable, found),
    )  # fmt: skip


def _axes(found: Equilibrium, which: int) -> np.ndarray:
    """(4,) axes of the wrench at the start, 0, or end, 1, of a piece."""
    assert found._mounts is not None
    axes: np.ndarray = found._mounts[which]
    return axes


def places(cable: Cable) -> list[str]:
    """Where each piece is, as messages say."""
    names = ["start", *(clip.name for clip in cable.supports), "end"]
    return [f"between {names[i]} and {names[i + 1]}" for i in range(len(names) - 1)]


def _message(cable: Cable, found: Sequence[Equilibrium]) -> str:
    """The common message, or those of the pieces that differ from the plain one."""
    plain = Status.CONVERGED.sentence
    told = [
        f"{where}: {one.message}"
        for where, one in zip(places(cable), found, strict=True)
        if one.message != plain
    ]
    text = " ".join(told)
    return text[:1].upper() + text[1:] if told else plain


def _begins(cable: Cable) -> list[float]:
    """Arc length at which each piece begins, m."""
    return [0.0, *(clip.arc_length for clip in cable.supports)]


def _overlaps(found: Sequence[Equilibrium]) -> tuple[Overlap, ...]:
    """Those of the pieces with themselves."""
    return tuple(overlap for piece in found for overlap in piece.overlaps)


def _contacts(cable: Cable, found: Sequence[Equilibrium]) -> ContactTable | None:
    """The contacts of all pieces."""
    tables = [
        dataclasses.replace(one._contact_table, arc_length=one._contact_table.arc_length + s)
        for s, one in zip(_begins(cable), found, strict=True)
        if one._contact_table is not None
    ]
    if not tables:
        return None
    columns = {
        field.name: np.concatenate([getattr(table, field.name) for table in tables])
        for field in dataclasses.fields(ContactTable)
        if field.name != "names"
    }
    return ContactTable(tables[0].names, **columns)


def _extremes(cable: Cable, found: Sequence[Equilibrium]) -> tuple[Extreme, ...]:
    """The worst of each quantity over all pieces."""
    if not all(one.extremes for one in found):
        return ()
    rows = [
        [dataclasses.replace(extreme, arc_length=extreme.arc_length + s) for extreme in one.extremes]
        for s, one in zip(_begins(cable), found, strict=True)
    ]
    return tuple(
        min(column, key=lambda one: one.value if one.quantity.least else -one.value)
        for column in zip(*rows, strict=True)
    )


class Together:
    """The linearised equations of all pieces; implements `equilibrium.Linearised`."""

    __slots__ = ("_cable", "_found")

    def __init__(self, cable: Cable, found: Sequence[Equilibrium]) -> None:
        self._cable, self._found = cable, found

    def wrench_response(self, obstacles: Sequence[str]) -> np.ndarray:
        """See `Equilibrium.wrench_response`; the clips stay where they are."""
        size, last = 12 + 6 * len(obstacles), len(self._found) - 1
        out = np.zeros((size, size))
        for i, one in enumerate(self._found):
            own = one.wrench_response(obstacles)
            kept = np.r_[: 6 * (i == 0), 6 : 6 + 6 * (i == last), 12:size].astype(int)
            out[np.ix_(kept, kept)] += own[np.ix_(kept, kept)]
        return out

    def modes(self, count: int, points: int) -> Modes:
        """See `Equilibrium.modes`: each is a vibration of one piece."""
        frequencies, shapes = [], []
        at = self._cable.length * np.linspace(0.0, 1.0, points)
        for s, piece, one in zip(_begins(self._cable), self._cable.pieces, self._found, strict=True):
            assert one._tangent is not None
            found = one._tangent.modes(count, max(points, 2))
            inside = (at >= s) & (at <= s + piece.length)
            own = np.linspace(0.0, piece.length, max(points, 2))
            for frequency, shape in zip(found.frequencies, found.shapes, strict=True):
                whole = np.zeros((points, 3))
                for a in range(3):
                    whole[inside, a] = np.interp(at[inside] - s, own, shape[:, a])
                frequencies.append(frequency)
                shapes.append(whole)
        order = np.argsort(frequencies, kind="stable")[:count]
        return Modes(np.array(frequencies)[order], np.array(shapes)[order])
