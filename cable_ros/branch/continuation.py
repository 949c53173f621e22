# SPDX-License-Identifier: Apache-2.0
"""Natural-parameter continuation of a branch along a path of conditions, and snap-through where it ends."""

from __future__ import annotations

import math

import numpy as np

from cable_ros.branch.failed_step import FailedStep, after_failure
from cable_ros.branch.snap_through import goes_on, snap_and_record
from cable_ros.branch.walk import VERY_TAUT, Continuation, End, Fallback, Path, Walk
from cable_ros.rod import warm_step
from cable_ros.rod.kirchhoff import Rod
from cable_ros.rod.units import norm

FALLBACK_LYING_WORK = 45_000
"""Maximum work, iterations times unknowns, spent on one step before a rod that lies along an obstacle with
friction is replaced: about 60 ms."""
HASTY_WORK = 20_000
"""The same if such a rod was replaced a while ago."""
SHORT = 0.02
"""Maximum step, as a fraction of the longest, that counts as short; see `descend_instead`."""
TINY = 1e-6
"""Length of a step, L, that counts as short, too."""
IN_A_ROW = 3
"""Number of steps after which a longer one is tried although each took many iterations."""
FULL = 0.9
"""Part of the longest step that those of a path which takes several are at most."""
LITTLE = 1e-3
"""Part of a step by which it may be longer: on a path of round numbers steps end with its poses, and rounding
would decide whether there is another one."""
OVERHEAD = 250
"""Cost of a step beside its iterations, in iterations times unknowns: kinematics and calls."""
AS_GOOD_AS_TAUT = 1e6
"""End force, EI / L^2, at which a cable that gets tauter is not followed any farther: with friction at all,
without it up to MOST_FORCE."""
TAUTER, UNRESOLVED = 10.0, 0.1
"""Growth of the end force that asks whether the mesh resolves how the cable bends, and the error that it must
not have: a mesh that is too coarse has slack where the cable is taut."""
MOST_FORCE = 2e6
"""End force, EI / L^2, above which such a cable is not followed even without friction if the force rises."""


def continue_branch(
    rod: Rod, q: np.ndarray, F: np.ndarray, path: Path, tolerance: float, step: float = 0.25,
    longest: float = 1.0, fallback: Fallback | None = None, farthest: float = np.inf,
    lying_work: float = FALLBACK_LYING_WORK, taut_force: float = VERY_TAUT, may_turn: bool = False,
    slackens: bool = False,
) -> Continuation:  # fmt: skip
    """Continue the branch of the factored equilibrium (q, F) along path(0..1), in steps of at most `longest`.

    The predictor extrapolates the last equilibria, see `warm_step.advance`; Newton's method corrects it.
    A step is halved until that converges. If even the smallest step fails, the cable snaps
    to the next stable equilibrium (`snap_through`). The continuation ends unfinished if the rod has no `work`
    left. A rod that fails is replaced by its `fallback`, if it has one, before steps become tiny.

    Args:
        rod, q, F: the factored rod at its equilibrium: nodal frames (n, 4) and end force (3,).
        path: see `Path`.
        tolerance: of the warm step.
        step: the first one, fraction of the path.
        longest: maximum step.
        fallback: see `Fallback`.
        farthest: maximum displacement of clamps and obstacles in one step, L, beside those of the rod.
        lying_work: maximum work before a rod that lies along an obstacle with friction is replaced.
        taut_force: end force from which the branch is known to be taut, EI / L^2.
        may_turn: whether a cable that is free to turn may turn as the path goes on, not at once.
        slackens: whether a taut cable is only followed where its end force falls.
    """
    walk = Walk(
        rod, q, F, path, tolerance, step, longest, fallback, farthest, lying_work, taut_force, may_turn,
        slackens,
    )  # fmt: skip
    rod.forked = False
    if not goes_on(rod, path):
        rod.falling = None
    elif not walk.fall(step, q) and rod.falling is not None:
        return walk.ended(End.UNFINISHED)
    while walk.at < 1.0:
        if (end := _go_on(walk)) is not None:
            return walk.ended(end)
    return walk.ended(_arrive(walk))


