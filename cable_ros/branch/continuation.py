# SPDX-License-Identifier: Apache-2.0
"""Natural-parameter continuation of a branch along a path of conditions, and snap-through where it ends."""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cable_ros.branch.branch_switching import switch_branch
from cable_ros.branch.cold_start import Conditions, Found, settle
from cable_ros.contact.nodal_rod import NodalRod
from cable_ros.contact.travel import travel
from cable_ros.linalg.bordered import NEUTRAL
from cable_ros.rod import warm_step
from cable_ros.rod.kirchhoff import Rod
from cable_ros.rod.rod_state import TWIST
from cable_ros.solve.trust_region import Options

SHORTEST = 1e-4
"""Minimum step, as a fraction of the longest: if it fails, the branch ends."""
BEYOND = 0.02
"""Minimum step out of reach, as a fraction of the longest: it is not halved further."""
FALLBACK_LYING, FALLBACK = 0.05, 1e-3
"""Minimum step, as a fraction of the longest, before a rod that fails is replaced: one that lies along an
obstacle with friction, and any other, which mostly arrives in small steps."""
FALLBACK_POINTS = 1e-6
"""The same of a rod on contact points whose step is only too large: beside a clamp a point lifts off within a
very small step."""
FALLBACK_LYING_WORK = 75_000
"""Maximum work, iterations times unknowns, before the first kind is replaced: about 150 ms."""
HASTY_WORK = 20_000
"""The same if such a rod was replaced a while ago."""
FALLBACK_WORK = 0.5
"""Maximum fraction of the budget spent on one step before the second kind is replaced."""
SHORT = 0.02
"""Maximum step, as a fraction of the longest, that counts as short; see `descend_instead`."""
IN_A_ROW = 3
"""Number of steps after which a longer one is tried although each took many iterations."""
LEAST = 1e-9
"""Fraction of the longest step below which a step is rounding error."""
OVERHEAD = 250
"""Cost of a step beside its iterations, in iterations times unknowns: kinematics and calls."""
NEAR = 30.0
"""Number of shortest steps below which a failed step records the stability margin."""
DESCENT_COST = 4
"""Work of an iteration of an energy descent, in iterations of a warm step."""
STEPS_BACK = (30.0, 10.0, 3.0)
"""Numbers of steps back to where the margin is computed if none was recorded before the last equilibrium."""
SMALL = 0.05
"""Maximum margin of the last equilibrium before a fold. At folds of free cables it was 1e-4 to 0.012, as the
root law gives for the last step's distance; away from folds it is 0.1 to 1."""
FOLD = 10.0
"""Maximum number of last steps to the zero of the margin's square, extrapolated linearly, at a fold. At
folds of free cables it was 0.3 to 1.7."""
FREE_TO_TURN = 10.0 * NEUTRAL
"""Maximum margin of an equilibrium that belongs to a continuous family (neutral stability)."""
PERTURBATION = 5e-12
"""Size, root of the elastic energy, of the fixed perturbation that a snap-through starts from: above
rounding, below what changes the energy."""
JUMP = 0.05
"""Minimum rotation of a section, rad, that shows another branch: a step of SHORTEST along one turns less."""
AWAY = 0.2
"""The same for a few such steps back from a fold, where the shape changes like the root of the load."""
SNAP_WORK = 90_000.0
"""Minimum budget of a snap-through: without it no call would get past a fold."""
AHEAD = 100.0
"""Number of steps along the path to where a bifurcating branch is looked for."""
FREE_SNAPS = 2
"""Number of snap-throughs outside the budget: even a small step may meet a fold, and end just before it."""
GRID = np.linspace(0.0, 1.0, 33)
"""Where shapes are compared."""
TAUT = 500.0
"""Minimum end force, EI / L^2, of a cable that may be pulled taut around an obstacle."""
VERY_TAUT = 2e4
"""The same of one whose end the extrapolation tells to 1 % of its slack."""
NEARLY = 2.0
"""Such a cable may be taut before the end of the path if that is expected within this many rests of it."""


class End(enum.Enum):
    """How a continuation ended."""

    ARRIVED = enum.auto()
    UNFINISHED = enum.auto()
    """The rod has no `work` left."""
    BEYOND_REACH = enum.auto()
    TAUT = enum.auto()
    """The cable is pulled taut around an obstacle: its force goes to infinity before the end of the path."""
    STUCK = enum.auto()


@dataclass(frozen=True, eq=False)
class SnapThrough:
    """An energy descent from where a branch could not be continued; in units of the cable."""

    at: float
    """Fraction of the path."""
    energy_before: float
    energy_after: float
    twist_before: float
    twist_after: float
    jumped: bool
    """Whether it ended in another shape; if not, the branch continues there."""
    touched: bool
    """Whether the cable touched something before, and friction was forgotten."""
    margin: float
    """Stability margin at the last equilibrium before."""
    to_fold: float
    """Steps from there to the extrapolated zero of the margin's square; inf if that does not decrease. Known
    only if the cable jumped."""

    crossed: bool = False
    """Whether the branch itself continues, unstable: its margin has passed through 0."""

    @property
    def folded(self) -> bool:
        """Whether the branch lost stability there: the margin went to 0, and at a fold the energy fell."""
        if self.crossed or self.margin < FREE_TO_TURN:
            return True
        return self.margin <= SMALL and self.to_fold <= FOLD and self.energy_after < self.energy_before


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


