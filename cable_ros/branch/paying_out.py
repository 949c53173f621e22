# SPDX-License-Identifier: Apache-2.0
"""Cold starts by continuation: in the cable's length, short at first and paid out, or in its weight.

A cable hardly longer than the shortest path between its clamps touches little, and a search finds it. As it
is paid out it comes to lie on the obstacles like a real one. It never passes through a thin wall, as a
descent from a shape partly inside the wall may.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cable_ros.branch import handover
from cable_ros.branch.cold_start import LIMIT, Conditions, Found, Sought, Starts
from cable_ros.branch.continuation import continue_branch
from cable_ros.branch.refinement import refine
from cable_ros.branch.walk import End
from cable_ros.contact.distance import AXES, CENTRE, DIMENSIONS, FRICTION_COEFFICIENT
from cable_ros.contact.friction_kernels import FRICTIONLESS
from cable_ros.contact.nodal_rod import NodalRod
from cable_ros.contact.shortest_path import taut_strings
from cable_ros.contact.travel import CONTACT_STEP
from cable_ros.rod.kirchhoff import Rod

SLACK = (1.05, 1.15)
"""Lengths of the short cable, tried in turn, over that of the shortest path past the obstacles."""
LIGHT = (0.5,)
"""Weights of the light cable, tried in turn, as fractions of the whole."""
LENGTHS = (slice(CENTRE, AXES), slice(DIMENSIONS, FRICTION_COEFFICIENT))
"""Columns of an obstacle whose unit is a length."""
LOOSE = 1e-2
"""Tolerance along the path: only its end is refined."""
PIECE = 50_000.0
"""Budget of a piece, iterations times unknowns."""
STEP = 0.1
"""First and longest step, as a fraction of the path."""


class Led(ABC):
    """Equilibria of one pose by continuation from easier ones, one after the other.

    Args:
        sought: the pose; without obstacles there is nothing to try.
        begins: what each begins from, tried in turn.
    """

    def __init__(self, sought: Sought, begins: Sequence[float]) -> None:
        self._sought = sought
        self._left = list(begins) if sought.conditions.obstacles is not None else []
        self._led: tuple[Rod, np.ndarray, np.ndarray, float] | None = None
        """A rod on its way: its shape, end force, and how far it is, a fraction that ends at 1."""
        self._starts: tuple[Starts, float] | None = None
        """The search for the equilibrium that the next way begins at, and the fraction there."""

    @property
    def over(self) -> bool:
        """Whether all have been tried."""
        return self._led is None and self._starts is None and not self._left

    def settle(self) -> tuple[list[Found], float]:
        """Search on for the next to begin from, or lead the present one on by a piece.

        Returns the equilibrium of the pose, if there is one now, and the work.
        """
        if self._led is None:
            return [], self._search()
        rod, q, F, part = self._led
        self._led = None

        def path(t: float) -> Conditions:
            there = self._at(part + t * (1.0 - part))
            return there if rod.qe @ there.qe > 0.0 else replace(there, qe=-there.qe)

        fallback = handover.nodal if rod.replaceable else None
        rod.work = PIECE
        led = continue_branch(rod, q, F, path, 1e-3 * LOOSE, STEP, STEP, fallback, CONTACT_STEP)
        work = PIECE - led.rod.work
        if led.end is End.ARRIVED:
            found, more = self._whole(led.rod, led.q, led.F)
            return [] if found is None else [found], work + more
        if led.end is End.UNFINISHED and (led.at > 0.0 or led.rod is not rod):
            self._led = led.rod, led.q, led.F, part + led.at * (1.0 - part)
        return [], work

    @abstractmethod
    def _begin(self, amount: float) -> float | None:
        """The fraction at which the way from this amount begins; None if there is none."""

    @abstractmethod
    def _at(self, part: float) -> Conditions:
        """The pose at a fraction of the way."""

    def _search(self) -> float:
        """Descend once more towards the equilibrium to begin from; returns the work."""
        if self._starts is None:
            part = self._begin(self._left.pop(0))
            if part is not None:
                there = replace(self._sought, conditions=self._at(part), tolerance=LOOSE)
                self._starts = Starts(there, thorough=False), part
            return 0.0
        starts, part = self._starts
        work = starts.descend()
        if starts.over:
            best = min(starts.found, key=lambda one: one.energy, default=None)
            self._led = None if best is None else (best.rod, best.q, best.F, part)
            self._starts = None
        return work

    def _whole(self, rod: Rod, q: np.ndarray, F: np.ndarray) -> tuple[Found | None, float]:
        """The equilibrium (q, F) of the whole cable, solved to the tolerance, or None; and the work."""
        if isinstance(rod, NodalRod):
            rod.work = LIMIT
            return handover.exact(rod, self._sought.tolerance, FRICTIONLESS), LIMIT - rod.work
        if not rod.refactor(q, F):
            return None, 0.0
        found, estimate = refine(Found.at(rod, q, F), self._sought.tolerance)
        return (
            found if estimate <= self._sought.tolerance else None,
            found.iterations * found.rod.iteration_work,
        )


class PayingOut(Led):
    """A short cable is paid out.

    Lengths are in units of the cable's present length, so that clamps and obstacles seem to come nearer.
    Load per length and natural curvature are those of the whole cable: only the end of the path counts.
    """

    def __init__(self, sought: Sought) -> None:
        super().__init__(sought, SLACK)

    def _begin(self, amount: float) -> float | None:
        whole = self._sought.conditions
        assert whole.obstacles is not None
        strings = taut_strings(whole.re, whole.obstacles, 1.0)
        if not strings:
            self._left.clear()
            return None
        shortest = float(np.linalg.norm(np.diff(strings[0], axis=0), axis=1).sum())
        return min(1.0, amount * shortest)

    def _at(self, part: float) -> Conditions:
        return _shortened(self._sought.conditions, part)


class Loading(Led):
    """A light cable is loaded until it has its weight: heavy ones are seldom found at once."""

    def __init__(self, sought: Sought) -> None:
        super().__init__(sought, LIGHT)

    def _begin(self, amount: float) -> float | None:
        return amount

    def _at(self, part: float) -> Conditions:
        whole = self._sought.conditions
        return replace(whole, f=part * whole.f)


def _shortened(whole: Conditions, length: float) -> Conditions:
    """The pose in units of a shorter cable; `length` is a fraction of the whole."""
    assert whole.obstacles is not None
    obstacles = whole.obstacles.copy()
    for columns in LENGTHS:
        obstacles[:, columns] /= length
    return replace(whole, re=whole.re / length, obstacles=obstacles)
