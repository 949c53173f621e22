# SPDX-License-Identifier: Apache-2.0
"""Following one branch along a path of conditions, and what happens where it ends."""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cable_ros.branch.cold_start import Conditions, Found, settle
from cable_ros.contact.nodal_rod import NodalRod
from cable_ros.contact.travel import travel
from cable_ros.linalg.bordered import NEUTRAL
from cable_ros.rod import warm_step
from cable_ros.rod.kirchhoff import Rod
from cable_ros.rod.rod_state import TWIST
from cable_ros.solve.trust_region import Options

SHORTEST = 1e-4
"""Smallest part of the longest step before the branch counts as ended."""
BEYOND = 0.02
"""Part of the longest step below which a step that leads out of reach is not halved further."""
CARRY, LAST = 0.05, 1e-3
"""Part of the longest step below which a rod that fails is replaced: one that lies on something that rubs,
and any other, which mostly gets there in small steps."""
LEAST_HELD = 1e-6
"""The same of one that is held by points and only goes too far: beside a clamp one lets go within a hair."""
CARRY_WORK = 75_000
"""Work, iterations times unknowns, after which the first kind is: about 150 ms."""
LAST_WORK = 0.5
"""Part of the budget spent without a step after which the second kind is."""
PATIENT = 0.02
"""Part of the longest step from which a step that fails is not made by a descent: a shorter one takes less."""
LEAST = 1e-9
"""Part of the longest step below which a step is rounding."""
OVERHEAD = 250
"""Iterations times unknowns that take as long as a step beside its iterations: kinematics and calls."""
NEAR = 30.0
"""Stability margins are noted at failures of steps below this many of the shortest."""
DESCENT = 4
"""Work of an iteration of a descent, in iterations of a warm start."""
BACK = (30.0, 10.0, 3.0)
"""If none was noted before the last equilibrium, its margin is compared with the one this many steps back."""
SMALL = 0.05
"""Largest margin of a fold's last equilibrium. Folds of free cables ended at 1e-4 to 0.012, by the root law
of the margin from the last step's distance; cables away from folds have 0.1 to 1."""
FOLD = 10.0
"""A fold is shown if the margin's square, falling as measured, is 0 within this many of the last steps; at
folds of free cables it was within 0.3 to 1.7."""
FREE_TO_TURN = 10.0 * NEUTRAL
"""Margin below which an equilibrium is one of many that turn freely into each other."""
ASIDE = 5e-12
"""Size, root of the elastic energy, of the rotation, always the same one, that a fall starts with: above
rounding, below what the energy shows."""
JUMP = 0.05
"""Rotation of a section, rad, that no step of SHORTEST along a branch makes."""
AWAY = 0.2
"""The same for a few of these steps away from a fold, where the shape moves like the root of the load."""
FALL_WORK = 90_000.0
"""Budget of a fall, if there is less left: without it no call would get past a fold."""
FREE_FALLS = 2
"""Number of falls that the budget leaves aside: even a small step may meet a fold, and end just before it."""
GRID = np.linspace(0.0, 1.0, 33)
"""Where shapes are compared."""


class End(enum.Enum):
    """How a walk ended."""

    ARRIVED = enum.auto()
    UNFINISHED = enum.auto()
    """The rod has no `work` left."""
    BEYOND_REACH = enum.auto()
    STUCK = enum.auto()


@dataclass(frozen=True, eq=False)
class Fall:
    """A descent from where a branch could not be followed on, at the part `at` of the path; cable units."""

    at: float
    energy_before: float
    energy_after: float
    twist_before: float
    twist_after: float
    jumped: bool
    """Whether it ended in another shape; if not, the branch goes on there."""
    touched: bool
    """Whether the cable touched something before, and friction was forgotten."""
    margin: float
    """Stability margin at the last equilibrium before."""
    to_fold: float
    """How far ahead of it the margin's square vanishes, in steps; inf if it does not fall. Asked only where
    the cable jumped."""

    crossed: bool = False
    """Whether the branch itself goes on, no longer stable: its margin has passed through 0."""

    @property
    def folded(self) -> bool:
        """Whether the branch ended: its stability margin ran to 0 there, and at a fold the energy fell."""
        if self.crossed or self.margin < FREE_TO_TURN:
            return True
        return self.margin <= SMALL and self.to_fold <= FOLD and self.energy_after < self.energy_before


@dataclass(frozen=True, eq=False)
class Walk:
    """Where a walk ended: part of the path, state there, iterations of all steps, falls on the way."""

    end: End
    at: float
    q: np.ndarray
    F: np.ndarray
    iterations: int
    falls: tuple[Fall, ...]
    rod: Rod
    """The rod that got there: the first one, or its `carrier`."""


