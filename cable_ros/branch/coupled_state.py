# SPDX-License-Identifier: Apache-2.0
"""What pieces share at their supports: orientations and arc lengths, and where that puts each piece."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from cable_ros.branch.coupling import LOOSE, PER
from cable_ros.branch.loose_ends import Tip
from cable_ros.branch.shared_piece import Place
from cable_ros.compilation import LEAF_ENTRY, njit
from cable_ros.rod import quaternion


class Shared(NamedTuple):
    """The unknowns of n supports and of the loose ends."""

    turns: np.ndarray
    """(n, 4) orientation of the section in each support, in the frame of its mount, scalar first."""
    arcs: np.ndarray
    """(n,) arc length of the cable there, m."""
    tips: tuple[Tip, ...] = ()
    """The sections at the loose ends."""

    def moved(self, step: np.ndarray) -> Shared:
        """After a step (N,): rotations about the sections' own axes, rad, and lengths, m, by support; then
        those of each loose end, see `Tip.moved`.
        """
        count = PER * len(self.arcs)
        each = step[:count].reshape(-1, PER)
        turns = np.empty_like(self.turns)
        quaternion.retract(self.turns, np.ascontiguousarray(each[:, :3]).ravel(), turns)
        steps = step[count:].reshape(-1, LOOSE)
        tips = tuple(tip.moved(own) for tip, own in zip(self.tips, steps, strict=True))
        return Shared(turns, self.arcs + each[:, 3], tips)

    def step_to(self, other: Shared) -> np.ndarray:
        """(N,) the step that leads to another state, as in `moved`."""
        out = np.empty(PER * len(self.arcs))
        _step_to(self.turns, self.arcs, other.turns, other.arcs, out)
        if not self.tips:
            return out
        tips = [one.step_to(two) for one, two in zip(self.tips, other.tips, strict=True)]
        return np.concatenate([out, *tips])

    def places(self, mounts: np.ndarray, length: float) -> list[Place]:
        """Where each piece is held; `mounts` (n + 1, 2, 7): of their ends; `length` of all together, m."""
        poses = mounts.copy()
        _turn(mounts, self.turns, poses)
        for tip in self.tips:
            poses[-tip.which, tip.which] = tip.pose(mounts[-tip.which, tip.which])
        cuts = [0.0, *self.arcs.tolist(), length]
        out = [Place(poses[i], cuts[i + 1] - cuts[i], cuts[i]) for i in range(len(poses))]
        if self.tips:
            out[-1] = out[-1]._replace(yields=self.tips[-1].yields(mounts[-1, 1]))
        return out


@njit(**LEAF_ENTRY)
def _step_to(turns, arcs, new_turns, new_arcs, out):  # type: ignore[no-untyped-def]
    """`Shared.step_to` of the supports: turns (n, 4) and arcs (n,) before and after, into `out` (PER n,)."""
    for j in range(arcs.shape[0]):
        one, two = turns[j], new_turns[j]
        change = quaternion.product((one[0], -one[1], -one[2], -one[3]), (two[0], two[1], two[2], two[3]))
        x, y, z = quaternion.turn(change)
        out[PER * j], out[PER * j + 1], out[PER * j + 2] = x, y, z
        out[PER * j + 3] = new_arcs[j] - arcs[j]


@njit(**LEAF_ENTRY)
def _turn(mounts, turns, poses):  # type: ignore[no-untyped-def]
    """Turn sections in their `mounts` by `turns` (n, 4), into `poses`; both (n + 1, 2, 7)."""
    for j in range(turns.shape[0]):
        mount, turn = mounts[j, 1], turns[j]
        w, x, y, z = quaternion.product(
            (mount[6], mount[3], mount[4], mount[5]), (turn[0], turn[1], turn[2], turn[3])
        )
        for pose in (poses[j, 1], poses[j + 1, 0]):
            pose[3], pose[4], pose[5], pose[6] = x, y, z, w


def first_guess(mounts: np.ndarray, arcs: np.ndarray, length: float, tubes: np.ndarray) -> Shared:
    """A state to start from: tangents of a smooth curve through all mounts, twisted evenly.

    Args:
        mounts: (n + 1, 2, 7) of the ends of the pieces, world.
        arcs: (n,) arc lengths, m.
        length: of the cable, m.
        tubes: (n,) which supports are tubes: the tangent is along the z axis of the mount.
    """
    count = len(arcs)
    r = np.concatenate([mounts[:, 0, :3], mounts[-1:, 1, :3]])
    first, last = (quaternion.from_ros(pose[3:]) for pose in (mounts[0, 0], mounts[-1, 1]))
    sections, before = [], first
    for j in range(1, count + 1):
        back, ahead = r[j] - r[j - 1], r[j + 1] - r[j]
        sizes = np.linalg.norm(back), np.linalg.norm(ahead)
        # the nearer neighbour tells more
        tangent = back / max(sizes[0] ** 2, 1e-12) + ahead / max(sizes[1] ** 2, 1e-12)
        if tubes[j - 1]:
            tangent = quaternion.rotate(quaternion.from_ros(mounts[j, 0, 3:]), np.array([0.0, 0.0, 1.0]))
        size = float(np.linalg.norm(tangent))
        along = quaternion.rotate(before, np.array([0.0, 0.0, 1.0]))
        if size > 1e-9:
            before = quaternion.multiply(quaternion.between(along, tangent / size), before)
        sections.append(before)
    along, to = (quaternion.rotate(q, np.array([0.0, 0.0, 1.0])) for q in (before, last))
    arrived = quaternion.multiply(quaternion.between(along, to), before)
    twist = float(quaternion.rotation_vector(quaternion.multiply(quaternion.conjugate(arrived), last))[2])
    turns = np.empty((count, 4))
    for j, section in enumerate(sections):
        half = 0.5 * twist * arcs[j] / length
        spun = quaternion.multiply(section, np.array([np.cos(half), 0.0, 0.0, np.sin(half)]))
        mount = quaternion.from_ros(mounts[j, 1, 3:])
        turns[j] = quaternion.multiply(quaternion.conjugate(mount), spun)
        if tubes[j]:
            turns[j, 1:3] = 0.0  # rounding, which nothing would take away
            turns[j] /= np.linalg.norm(turns[j])
    return Shared(turns, arcs.copy())


def reachable(mounts: np.ndarray, arcs: np.ndarray, length: float, slides: np.ndarray) -> np.ndarray:
    """Arc lengths (n,) at which each piece is longer than its chord, if the rings can slide to such.

    Args:
        mounts, arcs, length: as in `first_guess`.
        slides: (n,) which supports are rings or tubes.
    """
    chords = np.linalg.norm(mounts[:, 1, :3] - mounts[:, 0, :3], axis=1)
    cuts = np.concatenate([[0.0], arcs, [length]])
    lengths = np.diff(cuts)
    if (lengths > ROOM * chords).all():
        return arcs
    # what is too short takes from the slack of the others between two supports that do not slide
    fixed = [0, *(j + 1 for j in range(len(arcs)) if not slides[j]), len(cuts) - 1]
    for a, b in itertools.pairwise(fixed):
        slack = cuts[b] - cuts[a] - chords[a:b].sum()
        if b == a + 1:
            continue
        if not slack > 0.0:  # a cable that stretches: alike everywhere
            cuts[a + 1 : b] = cuts[a] + np.cumsum(chords[a:b])[:-1] * (cuts[b] - cuts[a]) / chords[a:b].sum()
            continue
        room = min(ROOM - 1.0, 0.5 * slack / chords[a:b].sum())
        least = (1.0 + room) * chords[a:b]
        more = np.maximum(lengths[a:b] - least, 0.0)
        given = more * (cuts[b] - cuts[a] - least.sum()) / more.sum() if more.any() else more
        cuts[a + 1 : b] = cuts[a] + np.cumsum(least + given)[:-1]
    return cuts[1:-1]


ROOM = 1.01
"""Minimum length of a piece over its chord in a first guess."""
