# SPDX-License-Identifier: Apache-2.0
"""Snap-through: where a branch ends, the energy is descended to the next stable equilibrium."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cable_ros.branch.branch_switching import switch_branch
from cable_ros.branch.cold_start import Conditions, Found, settled
from cable_ros.branch.free_turn import is_beside, place_to_turn_to, places_beside
from cable_ros.branch.mirror_image import GRID, by_rule
from cable_ros.contact.symmetry import LEANT, OUT
from cable_ros.contact.travel import FORCE_CHANGE, travel
from cable_ros.rod import warm_step
from cable_ros.rod.kirchhoff import FREE_TO_TURN, Rod
from cable_ros.rod.rod_state import ENERGY, TWIST
from cable_ros.solve.trust_region import Options

STEPS_BACK = (30.0, 10.0, 3.0)
"""Numbers of steps back to where the margin is computed if none was recorded before the last equilibrium."""
SMALL = 0.05
"""Maximum margin of the last equilibrium before a fold. At folds of free cables it was 1e-4 to 0.012, as the
root law gives for the last step's distance; away from folds it is 0.1 to 1."""
FOLD = 10.0
"""Maximum number of last steps to the zero of the margin's square, extrapolated linearly, at a fold. At
folds of free cables it was 0.3 to 1.7."""
FINE = (0.0, 1e-5, 1e-4)
"""Lengths of a step, L, below which it counts as so long, tried in turn: where rounding makes a cable lean,
the last ones are too short, and the margin along them too rough, to extrapolate from."""
ALMOST = 1.0 - 1e-9
"""Part of that length which is as long, but for rounding: a halved step is as long as the one before."""
PERTURBATION = 5e-12
"""Size, root of the elastic energy, of the fixed perturbation that a snap-through starts from: above
rounding, below what changes the energy."""
JUMP = 0.05
"""Minimum rotation of a section, rad, that shows another branch: a step of SHORTEST along one turns less."""
AWAY = 0.2
"""The same for a few such steps back from a fold, where the shape changes like the root of the load."""
HARDLY = 1e-5
"""Rotation of a section, rad, below which a fall has moved nothing: only friction has changed."""
SNAP_WORK = 120_000.0
"""Minimum budget of a snap-through: without it no call would get past a fold."""
FALL_WORK, FALL_CALL = 600_000.0, 150_000.0
"""The same of a fall with friction, which else would be forgotten until `reset`: of one that has to end in
the call, as on a grid, and of a call after which it goes on."""
AHEAD = 100.0
"""Number of steps along the path to where a bifurcating branch is looked for, and a fall leads first."""
BEYOND = 2e-4
"""Motion of clamps and obstacles beyond a fold, L, in which a cable with friction falls."""
DESCENT = Options(radius=0.1, largest_radius=0.3, iterations=400)
"""Of a snap-through: no step crosses a ridge."""
Descent = Callable[[np.ndarray, np.ndarray, Options], tuple[np.ndarray, np.ndarray, int] | None]
"""As `Rod.minimum`."""


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
    """Whether the cable touched something with friction before, which was forgotten."""
    margin: float
    """Stability margin at the last equilibrium before."""
    to_fold: float
    """Steps from there to the extrapolated zero of the margin's square; inf if that does not decrease. Known
    only if the cable jumped."""

    crossed: bool = False
    """Whether the branch itself continues, unstable: its margin has passed through 0."""
    forks: bool = False
    """Whether a stable branch leaves it there, which the cable is on now."""

    @property
    def turned(self) -> bool:
        """Whether the cable was free to turn there, and the path leaves it one of the places to turn to."""
        return not self.crossed and self.margin < FREE_TO_TURN

    @property
    def folded(self) -> bool:
        """Whether the branch lost stability there: the margin went to 0, and at a fold the energy fell."""
        if self.crossed or self.turned:
            return True
        return self.margin <= SMALL and self.to_fold <= FOLD and self.energy_after < self.energy_before