def continue_branch(
    rod: Rod, q: np.ndarray, F: np.ndarray, path: Callable[[float], Conditions], tolerance: float,
    step: float = 0.25, longest: float = 1.0,
    fallback: Callable[[Rod, np.ndarray, np.ndarray], NodalRod | None] | None = None,
    farthest: float = np.inf, lying_work: float = FALLBACK_LYING_WORK,
    taut_force: float = VERY_TAUT,
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
        farthest: maximum displacement of clamps and obstacles in one step, L.
        lying_work: maximum work before a rod that lies along an obstacle with friction is replaced.
        taut_force: end force from which the branch is known to be taut, EI / L^2.
    """
    at, iterations = 0.0, 0
    snaps: list[SnapThrough] = []
    margins: list[tuple[float, float]] = []  # fractions of the path and stability margins there
    forces: list[tuple[float, float]] = [(at, _norm(F))]  # of the last two equilibria, and their end forces
    taut, in_a_row = False, 0
    given = last = rod.work  # at the start, and after the last step

    def ended(end: End) -> Continuation:
        return Continuation(end, at, q, F, iterations, tuple(snaps), rod)

    while at < 1.0:
        if rod.work <= 0.0:
            rod.refactor(q, F)
            return ended(End.TAUT if taut else End.UNFINISHED)
        target = min(1.0, at + step)
        conditions, left = path(target), rod.work
        if rod.obstacles is not None and conditions.obstacles is not None:
            far = travel(rod.qe, rod.re, rod.obstacles, conditions.qe, conditions.re, conditions.obstacles)
            if far > farthest:
                step = (target - at) * max(0.9 * farthest / far, 0.1)
                continue
        rod.short = step <= SHORT * longest
        code, count, q_new, F_new = rod.advance(
            q, F, conditions.qe, conditions.re, conditions.f, tolerance, 0.35, conditions.obstacles
        )
        iterations += count
        # a rod in contact counts its work itself
        rod.work = min(rod.work, left - count * rod.iteration_work) - OVERHEAD
        if code == warm_step.ADVANCED:
            at, q, F, last = target, q_new, F_new, rod.work
            forces, taut = [forces[-1], (at, _norm(F))], False
            in_a_row += 1
            grows = count <= rod.few or in_a_row >= IN_A_ROW
            step = min(step * min(rod.stride, 2.0 if grows else 1.0), longest)
            in_a_row = 0 if grows else in_a_row
            continue
        in_a_row = 0
        if rod.chord(conditions.qe, conditions.re) >= 1.0 and step < BEYOND * longest:
            rod.refactor(q, F)
            return ended(End.BEYOND_REACH)
        force = forces[-1][1]
        # a grid does not resolve how a taut cable bends, and may fail on the way back as well
        known = len(forces) == 1 and force >= taut_force and not rod.on_grid
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
        spent = (given if soft else last) - rod.work
        smallest, most = (FALLBACK_LYING, lying_work) if soft else (FALLBACK, FALLBACK_WORK * given)
        if code == warm_step.TOO_FAR and not soft:
            smallest = FALLBACK_POINTS
        # without friction a cable snaps on this mesh as well as on a grid of contacts
        free = not (rod.remembers or rod.frictional)
        if free and spent > most and rod.patience > 0:
            # descents that lead away from the branch: short steps without them show whether it folds
            rod.patience, last, spent = 0, rod.work, 0.0
        hard = step * 0.5 < smallest * longest or spent > most
        stable = (free or fallback is None or not hard) and rod.refactor(q, F)
        lets_go = free and stable and rod.short and rod.lets_go(q, F)
        folding = free and (not stable or lets_go or (fallback is not None and rod._softest() < SMALL))
        if folding:
            rod.patience = 0
        if fallback is not None and not folding and (hard or not stable):
            replacement, fallback = fallback(rod, q, F), None
            if replacement is not None:
                rod, q, F = replacement, replacement.shape, replacement.end_force
                step = longest
                continue
            stable = stable or rod.refactor(q, F)
        if not (stable or folding):
            return ended(End.STUCK)
        if stable and step < NEAR * SHORTEST * longest and (not margins or margins[-1][0] < at):
            margins.append((at, rod._softest()))
        crossed = (code == warm_step.NOT_CONVEX and rod.remembers) or not stable or lets_go
        # a cable that turns freely goes far in any step
        turns = free and bool(margins) and margins[-1][1] < FREE_TO_TURN
        if crossed or ((code != warm_step.TOO_FAR or turns) and step * 0.5 < SHORTEST * longest):
            left, here = rod.work, (rod.qe, rod.re, rod.f, rod.obstacles)
            if crossed:  # the branch continues, but its margin has passed through 0
                margins.append((at, rod._softest() if lets_go else 0.0))
            spare = max(SNAP_WORK - rod.work, 0.0)
            rod.work += spare
            snapped = _snap_and_record(rod, q, F, path, step, margins, tolerance, crossed)
            rod.work -= spare
            if snapped is None:
                rod.set_conditions(*here)
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
            q, F = found.q, found.F
            if snap.jumped:
                margins.clear()  # of another branch
            continue
        step *= min(rod.stride, 0.5)
        if step < LEAST * longest:
            return ended(End.STUCK)
    if not (rod.remembers or rod.frictional or rod.refactor(q, F)):
        # the factors of an earlier step did not show that the margin passed through 0
        rod._softest()  # the mode in which it did
        snapped = _snap_and_record(rod, q, F, path, 0.0, [(at, 0.0)], tolerance, True)
        if snapped is None:
            return ended(End.STUCK)
        found, snap, _ = snapped
        snaps.append(snap)
        iterations, q, F = iterations + found.iterations, found.q, found.F
    return ended(End.ARRIVED)


def _snap_and_record(
    rod: Rod, q: np.ndarray, F: np.ndarray, path: Callable[[float], Conditions], step: float,
    margins: list[tuple[float, float]], tolerance: float, crossed: bool,
) -> tuple[Found, SnapThrough, float] | None:  # fmt: skip
    """`snap_through` from the factored equilibrium (q, F) at the end of the step: with its record, and where.

    First a branch is looked for that bifurcates, a little further along the path.

    `margins`: fractions of the path and stability margins there, last those of (q, F); `crossed`: whether the
    margin is known to be negative at the end of the step.
    """
    at, margin = margins[-1]
    touched = bool(rod.contact_force().any()) and not rod.remembers
    shape, before = rod.mesh.interpolate(q, GRID), rod.snapshot()()
    energy, mode = rod.linearize(q, F)[0], rod.mode.copy()
    twist, end, found = float(rod.totals[TWIST]), min(1.0, at + AHEAD * step), None
    if margin < SMALL:
        found = switch_branch(rod, q, F, mode, path(end))
        crossed = crossed or found is not None
    if found is None:
        end = min(1.0, at + step)
        found = snap_through(rod, q, F, path(end))
    if found is None:
        return None
    jumped, to_fold = _jumped(shape, rod.mesh.interpolate(found.q, GRID)), 0.0 if crossed else np.inf
    if jumped and not crossed:
        earlier = margins[-2:-1] or _earlier_margin(before, q, F, path, at, step, tolerance)
        to_fold = min((_to_fold(at, margin, *one) / step for one in earlier), default=np.inf)
    record = SnapThrough(
        at, energy, found.energy, twist, found.twist, jumped, touched, margin, to_fold, crossed
    )
    return found, record, end


def _earlier_margin(
    rod: Rod, q: np.ndarray, F: np.ndarray, path: Callable[[float], Conditions], at: float, step: float,
    tolerance: float,
) -> list[tuple[float, float]]:  # fmt: skip
    """A fraction of the path a little before (q, F), and the stability margin there; or an empty list."""
    for many in STEPS_BACK:
        if not rod.refactor(q, F):
            return []
        back = at - many * step
        there = path(back)
        code, _, q_back, F_back = rod.advance(
            q, F, there.qe, there.re, there.f, tolerance, 0.35, there.obstacles
        )
        if code == warm_step.ADVANCED and rod.refactor(q_back, F_back):
            return [(back, rod._softest())]
    # next to the fold Newton's method fails, and a descent of the energy does not
    shape, back = rod.mesh.interpolate(q, GRID), at - STEPS_BACK[0] * step
    snapped = snap_through(rod, q, F, path(back))
    if snapped is None or _jumped(shape, rod.mesh.interpolate(snapped.q, GRID), AWAY):
        return []
    return [(back, rod._softest())]


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


def _norm(F: np.ndarray) -> float:
    return float(np.linalg.norm(F))


def _to_fold(at: float, margin: float, before: float, margin_before: float) -> float:
    """Distance along the path from `at` to the extrapolated zero of the margin's square; inf if none.

    It is linear in the load near a simple fold, and decreases faster near a symmetric bifurcation.
    """
    decrease = margin_before**2 - margin**2
    return (at - before) * margin**2 / decrease if decrease > 0.0 else np.inf


def snap_through(rod: Rod, q: np.ndarray, F: np.ndarray, conditions: Conditions) -> Found | None:
    """Descend the energy from (q, F) under the given conditions, in steps too short to cross a ridge.

    Returns the stable equilibrium at the end; None if none was reached.
    """
    rod.set_conditions(conditions.qe, conditions.re, conditions.f, conditions.obstacles)
    # of two mirror images always the same one, whatever the last bit
    q = rod.retract(rod.on_end(q), PERTURBATION * rod.start_vector())
    found = settle(rod, q, F, Options(radius=0.1, largest_radius=0.3, iterations=400))
    # soft obstacles may have held it where hard ones do not
    return found if found is None or rod.refactor(found.q, found.F) else None


def _jumped(before: np.ndarray, after: np.ndarray, most: float = JUMP) -> bool:
    """Whether some section turned by more than `most`, rad."""
    return bool(np.abs(np.sum(before * after, axis=1)).min() < np.cos(0.5 * most))
