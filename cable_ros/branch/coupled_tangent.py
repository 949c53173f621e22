# SPDX-License-Identifier: Apache-2.0
"""How the wrenches of pieces that share supports answer to motions of all that holds them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cable_ros.branch.coupled_modes import coupled_modes
from cable_ros.branch.coupling import END, LOOSE, PER, START, Ends, Loose, Side, System, assemble, onto_mounts
from cable_ros.branch.loose_ends import PITCH, LooseEnd, Tip
from cable_ros.branch.modes import no_modes
from cable_ros.branch.results import Tangent
from cable_ros.branch.shared_piece import STRAIGHT
from cable_ros.equilibrium import Modes
from cable_ros.linalg.cross import cross_matrix
from cable_ros.rod import quaternion


class Turned:
    """The linearised equations of one piece along the axes of its mounts; implements `Linearised`."""

    def __init__(self, inner: Tangent, mounts: np.ndarray, sections: np.ndarray, weight: np.ndarray) -> None:
        """Of `inner`, whose ends are in `mounts` and have `sections`, (2, 7) poses, world; all is kept.

        `weight` (3,): load per length in the world, N/m.
        """
        self.inner, self._mounts, self._sections, self._weight = inner, mounts, sections, weight
        self._loose: list[tuple[LooseEnd, Tip]] = []

    def at_loose_end(self, end: LooseEnd, tip: Tip) -> None:
        """Take wrenches and motions at a loose end to those of its mount."""
        self._loose.append((end, tip))

    def on_mounts(self, wrenches: np.ndarray) -> np.ndarray:
        """(12,) of both ends along the axes of the mounts, from those along the axes of the sections."""
        out = np.empty(12)
        onto_mounts(self._mounts, self._sections, wrenches, out)
        return out

    @cached_property
    def turn(self) -> np.ndarray:
        """(12, 12) what takes wrenches at the sections to those on the mounts."""
        mounts, sections = (
            quaternion.matrices_from_ros(p[:, 3:].copy()) for p in (self._mounts, self._sections)
        )
        turns, out = mounts.transpose(0, 2, 1) @ sections, np.zeros((12, 12))
        for i in range(4):
            out[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = turns[i // 2]
        for end, tip in self._loose:
            own = END if end.which else START
            out[own, own] = end.onto_mount(tip)
        return out

    @property
    def loads(self) -> np.ndarray:
        """(2, 3) load per length along the axes of the sections at both ends, N/m."""
        turn = quaternion.matrices_from_ros(self._sections[:, 3:].copy())
        return np.einsum("sba,b->sa", turn, self._weight)

    def wrench_response(self, obstacles: Sequence[str]) -> np.ndarray:
        """See `Equilibrium.wrench_response`; its sections are clamped to its mounts."""
        out = self.inner.wrench_response(obstacles)
        whole = np.eye(len(out))
        whole[:12, :12] = self.turn
        turned: np.ndarray = whole @ out @ whole.T
        return turned

    def modes(self, count: int, points: int) -> Modes:
        """Of a piece alone there are none."""
        return no_modes(count, points, np.nan)


class Carried(NamedTuple):
    """A tip on an obstacle that moves; SI, rotations and moments of the obstacle about the world's origin."""

    end: Loose
    rows: slice
    """Of its wrench among those of all pieces."""
    columns: slice
    """Of the obstacle."""
    lengths: slice
    """Of its positions among the unknowns."""
    wrench: np.ndarray
    """(6,) of the piece on its section."""
    section: np.ndarray
    """(3, 3) axes of its section, world, in columns."""
    motion: np.ndarray
    """(6, 6) of its section by motions of the obstacle, which turn one that lies on it out of the face."""
    push: np.ndarray
    """(3,) of the obstacle on it, N, world."""
    turned_push: np.ndarray
    """(3, 6) change of the equations for its positions as the obstacle turns their directions."""
    onto_obstacle: np.ndarray
    """(6, 3) what is exerted on the obstacle by a force of the section."""

    @classmethod
    def of(
        cls, end: Loose, tip: Tip, wrench: np.ndarray, rows: slice, columns: slice, lengths: slice
    ) -> Carried:
        """From its parts."""
        section = quaternion.matrices_from_ros(quaternion.to_ros(tip.turn)[None])[0]
        motion, turned, push = np.zeros((6, 6)), np.zeros((3, 6)), end.push(wrench)[3:]
        rubs = tip.face is not None and tip.face.grip is not None
        push = tip.axes @ push if rubs else push[2] * tip.axes[:, 2]
        motion[:3] = section.T @ np.concatenate([np.eye(3), -cross_matrix(tip.position)], axis=1)
        if tip.face is not None and tip.face.lies:
            pitch = tip.spins[:, PITCH]
            motion[3:, 3:] = np.outer(pitch, section @ pitch)
        turned[:, 3:] = tip.axes.T @ cross_matrix(push)
        onto = np.concatenate([section, cross_matrix(tip.position) @ section])
        return cls(end, rows, columns, lengths, wrench, section, motion, push, turned, onto)