def snap_and_record(
    rod: Rod, q: np.ndarray, F: np.ndarray, path: Callable[[float], Conditions], step: float,
    margins: list[tuple[float, float]], tolerance: float, crossed: bool, may_turn: bool = False,
) -> tuple[Found, SnapThrough, float] | None:  # fmt: skip
    """`snap_through` from the factored equilibrium (q, F) at the end of the step: with its record, and where.

    First a branch is looked for that bifurcates, or where a cable turns to that is free to, a little further
    along the path.

    `margins`: fractions of the path and stability margins there, last those of (q, F); `crossed`: whether the
    margin is known to be negative at the end of the step; `may_turn`: as in `continue_branch`.
    """
    at, margin = margins[-1]
    touched = _forgets(rod)
    shape, before = rod.mesh.interpolate(q, GRID), rod.snapshot()()
    energy, mode = rod.linearize(q, F)[0], rod.mode.copy()
    twist, end, found = float(rod.totals[TWIST]), min(1.0, at + AHEAD * step), None
    turns, forks = may_turn and margin < FREE_TO_TURN, False
    if turns and (turned := _turned(rod, q, F, path, at, end)) is not None:
        found, end = turned
    if found is None and margin < SMALL:
        found = switch_branch(rod, q, F, mode, path(end))
        forks = found is not None
    crossed = crossed or forks
    if found is None:
        end = min(1.0, at + step)
        found = snap_through(rod, q, F, path(end))
    ends = min(1.0, at + AHEAD * step), 1.0
    if found is None and turns:
        found, end = _further_on(rod, q, F, path, ends, rod.minimum)
    falls = (rod.fall, rod.fall_closely) if rod.touches and not (rod.remembers or rod.frictional) else ()
    for fall in falls:
        if found is None:
            found, end = _further_on(rod, q, F, path, ends, fall)
    if found is None:
        return None
    found, forked = by_rule(found, shape, LEANT)
    jumped = has_jumped(shape, rod.mesh.interpolate(found.q, GRID))
    to_fold = 0.0 if crossed else np.inf
    if jumped and not (crossed or turns):
        long = max(_length(path, at, at + step), 1e-300)
        for fine in FINE:
            least = step * max(1.0, fine / long)
            earlier = [one for one in margins[:-1] if at - one[0] >= ALMOST * least][-1:]
            earlier = earlier or _earlier_margin(before, q, F, path, at, least, tolerance)
            to_fold = min((_to_fold(at, margin, *one) / least for one in earlier), default=np.inf)
            if to_fold <= FOLD:
                break
    forks = forks or (forked and not jumped)
    after = found.energy if end <= at + step else _energy(found, path(at), tolerance)
    record = SnapThrough(
        at, energy, after, twist, found.twist, jumped, touched, margin, to_fold, crossed, forks
    )
    return found, record, end


def _forgets(rod: Rod) -> bool:
    """Whether it touches something with friction, which a descent forgets."""
    return rod.frictional and bool(rod.contact_force().any()) and not rod.remembers


def _turned(
    rod: Rod, q: np.ndarray, F: np.ndarray, path: Callable[[float], Conditions], at: float, end: float
) -> tuple[Found, float] | None:
    """The equilibrium that the equilibrium (q, F), free to turn, turns to, and at which fraction of the path.

    None: not known. At `end` if that tells; else where it has moved so far that some places are better.
    """
    place = place_to_turn_to(rod, q, F, path(end))
    places = [place] if place is not None else []
    if place is None:
        while end < 1.0 and not is_beside(rod, path(end)):
            end = min(1.0, at + 2.0 * (end - at))
        places = places_beside(rod, q, F, path(end))
    for place in places:  # an obstacle may be where the first one is
        found = snap_through(rod, *place, path(end))
        if found is not None:
            return found, end
        rod.refactor(q, F)
    return None


