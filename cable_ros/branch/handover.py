# SPDX-License-Identifier: Apache-2.0
"""From one formulation of contact to the other: `TouchingRod` is accurate, `NodalRod` is robust."""

from __future__ import annotations

import numpy as np

from cable_ros.branch.cold_start import LIMIT, Found, Sought, conditions_of, first_mesh, settled
from cable_ros.branch.refinement import LENIENT, refine
from cable_ros.contact.friction_kernels import COULOMB, FRICTIONLESS
from cable_ros.contact.grid_friction import Friction
from cable_ros.contact.nodal_contacts import MOST, point_count
from cable_ros.contact.nodal_rod import FINER, NodalRod
from cable_ros.contact.patches import SAMPLES, WEIGHTS
from cable_ros.contact.penalty import give_contacts
from cable_ros.contact.penalty_continuation import descend
from cable_ros.contact.points import ARC_LENGTH, FORCE, FRICTION, KIND, LENGTH, NUMBER, OBSTACLE, SAMPLE
from cable_ros.contact.report import positions
from cable_ros.contact.shearing_rod import among_obstacles
from cable_ros.contact.stretching_rod import StretchingTouchingRod
from cable_ros.contact.touching_rod import TouchingRod
from cable_ros.rod import warm_step
from cable_ros.rod.elements import Mesh
from cable_ros.rod.initial_shapes import starts
from cable_ros.rod.kirchhoff import Rod
from cable_ros.rod.rod_state import TWIST
from cable_ros.rod.units import relative_change
from cable_ros.solve.trust_region import Options

ALIKE, FARTHEST = 0.05, 0.25
"""Maximum relative difference of the end wrenches of one equilibrium in both formulations: to be published,
and of a grid that keeps the branch, from which friction may slide to where it belongs."""
TURNED = 0.1
"""Maximum rotation of a section, rad, between both."""
SETTLE = Options(
    radius=0.1, largest_radius=0.3, iterations=60, step_tolerance=1e-8, constraint_tolerance=1e-8
)
"""For a descent to the equilibrium nearest to a shape."""
TRIALS: tuple[tuple[int, int | None], ...] = ((16, None), (0, 1), (16, 0), (8, 1), (16, 1))
"""Tried in turn: numbers of elements, 0 for those of a search, and the first of
`penalty_continuation.SPRINGS`, or None to start from the contacts of the grid."""
WORK = 40_000.0
"""Minimum budget, iterations times unknowns, of a rod that takes over."""
EXACT_WORK = 60_000.0
"""Maximum budget of a search for the accurate equilibrium beside one on a grid."""
LEAST_WORK = 10_000.0
"""Its minimum at a pose that was asked for, without friction, where a grid's own numbers are not published:
one trial, whatever the way there took."""
SPREAD = 400.0
"""Number of forces per length, 1 / L, by which a sample of a patch is spread: more than cells."""
CELLS = 12.0
"""Minimum number of cells of a grid along the longest patch."""
LEVEL = 0.1
"""Maximum gap of a contact on the grid, in spacings squared per length: the grid resolves no less."""
PATCH = 4
"""Maximum number of points of a short patch on the grid."""
MOVED, MOVED_PATCH = 1e-3, 3e-4
"""Maximum motion along the surface, L, of contact points as friction is handed over to them from the grid: of
points and short patches, and along longer ones, where it may stick in another place then."""
PRESLIDING = 0.003
"""Presliding, L, in solves that start from the grid's friction: more than contacts move between both."""
SOLVES = 3
"""Their maximum number: the first may change the contacts, and with them how much what slides can bear."""
TRIES = 3
"""Number of initial shapes that a search relaxes on a grid."""
CENTRINGS, CENTRED, FARTHEST_OFF = 8, 1e-7, 0.05
"""Maximum number of solves that bring lone contacts to where they touch, the distance, L, at which they are
there, and that at which they are not sought further."""
GRID = np.linspace(0.0, 1.0, 33)
"""Arc lengths at which shapes are compared."""