@dataclass(frozen=True, eq=False)
class CoupledTangent:
    """The linearised equations of n + 1 pieces about their common equilibrium."""

    pieces: tuple[Turned, ...]
    ends: tuple[Ends, ...]
    friction: np.ndarray
    """(n,) see `coupling.assemble`."""
    free: np.ndarray
    """(N,) which unknowns of the supports and loose ends there are."""
    loose: tuple[Loose, ...] = ()
    """The loose ends,"""
    released: tuple[LooseEnd, ...] = ()
    """how they are held,"""
    tips: tuple[Tip, ...] = ()
    """and their sections."""

    @property
    def count(self) -> int:
        """Number of pieces."""
        return len(self.pieces)

    def sides(self, obstacles: Sequence[str] = (), held: bool = False) -> list[Side]:
        """The pieces as their supports see them; `held`: whether no end yields."""
        last = len(self.pieces) - 1
        return [
            Side.of(ends, piece.inner.wrench_response(obstacles, held), piece.loads, by_end=i < last)
            for i, (ends, piece) in enumerate(zip(self.ends, self.pieces, strict=True))
        ]

    @property
    def _straight(self) -> bool:
        """Whether the piece before a loose end is straight, so that its end must yield; but for stretch."""
        return bool(self.loose) and not self.ends[-1].compliance[2] and self.pieces[-1].inner.slack < STRAIGHT

    def modes(self, count: int, places: Sequence[np.ndarray]) -> Modes:
        """The `count` lowest of all pieces together; see `coupled_modes`.

        A ring that slides against friction is free to slide. NaN if they are not known.
        """
        pieces, points = [piece.inner.piece() for piece in self.pieces], sum(len(at) for at in places)
        if not pieces[0].density:
            return no_modes(count, points, np.inf)
        if self._straight:
            return no_modes(count, points, np.nan)
        system = assemble(self.sides(held=True), np.zeros(len(self.friction)), self.loose)
        K = system.hessian[np.ix_(self.free, self.free)]
        if np.isfinite(K).all():
            try:
                return coupled_modes(pieces, self.ends, K, self.free, count, places, self.loose)
            except np.linalg.LinAlgError:
                pass
        return no_modes(count, points, np.nan)

    def by_mounts(self, motions: np.ndarray) -> np.ndarray:
        """(N,) change of the equations' residual by motions (n + 1, 12) of the mounts, along their axes."""
        sides = self.sides()
        by_wrenches = assemble(sides, self.friction, self.loose).by_wrenches
        out = np.zeros(len(self.free))
        for i, (side, piece) in enumerate(zip(sides, self.pieces, strict=True)):
            out += by_wrenches[:, 12 * i : 12 * i + 12] @ side.response[:12, :12] @ piece.turn.T @ motions[i]
        return out

    def response(self, obstacles: Sequence[str]) -> np.ndarray:
        """(12 (n + 1) + 6 k, same) derivative of all pieces' wrenches, then of those on k obstacles.

        Rows and columns: of each piece what it exerts on what holds its start and its end, along the axes of
        the mounts, and the motions of these; then as in `Equilibrium.wrench_response`. Two pieces that meet
        at a support have columns of their own, which move together.
        """
        sides = self.sides(obstacles, held=not self._straight)
        count, size = len(sides), 12 * len(sides)
        whole = np.zeros((size + 6 * len(obstacles),) * 2)
        turn = np.eye(len(whole))
        for i, side in enumerate(sides):
            at = np.r_[12 * i : 12 * i + 12, size : len(whole)]
            whole[np.ix_(at, at)] += side.response
            turn[12 * i : 12 * i + 12, 12 * i : 12 * i + 12] = self.pieces[i].turn
        system = assemble(sides, self.friction, self.loose)
        carried = self._carried(obstacles)
        for one in carried:
            whole[:, one.columns] += whole[:, one.rows] @ one.motion
        given = system.by_wrenches @ whole[:size]
        for one in carried:
            given[one.lengths, one.columns] += one.turned_push
        out = self._answer(system, whole, given, carried)
        out = turn @ out @ turn.T
        for k, end in enumerate(self.loose):
            # the axes of a free end's load turn
            by_turn = np.zeros((len(self.free), 3))
            by_turn[PER * (count - 1) + LOOSE * k :][:LOOSE] = -end.motion.T @ end.by_turn
            answer = self._answer(system, np.zeros((len(whole), 3)), by_turn, carried)
            for one in carried:
                if one.end is end:
                    answer[one.columns] += one.onto_obstacle @ end.by_turn[:3]
            at = 12 * end.which * (count - 1) + (END if end.which else START).start
            out[:, at + 3 : at + 6] += turn @ answer
        return out

    def _answer(
        self, system: System, whole: np.ndarray, given: np.ndarray, carried: Sequence[Carried]
    ) -> np.ndarray:
        """(12 (n + 1) + 6 k, m) change of the wrenches, along the axes of the sections.

        Args:
            system: the equations.
            whole: (12 (n + 1) + 6 k, m) the change if the unknowns stay.
            given: (N, m) that of the equations' residual.
            carried: the tips on obstacles that move.
        """
        free = self.free
        by_motion = -np.linalg.solve(system.tangent[np.ix_(free, free)], given[free])
        out = whole + system.spread[:, free] @ by_motion
        steps = np.zeros((len(free), by_motion.shape[1]))
        steps[free] = by_motion
        for one in carried:
            motion = one.end.motion @ steps[one.lengths.start - 3 : one.lengths.stop]
            if motion.shape[1] == len(out):
                motion[:, one.columns] += one.motion
            change = out[one.rows][:3] - cross_matrix(one.wrench[:3]) @ motion[3:]
            out[one.columns] += one.onto_obstacle @ change
            out[one.columns][3:] += cross_matrix(one.push) @ one.section @ motion[:3]
        self._turn_along(out, by_motion)
        return out

    def _carried(self, obstacles: Sequence[str]) -> list[Carried]:
        """The tips that rest on the named obstacles."""
        out, count = [], len(self.pieces)
        for k, (end, tip) in enumerate(zip(self.loose, self.tips, strict=True)):
            if tip.face is None:
                continue
            name = self.pieces[-tip.which].inner.obstacle(tip.face.obstacle)
            if name in obstacles:
                first = 12 * count + 6 * list(obstacles).index(name)
                wrench = self.ends[-tip.which].wrench(tip.which)
                at = 12 * tip.which * (count - 1) + 6 * tip.which
                lengths = slice(PER * (count - 1) + LOOSE * k + 3, PER * (count - 1) + LOOSE * (k + 1))
                out.append(Carried.of(end, tip, wrench, slice(at, at + 6), slice(first, first + 6), lengths))
        return out

    def _turn_along(self, out: np.ndarray, by_motion: np.ndarray) -> None:
        """Add to wrenches (12 (n + 1) + 6 k, m) that sections turn in their mounts, and what they exert with
        them, by `by_motion` of the unknowns that there are.
        """
        count, free = len(self.pieces), self.free
        turns = np.zeros((len(free), by_motion.shape[1]))
        turns[free] = by_motion
        for k, end in enumerate(self.loose):
            at, own = 12 * end.which * (count - 1), END if end.which else START
            W = self.ends[-end.which].wrenches[own]
            rows = slice(at + own.start, at + own.stop)
            moved = end.motion @ turns[PER * (count - 1) + LOOSE * k :][:LOOSE]
            out[rows][:3] -= cross_matrix(W[:3]) @ moved[3:]
            out[rows][3:] -= cross_matrix(W[3:]) @ moved[3:] + cross_matrix(W[:3]) @ moved[:3]
        for j in range(count - 1):
            psi = turns[PER * j : PER * j + 3]
            for at, W in (
                (12 * j + 6, self.ends[j].wrenches[6:]),
                (12 * j + 12, self.ends[j + 1].wrenches[:6]),
            ):
                out[at : at + 3] -= cross_matrix(W[:3]) @ psi
                out[at + 3 : at + 6] -= cross_matrix(W[3:]) @ psi


class Whole:
    """The linearised equations of a cable of one piece; implements `equilibrium.Linearised`."""

    __slots__ = ("_inner",)

    def __init__(self, inner: CoupledTangent) -> None:
        self._inner = inner

    def wrench_response(self, obstacles: Sequence[str]) -> np.ndarray:
        """See `Equilibrium.wrench_response`."""
        return self._inner.response(obstacles)

    def modes(self, count: int, points: int) -> Modes:
        """See `Equilibrium.modes`."""
        return self._inner.modes(count, [np.linspace(0.0, 1.0, points)])