def _length(path: Callable[[float], Conditions], begin: float, end: float) -> float:
    """Length, L, of the path between two fractions of it; inf without obstacles."""
    a, b = path(begin), path(end)
    if a.obstacles is None or b.obstacles is None:
        return np.inf
    return travel(a.qe, a.re, a.obstacles, b.qe, b.re, b.obstacles)


def _energy(found: Found, conditions: Conditions, tolerance: float) -> float:
    """Energy, EI / L, of an equilibrium's branch under other conditions nearby; its own if that fails."""
    rod, energy = found.rod, found.energy
    put_back, there = rod.kept(), (conditions.qe, conditions.re, conditions.f)
    code, _, q, F = rod.advance(found.q, found.F, *there, tolerance, 0.35, conditions.obstacles)
    if code == warm_step.ADVANCED:
        energy = rod.linearize(q, F)[0]
    put_back()
    rod.refactor(found.q, found.F)
    return energy


def left_on_refining(before: Found, after: Found) -> tuple[Found, SnapThrough] | None:
    """The snap-through, with where it leads, of an equilibrium `before` whose finer mesh led to `after`.

    A branch may end, or fork, a little earlier than a coarse mesh tells. None if it has not left its branch,
    or is free to turn there.
    """
    rod = before.rod
    shape = rod.mesh.interpolate(before.q, GRID)
    jumped = has_jumped(shape, after.rod.mesh.interpolate(after.q, GRID), AWAY)
    if jumped and after.rod._softest() < FREE_TO_TURN:
        return None
    forks = False
    if jumped or (rod.clamped and rod.touches and not rod.frictional):
        after, forks = by_rule(after, shape, LEANT if jumped else OUT)
    if not (jumped or forks):
        return None
    margin = rod._softest() if rod.refactor(before.q, before.F) else 0.0
    energies, twists = (before.energy, after.energy), (before.twist, after.twist)
    return after, SnapThrough(1.0, *energies, *twists, jumped, _forgets(rod), margin, 0.0, forks=forks)


def _earlier_margin(
    rod: Rod, q: np.ndarray, F: np.ndarray, path: Callable[[float], Conditions], at: float, step: float,
    tolerance: float,
) -> list[tuple[float, float]]:  # fmt: skip
    """A fraction of the path a little before (q, F), and the stability margin there; or an empty list."""
    put_back = rod.kept()  # a step may change the mesh
    for many in STEPS_BACK:
        if not rod.refactor(q, F):
            return []
        back = at - many * step
        there = path(back)
        code, _, q_back, F_back = rod.advance(
            q, F, there.qe, there.re, there.f, tolerance, 0.35, there.obstacles
        )
        stable = code == warm_step.ADVANCED and rod.refactor(q_back, F_back)
        margin = rod._softest() if stable else np.nan
        put_back()
        if stable:
            return [(back, margin)]
    # next to the fold Newton's method fails, and a descent of the energy does not
    shape, back = rod.mesh.interpolate(q, GRID), at - STEPS_BACK[0] * step
    snapped = snap_through(rod, q, F, path(back))
    if snapped is None:
        return []
    left = has_jumped(shape, rod.mesh.interpolate(snapped.q, GRID), AWAY)
    margin = np.nan if left else rod._softest()
    put_back()
    return [] if left else [(back, margin)]


def _to_fold(at: float, margin: float, before: float, margin_before: float) -> float:
    """Distance along the path from `at` to the extrapolated zero of the margin's square; inf if none.

    It is linear in the load near a simple fold, and decreases faster near a symmetric bifurcation.
    """
    decrease = margin_before**2 - margin**2
    return (at - before) * margin**2 / decrease if decrease > 0.0 else np.inf


