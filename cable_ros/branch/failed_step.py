# SPDX-License-Identifier: Apache-2.0
"""What a continuation does about a step that failed: halve it, fall, snap, change the rod, or end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cable_ros.branch.cold_start import Conditions
from cable_ros.branch.snap_through import SMALL, SNAP_WORK, snap_and_record
from cable_ros.branch.walk import End, Sound, Walk
from cable_ros.contact.travel import TAUT
from cable_ros.contact.viscous_flow import leaning
from cable_ros.rod import warm_step
from cable_ros.rod.kirchhoff import FREE_TO_TURN
from cable_ros.rod.units import norm

SHORTEST = 1e-4
"""Minimum step, as a fraction of the longest: if it fails, the branch ends."""
BEYOND = 0.02
"""Minimum step out of reach, as a fraction of the longest: it is not halved further."""
LEAST = 1e-9
"""Fraction of the longest step below which a step is rounding error."""
FALLBACK_LYING, FALLBACK_CREEPING, FALLBACK = 0.005, 0.05, 1e-3
"""Minimum step, as a fraction of the longest, before a rod that fails is replaced: one that lies along an
obstacle with friction, one that stretches there, too, and any other, which mostly arrives in small steps."""
FALLBACK_POINTS = 1e-6
"""The same of a rod in exact contact whose step is only too large: beside a clamp a point lifts off within a
very small step, and where it lies friction may turn as fast."""
SHORTENED = 3
"""Number of times that the step of the first kind is shortened, whatever that takes: with 90 contacts a solve
that failed took 118,000. Lifts and hoses came onto grids, 1 to 3 % off, that go on in exact contact in steps
half as long."""
FALLBACK_WORK = 0.5
"""Maximum fraction of the budget spent on one step before the second kind is replaced."""
BACK = 0.25
"""Length of the first step after a continuation has gone back, over how far that was."""
NEAR = 30.0
"""Number of shortest steps below which a failed step always records the stability margin."""
DESCENT_COST = 4
"""Work of an iteration of an energy descent, in iterations of a warm step."""
FREE_SNAPS = 2
"""Number of snap-throughs outside the budget: even a small step may meet a fold, and end just before it."""
FALLS, FALL, FALL_LYING = 3, 1e-3, 5e-3
"""Maximum number of falls with friction in a call, and the length of the failed step, L, below which it is
tried whether the cable falls, and whether one that lies does. Else a grid takes over, and falls itself, by
the last digit of the joints to another place."""
AT_END = 3e-3
"""Stability margin below which a cable with friction falls as soon as a step shows that its branch ends.
Nearer to a fork it leans to a side by rounding, and not by rule: on a symmetric drum to one or the other."""
EDGE = 3.0
"""Maximum distance to an edge that a step may cross, in motions of clamps and obstacles."""
SLACKENS = 0.5
"""End force that a step which is too long would have led to, over that before, which shows the way back."""
NEARLY = 2.0
"""Such a cable may be taut before the end of the path if that is expected within this many rests of it."""


@dataclass(frozen=True, eq=False)
class FailedStep:
    """A step that failed."""

    code: int
    """See `warm_step.advance`."""
    conditions: Conditions
    """That it should have led to."""
    far: float
    """Its length, L."""
    work: float
    """The rod's `work` before it."""
    F_new: np.ndarray
    """(3,) end force where it ended."""


@dataclass(frozen=True, eq=False)
class Judged:
    """The equilibrium before a step that failed, and what that has cost."""

    soft: bool
    """Whether it lies with friction and is not taut: a grid would take over."""
    free: bool
    """Whether there is no friction."""
    tiny: bool
    """Whether the next step would be shorter than any before a rod is replaced."""
    hard: bool
    """Whether it is, or has cost too much."""
    stable: bool
    """Whether it is known to be."""
    lets_go: bool
    """See `Rod.lets_go`."""
    margin: float | None
    """Stability margin, if it is known."""
    taut: bool
    """Whether it is very taut: its margin is small then, whether or not it falls."""

    @property
    def folding(self) -> bool:
        """Whether the branch ends at a fold there."""
        near = self.margin is not None and self.margin < SMALL and not self.taut
        return self.free and (not self.stable or self.lets_go or near)

    @property
    def gives_way(self) -> bool:
        """Whether it goes on by a fall or on a grid."""
        return not self.folding and (self.hard or not self.stable)


