# SPDX-License-Identifier: Apache-2.0
"""Balance of the spacers between cables that touch: Newton's method for where they are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cable_ros.branch.crossing_cable import CrossingCable
from cable_ros.branch.results import Tangent
from cable_ros.contact.crossing import FREEDOMS, UNSTABLE, Spacer
from cable_ros.equilibrium import Modes


class Touching(NamedTuple):
    """A cable and the obstacles in its slots that are spacers."""

    slots: list[int]
    spacers: list[int]
    """Their numbers, one for each slot."""


def touching(spacers: Sequence[Spacer], count: int) -> list[Touching]:
    """Of each of `count` cables."""
    out = [Touching([], []) for _ in range(count)]
    for j, spacer in enumerate(spacers):
        for cable, slot in zip(spacer.cables, spacer.slots, strict=True):
            out[cable].slots.append(slot)
            out[cable].spacers.append(j)
    return out


class System(NamedTuple):
    """The spacers' equations, k of them between n cables; SI."""

    tangent: np.ndarray
    """(5 k, 5 k) derivative of the forces on the spacers by their motions, see `Spacer.basis`."""
    spread: np.ndarray
    """(12 n + 6 o, 5 k) derivative of the wrenches on clamps, then on o obstacles, by these motions."""
    pushed: np.ndarray
    """(5 k, 12 n + 6 o) derivative of the forces on the spacers by motions of the clamps and obstacles."""
    held: np.ndarray
    """(12 n + 6 o, same) derivative of these wrenches by these motions, spacers at rest."""

    def modes(self) -> tuple[np.ndarray, np.ndarray]:
        """Eigenvalues (5 k,) of the symmetric part of the tangent, rising, and their vectors (5 k, 5 k).

        It belongs to a minimum of the energy, each cable's among resting obstacles being one, if `UNSTABLE`
        of them are positive for each spacer: the inertia of all equations is that of the cables' and of this
        Schur complement together.
        """
        values, vectors = np.linalg.eigh(0.5 * (self.tangent + self.tangent.T))
        return values, vectors


def is_minimum(values: np.ndarray) -> bool:
    """Whether these eigenvalues (5 k,) of `System.modes` are those of a minimum."""
    return int((values > 0.0).sum()) == UNSTABLE * (len(values) // FREEDOMS)


def assemble(spacers: Sequence[Spacer], responses: Sequence[np.ndarray], obstacles: int = 0) -> System:
    """The equations of the spacers.

    Args:
        spacers: at least one.
        responses: of each cable, see `Equilibrium.wrench_response`: of its clamps, the obstacles, then the
            spacers that it touches.
        obstacles: number of obstacles that may move.
    """
    count, size, ends = len(responses), FREEDOMS * len(spacers), 12 * len(responses)
    tangent, spread = np.zeros((size, size)), np.zeros((ends + 6 * obstacles, size))
    pushed, held = np.zeros((size, len(spread))), np.zeros((len(spread),) * 2)
    bases = [spacer.basis() for spacer in spacers]
    for i, (own, response) in enumerate(zip(touching(spacers, count), responses, strict=True)):
        rows, known = np.r_[12 * i : 12 * i + 12, ends : len(spread)], 12 + 6 * obstacles
        held[np.ix_(rows, rows)] += response[:known, :known]
        for a, j in enumerate(own.spacers):
            at = slice(known + 6 * a, known + 6 * a + 6)
            to = slice(FREEDOMS * j, FREEDOMS * j + FREEDOMS)
            spread[rows, to] += response[:known, at] @ bases[j]
            pushed[to, rows] += bases[j].T @ response[at, :known]
            for b, k in enumerate(own.spacers):
                other = slice(known + 6 * b, known + 6 * b + 6)
                over = slice(FREEDOMS * k, FREEDOMS * k + FREEDOMS)
                tangent[to, over] += bases[j].T @ response[at, other] @ bases[k]
    return System(tangent, spread, pushed, held)


class CrossedTangent:
    """The linearised equations of all cables of a group about their common equilibrium."""

    def __init__(self, cables: Sequence[CrossingCable], spacers: Sequence[Spacer], poses: np.ndarray) -> None:
        """Of the present equilibria; `poses` (n, 2, 7): of the clamps."""
        self._spacers, self._touching = tuple(spacers), touching(spacers, len(cables))
        self._each: list[tuple[Tangent, int]] = [
            (cable.tangent(own), cable.first_slot) for cable, own in zip(cables, poses, strict=True)
        ]

    @property
    def count(self) -> int:
        """Number of cables."""
        return len(self._each)

    def system(self, obstacles: Sequence[str] = ()) -> System:
        """The equations of the spacers, with these obstacles."""
        responses = []
        for (tangent, first), own in zip(self._each, self._touching, strict=True):
            moving = [*tangent.numbers(obstacles), *(first + slot for slot in own.slots)]
            responses.append(tangent.response_of(moving))
        return assemble(self._spacers, responses, len(obstacles))

    def response(self, obstacles: Sequence[str]) -> np.ndarray:
        """(12 n + 6 k, same) derivative of all wrenches on clamps and on k obstacles by their motions."""
        system = self.system(obstacles)
        if not self._spacers:
            return system.held
        out: np.ndarray = system.held - system.spread @ np.linalg.solve(system.tangent, system.pushed)
        return out

    def modes(self, count: int, places: Sequence[np.ndarray]) -> Modes:
        """None are known: cables that touch vibrate together."""
        points = sum(len(at) for at in places)
        return Modes(np.full(count, np.nan), np.full((count, points, 3), np.nan))


class OneOf:
    """The linearised equations of one cable that touches others; implements `equilibrium.Linearised`."""

    def __init__(self, whole: CrossedTangent, index: int) -> None:
        self._whole, self._index = whole, index

    def wrench_response(self, obstacles: Sequence[str]) -> np.ndarray:
        """See `Equilibrium.wrench_response`; the clamps of the other cables stay where they are."""
        first, ends = 12 * self._index, 12 * self._whole.count
        kept = np.r_[first : first + 12, ends : ends + 6 * len(obstacles)]
        return self._whole.response(obstacles)[np.ix_(kept, kept)]

    def modes(self, count: int, points: int) -> Modes:
        """None: cables that touch vibrate together."""
        return Modes(np.full(count, np.nan), np.full((count, points, 3), np.nan))
