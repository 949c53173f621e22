# SPDX-License-Identifier: Apache-2.0
"""A cable with supports: the results of its pieces are one result."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np

from cable_ros.branch.extremes import Reading, worst_of
from cable_ros.branch.modes import no_modes
from cable_ros.contact.overlaps import OUTLINE, SelfApproach, warning
from cable_ros.equilibrium import ContactTable, Equilibrium, Modes, Overlap, Status
from cable_ros.limits import Extreme
from cable_ros.scene import Cable
from cable_ros.scene.model import CLIP, PIN, RING, TUBE

SEVERITY = (
    Status.CONVERGED, Status.SNAPPED, Status.UNFINISHED, Status.BRANCH_LOST, Status.NOT_CONVERGED,
    Status.OUT_OF_REACH, Status.INVALID_INPUT,
)  # fmt: skip
"""From the best to the worst: a cable is as well as its worst piece."""


TURNS = np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
HELD = {CLIP: np.ones(6), PIN: TURNS, RING: TURNS, TUBE: np.array([1.0, 1.0, 1.0, 1.0, 1.0, 0.0])}
"""(6,) which components of its wrench a support may have."""


class Span(NamedTuple):
    """Which of the equal arc lengths of a cable are on a piece of it."""

    first: int
    last: int
    """The one behind the last of them."""
    begin: float
    """Arc length at which the piece begins, m."""
    end: float

    def fractions(self, length: float, count: int) -> np.ndarray:
        """Them as fractions of the piece's length; `length` of the cable, m, `count` of points."""
        at = arc_lengths(length, count)[self.first : self.last]
        out: np.ndarray = (at - self.begin) / (self.end - self.begin)
        return np.minimum(np.maximum(out, 0.0), 1.0)  # in a third of clip's time


@lru_cache(8)
def arc_lengths(length: float, count: int) -> np.ndarray:
    """(count,) equal arc lengths on a cable, m."""
    out: np.ndarray = length * np.arange(count) / (count - 1)
    return out


def spans(cuts: Sequence[float], count: int) -> list[Span]:
    """Of each piece of a cable.

    A point at a support belongs to the piece that begins there, the last one to the last piece.

    Args:
        cuts: arc lengths of start, supports and end, m.
        count: of points.
    """
    first = [*arc_lengths(cuts[-1], count).searchsorted(cuts[:-1]).tolist(), count]
    return [
        Span(i, k, begin, end)
        for i, k, (begin, end) in zip(first, first[1:], itertools.pairwise(cuts), strict=False)
    ]


def shares(cuts: Sequence[float], count: int) -> list[np.ndarray]:
    """For each piece of a cable, which of `count` equal arc lengths are on it, as fractions of its length."""
    return [span.fractions(cuts[-1], count) for span in spans(cuts, count)]


def joined(
    cable: Cable, found: Sequence[Equilibrium], cuts: Sequence[float], outline: Callable[[], np.ndarray],
    approach: SelfApproach,
) -> Equilibrium:  # fmt: skip
    """The result of a cable with supports.

    Args:
        cable: of the scene.
        found: of its pieces, with their parts of the polyline.
        cuts: arc lengths of its start, its supports and its end at present, m.
        outline: gives a polyline (n, 3) of the whole cable, world, m.
        approach: of this cable.
    """
    status = max((one.status for one in found), key=SEVERITY.index)
    first, last = found[0], found[-1]
    message, overlaps = _message(cable, found), _overlaps(found)
    diameter, points = 2.0 * cable.radius, np.concatenate([one.points for one in found])
    if diameter and status.trusted and not overlaps:
        line = points if len(points) >= OUTLINE else outline()
        apart = approach.bound(line, diameter)
        if apart < diameter:
            overlaps = (Overlap(cable.name, apart, diameter),)
            message = f"{message} {warning(apart, diameter)}"
    mounts = None
    if status.trusted:
        mounts = np.array([_axes(first, 0), _axes(last, 1)])
    numbers = [(one.stability_margin, one.error_estimate, one.total_twist, one.energy) for one in found]
    margins, errors, twists, energies = np.array(numbers).T
    return Equilibrium.of({
        "status": status, "message": message, "converged": all(one.converged for one in found),
        "stable": all(one.stable for one in found), "stability_margin": float(margins.min()),
        "end_wrench": last.end_wrench, "start_wrench": first.start_wrench,
        "points": points,
        "orientations": np.concatenate([one.orientations for one in found]),
        "total_twist": float(twists.sum()), "energy": float(energies.sum()),
        "error_estimate": float(errors.max()), "iterations": sum(one.iterations for one in found),
        "solve_time": sum(one.solve_time for one in found), "overlaps": overlaps, "_pieces": tuple(found),
        "_supports": tuple((one.name, HELD[one.kind]) for one in cable.supports), "_mounts": mounts,
        "_tangent": Together(found, cuts), "_touching": partial(_contacts, found, cuts),
        "_extremes": partial(_extremes, found, cuts),
    })  # fmt: skip


def _axes(found: Equilibrium, which: int) -> np.ndarray:
    """(4,) axes of the wrench at the start, 0, or end, 1, of a piece."""
    assert found._mounts is not None
    axes: np.ndarray = found._mounts[which]
    return axes


def places(cable: Cable) -> list[str]:
    """Where each piece is, as messages say."""
    names = ["start", *(support.name for support in cable.supports), "end"]
    return [f"between {names[i]} and {names[i + 1]}" for i in range(len(names) - 1)]