def walk(
    rod: Rod, q: np.ndarray, F: np.ndarray, path: Callable[[float], Conditions], tolerance: float,
    step: float = 0.25, longest: float = 1.0,
    carrier: Callable[[Rod, np.ndarray, np.ndarray], NodalRod | None] | None = None,
    farthest: float = np.inf,
) -> Walk:  # fmt: skip
    """Follow the branch of the factored equilibrium (q, F) along path(0..1), in steps of at most `longest`.

    A step is halved until the warm-started solve converges from it. If even the smallest does not, the
    cable descends from there to the next stable equilibrium at fixed ends (`fall`). The walk is unfinished
    if the rod has no `work` left; `path` gives end frames whose signs follow the rod's. A rod that fails is
    replaced by its `carrier`, if it has one, before steps become tiny. Among obstacles no step leads clamps
    and obstacles `farthest` or more, lengths.
    """
    at, iterations = 0.0, 0
    falls: list[Fall] = []
    margins: list[tuple[float, float]] = []  # parts of the path and stability margins there

    given = last = rod.work  # at the start, and when a step was made last

    def ended(end: End) -> Walk:
        return Walk(end, at, q, F, iterations, tuple(falls), rod)

    while at < 1.0:
        if rod.work <= 0.0:
            rod.refactor(q, F)
            return ended(End.UNFINISHED)
        target = min(1.0, at + step)
        conditions, left = path(target), rod.work
        if rod.obstacles is not None and conditions.obstacles is not None:
            far = travel(rod.qe, rod.re, rod.obstacles, conditions.qe, conditions.re, conditions.obstacles)
            if far > farthest:
                step = (target - at) * max(0.9 * farthest / far, 0.1)
                continue
        patience, rod.patience = rod.patience, rod.patience if step <= PATIENT * longest else 0
        code, count, q_new, F_new = rod.advance(
            q, F, conditions.qe, conditions.re, conditions.f, tolerance, 0.35, conditions.obstacles
        )
        iterations += count
        rod.patience = patience if step > PATIENT * longest else rod.patience
        # what touches counts what it spends itself
        rod.work = min(rod.work, left - count * rod.iteration_work) - OVERHEAD
        if code == warm_step.ADVANCED:
            at, q, F, last = target, q_new, F_new, rod.work
            step = min(step * min(rod.stride, 2.0 if count <= rod.few else 1.0), longest)
            continue
        if np.linalg.norm(conditions.re) >= 1.0 and step < BEYOND * longest:
            rod.refactor(q, F)
            return ended(End.BEYOND_REACH)
        spent = (given if rod.lies else last) - rod.work
        smallest, most = (CARRY, CARRY_WORK) if rod.lies else (LAST, LAST_WORK * given)
        if code == warm_step.TOO_FAR and not rod.lies:
            smallest = LEAST_HELD
        hard = step * 0.5 < smallest * longest or spent > most
        # a cable that nothing rubs falls exactly as well as on a grid
        free = not (rod.remembers or rod.rubs)
        stable = (free or carrier is None or not hard) and rod.refactor(q, F)
        folding = free and (not stable or (carrier is not None and rod._softest() < SMALL))
        if folding:
            rod.patience = 0
        if carrier is not None and not folding and (hard or not stable):
            carried, carrier = carrier(rod, q, F), None
            if carried is not None:
                rod, q, F = carried, carried.shape, carried.end_force
                step = longest
                continue
            stable = stable or rod.refactor(q, F)
        if not (stable or folding):
            return ended(End.STUCK)
        if stable and step < NEAR * SHORTEST * longest and (not margins or margins[-1][0] < at):
            margins.append((at, rod._softest()))
        crossed = (code == warm_step.NOT_CONVEX and rod.remembers) or not stable
        # what is free to turn goes far in any step
        turns = free and bool(margins) and margins[-1][1] < FREE_TO_TURN
        if crossed or ((code != warm_step.TOO_FAR or turns) and step * 0.5 < SHORTEST * longest):
            left, here = rod.work, (rod.qe, rod.re, rod.f, rod.obstacles)
            if crossed:  # the branch goes on, but its margin has passed through 0
                margins.append((at, 0.0))
            spare = max(FALL_WORK - rod.work, 0.0)
            rod.work += spare
            fallen = _fallen(rod, q, F, path, step, margins, tolerance, crossed)
            rod.work -= spare
            if fallen is None:
                rod.set_conditions(*here)
                if carrier is None:
                    return ended(End.STUCK)
                carried, carrier = carrier(rod, q, F), None
                if carried is None:
                    return ended(End.STUCK)
                rod, q, F = carried, carried.shape, carried.end_force
                continue
            found, fell = fallen
            if len(falls) >= FREE_FALLS:
                rod.work = min(rod.work, left - DESCENT * found.iterations * rod.elastic.shape[0])
            falls.append(fell)
            iterations += found.iterations
            at, q, F = min(1.0, at + step), found.q, found.F
            if fell.jumped:
                margins.clear()  # of another branch
            continue
        step *= min(rod.stride, 0.5)
        if step < LEAST * longest:
            return ended(End.STUCK)
    return ended(End.ARRIVED)