def after_failure(walk: Walk, failed: FailedStep) -> End | None:
    """How the continuation ends; None if it goes on, from where it is or with another step."""
    rod, code = walk.rod, failed.code
    walk.in_a_row = 0
    if code == warm_step.NOT_CONVEX and rod.frictional:
        rod.refactor_at = 0.0  # from here on each step is judged
    if rod.chord(failed.conditions.qe, failed.conditions.re) >= 1.0 and walk.step < BEYOND * walk.longest:
        walk.refactor()
        return End.BEYOND_REACH
    if _is_way_back(walk, failed):
        walk.shorten()  # the first steps of the way back are the shortest
        return None
    shortest = FALLBACK * walk.longest
    if rod.touches and _gets_taut(walk):
        rod.patience = 0  # a search without contact forces does not get farther
        walk.refactor()
        if walk.taut and (walk.step < shortest or (walk.at > 0.0 and walk.very_taut)):
            return End.TAUT
        if walk.step >= shortest:
            walk.shorten()
            return None
    judged = _judge(walk, failed)
    if _goes_back(walk, judged):
        return None
    if judged.gives_way and judged.taut and not rod.on_grid:
        return End.STUCK  # it may give way before, but neither a fall nor a grid would tell when
    forks = _forks(walk, failed, judged)
    if (forks or _may_fall(walk, failed, judged)) and walk.falls < FALLS and rod.fell_short is not walk.F:
        walk.falls += 1
        # points and patches that are not stable have already passed the branch's end
        first = walk.step if judged.stable or rod.on_grid else SHORTEST * walk.longest
        if walk.fall(first, leaning(rod, walk.q) if forks else walk.q):
            return None
        if rod.falling is not None:
            return End.UNFINISHED
    stable = judged.stable
    if walk.fallback is not None and judged.gives_way:
        if walk.replace_rod():
            walk.step = walk.allowed
            return None
        stable = stable or walk.refactor()
    if not (stable or judged.folding):
        return End.STUCK
    return _snap_or_shorten(walk, failed, judged, stable)


def _is_way_back(walk: Walk, failed: FailedStep) -> bool:
    """Whether the cable was taut at the start and slackens, in steps that are only too long."""
    # a grid does not resolve how a taut cable bends, and may fail on the way back as well
    known = len(walk.forces) == 1 and walk.was_taut
    strays = failed.code in (warm_step.TOO_FAR, warm_step.NOT_CONTRACTING)
    walk.gives |= known and strays and norm(failed.F_new) < SLACKENS * walk.force
    return known and walk.gives and walk.step > LEAST * walk.longest


def _gets_taut(walk: Walk) -> bool:
    """Whether the cable may be taut soon; notes whether it is before the path's end."""
    known = len(walk.forces) == 1 and walk.was_taut
    at = walk.at if known else taut_at(walk.forces)
    soon = at < walk.at + NEARLY * (1.0 - walk.at)
    if soon:
        walk.taut = at < 1.0
    return soon


def taut_at(forces: list[tuple[float, float]]) -> float:
    """Fraction of the path where the cable is taut, extrapolated from two end forces; inf if it is nowhere.

    A stiff cable that is about to be taut bends within sqrt(EI / F) of where it is held or touches: that much
    is left of its slack, so the force to the power -1/2 goes linearly to 0.
    """
    if len(forces) < 2:
        return np.inf
    (before, force_before), (at, force) = forces
    if force < TAUT or force <= force_before:
        return np.inf
    return at + (at - before) / (np.sqrt(force / force_before) - 1.0)


def _judge(walk: Walk, failed: FailedStep) -> Judged:
    """Count what the step has cost, and judge the equilibrium before it if it is to be known."""
    rod = walk.rod
    soft = rod.lies and walk.force < TAUT  # a grid does not resolve how a taut cable bends
    creeps = soft and rod.creeps
    if soft and failed.code == warm_step.TOO_FAR:
        walk.last -= failed.work - rod.work  # it converged: shorter steps will do
    spent = (walk.given if creeps else walk.last) - rod.work
    lying = FALLBACK_CREEPING if creeps else FALLBACK_LYING
    smallest, most = (lying, walk.lying_work) if soft else (FALLBACK, FALLBACK_WORK * walk.given)
    if failed.code == warm_step.TOO_FAR and not creeps:
        smallest = FALLBACK_POINTS
    # without friction a cable snaps on this mesh as well as on a grid of contacts
    free = not (rod.remembers or rod.frictional)
    if free and spent > most and rod.patience > 0:
        # descents that lead away from the branch: short steps without them show whether it folds
        rod.patience, walk.last, spent = 0, rod.work, 0.0
    tiny = walk.step * 0.5 < smallest * walk.longest
    walk.failed += 1
    hard = tiny or (spent > most and (walk.failed > SHORTENED or not soft))
    stable = (free or walk.fallback is None or not hard) and walk.refactor()
    may_let_go = free and stable and (hard or rod.short)
    lets_go = may_let_go and rod.lets_go(walk.q, walk.F, EDGE * failed.far)
    margin = rod._softest() if free and stable and walk.fallback is not None else None
    judged = Judged(soft, free, tiny, hard, stable, lets_go, margin, walk.very_taut)
    if judged.folding:
        rod.patience = 0
    return judged