def nodal(rod: Rod, q: np.ndarray, F: np.ndarray, always: bool = False) -> NodalRod | None:
    """The equilibrium (q, F) and its friction on a uniform grid of contacts; None if that fails.

    `always`: even if a cable that stretches does better without.
    """
    if not isinstance(rod, TouchingRod) or rod.obstacles is None:
        return None
    if rod.soft and not (rod.replaceable or always):
        return None
    points = rod.points[: rod.count]
    forces = points[:, FORCE, None] * rod.normals[: rod.count] + points[:, FRICTION : FRICTION + 3]
    force = max(np.linalg.norm(F), np.linalg.norm(rod.start_force(F)))
    count = max(point_count(float(force)), int(min(CELLS / _longest_span(points), MOST)))
    rod.refactor(q, F)
    arc_lengths, which = points[:, ARC_LENGTH], points[:, OBSTACLE].astype(int)
    if rod.count:
        arc_lengths, forces, which = _spread(rod, forces)
    best, least = None, FARTHEST
    for cells in (count, int(FINER * count)):
        new = NodalRod(rod.K, rod.natural, rod.obstacles, cells, rod.model == COULOMB, rod.compliance)
        new.work = max(rod.work, WORK)
        if new.adopt(rod, q, F, arc_lengths, forces, which):
            away = apart(new, rod, F)
            new.doubt(away)
            if away < least:
                best, least = new, away
        if least < ALIKE:
            break
    return best


