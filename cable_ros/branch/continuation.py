# SPDX-License-Identifier: Apache-2.0
"""Natural-parameter continuation of a branch along a path of conditions, and snap-through where it ends."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from cable_ros.branch.cold_start import Conditions
from cable_ros.branch.snap_through import (
    SMALL,
    SNAP_WORK,
    SnapThrough,
    fall_with_friction,
    goes_on,
    snap_and_record,
)
from cable_ros.contact.nodal_rod import NodalRod
from cable_ros.contact.travel import TAUT, travel
from cable_ros.contact.viscous_flow import leaning
from cable_ros.rod import warm_step
from cable_ros.rod.kirchhoff import FREE_TO_TURN, Rod

SHORTEST = 1e-4
"""Minimum step, as a fraction of the longest: if it fails, the branch ends."""
BEYOND = 0.02
"""Minimum step out of reach, as a fraction of the longest: it is not halved further."""
FALLBACK_LYING, FALLBACK_CREEPING, FALLBACK = 0.005, 0.05, 1e-3
"""Minimum step, as a fraction of the longest, before a rod that fails is replaced: one that lies along an
obstacle with friction, one that stretches there, too, and any other, which mostly arrives in small steps."""
FALLBACK_POINTS = 1e-6
"""The same of a rod in exact contact whose step is only too large: beside a clamp a point lifts off within a
very small step, and where it lies friction may turn as fast."""
FALLBACK_LYING_WORK = 45_000
"""Maximum work, iterations times unknowns, spent on one step before the first kind is replaced: about
60 ms."""
SHORTENED = 3
"""Number of times that it is shortened, whatever that takes: with 90 contacts a solve that failed took
118,000. Lifts and hoses came onto grids, 1 to 3 % off, that go on in exact contact in steps half as long."""
HASTY_WORK = 20_000
"""The same if such a rod was replaced a while ago."""
FALLBACK_WORK = 0.5
"""Maximum fraction of the budget spent on one step before the second kind is replaced."""
SHORT = 0.02
"""Maximum step, as a fraction of the longest, that counts as short; see `descend_instead`."""
IN_A_ROW = 3
"""Number of steps after which a longer one is tried although each took many iterations."""
BACK = 0.25
"""Length of the first step after a continuation has gone back, over how far that was."""
LEAST = 1e-9
"""Fraction of the longest step below which a step is rounding error."""
FULL = 0.9
"""Part of the longest step that those of a path which takes several are at most."""
LITTLE = 1e-3
"""Part of a step by which it may be longer: on a path of round numbers steps end with its poses, and rounding
would decide whether there is another one."""
OVERHEAD = 250
"""Cost of a step beside its iterations, in iterations times unknowns: kinematics and calls."""
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
VERY_TAUT = 1e4
"""`TAUT` of a cable whose end the extrapolation tells to 1 % of its slack."""
AS_GOOD_AS_TAUT = 1e6
"""End force, EI / L^2, at which a cable that gets tauter is not followed any farther: with friction at all,
without it up to MOST_FORCE."""
TAUTER, UNRESOLVED = 10.0, 0.1
"""Growth of the end force that asks whether the mesh resolves how the cable bends, and the error that it must
not have: a mesh that is too coarse has slack where the cable is taut."""
SLACKENS = 0.5
"""End force that a step which is too long would have led to, over that before, which shows the way back."""
MOST_FORCE = 2e6
"""End force, EI / L^2, above which such a cable is not followed even without friction if the force rises."""
NEARLY = 2.0
"""Such a cable may be taut before the end of the path if that is expected within this many rests of it."""


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


def continue_branch(
    rod: Rod, q: np.ndarray, F: np.ndarray, path: Callable[[float], Conditions], tolerance: float,
    step: float = 0.25, longest: float = 1.0,
    fallback: Callable[[Rod, np.ndarray, np.ndarray], NodalRod | None] | None = None,
    farthest: float = np.inf, lying_work: float = FALLBACK_LYING_WORK,
    taut_force: float = VERY_TAUT, may_turn: bool = False, slackens: bool = False,
) -> Continuation:  # fmt: skip
    """Continue the branch of the factored equilibrium (q, F) along path(0..1), in steps of at most `longest`.

    The predictor extrapolates the last equilibria, see `warm_step.advance`; Newton's method corrects it.
    A step is halved until that converges. If even the smallest step fails, the cable snaps
    to the next stable equilibrium (`snap_through`). The continuation ends unfinished if the rod has no `work`
    left. A rod that fails is replaced by its `fallback`, if it has one, before steps become tiny.

    Args:
        rod, q, F: the factored rod at its equilibrium: nodal frames (n, 4) and end force (3,).
        path: conditions at a fraction of the path; the signs of end frames follow the rod's.
        tolerance: of the warm step.
        step: the first one, fraction of the path.
        longest: maximum step.
        fallback: makes the replacement from (rod, q, F), or None if that fails.
        farthest: maximum displacement of clamps and obstacles in one step, L, beside those of the rod.
        lying_work: maximum work before a rod that lies along an obstacle with friction is replaced.
        taut_force: end force from which the branch is known to be taut, EI / L^2.
        may_turn: whether a cable that is free to turn may turn as the path goes on, not at once.
        slackens: whether a taut cable is only followed where its end force falls.
    """
    at, iterations = 0.0, 0
    snaps: list[SnapThrough] = []
    margins: list[tuple[float, float]] = []  # fractions of the path and stability margins there
    first = _norm(F)
    forces: list[tuple[float, float]] = [(at, first)]  # of the last two equilibria, and their end forces
    taut, in_a_row, failed, falls = slackens, 0, 0, 0  # `failed`: times since a step was taken
    given = last = rod.work  # at the start, and after the last step
    fork: float | None = None
    was_taut = first >= taut_force and not rod.on_grid
    gives = slackens  # whether a step that was too long would have led to a smaller end force
    most_force = (first if slackens else max(first, MOST_FORCE)) if was_taut else np.inf
    allowed = longest  # how long a step friction's changes in the last one allow, whether or not it is solved
    rod.forked = False
    sound: Sound | None = None

    def ended(end: End) -> Continuation:
        return Continuation(end, at, q, F, iterations, tuple(snaps), rod, step, fork)

    def fallen(first: float, start: np.ndarray) -> bool:
        """Whether the cable has fallen from the shape `start` and rests, a step of `first` further on."""
        nonlocal at, q, F, last, iterations, forces
        fall = fall_with_friction(rod, start, F, path, at, first, partial(_travel, rod))
        if fall is None:
            rod.refactor(q, F)
            rod.fell_short = F if rod.falling is None and not rod.on_grid else None
            return False
        found, snap, at = fall
        snaps.append(snap)
        iterations += found.iterations
        q, F, last = found.q, found.F, rod.work
        forces = [(at, _norm(F))]
        return True

    if not goes_on(rod, path):
        rod.falling = None
    elif not fallen(step, q) and rod.falling is not None:
        return ended(End.UNFINISHED)
    while at < 1.0:
        if rod.work <= 0.0:
            rod.refactor(q, F)
            return ended(End.TAUT if taut else End.UNFINISHED)
        target = at + step if at + (1.0 + LITTLE) * step < 1.0 else 1.0  # rounding adds no step
        conditions, left = path(target), rod.work
        far = _travel(rod, conditions)
        at_once = min(farthest, rod.longest_step, rod.next_step)
        if far > (1.0 + 2.0 * LITTLE) * at_once:
            step = max(_even_step(far / (target - at) / at_once, 1.0 - at), 0.1 * (target - at))
            continue
        rod.short = step <= SHORT * longest
        put_back = rod.kept() if was_taut and (slackens or first >= AS_GOOD_AS_TAUT) else None
        each = rod.iteration_work  # a step that fails may leave more rows behind
        code, count, q_new, F_new = rod.advance(
            q, F, conditions.qe, conditions.re, conditions.f, tolerance, 0.35, conditions.obstacles
        )
        rod.note_step(code, far)
        iterations += count
        # a rod in contact counts its work itself
        rod.work = min(rod.work, left - count * each) - OVERHEAD
        if rod.frictional and code in (warm_step.ADVANCED, warm_step.TOO_FAR):
            allowed = min((target - at) * rod.stride, longest)
        if code == warm_step.ADVANCED and put_back is not None and _norm(F_new) > most_force:
            put_back()  # from there it may not be led back
            rod.refactor(q, F)
            return ended(End.TAUT)
        if code == warm_step.ADVANCED:
            at, q, F, last = target, q_new, F_new, rod.work
            fork, rod.forked = (at if rod.forked else fork), False
            forces, taut = [forces[-1], (at, _norm(F))], False
            in_a_row, failed = in_a_row + 1, 0
            # whether there is one more iteration is rounding, and friction depends on the steps
            grows = (rod.frictional and not rod.on_grid) or count <= rod.few or in_a_row >= IN_A_ROW
            step = min(step * min(rod.stride, 2.0 if grows else 1.0), longest)
            in_a_row = 0 if grows else in_a_row
            if rod.frictional and forces[1][1] > max(forces[0][1], AS_GOOD_AS_TAUT):
                rod.refactor(q, F)
                return ended(End.TAUT)
            if at < 1.0 and _outgrows(rod, q, F, forces[1][1], first):
                return ended(End.UNFINISHED)
            continue
        in_a_row = 0
        if code == warm_step.NOT_CONVEX and rod.frictional:
            rod.refactor_at = 0.0  # from here on each step is judged
        if rod.chord(conditions.qe, conditions.re) >= 1.0 and step < BEYOND * longest:
            rod.refactor(q, F)
            return ended(End.BEYOND_REACH)
        force = forces[-1][1]
        # a grid does not resolve how a taut cable bends, and may fail on the way back as well
        known = len(forces) == 1 and was_taut
        strays = code in (warm_step.TOO_FAR, warm_step.NOT_CONTRACTING)
        gives |= known and strays and _norm(F_new) < SLACKENS * force
        if known and gives and step > LEAST * longest:
            step *= min(rod.stride, 0.5)  # the first steps of the way back are the shortest
            continue
        taut_at = at if known else _taut_at(forces)
        if rod.touches and taut_at < at + NEARLY * (1.0 - at):
            rod.patience = 0  # a search without contact forces does not get farther
            rod.refactor(q, F)
            taut = taut_at < 1.0
            shortest = FALLBACK * longest
            if taut and (step < shortest or (at > 0.0 and force > VERY_TAUT)):
                return ended(End.TAUT)
            if step >= shortest:
                step *= min(rod.stride, 0.5)
                continue
        soft = rod.lies and force < TAUT  # a grid does not resolve how a taut cable bends
        creeps = soft and rod.creeps
        if soft and code == warm_step.TOO_FAR:
            last -= left - rod.work  # it converged: shorter steps will do
        spent = (given if creeps else last) - rod.work
        lying = FALLBACK_CREEPING if creeps else FALLBACK_LYING
        smallest, most = (lying, lying_work) if soft else (FALLBACK, FALLBACK_WORK * given)
        if code == warm_step.TOO_FAR and not creeps:
            smallest = FALLBACK_POINTS
        # without friction a cable snaps on this mesh as well as on a grid of contacts
        free = not (rod.remembers or rod.frictional)
        if free and spent > most and rod.patience > 0:
            # descents that lead away from the branch: short steps without them show whether it folds
            rod.patience, last, spent = 0, rod.work, 0.0
        tiny = step * 0.5 < smallest * longest
        failed += 1
        hard = tiny or (spent > most and (failed > SHORTENED or not soft))
        stable = (free or fallback is None or not hard) and rod.refactor(q, F)
        lets_go = free and stable and (hard or rod.short) and rod.lets_go(q, F, EDGE * far)
        margin = rod._softest() if free and stable and fallback is not None else None
        folding = free and (not stable or lets_go or (margin is not None and margin < SMALL))
        if folding:
            rod.patience = 0
        gives_way = not folding and (hard or not stable)
        follows = rod.frictional and not (rod.on_grid or rod.lies)
        if follows and stable and (sound is None or sound.at < at):
            sound = Sound(at, q, F, rod.kept())
        elif follows and not (stable or hard) and sound is not None and sound.at < at:
            # steps that were not judged have led past a fork, on a branch that may not be the cable's
            step, at, q, F = BACK * (at - sound.at), sound.at, sound.q, sound.F
            sound.put_back()
            rod.refactor(q, F)
            rod.refactor_at, sound = 0.0, None  # from here on each step is judged
            forces, failed = [(at, _norm(F))], 0
            continue
        if gives_way and rod.frictional and not rod.on_grid and force > VERY_TAUT:
            return ended(End.TAUT)  # it may give way before, but neither a fall nor a grid would tell when
        forks = False
        if rod.on_grid:
            may_fall = far < FALL and code != warm_step.TOO_FAR
        else:
            # one that is taut slackens as far in as short a step
            near = far < (FALL_LYING if soft else FALL) and (force < TAUT or tiny)
            ends = near or not (stable or rod.lies)
            may_fall = fallback is not None and gives_way and ends
            may_end = rod.frictional and stable and code == warm_step.NOT_CONVEX and far < FALL
            forks = may_end and rod._softest() < AT_END
        if (may_fall or forks) and falls < FALLS and rod.fell_short is not F:
            falls += 1
            # points and patches that are not stable have already passed the branch's end
            first = step if stable or rod.on_grid else SHORTEST * longest
            if fallen(first, leaning(rod, q) if forks else q):
                continue
            if rod.falling is not None:
                return ended(End.UNFINISHED)
        if fallback is not None and gives_way:
            replacement, fallback = fallback(rod, q, F), None
            if replacement is not None:
                rod, q, F = replacement, replacement.shape, replacement.end_force
                step = allowed
                continue
            stable = stable or rod.refactor(q, F)
        if not (stable or folding):
            return ended(End.STUCK)
        if stable and (not margins or margins[-1][0] < at):
            margin = rod._softest() if step < NEAR * SHORTEST * longest else margin
            if margin is not None:
                margins.append((at, margin))
        crossed = (code == warm_step.NOT_CONVEX and rod.remembers) or not stable or lets_go
        # a cable that turns freely goes far in any step
        turns = free and bool(margins) and margins[-1][1] < FREE_TO_TURN
        if crossed or ((code != warm_step.TOO_FAR or turns) and step * 0.5 < SHORTEST * longest):
            left = rod.work
            if crossed:  # the branch continues, but its margin has passed through 0
                margins.append((at, rod._softest() if lets_go else 0.0))
            spare = max(SNAP_WORK - rod.work, 0.0)
            rod.work += spare
            snapped = snap_and_record(rod, q, F, path, step, margins, tolerance, crossed, may_turn)
            rod.work -= spare
            if snapped is None:
                rod.refactor(q, F)
                if fallback is None:
                    return ended(End.STUCK)
                replacement, fallback = fallback(rod, q, F), None
                if replacement is None:
                    return ended(End.STUCK)
                rod, q, F = replacement, replacement.shape, replacement.end_force
                continue
            found, snap, at = snapped
            if len(snaps) >= FREE_SNAPS:
                rod.work = min(rod.work, left - DESCENT_COST * found.iterations * rod.elastic.shape[0])
            snaps.append(snap)
            iterations += found.iterations
            rod, q, F = found.rod, found.q, found.F
            if snap.jumped:
                margins.clear()  # of another branch
            continue
        step *= min(rod.stride, 0.5)
        if step < LEAST * longest:
            return ended(End.STUCK)
    if not (rod.remembers or rod.frictional or rod.refactor(q, F)):
        # the factors of an earlier step did not show that the margin passed through 0
        rod._softest()  # the mode in which it did
        snapped = snap_and_record(rod, q, F, path, 0.0, [(at, 0.0)], tolerance, True)
        if snapped is None:
            return ended(End.STUCK)
        found, snap, _ = snapped
        snaps.append(snap)
        iterations, rod, q, F = iterations + found.iterations, found.rod, found.q, found.F
    return ended(End.ARRIVED)


def _even_step(rate: float, left: float) -> float:
    """A step with which a path is done in even ones: fraction of the path, of which so much is `left`.

    `rate`: longest steps along all of the path.
    """
    return left / max(math.ceil(rate * left / FULL - LITTLE), 1)


def _taut_at(forces: list[tuple[float, float]]) -> float:
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


def _outgrows(rod: Rod, q: np.ndarray, F: np.ndarray, force: float, first: float) -> bool:
    """Whether a cable that touches is so much tauter than it was `first` that it needs another mesh."""
    if rod.frictional or rod.on_grid or not rod.touches or force < max(VERY_TAUT, TAUTER * first):
        return False
    return rod.refactor(q, F) and rod.relative_error(q, F) > UNRESOLVED


def _travel(rod: Rod, conditions: Conditions) -> float:
    """`travel` from the rod's conditions to these; 0 without obstacles."""
    if rod.obstacles is None or conditions.obstacles is None:
        return 0.0
    return travel(rod.qe, rod.re, rod.obstacles, conditions.qe, conditions.re, conditions.obstacles)


def _norm(F: np.ndarray) -> float:
    return float(np.linalg.norm(F))