def _message(cable: Cable, found: Sequence[Equilibrium]) -> str:
    """The common message, or those of the pieces that differ from the plain one."""
    plain = Status.CONVERGED.sentence
    if all(one.message == plain for one in found):
        return plain
    told = [
        f"{where}: {one.message}"
        for where, one in zip(places(cable), found, strict=True)
        if one.message not in (plain, "")
    ]
    text = " ".join(told)
    return text[:1].upper() + text[1:] if told else plain


def _overlaps(found: Sequence[Equilibrium]) -> tuple[Overlap, ...]:
    """Those of the pieces with themselves."""
    return tuple(overlap for piece in found for overlap in piece.overlaps)


def _contacts(found: Sequence[Equilibrium], cuts: Sequence[float]) -> ContactTable | None:
    """The contacts of all pieces."""
    tables = [
        dataclasses.replace(one._contact_table, arc_length=one._contact_table.arc_length + s)
        for s, one in zip(cuts, found, strict=False)
        if one._contact_table is not None
    ]
    if len(tables) < 2:
        return tables[0] if tables else None
    columns = {
        field.name: np.concatenate([getattr(table, field.name) for table in tables])
        for field in dataclasses.fields(ContactTable)
        if field.name not in ("names", "other_arc_length")  # a cable with supports touches no other
    }
    return ContactTable(tables[0].names, **columns)


def _extremes(found: Sequence[Equilibrium], cuts: Sequence[float]) -> tuple[Extreme, ...]:
    """The worst of each quantity over all pieces."""
    readings = [one._extremes for one in found if isinstance(one._extremes, Reading)]
    return worst_of(readings, cuts) if len(readings) == len(found) else ()


def runs(found: Sequence[Equilibrium]) -> Iterator[range]:
    """The numbers of the pieces that move each other, run by run; those between two clips are alone."""
    begin = 0
    while begin < len(found):
        coupled = found[begin]._coupled
        end = begin + (1 if coupled is None else coupled.count)
        yield range(begin, end)
        begin = end


def response(found: Sequence[Equilibrium], run: range, obstacles: Sequence[str]) -> np.ndarray:
    """(12 m + 6 k, 12 m + 6 k) derivative of the wrenches of a run of m pieces by motions of their mounts.

    Rows and columns: start and end of each piece, then k obstacles, as in `Equilibrium.wrench_response`.
    """
    coupled = found[run[0]]._coupled
    if coupled is not None:
        return coupled.response(obstacles)
    one = found[run[0]]
    return one.wrench_response(obstacles) if obstacles else one.clamp_stiffness


class Together:
    """The linearised equations of all pieces; implements `equilibrium.Linearised`."""

    __slots__ = ("_cuts", "_found")

    def __init__(self, found: Sequence[Equilibrium], cuts: Sequence[float]) -> None:
        self._found, self._cuts = found, cuts

    def wrench_response(self, obstacles: Sequence[str]) -> np.ndarray:
        """See `Equilibrium.wrench_response`; the supports stay where they are."""
        size, last = 12 + 6 * len(obstacles), len(self._found) - 1
        out = np.zeros((size, size))
        for run in runs(self._found):
            own, ends = response(self._found, run, obstacles), 12 * len(run)
            first, final = run[0] == 0, run[-1] == last
            kept = np.r_[: 6 * first, 6 : 6 + 6 * final, 12:size].astype(int)
            inner = np.r_[: 6 * first, ends - 6 : ends - 6 + 6 * final, ends : len(own)].astype(int)
            out[np.ix_(kept, kept)] += own[np.ix_(inner, inner)]
        return out

    def modes(self, count: int, points: int) -> Modes:
        """See `Equilibrium.modes`; each is a vibration of one piece, or of those that move each other."""
        at = self._cuts[-1] * np.linspace(0.0, 1.0, points)
        found = []
        for run in runs(self._found):
            cuts = self._cuts[run[0] : run[-1] + 2]
            inside = np.flatnonzero((at >= cuts[0]) & (at <= cuts[-1]))
            own = _modes(self._found[run[0]], cuts, at[inside], count, points)
            whole = np.zeros((len(own.frequencies), points, 3))
            whole[:, inside] = own.shapes
            found.append(Modes(own.frequencies, whole))
        frequencies = np.concatenate([own.frequencies for own in found])
        shapes = np.concatenate([own.shapes for own in found])
        if np.isnan(frequencies).any():  # the lowest may be among those that are not known
            return no_modes(count, points, np.nan)
        order = np.argsort(frequencies, kind="stable")[:count]
        return Modes(frequencies[order], shapes[order])


def _modes(first: Equilibrium, cuts: Sequence[float], at: np.ndarray, count: int, points: int) -> Modes:
    """The `count` lowest of the run of pieces that begins with `first`.

    Args:
        first: the first piece.
        cuts: arc lengths of the ends of the pieces, m.
        at: (k,) rising arc lengths on them at which shapes are asked for, m.
        count: of modes.
        points: at which the shape of one piece is computed, to interpolate it.
    """
    if first._coupled is not None:
        edges = [0, *at.searchsorted(cuts[1:-1]).tolist(), len(at)]
        places = [
            (at[a:b] - s) / (end - s)
            for (a, b), (s, end) in zip(itertools.pairwise(edges), itertools.pairwise(cuts), strict=True)
        ]
        return first._coupled.modes(count, places)
    if first._tangent is None:  # it has no result
        return no_modes(count, len(at), np.nan)
    found = first._tangent.modes(count, max(points, 2))
    own = np.linspace(cuts[0], cuts[1], max(points, 2))
    shapes = [np.stack([np.interp(at, own, shape[:, a]) for a in range(3)], axis=1) for shape in found.shapes]
    return Modes(found.frequencies, np.array(shapes).reshape(len(shapes), len(at), 3))