def snap_through(
    rod: Rod, q: np.ndarray, F: np.ndarray, conditions: Conditions, descend: Descent | None = None
) -> Found | None:
    """Descend the energy from (q, F) under the given conditions, in steps too short to cross a ridge.

    Returns the stable equilibrium at the end; None, with the rod as it was, if none was reached. `descend`:
    else `rod.minimum`.
    """
    put_back = rod.kept()
    rod.set_conditions(conditions.qe, conditions.re, conditions.f, conditions.obstacles)
    # of two mirror images always the same one, whatever the last bit
    q = rod.retract(rod.on_end(q), PERTURBATION * rod.start_vector())
    found = settled(rod, (descend or rod.minimum)(q, F, DESCENT))
    # soft obstacles may have held it where hard ones do not
    if found is not None and rod.refactor(found.q, found.F):
        return found
    put_back()
    return None


def _further_on(
    rod: Rod, q: np.ndarray, F: np.ndarray, path: Callable[[float], Conditions], ends: Sequence[float],
    descend: Descent,
) -> tuple[Found | None, float]:  # fmt: skip
    """`snap_through` at the first of these fractions of the path where it arrives; which one.

    Next to a fold the energy is all but flat, and soft obstacles hold the cable longer than hard ones. Where
    it is free to turn, so little of the path changes the energy by turning that rounding hides it.
    """
    left = len(ends) * SNAP_WORK
    for end in ends:
        spare = max(left - rod.work, 0.0)
        rod.work += spare
        given = rod.work
        rod.refactor(q, F)  # the descent before has left other factors
        found = snap_through(rod, q, F, path(end), descend)
        left -= given - rod.work
        rod.work -= spare
        if found is not None:
            break
    return found, end


def goes_on(rod: Rod, path: Callable[[float], Conditions]) -> bool:
    """Whether the rod is falling, and on this path."""
    if rod.falling is None:
        return False
    there = path(rod.falling.rest)
    return bool(rod.falling.leads_to((there.qe, there.re, there.f, there.obstacles)))


def fall_with_friction(
    rod: Rod, q: np.ndarray, F: np.ndarray, path: Callable[[float], Conditions], at: float, step: float,
    away: Callable[[Conditions], float],
) -> tuple[Found, SnapThrough, float] | None:  # fmt: skip
    """As `snap_and_record`, of a cable that keeps its friction: it falls as in a viscous medium.

    A branch that goes on attracts it. So where it ends in another shape the branch has ended. None if it does
    not come to rest, or not yet: then the rod is `falling`, and the next call goes on from there.

    `away`: the distance of the rod's conditions from others, L.
    """
    end = min(1.0, at + step)
    if rod.falling is not None:
        end = at + rod.falling.rest * (1.0 - at)
    else:
        while end < 1.0 and away(path(end)) < BEYOND:
            end = min(1.0, at + 2.0 * (end - at))
    there, shape = path(end), rod.mesh.interpolate(q, GRID)
    energy, twist = rod.linearize(q, F)[0], float(rod.totals[TWIST])
    spare = max((FALL_WORK if rod.on_grid else FALL_CALL) - rod.work, 0.0)
    put_back = rod.kept()
    rod.work += spare
    fallen = rod.fall_with_friction(q, F, there.qe, there.re, there.f, there.obstacles)
    rod.work -= spare
    if fallen is None:
        if rod.falling is not None:
            rod.falling.rest = (end - at) / (1.0 - at)
        return None
    found = Found.at(rod, *fallen)
    after = rod.mesh.interpolate(found.q, GRID)
    jumped = has_jumped(shape, after)
    change, size = (float(np.linalg.norm(one)) for one in (found.F - F, F))
    if not (rod.on_grid or has_jumped(shape, after, HARDLY)) and change > FORCE_CHANGE * max(size, rod.least):
        put_back()  # nothing but friction has changed, more than a step may change it
        return None
    record = SnapThrough(
        at, energy, float(rod.totals[ENERGY]), twist, float(rod.totals[TWIST]), jumped, False, 0.0, 0.0,
        crossed=jumped,
    )  # fmt: skip
    return found, record, end


def has_jumped(before: np.ndarray, after: np.ndarray, most: float = JUMP) -> bool:
    """Whether some section turned by more than `most`, rad."""
    return bool(np.abs(np.sum(before * after, axis=1)).min() < np.cos(0.5 * most))
