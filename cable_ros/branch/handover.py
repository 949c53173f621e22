# SPDX-License-Identifier: Apache-2.0
"""From one formulation of contact to the other: `TouchingRod` is exact, `NodalRod` is robust."""

from __future__ import annotations

import numpy as np

from cable_ros.branch.cold_start import LIMIT, Conditions, Found, Sought, first_mesh, refine
from cable_ros.contact.friction_kernels import COULOMB, FRICTIONLESS
from cable_ros.contact.nodal_contacts import places_for
from cable_ros.contact.nodal_rod import NodalRod
from cable_ros.contact.grid_friction import Friction
from cable_ros.contact.penalty import give_contacts
from cable_ros.contact.penalty_continuation import descend
from cable_ros.contact.points import ARC_LENGTH, FORCE, FRICTION, OBSTACLE
from cable_ros.contact.touching_rod import TouchingRod
from cable_ros.rod import warm_step
from cable_ros.rod.elements import Mesh
from cable_ros.rod.initial_shapes import starts
from cable_ros.rod.kirchhoff import Rod
from cable_ros.rod.rod_state import TWIST
from cable_ros.rod.units import relative_change
from cable_ros.solve.trust_region import Options

ALIKE = 0.05
"""Relative difference of two end wrenches below which both formulations show the same equilibrium."""
TURNED = 0.1
"""Rotation of a section, rad, below which they do."""
SETTLE = Options(
    radius=0.1, largest_radius=0.3, iterations=60, step_tolerance=1e-8, constraint_tolerance=1e-8
)
"""For a descent to the equilibrium beside a shape."""
TRIALS: tuple[tuple[int, int | None], ...] = ((16, None), (0, 1), (16, 0), (8, 1), (16, 1))
"""What is tried in turn: numbers of elements, 0 for those of a search, and the first of
`penalty_continuation.SPRINGS`, None to take over the contacts of the grid."""
WORK = 40_000.0
"""Budget, iterations times unknowns, of a rod that takes over, if there is less left."""
EXACT_WORK = 60_000.0
"""Budget of a search for an exact equilibrium beside one on a grid."""
LEVEL = 0.1
"""Gap between two contacts on the grid, spacings squared per length, that counts as none: it is no finer."""
HOLDS = 2
"""Number of solves with friction held: the first may find other contacts."""
TRIES = 3
"""Number of start shapes that a search lets come to rest."""
GRID = np.linspace(0.0, 1.0, 33)
"""Where shapes are compared."""


def nodal(rod: Rod, q: np.ndarray, F: np.ndarray) -> NodalRod | None:
    """The equilibrium (q, F) with its friction on a uniform grid of contacts; None if that fails."""
    if not isinstance(rod, TouchingRod) or rod.obstacles is None:
        return None
    points = rod.points[: rod.count]
    forces = points[:, FORCE, None] * rod.normals[: rod.count] + points[:, FRICTION : FRICTION + 3]
    force = max(np.linalg.norm(F), np.linalg.norm(F + rod.f + rod.contact_force()))
    new = NodalRod(rod.K, rod.natural, rod.obstacles, places_for(float(force)), rod.model == COULOMB)
    new.work = max(rod.work, WORK)
    adopted = new.adopt(rod, q, F, points[:, ARC_LENGTH], forces, points[:, OBSTACLE].astype(int))
    return new if adopted else None


def exact(rod: NodalRod, tolerance: float, model: int) -> Found | None:
    """The equilibrium of a nodal rod without its grid, to the tolerance; None if none is found beside it."""
    if model != FRICTIONLESS and rod.touches:
        return _with_friction(rod, tolerance) if model == COULOMB else None
    assert rod.obstacles is not None
    conditions = Conditions(rod.qe, rod.re, rod.f, rod.obstacles)
    first = first_mesh(conditions, float(rod.totals[TWIST]), tolerance)
    left = given = min(rod.work, EXACT_WORK)
    found = None
    for _ in TRIALS:
        if left <= 0.0:
            break
        count, stage = TRIALS[rod.tried % len(TRIALS)]
        mesh = Mesh(first.element, np.full(count, 1.0 / count)) if count else first
        new = TouchingRod(mesh, rod.K, rod.natural, tolerance)
        new.set_conditions(rod.qe, rod.re, rod.f, rod.obstacles)
        new.work = left
        q = rod.mesh.interpolate(rod.state.q, mesh.nodes)
        q[0], q[-1] = rod.state.q[0], rod.state.q[-1]
        result = _taken_over(new, q, rod) if stage is None else descend(new, q, rod.end_force, SETTLE, stage)
        left = new.work
        if result is not None:
            one, estimate = refine(Found.at(new, *result), tolerance)
            if estimate <= tolerance and _same(rod, one):
                found = one
                break
        rod.tried += 1  # if no budget is left, the next pose goes on with the next
    rod.work -= given - left
    return found