def _fallen(
    rod: Rod, q: np.ndarray, F: np.ndarray, path: Callable[[float], Conditions], step: float,
    margins: list[tuple[float, float]], tolerance: float, crossed: bool,
) -> tuple[Found, Fall] | None:  # fmt: skip
    """`fall` from the factored equilibrium (q, F) to the end of the step, and what is told of it.

    `margins`: parts of the path and stability margins there, last those of (q, F); `crossed`: whether the
    margin is known to be negative at the end of the step.
    """
    at, margin = margins[-1]
    touched = bool(rod.contact_force().any()) and not rod.remembers
    shape, standing = rod.mesh.interpolate(q, GRID), rod.snapshot()()
    fallen = fall(rod, q, F, path(min(1.0, at + step)))
    if fallen is None:
        return None
    found, energy, twist = fallen
    jumped, ahead = _jumped(shape, rod.mesh.interpolate(found.q, GRID)), 0.0 if crossed else np.inf
    if jumped and not crossed:
        behind = margins[-2:-1] or _behind(standing, q, F, path, at, step, tolerance)
        ahead = min((_to_fold(at, margin, *one) / step for one in behind), default=np.inf)
    return found, Fall(at, energy, found.energy, twist, found.twist, jumped, touched, margin, ahead, crossed)


def _behind(
    rod: Rod, q: np.ndarray, F: np.ndarray, path: Callable[[float], Conditions], at: float, step: float,
    tolerance: float,
) -> list[tuple[float, float]]:  # fmt: skip
    """Where on the path a little before (q, F) there is an equilibrium, and its stability margin."""
    for many in BACK:
        if not rod.refactor(q, F):
            return []
        back = at - many * step
        there = path(back)
        code, _, q_back, F_back = rod.advance(
            q, F, there.qe, there.re, there.f, tolerance, 0.35, there.obstacles
        )
        if code == warm_step.ADVANCED and rod.refactor(q_back, F_back):
            return [(back, rod._softest())]
    # next to the fold Newton's method does not lead away from it, but a descent does
    shape, back = rod.mesh.interpolate(q, GRID), at - BACK[0] * step
    fallen = fall(rod, q, F, path(back))
    if fallen is None or _jumped(shape, rod.mesh.interpolate(fallen[0].q, GRID), AWAY):
        return []
    return [(back, rod._softest())]


def _to_fold(at: float, margin: float, before: float, margin_before: float) -> float:
    """How far ahead of `at` the margin's square vanishes; inf if it does not fall.

    It is linear in the load near a simple fold, and falls still faster near a symmetric bifurcation.
    """
    fall = margin_before**2 - margin**2
    return (at - before) * margin**2 / fall if fall > 0.0 else np.inf


def fall(rod: Rod, q: np.ndarray, F: np.ndarray, conditions: Conditions) -> tuple[Found, float, float] | None:
    """Descend the energy from (q, F) under the given conditions, in short steps so that no ridge is jumped.

    Returns the stable equilibrium it ends in, and energy and twist of the start; None where none was reached.
    """
    energy, _, _ = rod.linearize(q, F)
    twist = float(rod.totals[TWIST])
    rod.set_conditions(conditions.qe, conditions.re, conditions.f, conditions.obstacles)
    q = q.copy()
    q[-1] = conditions.qe if q[-1] @ conditions.qe > 0.0 else -conditions.qe
    # of two mirror images the same one, whatever the last bit
    q = rod.retract(q, ASIDE * rod.start_vector())
    found = settle(rod, q, F, Options(radius=0.1, largest_radius=0.3, iterations=400))
    return None if found is None else (found, energy, twist)


def _jumped(before: np.ndarray, after: np.ndarray, most: float = JUMP) -> bool:
    """Whether some section turned by more than that, rad."""
    return bool(np.abs(np.sum(before * after, axis=1)).min() < np.cos(0.5 * most))
