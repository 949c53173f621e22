# SPDX-License-Identifier: Apache-2.0
"""How the wrenches of pieces that share supports answer to motions of all that holds them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cable_ros.branch.coupled_modes import coupled_modes
from cable_ros.branch.coupling import PER, Ends, Side, assemble
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
    """(4 n,) which unknowns of the supports there are."""

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
        K = assemble(self.sides(), np.zeros(len(self.friction))).tangent[np.ix_(self.free, self.free)]
        if np.isfinite(K).all():
            try:
                return coupled_modes(pieces, self.ends, K, self.free, count, places)
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
        system = assemble(sides, self.friction)
        free = self.free
        by_motion = -np.linalg.solve(
            system.tangent[np.ix_(free, free)], (system.by_wrenches @ whole[:size])[free]
        )
        out = whole + system.spread[:, free] @ by_motion
        # sections turn in their mounts, and what they exert with them
        turns = np.zeros((PER * (count - 1), len(whole)))
        turns[free] = by_motion
        for j in range(count - 1):
            psi = turns[PER * j : PER * j + 3]
            for at, W in (
                (12 * j + 6, self.ends[j].wrenches[6:]),
                (12 * j + 12, self.ends[j + 1].wrenches[:6]),
            ):
                out[at : at + 3] -= cross_matrix(W[:3]) @ psi
                out[at + 3 : at + 6] -= cross_matrix(W[3:]) @ psi
        return turn @ out @ turn.T
