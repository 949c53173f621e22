# SPDX-License-Identifier: Apache-2.0
"""A continuation under way: where it is on its path, and what its steps have told."""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from cable_ros.branch.cold_start import Conditions, Found
from cable_ros.branch.snap_through import SnapThrough, fall_with_friction
from cable_ros.contact.nodal_rod import NodalRod
from cable_ros.contact.travel import travel
from cable_ros.rod.kirchhoff import Rod
from cable_ros.rod.units import norm

VERY_TAUT = 1e4
"""`TAUT` of a cable whose end the extrapolation tells to 1 % of its slack."""

Path = Callable[[float], Conditions]
"""Conditions at a fraction of a path; the signs of end frames follow the rod's."""
Fallback = Callable[[Rod, np.ndarray, np.ndarray], "NodalRod | None"]
"""Makes the rod that replaces one that fails, from it and its equilibrium, or None if that fails, too."""


class End(enum.Enum):
    """How a continuation ended."""

    ARRIVED = enum.auto()
    UNFINISHED = enum.auto()
    """The rod has no `work` left."""
    BEYOND_REACH = enum.auto()
    TAUT = enum.auto()
    """Around an obstacle its force goes to infinity, as extrapolated, before the end of the path."""
    STUCK = enum.auto()


@dataclass(frozen=True, eq=False)
class Sound:
    """An equilibrium that is stable for sure, to which a continuation may go back."""

    at: float
    """Fraction of the path."""
    q: np.ndarray
    """(n, 4) nodal frames."""
    F: np.ndarray
    """(3,) end force."""
    put_back: Callable[[], None]
    """See `Rod.kept`."""


@dataclass(frozen=True, eq=False)
class Continuation:
    """Where a continuation ended, and how."""

    end: End
    at: float
    """Fraction of the path."""
    q: np.ndarray
    """(n, 4) nodal frames there."""
    F: np.ndarray
    """(3,) end force there."""
    iterations: int
    """Of all steps."""
    snaps: tuple[SnapThrough, ...]
    rod: Rod
    """The rod at the end: the first one, or its `fallback`."""
    step: float
    """The step that it would try next, fraction of the path."""
    fork: float | None = None
    """Fraction of the path at the end of the last step in which a rule told mirror images apart."""


@dataclass(eq=False)
class Walk:
    """A continuation under way. The first fields are those of `continue_branch`."""

    rod: Rod
    q: np.ndarray
    F: np.ndarray
    path: Path
    tolerance: float
    step: float
    longest: float
    fallback: Fallback | None
    farthest: float
    lying_work: float
    taut_force: float
    may_turn: bool
    slackens: bool

    at: float = 0.0
    """Fraction of the path."""
    iterations: int = 0
    snaps: list[SnapThrough] = field(default_factory=list)
    margins: list[tuple[float, float]] = field(default_factory=list)
    """Fractions of the path and stability margins there."""
    fork: float | None = None
    """See `Continuation`."""
    sound: Sound | None = None
    in_a_row: int = 0
    """Number of steps taken since one failed, or since the step grew."""
    failed: int = 0
    """Number of steps that failed since one was taken."""
    falls: int = 0

    def __post_init__(self) -> None:
        self.first = norm(self.F)
        """End force at the start, EI / L^2."""
        self.forces = [(0.0, self.first)]
        """Of the last two equilibria: fractions of the path, and end forces."""
        self.given = self.last = self.rod.work
        """At the start, and after the last step that was taken."""
        self.was_taut = self.first >= self.taut_force and not self.rod.on_grid
        self.taut = self.slackens
        """Whether the path's end is known to be past where the cable is taut."""
        self.gives = self.slackens
        """Whether a step that was too long would have led to a smaller end force."""
        self.allowed = self.longest
        """How long a step friction's changes in the last one allow, whether or not it was solved."""

    @property
    def force(self) -> float:
        """The end force, EI / L^2."""
        return self.forces[-1][1]

    @property
    def very_taut(self) -> bool:
        return self.force > VERY_TAUT

    def ended(self, end: End) -> Continuation:
        return Continuation(
            end, self.at, self.q, self.F, self.iterations, tuple(self.snaps), self.rod, self.step, self.fork
        )

    def shorten(self) -> None:
        """Halve the step, or more where friction's changes ask for it."""
        self.step *= min(self.rod.stride, 0.5)

    def refactor(self) -> bool:
        """Factor the rod where it is; whether it is stable."""
        return self.rod.refactor(self.q, self.F)

    def away(self, conditions: Conditions) -> float:
        """`travel` from the rod's conditions to these; 0 without obstacles."""
        rod = self.rod
        if rod.obstacles is None or conditions.obstacles is None:
            return 0.0
        return travel(rod.qe, rod.re, rod.obstacles, conditions.qe, conditions.re, conditions.obstacles)

    def replace_rod(self) -> bool:
        """Go on with the rod's `fallback`, which there is only once; whether that could be made.

        A grid does not resolve how a cable bends that is very taut.
        """
        if self.fallback is None or self.very_taut:
            return False
        replacement, self.fallback = self.fallback(self.rod, self.q, self.F), None
        if replacement is None:
            return False
        self.rod, self.q, self.F = replacement, replacement.shape, replacement.end_force
        return True

    def take_snap(self, found: Found, snap: SnapThrough) -> None:
        """Go on from where the cable has snapped to, maybe on another rod."""
        self.snaps.append(snap)
        self.iterations += found.iterations
        self.rod, self.q, self.F = found.rod, found.q, found.F

    def fall(self, first: float, start: np.ndarray) -> bool:
        """Whether the cable falls from the shape `start` and rests, a step of `first` further on."""
        rod = self.rod
        fall = fall_with_friction(rod, start, self.F, self.path, self.at, first, self.away)
        if fall is None:
            self.refactor()
            rod.fell_short = self.F if rod.falling is None and not rod.on_grid else None
            return False
        found, snap, self.at = fall
        self.snaps.append(snap)
        self.iterations += found.iterations
        self.q, self.F, self.last = found.q, found.F, rod.work
        self.forces = [(self.at, norm(self.F))]
        return True