def _goes_back(walk: Walk, judged: Judged) -> bool:
    """Whether the continuation has gone back to the last equilibrium that was stable for sure.

    Steps that were not judged have led past a fork, on a branch that may not be the cable's.
    """
    rod, sound = walk.rod, walk.sound
    if not rod.frictional or rod.on_grid or rod.lies:
        return False
    if judged.stable and (sound is None or sound.at < walk.at):
        walk.sound = Sound(walk.at, walk.q, walk.F, rod.kept())
    elif not (judged.stable or judged.hard) and sound is not None and sound.at < walk.at:
        walk.step, walk.at, walk.q, walk.F = BACK * (walk.at - sound.at), sound.at, sound.q, sound.F
        sound.put_back()
        walk.refactor()
        rod.refactor_at, walk.sound = 0.0, None  # from here on each step is judged
        walk.forces, walk.failed = [(walk.at, norm(walk.F))], 0
        return True
    return False


def _forks(walk: Walk, failed: FailedStep, judged: Judged) -> bool:
    """Whether the branch of a cable with friction ends by all signs, though where it is it is stable."""
    rod = walk.rod
    if rod.on_grid or not (rod.frictional and judged.stable):
        return False
    return failed.code == warm_step.NOT_CONVEX and failed.far < FALL and rod._softest() < AT_END


def _may_fall(walk: Walk, failed: FailedStep, judged: Judged) -> bool:
    """Whether it is to be tried whether a cable with friction falls."""
    rod = walk.rod
    if rod.on_grid:
        return failed.far < FALL and failed.code != warm_step.TOO_FAR
    # one that is taut slackens as far in as short a step
    near = failed.far < (FALL_LYING if judged.soft else FALL) and (walk.force < TAUT or judged.tiny)
    ends = near or not (judged.stable or rod.lies)
    return walk.fallback is not None and judged.gives_way and ends


def _snap_or_shorten(walk: Walk, failed: FailedStep, judged: Judged, stable: bool) -> End | None:
    """Snap where the branch ends; else shorten the step. As `after_failure`."""
    rod, step = walk.rod, walk.step
    if stable and (not walk.margins or walk.margins[-1][0] < walk.at):
        near = step < NEAR * SHORTEST * walk.longest
        margin = rod._softest() if near else judged.margin
        if margin is not None:
            walk.margins.append((walk.at, margin))
    not_convex = failed.code == warm_step.NOT_CONVEX
    crossed = (not_convex and rod.remembers) or not stable or judged.lets_go
    # a cable that turns freely goes far in any step
    turns = judged.free and bool(walk.margins) and walk.margins[-1][1] < FREE_TO_TURN
    strays = failed.code == warm_step.TOO_FAR and not turns
    if crossed or (not strays and step * 0.5 < SHORTEST * walk.longest):
        if crossed:  # the branch continues, but its margin has passed through 0
            walk.margins.append((walk.at, rod._softest() if judged.lets_go else 0.0))
        return None if _snaps(walk, crossed) or walk.replace_rod() else End.STUCK
    walk.shorten()
    return End.STUCK if walk.step < LEAST * walk.longest else None


def _snaps(walk: Walk, crossed: bool) -> bool:
    """Whether the cable has snapped; see `snap_and_record`."""
    rod = walk.rod
    left = rod.work
    spare = max(SNAP_WORK - left, 0.0)
    rod.work += spare
    snapped = snap_and_record(
        rod, walk.q, walk.F, walk.path, walk.step, walk.margins, walk.tolerance, crossed, walk.may_turn
    )
    rod.work -= spare
    if snapped is None:
        walk.refactor()
        return False
    found, snap, walk.at = snapped
    if len(walk.snaps) >= FREE_SNAPS:
        rod.work = min(rod.work, left - DESCENT_COST * found.iterations * rod.elastic.shape[0])
    walk.take_snap(found, snap)
    if snap.jumped:
        walk.margins.clear()  # of another branch
    return True
