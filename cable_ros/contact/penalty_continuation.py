# SPDX-License-Identifier: Apache-2.0
"""Penalty continuation: stable equilibria of a cable that touches, by descents with stiffer and stiffer
obstacles.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cable_ros.contact.active_set_rod import ActiveSetRod
from cable_ros.contact.distance import POSE
from cable_ros.contact.edge_rounding import remove_rounding, rounded
from cable_ros.contact.friction_kernels import COULOMB, FRICTIONLESS, SLIDING
from cable_ros.contact.penalty import PenaltyProblem
from cable_ros.contact.points import ARC_LENGTH, FORCE, FRICTION, INTERFACE, OBSTACLE
from cable_ros.contact.response import HELD, NOTHING
from cable_ros.contact.symmetry import leaves_plane
from cable_ros.rod import warm_step
from cable_ros.solve.trust_region import Options, minimize

SPRINGS = (3e4, 3e6, 3e8, 1e10)
"""Stiffness of the obstacles, EI / L^4, in turn: the first leads past them, the last shows what touches."""
DENSITIES = (1, 1, 2, 3)
"""Number of samples with each of them, over that which the tolerance asks for, if the cable may be taut."""
NEAR, FAR = 2, 1
"""The first of them from a shape whose contacts are right, as softer obstacles could let it through, and of a
snap-through that leads away from them."""
LAID, QUADRATURE = 1e-5, 1e-8
"""Last step on a foundation, and relative error of its energy by the rule that integrates it."""
SUNK = (np.inf, 0.03, 3e-3)
"""Maximum depth after the first, second, and later descents, L: a cable that is deeper stays inside."""
DESCENT_OPTIONS = Options(
    radius=0.1, largest_radius=0.3, iterations=60, step_tolerance=1e-8, constraint_tolerance=1e-8
)
"""For a descent that must not leave its basin."""
MOST_HARDER = 100
"""Maximum number of iterations of a descent among harder obstacles from where one among softer ones ended."""
SOFT = 2
"""Work of an iteration among soft obstacles over that of another: each tries several radii."""
SHARE = 0.3
"""Maximum fraction of the budget spent on a descent for a step that failed: a shorter step may not fail."""
PRESSES = 1e-2
"""Force over the end's, above which a contact beside a clamp must not go within a descent."""
GRID = np.linspace(0.0, 1.0, 33)
"""Where shapes are compared."""


def descend(
    rod: ActiveSetRod, q: np.ndarray, F: np.ndarray, options: Options, first: int = 0, taut: bool = False,
    foundation: bool = False, round_edges: bool = True,
) -> tuple[np.ndarray, np.ndarray, int] | None:  # fmt: skip
    """The stable equilibrium with contact where a descent from (q, F) ends: q, F, iterations; or None.

    The obstacles are springs at first, SPRINGS[first] and on, which any shape can start from. A cable that
    may be `taut` bends about them within short lengths; one that slides off edges needs a `foundation`,
    see `press`. Contacts and mesh are put back where it fails.
    """
    assert rod.obstacles is not None
    sharp, kept, mesh, give = rod.obstacles, rod.state(), rod.mesh, rod.end_compliance
    rod.yield_at_end(HELD)
    if round_edges:
        rod.obstacles = rounded(sharp)
    found = _descend(rod, q, F, options, first, taut, foundation)
    if found is not None and rod.obstacles is not sharp:
        total = found[2]
        found = remove_rounding(rod, found[0], found[1], sharp, options.step_tolerance)
        found = None if found is None else (found[0], found[1], total + found[2])
    rod.obstacles = sharp
    rod.yield_at_end(give)
    if found is None:
        rod.restore(kept, mesh)
    return found


Descent = Callable[
    [ActiveSetRod, np.ndarray, np.ndarray, Options, int], tuple[np.ndarray, np.ndarray, int] | None
]
"""As `descend`, with its first arguments."""


def _descend(
    rod: ActiveSetRod, q: np.ndarray, F: np.ndarray, options: Options, first: int, taut: bool,
    foundation: bool,
) -> tuple[np.ndarray, np.ndarray, int] | None:  # fmt: skip
    """`descend` among the rod's obstacles as they are; leaves the rod where it fails."""
    assert rod.obstacles is not None
    before, total, energy = rod.points[: rod.count].copy(), 0, 0.0
    for stage in range(first, len(SPRINGS)):
        if rod.work <= 0.0:
            break
        stiffness = SPRINGS[stage]
        rod.count = 0
        if taut:
            rod.densify(DENSITIES[stage])
        soft = PenaltyProblem(rod, stiffness, foundation)
        iterations = options.iterations if stage == first else min(options.iterations, MOST_HARDER)
        most = max(1, int(min(iterations, rod.work / (SOFT * rod.elastic.shape[0]))))
        now = replace(options, iterations=most)
        if foundation:
            now = replace(now, step_tolerance=LAID, noise=QUADRATURE)
        try:
            result = minimize(soft, q, F, now)
        except np.linalg.LinAlgError:  # the springs' rows depend on each other
            break
        total += result.iterations
        rod.spend(SOFT * result.iterations)
        if not (result.converged or result.stalled):  # springs have kinks, contacts do not
            break
        q, F = result.x, result.y
        rod.ready = False
        if stage == first and _known(rod, q, result.objective):
            break
        if stage > 0 and soft.phi[:, 1:-1].min(initial=0.0) < -SUNK[min(stage, len(SUNK) - 1)]:
            break  # it has passed the obstacle's middle: the springs keep it inside
        with_softer, energy = energy, soft.to_contacts(q)
        if energy > with_softer > 0.0:
            break  # that of springs falls as 1 / stiffness, unless the cable is through the obstacle
        _inherit(rod, before)
        if not rod.count and rod.clear(q):
            return (q, F, total) if rod.refactor(q, F) else None
        if taut:
            q = rod.resolve(q, F)
        q = rod.fit_patches(q)
        code, iterations, q_new, F_new = rod.correct(q, F, options.step_tolerance)
        if code == warm_step.ADVANCED:
            return q_new, F_new, total + iterations
        # beside a fold there may be no equilibrium whose contacts bear within an element
        q = rod.fit(q)
    return None


