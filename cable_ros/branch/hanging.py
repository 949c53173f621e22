# SPDX-License-Identifier: Apache-2.0
"""Where loose ends that the pieces' supports solve may be at first: as it hangs or stands without obstacles.

A cable that strains begins where one that does not would be.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from cable_ros.branch.cold_start import Found
from cable_ros.branch.landing import pushed_out
from cable_ros.branch.loose_ends import LooseEnd, Surface
from cable_ros.branch.loose_piece import LoosePiece
from cable_ros.contact.distance import nearest
from cable_ros.rod import quaternion
from cable_ros.scene import Cable

MOST = 3
"""Maximum number of equilibria without obstacles that are begun with."""
SLACK = 0.97
"""Part of what is left of the cable, beyond where it comes to lie, that is laid out straight."""
REACHES = (0.95, 0.75, 0.5)
"""Distances of a free end from the other end, as fractions of the length, where nothing else is known."""
STEEP = 0.1
"""Minimum sine of the angle to the normal at which a cable that comes down goes on in its own direction."""
LEAST_SLACK = 1e-6
"""Least slack, as a fraction of the length, of a cable that a piece between two clamps can stand for."""
Z_AXIS = np.array([0.0, 0.0, 1.0])
ASIDE = np.array([-1.0, 3.0, 2.0])
"""A direction that no drawn scene has, to fall to."""


class Begin(NamedTuple):
    """Where a search may begin."""

    poses: np.ndarray
    """(2, 7) of the first and of the last section, world."""
    found: Found | None = None
    """An equilibrium that hangs clear of all obstacles there, in the frame of the start's mount."""


def plausible(
    run: Cable, loose: Sequence[LooseEnd], piece: LoosePiece, mounts: np.ndarray,
    rows: np.ndarray | None,
) -> Iterator[Begin]:  # fmt: skip
    """Where to begin, one after the other.

    Args:
        run: the cable.
        loose: its loose ends.
        piece: its first one.
        mounts: (n + 1, 2, 7) of the ends of the pieces, world.
        rows: (o, WIDTH) the obstacles in the world, SI.
    """
    free = next((end.which for end in loose if end.free), None)
    shapes = piece.without_obstacles(run.mounts, mounts[0])[:MOST] if not run.supports else []
    for found, points, frames in shapes:
        poses = np.concatenate([points, frames], axis=1)
        clear = rows is None or min(nearest(rows, point)[0] for point in points[1:]) > 0.0
        if clear and not (piece.strains and rows is None):
            yield Begin(poses[[0, -1]], found)
        if (
            not piece.stretches
            and float(np.linalg.norm(points[-1] - points[0])) > (1.0 - LEAST_SLACK) * run.length
        ):
            continue  # its tension would have no bound
        if free is None or rows is None or nearest(rows, points[-free])[0] >= 0.0:
            yield Begin(poses[[0, -1]])
        if free is not None and rows is not None:
            draped = _draped(poses if free else poses[::-1], run.length, rows, 1.0 if free else -1.0)
            if draped is not None:
                yield Begin(np.stack([poses[0], draped] if free else [draped, poses[-1]]))
    for poses in _fan(run, loose, mounts, rows, piece.weight):
        yield Begin(poses)


def _draped(poses: np.ndarray, length: float, rows: np.ndarray, sign: float) -> np.ndarray | None:
    """(7,) the free end if what is beyond the first point inside of an obstacle is laid out along that.

    Args:
        poses: (n, 7) of sections, from the other end on.
        length: m.
        rows: as in `plausible`.
        sign: 1 if tangents point to the free end, else -1.
    """
    inside = next((i for i in range(1, len(poses)) if nearest(rows, poses[i, :3])[0] < 0.0), None)
    if inside is None:
        return None
    which, frame = nearest(rows, poses[inside, :3])[1], quaternion.from_ros(poses[inside, 3:])
    place = pushed_out(poses[inside, :3], rows)
    n, onward = Surface.at(rows[which], place).normal, sign * quaternion.rotate(frame, Z_AXIS)
    ahead = sign * quaternion.rotate(quaternion.from_ros(poses[0, 3:]), Z_AXIS)
    for way in (onward, ahead, ASIDE / np.linalg.norm(ASIDE)):
        flat = way - (way @ n) * n
        if np.linalg.norm(flat) > STEEP:
            break
    flat /= np.linalg.norm(flat)
    left = length * (1.0 - inside / (len(poses) - 1))
    turn = quaternion.multiply(quaternion.between(onward, flat), frame)
    return np.concatenate([pushed_out(place + SLACK * left * flat, rows), quaternion.to_ros(turn)])


def _fan(
    run: Cable, loose: Sequence[LooseEnd], mounts: np.ndarray, rows: np.ndarray | None, weight: np.ndarray
) -> Iterator[np.ndarray]:
    """Poses (2, 7) with loose ends ahead of what is next to them, and more and more below.

    `weight` (3,): load per length, N/m.
    """
    pull = sum((mount.force for mount in run.mounts), run.length * weight)
    size = float(np.linalg.norm(pull))
    down = pull / size if size > 0.0 else np.zeros(3)
    for reach in REACHES:
        for part in (0.0, 0.5, 1.0):
            poses, inside = np.stack([mounts[0, 0], mounts[-1, 1]]), False
            for end in loose:
                beside, sign = mounts[-end.which, 1 - end.which], 1.0 if end.which else -1.0
                frame = quaternion.from_ros(beside[3:])
                ahead = quaternion.rotate(frame, sign * Z_AXIS)
                way = (1.0 - part) * ahead + part * down
                if end.free and np.linalg.norm(way) > STEEP:
                    way = reach * run.length / len(mounts) * way / np.linalg.norm(way)
                    poses[end.which, :3] = beside[:3] + way
                    inside |= rows is not None and nearest(rows, poses[end.which, :3])[0] < 0.0
                chord = poses[end.which, :3] - beside[:3]
                if chord.any():
                    onto = quaternion.between(ahead, chord / np.linalg.norm(chord))
                    poses[end.which, 3:] = quaternion.to_ros(quaternion.multiply(onto, frame))
            if not inside:
                yield poses
