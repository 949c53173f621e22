# SPDX-License-Identifier: Apache-2.0
"""Ends other than two clamps, from a scene's mounts to the rod; and initial shapes of a search with them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cable_ros.rod import quaternion
from cable_ros.rod.ends import HELD, SWIVEL, TURNING, ZERO, End, Ends
from cable_ros.rod.initial_shapes import closing_turn, spin, starts, tangents, transport, unloaded
from cable_ros.rod.units import Units
from cable_ros.scene.model import CLAMPED, FREE, PINNED, Mount

REACHES = (0.9, 0.5, 0.1)
"""Distances of the ends, as fractions of the length, at which a cable that slides begins."""
BENDS = (0.9, 0.4)
"""The same of a cable with a free end."""
LEVEL = np.array([0.0, 0.0, 1.0])


def ends_of(start: Mount, end: Mount, units: Units) -> Ends | None:
    """How the ends are held, in units of the cable; None: by two clamps."""
    if start.kind == end.kind == CLAMPED:
        return None
    return Ends(_end(start, units), _end(end, units))


def _end(mount: Mount, units: Units) -> End:
    turns = TURNING if mount.turns or mount.kind in (PINNED, FREE) else HELD
    turns = SWIVEL if mount.kind == "swivel" else turns
    axis = None if mount.axis is None else mount.axis.copy()  # a writable one: compiled code is of one kind
    moment = mount.moment / units.moment if mount.moment.any() else ZERO
    return End(turns, mount.kind != FREE, axis, mount.force / units.force, moment)


def load_moment(ends: Ends) -> float:
    """A moment, EI / L, that the given loads bend the cable with: for the first mesh."""
    given = [max(np.linalg.norm(end.force), np.linalg.norm(end.moment)) for end in (ends.start, ends.end)]
    return float(max(given))


def held_starts(
    ends: Ends, nodes: np.ndarray, qe: np.ndarray, re: np.ndarray, f: np.ndarray,
    target_twist: float | None, natural: np.ndarray,
) -> Iterator[np.ndarray]:  # fmt: skip
    """Initial shapes (n, 4) of a search, as `initial_shapes.starts`, whose ends are where they can be.

    Args:
        ends: how the ends are held.
        nodes: (n,) arc lengths, L.
        qe, re: end frame (4,) and position (3,) of the mount, L.
        f: (3,) load per length.
        target_twist: rad; None: the natural twist.
        natural: (3,) curvature and twist of the unloaded cable, 1 / L.
    """
    for begin, end, position in _poses(ends, qe, re, f):
        # in the frame of the first section
        back = quaternion.conjugate(begin)
        there = quaternion.multiply(back, end)
        r, load = quaternion.rotate(back, position), quaternion.rotate(back, f)
        if ends.twist_held:
            shapes = starts(nodes, there, r, load, target_twist, natural)
        else:
            shapes = _untwisted(nodes, there, r, load, natural)
        for q in shapes:
            if not any(ends.end.turns):  # the start turns instead
                q = spin(q, np.ones(len(nodes)), closing_turn(q, there))
            yield np.array([quaternion.multiply(begin, one) for one in q])
    if ends.free:
        begin = np.array([1.0, 0.0, 0.0, 0.0])
        helix = next(unloaded(nodes, _helix_end(natural), natural, float(natural[2])))
        if not ends.end.placed:
            yield helix
        else:  # its last section is held
            onto = quaternion.multiply(qe, quaternion.conjugate(helix[-1]))
            yield np.array([quaternion.multiply(onto, one) for one in helix])


def _helix_end(natural: np.ndarray) -> np.ndarray:
    """(4,) the last frame of the unloaded cable."""
    out = np.empty((1, 4))
    quaternion.retract(np.array([[1.0, 0.0, 0.0, 0.0]]), natural, out)
    return out[0]


def _untwisted(
    nodes: np.ndarray, qe: np.ndarray, re: np.ndarray, f: np.ndarray, natural: np.ndarray
) -> Iterator[np.ndarray]:
    """Curves between the ends with the natural twist: nothing holds another one."""
    across = np.cross(re, np.eye(3)[np.argmin(np.abs(re))])
    sides = [None, across / max(float(np.linalg.norm(across)), 1e-12)]
    if np.linalg.norm(f) > 1e-9:
        sides.append(f / np.linalg.norm(f))
    for bulge in sides:
        yield spin(transport(tangents(nodes, qe, re, bulge)), nodes, float(natural[2]))


def _poses(
    ends: Ends, qe: np.ndarray, re: np.ndarray, f: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """First and last frame, (4,) each, and end position (3,) to draw curves between."""
    upright = np.array([1.0, 0.0, 0.0, 0.0])
    if ends.free:
        held = upright if ends.start.placed else qe
        ahead = quaternion.rotate(held, LEVEL) * (1.0 if ends.start.placed else -1.0)
        pull = f + (ends.end.force if ends.start.placed else ends.start.force)
        down = pull / np.linalg.norm(pull) if np.linalg.norm(pull) > 1e-9 else ahead
        for reach in BENDS:
            for way in (down, 0.5 * (down + ahead), ahead):
                size = float(np.linalg.norm(way))
                if size < 1e-6:
                    continue
                tip, turn = reach * way / size, quaternion.between(LEVEL, way / size)
                if ends.start.placed:
                    begin = turn if ends.start.turns[0] else upright
                    yield begin, turn, tip
                else:
                    away = quaternion.between(LEVEL, -way / size)
                    yield away, away if ends.end.turns[0] else qe, -tip
        return
    for position in _positions(ends, qe, re):
        size = float(np.linalg.norm(position))
        chord = quaternion.between(LEVEL, position / size) if size > 1e-9 else upright
        if ends.start.turns[0] or ends.end.turns[0]:
            yield chord if ends.start.turns[0] else upright, chord if ends.end.turns[0] else qe, position
            continue
        yield upright, qe, position


def _positions(ends: Ends, qe: np.ndarray, re: np.ndarray) -> Iterator[np.ndarray]:
    axis = ends.axis(qe)
    if axis is None:
        yield re
        return
    across = re - float(axis @ re) * axis
    near = float(across @ across)
    for reach in REACHES:
        if reach**2 > near:
            along = np.sqrt(reach**2 - near)
            yield across + along * axis
            yield across - along * axis
    if near >= REACHES[0] ** 2:
        yield across