def _go_on(walk: Walk) -> End | None:
    """Try one step, or choose another one; how the continuation ends, if it does."""
    rod = walk.rod
    if rod.work <= 0.0:
        walk.refactor()
        return End.TAUT if walk.taut else End.UNFINISHED
    # rounding adds no step
    target = walk.at + walk.step if walk.at + (1.0 + LITTLE) * walk.step < 1.0 else 1.0
    conditions, work = walk.path(target), rod.work
    far, length = walk.away(conditions), target - walk.at
    at_once = min(walk.farthest, rod.longest_step, rod.next_step)
    if far > (1.0 + 2.0 * LITTLE) * at_once:
        walk.step = max(_even_step(far / length / at_once, 1.0 - walk.at), 0.1 * length)
        return None
    rod.short = walk.step <= SHORT * walk.longest or far < TINY
    may_tighten = walk.was_taut and (walk.slackens or walk.first >= AS_GOOD_AS_TAUT)
    put_back = rod.kept() if may_tighten else None
    each = rod.iteration_work  # a step that fails may leave more rows behind
    code, count, q_new, F_new = rod.advance(
        walk.q, walk.F, conditions.qe, conditions.re, conditions.f, walk.tolerance, 0.35, conditions.obstacles
    )
    rod.note_step(code, far)
    walk.iterations += count
    # a rod in contact counts its work itself
    rod.work = min(rod.work, work - count * each) - OVERHEAD
    if rod.frictional and code in (warm_step.ADVANCED, warm_step.TOO_FAR):
        walk.allowed = min(length * rod.stride, walk.longest)
    if code != warm_step.ADVANCED:
        return after_failure(walk, FailedStep(code, conditions, far, work, F_new))
    if put_back is not None and norm(F_new) > _most_force(walk):
        put_back()  # from there it may not be led back
        walk.refactor()
        return End.TAUT
    return _take(walk, target, q_new, F_new, count)


def _take(walk: Walk, target: float, q: np.ndarray, F: np.ndarray, count: int) -> End | None:
    """Take the step that led to the equilibrium (q, F) in `count` iterations; as `_go_on`."""
    rod = walk.rod
    walk.at, walk.q, walk.F, walk.last = target, q, F, rod.work
    walk.fork, rod.forked = (target if rod.forked else walk.fork), False
    walk.forces, walk.taut, walk.failed = [walk.forces[-1], (target, norm(F))], False, 0
    walk.in_a_row += 1
    # whether there is one more iteration is rounding, and friction depends on the steps
    grows = (rod.frictional and not rod.on_grid) or count <= rod.few or walk.in_a_row >= IN_A_ROW
    walk.step = min(walk.step * min(rod.stride, 2.0 if grows else 1.0), walk.longest)
    walk.in_a_row = 0 if grows else walk.in_a_row
    if rod.frictional and walk.force > max(walk.forces[0][1], AS_GOOD_AS_TAUT):
        walk.refactor()
        return End.TAUT
    return End.UNFINISHED if target < 1.0 and _outgrows(walk) else None


def _arrive(walk: Walk) -> End:
    """Judge the equilibrium at the path's end: the factors of an earlier step do not show whether its margin
    has passed through 0.
    """
    rod = walk.rod
    if rod.remembers or rod.frictional or walk.refactor():
        return End.ARRIVED
    rod._softest()  # the mode in which it did
    snapped = snap_and_record(rod, walk.q, walk.F, walk.path, 0.0, [(walk.at, 0.0)], walk.tolerance, True)
    if snapped is None:
        return End.STUCK
    walk.take_snap(*snapped[:2])
    return End.ARRIVED


def _even_step(rate: float, left: float) -> float:
    """A step with which a path is done in even ones: fraction of the path, of which so much is `left`.

    `rate`: longest steps along all of the path.
    """
    return left / max(math.ceil(rate * left / FULL - LITTLE), 1)


def _most_force(walk: Walk) -> float:
    """The end force above which a cable that was taut is not followed, EI / L^2."""
    return walk.first if walk.slackens else max(walk.first, MOST_FORCE)


def _outgrows(walk: Walk) -> bool:
    """Whether a cable that touches is so much tauter than it was at first that it needs another mesh."""
    rod = walk.rod
    if rod.frictional or rod.on_grid or not rod.touches or walk.force < max(VERY_TAUT, TAUTER * walk.first):
        return False
    return walk.refactor() and rod.relative_error(walk.q, walk.F) > UNRESOLVED