def _spread(rod: TouchingRod, forces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Arc lengths (c,), forces (c, 3) and obstacles (c,) of the rod's contacts, those of samples spread over
    the length that each stands for.

    Else a cell between two samples bears its share of the pressure and little of their friction, and those
    beside it more than they can hold: 5 % of the end force were lost so, and more on finer grids.

    `forces` (k, 3): on the rod's contact points.
    """
    arc_lengths, shares, which = [], [], []
    edges = np.concatenate(([0.0], np.cumsum(WEIGHTS)))
    for point, force in zip(rod.points[: rod.count], forces, strict=True):
        parts = np.array([point[ARC_LENGTH]])
        if point[LENGTH] > 0.0:
            e, k = divmod(int(point[NUMBER]), SAMPLES)
            low, high = rod.s0[e] + rod.h[e] * edges[k : k + 2]
            count = int(np.ceil((high - low) * SPREAD))
            parts = low + (high - low) * (np.arange(count) + 0.5) / count
        arc_lengths.append(parts)
        shares.append(np.repeat(force[None] / len(parts), len(parts), axis=0))
        which.append(np.full(len(parts), int(point[OBSTACLE])))
    return np.concatenate(arc_lengths), np.concatenate(shares), np.concatenate(which)


def _longest_span(points: np.ndarray) -> float:
    """Length, L, of the longest patch among contact points (k, COLUMNS); inf without any."""
    samples = points[points[:, KIND] == SAMPLE]
    spans = [np.ptp(samples[samples[:, OBSTACLE] == o, ARC_LENGTH]) for o in set(samples[:, OBSTACLE])]
    return max((float(span) for span in spans if span > 0.0), default=np.inf)


def exact(
    rod: NodalRod, tolerance: float, model: int, anywhere: bool = False, least: float = 0.0
) -> Found | None:
    """The equilibrium of a nodal rod, solved to the tolerance without its grid; None if none is found.

    `anywhere`: whether another one that a descent finds will do, too: in a search any is as good. `least`:
    the minimum budget, without friction.
    """
    if rod.compliance[:2].any():
        return None if rod.touches else _lifted(rod, tolerance)
    if model != FRICTIONLESS and rod.rubs:
        return _with_friction(rod, tolerance) if model == COULOMB else None
    first = _first_mesh(rod, tolerance)
    left = given = max(min(rod.work, EXACT_WORK), least)
    found = None
    for _ in TRIALS:
        if left <= 0.0:
            break
        count, stage = TRIALS[rod.tried % len(TRIALS)]
        mesh = Mesh(first.element, np.full(count, 1.0 / count)) if count else first
        new, q = _started(rod, mesh, tolerance, left)
        if stage is None:
            result = _taken_over(new, q, rod)
        elif isinstance(new, StretchingTouchingRod):
            result = new.from_inextensible(q, rod.end_force, SETTLE, stage)
        else:
            result = descend(new, q, rod.end_force, SETTLE, stage, foundation=anywhere)
        left = new.work
        if result is not None:
            one, estimate = refine(Found.at(new, *result), tolerance)
            if estimate <= tolerance and (anywhere or _same(rod, one)):
                found = one
                break
        rod.tried += 1  # without budget left, the next pose tries the next
    rod.work -= given - left
    return found


def centred(rod: NodalRod) -> NodalRod | None:
    """The equilibrium of a nodal rod, with its friction, whose lone contacts are where the cable touches, not
    in the middle of their cells; None if none is alone, or if it is not found.

    Each is where the gap has no slope along the cable, the mean of both sides where it has a kink.
    """
    assert rod.obstacles is not None
    last: dict[int, tuple[float, float]] = {}
    lone = rod.lone()
    places = {o: s for _, o, s in lone}
    if not places or len(places) != len(lone):
        return None
    now = rod
    for _ in range(CENTRINGS):
        new = now.moved(list(places.values()))
        if new is None:
            return None
        now = new
        boundaries = np.append(now.s0, 1.0)
        off, there = 0.0, {}
        for k, o, s in now.lone():
            slope, bend = now.rise(k, rod.obstacles[o]), now.bend(k, o)
            if o in last and last[o][0] != s:
                bend = (slope - last[o][1]) / (s - last[o][0])
            there[o] = s - slope / bend if bend > 0.0 else np.nan
            last[o] = s, slope
            off = max(off, abs(there[o] - boundaries[k]))
        if there.keys() != places.keys() or not off < FARTHEST_OFF:
            return None  # it touches along a patch, or elsewhere
        places = there
        if off < CENTRED:
            now.offset = off
            now.pair()
            return now
    return None


def _first_mesh(rod: NodalRod, tolerance: float) -> Mesh:
    """See `first_mesh`, for the shape on the grid."""
    return first_mesh(conditions_of(rod), float(rod.totals[TWIST]), tolerance)


def _lifted(rod: NodalRod, tolerance: float) -> Found | None:
    """As `exact`, of a cable that shears and touches nothing any more."""
    mesh = _first_mesh(rod, tolerance)
    given = min(rod.work, EXACT_WORK)
    new, q = _started(rod, mesh, tolerance, given)
    found = settled(new, new.minimum(q, rod.end_force, SETTLE))
    rod.work -= given - new.work
    if found is None:
        return None
    one, estimate = refine(found, tolerance)
    return one if estimate <= tolerance and _same(rod, one) else None


def _with_friction(rod: NodalRod, tolerance: float) -> Found | None:
    """As `exact`. What sticks yields a little, so that friction stays that of the grid."""
    mesh = _first_mesh(rod, tolerance)
    given = min(rod.work, EXACT_WORK)
    new, q = _started(rod, mesh, tolerance, given)
    _give_contacts(new, q, rod)
    F, friction = rod.end_force, Friction.of(rod)
    new.model, new.presliding = COULOMB, PRESLIDING
    for solve in range(SOLVES):
        friction.give(new)
        new.ready = False
        # from the grid's shape: as far as the last solve led, its friction was wrong
        code, _, q_new, F_new = new.correct(_shape(rod, new.mesh), F, SETTLE.step_tolerance)
        if code != warm_step.ADVANCED and solve > 0:
            # but around an edge its points may have come far from the grid's
            code, _, q_new, F_new = new.correct(q, F, SETTLE.step_tolerance)
        q, F = q_new, F_new
        if code != warm_step.ADVANCED or (solve > 0 and friction.slides_on(new)):
            break
    new.presliding, new.ready = 0.0, False
    rod.work -= given - new.work
    if code != warm_step.ADVANCED:
        return None
    found, estimate = refine(Found.at(new, q, F), tolerance)
    if estimate > tolerance or found.rod.forgot or not _same(rod, found) or not _stays(found, tolerance):
        return None
    short = _longest_patch(rod.lies_on(LEVEL)) <= PATCH
    return found if _displacement(rod, found) < (MOVED if short else MOVED_PATCH) else None


def _started(rod: NodalRod, mesh: Mesh, tolerance: float, work: float) -> tuple[TouchingRod, np.ndarray]:
    """A rod without contacts on the `mesh`, under the grid's conditions; the grid's shape (n, 4) on it."""
    new = among_obstacles(mesh, rod.K, rod.natural, rod.compliance, tolerance)
    new.set_conditions(rod.qe, rod.re, rod.f, rod.obstacles)
    new.work = work
    return new, _shape(rod, mesh)


def _stays(found: Found, tolerance: float) -> bool:
    """Whether its mesh resolves its friction and its contacts, or else it would need a grid at once."""
    rod, q, F = found.rod, found.q, found.F
    error = max(float(rod.clamp_errors(q, F).max()), rod.friction_error(q, F))
    return error <= tolerance and not rod.unresolved(q, LENIENT).any()


def _shape(rod: NodalRod, mesh: Mesh) -> np.ndarray:
    """(n, 4) the shape of the grid's cable on another mesh."""
    q = rod.mesh.interpolate(rod.state.q, mesh.nodes)
    q[0], q[-1] = rod.state.q[0], rod.state.q[-1]
    return q


def _longest_patch(lies: np.ndarray) -> int:
    """Largest number of points in a row, along axis 0 of (m + 1, o), that lie on one obstacle."""
    longest = run = np.zeros(lies.shape[1], int)
    for row in lies:
        run = np.where(row, run + 1, 0)
        longest = np.maximum(longest, run)
    return int(longest.max(initial=0))


def _displacement(rod: NodalRod, found: Found) -> float:
    """Largest distance, L, of the contact points of `found` from the same points of the grid's cable."""
    new = found.rod
    assert isinstance(new, TouchingRod)
    new.trace(found.q, found.F)
    at, boundaries = new.points[: new.count, ARC_LENGTH].copy(), np.append(rod.s0, 1.0)
    there = np.column_stack([np.interp(at, boundaries, rod.state.r[:, a]) for a in range(3)])
    here = positions(new.c, new.h, new.s0, at)
    away, normals = here - there, new.normals[: new.count]
    away -= np.einsum("ca,ca->c", away, normals)[:, None] * normals
    return float(np.linalg.norm(away, axis=1).max(initial=0.0))


def _taken_over(new: TouchingRod, q: np.ndarray, rod: NodalRod) -> tuple[np.ndarray, np.ndarray, int] | None:
    """The equilibrium of the `new` rod, started from the shape q (n, 4) and the contacts of the grid."""
    q = _give_contacts(new, q, rod)
    code, iterations, q_new, F_new = new.correct(q, rod.end_force, SETTLE.step_tolerance)
    return (q_new, F_new, iterations) if code == warm_step.ADVANCED else None


def _give_contacts(new: TouchingRod, q: np.ndarray, rod: NodalRod) -> np.ndarray:
    """Give the `new` rod of shape q (n, 4) the contacts of the grid; returns the shape on its mesh then."""
    new.trace(q, rod.end_force)
    at, which = np.nonzero(rod.lies_on(LEVEL))
    arc_lengths = np.append(rod.s0, 1.0)[at]
    give_contacts(new, q, which, arc_lengths, rod.state.lam[at, which], 1.0 / rod.cells)
    return new.fit_patches(q)


class Rest:
    """A last resort of a search: initial shapes relax on a grid of contacts, the least penetrating first.

    Args:
        sought: the pose; without obstacles there is nothing to try.
    """

    def __init__(self, sought: Sought) -> None:
        self._sought = sought
        self._shapes: list[np.ndarray] | None = None if sought.conditions.obstacles is not None else []
        self._resting: NodalRod | None = None
        """That of the last shape, if it came to rest."""

    @property
    def over(self) -> bool:
        """Whether all shapes have been tried."""
        return self._shapes is not None and not self._shapes and self._resting is None

    def settle(self) -> tuple[list[Found], float]:
        """Let the next shape come to rest, or solve accurately where the last one did.

        Returns the equilibrium, if there is one now, and the work.
        """
        if self._resting is None:
            return [], self._relax()
        rod, self._resting = self._resting, None
        rod.work = LIMIT
        found = exact(rod, self._sought.tolerance, FRICTIONLESS, anywhere=True)
        return [] if found is None else [found], LIMIT - rod.work

    def _relax(self) -> float:
        """Let the next shape come to rest; returns the work."""
        sought, there = self._sought, self._sought.conditions
        assert there.obstacles is not None
        points = point_count(float(np.linalg.norm(there.f)))
        rod = NodalRod(sought.stiffness, sought.natural, there.obstacles, points, coulomb=False)
        rod.set_conditions(there.qe, there.re, there.f)
        if self._shapes is None:
            begins = starts(
                rod.mesh.nodes, there.qe, there.re, there.f, sought.target_twist, sought.natural, False
            )
            self._shapes = sorted(begins, key=rod.depth)[:TRIES]
        rod.work = LIMIT
        if rod.begin(self._shapes.pop(0), there.qe, there.re, there.f) is not None:
            self._resting = rod
        rod.obstacles = there.obstacles  # as rough as they are, for the rod that follows it
        return LIMIT - rod.work


def _same(rod: NodalRod, found: Found) -> bool:
    a = rod.mesh.interpolate(rod.state.q, GRID)
    b = found.rod.mesh.interpolate(found.q, GRID)
    if np.abs(np.sum(a * b, axis=1)).min() < np.cos(0.5 * TURNED):
        return False
    return apart(rod, found.rod, found.F) < ALIKE


def apart(rod: NodalRod, other: Rod, F: np.ndarray) -> float:
    """Relative difference of the end wrench from that of another rod, whose end force is F (3,)."""
    theirs = np.concatenate((F, other.g[-1]))
    return float(relative_change(rod.wrench - theirs, theirs, rod.least))