def descend_instead(
    rod: ActiveSetRod, q: np.ndarray, F: np.ndarray, qe: np.ndarray, re: np.ndarray, f: np.ndarray,
    limit: float, obstacles: np.ndarray, failed: tuple[int, int, np.ndarray, np.ndarray],
    descent: Descent = descend,
) -> tuple[int, int, np.ndarray, np.ndarray]:  # fmt: skip
    """A `descent` with soft obstacles, for a step whose contacts change so much that Newton's method fails.

    Taken only if it ends near the shape before, as a continued branch does; else returns `failed`.
    """
    assert rod.obstacles is not None
    motion = float(np.abs(re - rod.re).max() + np.abs(obstacles[:, POSE] - rod.obstacles[:, POSE]).max())
    end = qe if q[-1] @ qe > 0.0 else -qe
    motion += 2.0 * float(np.abs(q[-1] - end).max())
    if rod.model == COULOMB:
        return failed  # a descent knows nothing of the history of this friction
    if rod.patience <= 0 or rod.work <= 0.0:
        return failed
    if rod.model == FRICTIONLESS and not rod.short:
        return failed  # a shorter step costs less than a descent, which may leave a branch that goes on
    rod.patience -= 1
    before, kept, direction = (rod.qe, rod.re, rod.f, rod.obstacles), rod.state(), rod.direction
    ahead = re - rod.re
    against = ahead / np.linalg.norm(ahead) if ahead.any() else direction
    mesh, shape = rod.mesh, rod.mesh.interpolate(q, GRID)
    rod.set_conditions(qe, re, f, obstacles)
    start = q.copy()
    start[-1] = end
    kept_back = (1.0 - SHARE) * rod.work if np.isfinite(rod.work) else 0.0
    rod.work -= kept_back
    rod.direction = NOTHING  # mobilised friction has no history, and is mobilised again where it arrives
    found = descent(rod, start, F, DESCENT_OPTIONS, FAR)
    code = warm_step.ADVANCED
    if found is not None and rod.model == SLIDING:
        code, more, q_new, F_new = rod.mobilise(
            found[0], found[1], NOTHING, against, DESCENT_OPTIONS.step_tolerance, limit
        )
        found = q_new, F_new, found[2] + more
    rod.work += kept_back
    if found is not None and code == warm_step.ADVANCED:
        after = rod.mesh.interpolate(found[0], GRID)
        moved = 2.0 * np.sqrt(max(0.0, 1.0 - float(np.abs(np.sum(shape * after, axis=1)).min()) ** 2))
        near = moved < min(limit, 0.02 + 20.0 * motion) and not leaves_plane(q, found[0], qe, re)
        if near and not drops(rod, kept[0], found[1]):
            rod.rotation = 0.0
            return warm_step.ADVANCED, failed[1] + found[2], found[0], found[1]
    rod.restore(kept, mesh)
    rod.set_conditions(*before)
    rod.direction = direction
    return failed


def drops(rod: ActiveSetRod, before: np.ndarray, F: np.ndarray) -> bool:
    """Whether a contact beside a clamp, which pressed before, has gone: the clamp may bear it all the same.

    A dip so close to a clamp is shallow whatever the force that it hides. F: (3,) the end force.
    """
    here = rod.points[: rod.count, ARC_LENGTH]
    for point in before[before[:, FORCE] > PRESSES * float(np.linalg.norm(F))]:
        for away, others in ((point[ARC_LENGTH], here), (1.0 - point[ARC_LENGTH], 1.0 - here)):
            if away < 0.5 * rod.spacing and not (others < 2.0 * away).any():
                return True
    return False


def _inherit(rod: ActiveSetRod, before: np.ndarray) -> None:
    """Give every contact point the ratio of friction to force of the nearest of those `before`."""
    for point in rod.points[: rod.count]:
        same = before[(before[:, OBSTACLE] == point[OBSTACLE]) & (before[:, FORCE] > 0.0)]
        if len(same):
            nearest = same[np.argmin(np.abs(same[:, ARC_LENGTH] - point[ARC_LENGTH]))]
            point[FRICTION:INTERFACE] = nearest[FRICTION:INTERFACE] * point[FORCE] / nearest[FORCE]


def _known(rod: ActiveSetRod, q: np.ndarray, energy: float) -> bool:
    """Whether the search has found this state of the soft obstacles before."""
    if rod.seen is None:
        return False
    # mirror images have the same energy
    state = np.append(rod.mesh.interpolate(q, np.array([0.25, 0.5, 0.75])).ravel(), energy)
    for other in rod.seen:
        cosines = np.abs(np.sum(state[:-1].reshape(3, 4) * other[:-1].reshape(3, 4), axis=1))
        if cosines.min() >= 1.0 - 1e-5 and abs(state[-1] - other[-1]) < 1e-5 * (1.0 + abs(energy)):
            return True
    rod.seen.append(state)
    return False