def _with_friction(rod: NodalRod, tolerance: float) -> Found | None:
    """As `exact`. Friction is held first, while the shape becomes exact, and then obeys its law again."""
    assert rod.obstacles is not None
    conditions = Conditions(rod.qe, rod.re, rod.f, rod.obstacles)
    mesh = first_mesh(conditions, float(rod.totals[TWIST]), tolerance)
    new = TouchingRod(mesh, rod.K, rod.natural, tolerance)
    new.set_conditions(rod.qe, rod.re, rod.f, rod.obstacles)
    given = new.work = min(rod.work, EXACT_WORK)
    q = rod.mesh.interpolate(rod.state.q, mesh.nodes)
    q[0], q[-1] = rod.state.q[0], rod.state.q[-1]
    q, F = _give_contacts(new, q, rod), rod.end_force
    friction = Friction.of(rod)
    for model in (*(FRICTIONLESS,) * HOLDS, COULOMB):
        friction.give(new)
        new.model, new.ready = model, False
        code, _, q, F = new.correct(q, F, SETTLE.step_tolerance)
        if code != warm_step.ADVANCED:
            break
    rod.work -= given - new.work
    if code != warm_step.ADVANCED:
        return None
    found, estimate = refine(Found.at(new, q, F), tolerance)
    return found if estimate <= tolerance and not found.rod.forgot and _same(rod, found) else None


def _taken_over(new: TouchingRod, q: np.ndarray, rod: NodalRod) -> tuple[np.ndarray, np.ndarray, int] | None:
    """The equilibrium of the `new` rod next to the grid's, from its shape q (n, 4) there and its contacts."""
    q = _give_contacts(new, q, rod)
    code, iterations, q_new, F_new = new.correct(q, rod.end_force, SETTLE.step_tolerance)
    return (q_new, F_new, iterations) if code == warm_step.ADVANCED else None


def _give_contacts(new: TouchingRod, q: np.ndarray, rod: NodalRod) -> np.ndarray:
    """Give the `new` rod of shape q (n, 4) the contacts of the grid; returns the shape on its mesh then."""
    new.trace(q)
    at, which = np.nonzero(rod.lies_on(LEVEL))
    places = np.append(rod.s0, 1.0)[at]
    give_contacts(new, q, which, places, rod.state.lam[at, which], 1.0 / rod.cells)
    return new.fit_patches(q)


class Rest:
    """A last resort of a search: start shapes come to rest on a grid, the least deep inside obstacles first.

    Args:
        sought: the pose; without obstacles there is nothing to try.
    """

    def __init__(self, sought: Sought) -> None:
        self._sought = sought
        self._shapes: list[np.ndarray] | None = None if sought.conditions.obstacles is not None else []

    @property
    def over(self) -> bool:
        """Whether all shapes have been tried."""
        return self._shapes is not None and not self._shapes

    def settle(self) -> tuple[Found | None, float]:
        """The exact equilibrium where the next shape comes to rest, or None; the work that it took."""
        sought, there = self._sought, self._sought.conditions
        assert there.obstacles is not None
        places = places_for(float(np.linalg.norm(there.f)))
        rod = NodalRod(sought.stiffness, sought.natural, there.obstacles, places, coulomb=False)
        rod.set_conditions(there.qe, there.re, there.f)
        if self._shapes is None:
            begins = starts(rod.mesh.nodes, there.qe, there.re, there.f, sought.hint, sought.natural, False)
            self._shapes = sorted(begins, key=rod.depth)[:TRIES]
        rod.work = LIMIT
        rests = rod.begin(self._shapes.pop(0), there.qe, there.re, there.f) is not None
        found = exact(rod, sought.tolerance, FRICTIONLESS) if rests else None
        return found, LIMIT - rod.work


def _same(rod: NodalRod, found: Found) -> bool:
    a = rod.mesh.interpolate(rod.state.q, GRID)
    b = found.rod.mesh.interpolate(found.q, GRID)
    if np.abs(np.sum(a * b, axis=1)).min() < np.cos(0.5 * TURNED):
        return False
    return apart(rod, found) < ALIKE


def apart(rod: NodalRod, found: Found) -> float:
    """Relative difference of the end wrenches."""
    mine = np.concatenate((rod.state.F[-1], rod.g[-1]))
    theirs = np.concatenate((found.F, found.rod.g[-1]))
    return float(relative_change(mine - theirs, theirs, rod.least))
