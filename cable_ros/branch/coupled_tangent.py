# SPDX-License-Identifier: Apache-2.0
"""How the wrenches of pieces that share supports answer to motions of all that holds them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cable_ros.branch.coupled_modes import coupled_modes
from cable_ros.branch.coupling import END, LOOSE, PER, START, Ends, Loose, Side, assemble
from cable_ros.branch.loose_ends import LooseEnd, Tip
from cable_ros.branch.modes import no_modes
from cable_ros.branch.results import Tangent
from cable_ros.equilibrium import Modes
from cable_ros.linalg.cross import cross_matrix


class Turned:
    """The linearised equations of one piece along the axes of its mounts; implements `Linearised`."""

    __slots__ = ("inner", "turn")

    def __init__(self, inner: Tangent, turns: np.ndarray) -> None:
        """Of `inner`; `turns` (2, 3, 3): its sections' axes in its mounts' frames."""
        self.inner = inner
        self.turn = np.zeros((12, 12))
        for i in range(4):
            self.turn[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = turns[i // 2]

    def at_loose_end(self, end: LooseEnd, tip: Tip) -> None:
        """Take wrenches and motions at a loose end to those of its mount."""
        own = END if end.which else START
        self.turn[own, own] = end.onto_mount(tip)

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


@dataclass(frozen=True, eq=False)
class CoupledTangent:
    """The linearised equations of n + 1 pieces about their common equilibrium."""

    pieces: tuple[Turned, ...]
    ends: tuple[Ends, ...]
    loads: np.ndarray
    """(n + 1, 2, 3) load per length along the axes of the sections at the ends of each piece, N/m."""
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

    def sides(self, obstacles: Sequence[str] = ()) -> list[Side]:
        """The pieces as their supports see them."""
        last = len(self.pieces) - 1
        return [
            Side.of(ends, piece.inner.wrench_response(obstacles), load, by_end=i < last)
            for i, (ends, piece, load) in enumerate(zip(self.ends, self.pieces, self.loads, strict=True))
        ]

    def modes(self, count: int, places: Sequence[np.ndarray]) -> Modes:
        """The `count` lowest of all pieces together; see `coupled_modes`.

        A ring that slides against friction is free to slide. NaN if they are not known.
        """
        pieces, points = [piece.inner.piece() for piece in self.pieces], sum(len(at) for at in places)
        if not pieces[0].density:
            return no_modes(count, points, np.inf)
        system = assemble(self.sides(), np.zeros(len(self.friction)), self.loose)
        K = system.tangent[np.ix_(self.free, self.free)]
        if np.isfinite(K).all():
            try:
                return coupled_modes(pieces, self.ends, K, self.free, count, places, self.loose)
            except np.linalg.LinAlgError:
                pass
        return no_modes(count, points, np.nan)

    def response(self, obstacles: Sequence[str]) -> np.ndarray:
        """(12 (n + 1) + 6 k, same) derivative of all pieces' wrenches, then of those on k obstacles.

        Rows and columns: of each piece what it exerts on what holds its start and its end, along the axes of
        the mounts, and the motions of these; then as in `Equilibrium.wrench_response`. Two pieces that meet
        at a support have columns of their own, which move together.
        """
        sides = self.sides(obstacles)
        count, size = len(sides), 12 * len(sides)
        whole = np.zeros((size + 6 * len(obstacles),) * 2)
        turn = np.eye(len(whole))
        for i, side in enumerate(sides):
            at = np.r_[12 * i : 12 * i + 12, size : len(whole)]
            whole[np.ix_(at, at)] += side.response
            turn[12 * i : 12 * i + 12, 12 * i : 12 * i + 12] = self.pieces[i].turn
        system = assemble(sides, self.friction, self.loose)
        free = self.free
        by_motion = -np.linalg.solve(
            system.tangent[np.ix_(free, free)], (system.by_wrenches @ whole[:size])[free]
        )
        out = whole + system.spread[:, free] @ by_motion
        self._turn_along(out, by_motion)
        out = turn @ out @ turn.T
        for k, end in enumerate(self.loose):
            # the axes of a free end's load turn
            by_turn = np.zeros((len(free), 3))
            by_turn[PER * (count - 1) + LOOSE * k :][:LOOSE] = -end.motion.T @ end.by_turn
            follows = -np.linalg.solve(system.tangent[np.ix_(free, free)], by_turn[free])
            answer = system.spread[:, free] @ follows
            self._turn_along(answer, follows)
            at = 12 * end.which * (count - 1) + (END if end.which else START).start
            out[:, at + 3 : at + 6] += turn @ answer
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
