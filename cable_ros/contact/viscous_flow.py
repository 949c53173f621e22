# SPDX-License-Identifier: Apache-2.0
"""How a cable with friction falls where its branch ends: as in a viscous medium, with friction's memory.

An energy descent would forget what sticks. An implicit Euler step in a medium whose drag is d times the
elastic metric D solves the equations of an equilibrium with d D times the rotations since the step's
beginning added, (H + d D) s = -(g + d D sum s), with contact and friction as in any step. The drag fades as
the motion calms down; at rest it does nothing. A branch that goes on attracts the cable, so one that leaves
in short steps, each of which lowers the energy, shows that its branch has ended.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cable_ros.contact.active_set_rod import ActiveSetRod
from cable_ros.rod import quaternion, warm_step
from cable_ros.rod.elements import Mesh
from cable_ros.rod.rod_state import ENERGY
from cable_ros.rod.without_contact import SAME

FIRST, LARGEST = 0.3, 1e5
"""Drag at first, and the largest, over the elastic stiffness. Where one leg in a corner sticks no more, and
slips the wrong way in any step against less than 400, the cable was lost."""
FADES, GROWS, EASES = 0.3, 3.0, 0.7
"""Factors of the drag after a step that arrived and after one that failed, and, after every step, of the drag
below which it does not go since a step failed."""
CALM, LONGEST = 0.03, 0.3
"""Maximum rotation of a section in a step, rad, after which the drag fades, and of any step."""
STILL = 1e-4
"""Maximum drag times that rotation, rad, of a cable that is all but at rest."""
STEPS = 400
"""Maximum number of steps."""
TOLERANCE, LIMIT = 1e-7, 0.6
"""Of Newton's method in a step: its last rotation, and the maximum of any, rad."""
ROUNDING = 1e-9
"""Relative rise of the energy that is rounding."""
Ends = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""End frame, end position, load per length and obstacles, of `Rod.advance`."""


def flow(
    rod: ActiveSetRod, q: np.ndarray, F: np.ndarray, ends: Ends, passed: Callable[..., bool]
) -> tuple[np.ndarray, np.ndarray, int] | None:
    """Come to rest from (q, F) under new conditions; None if that fails, with the rod as it was.

    Args:
        rod: with friction, at its equilibrium.
        q, F: nodal frames (n, 4) and end force (3,) there.
        ends: the new conditions, a little further along the path.
        passed: whether a step has led through an obstacle, see `TouchingRod.passed_in_contact`.

    Returns:
        The stable equilibrium (q, F), factored, and the number of iterations.
    """
    put_back, trial, then = rod.kept(), rod.trial, rod.then
    rod.trial = True
    drag, last, floor, energy, spent, rests = FIRST, FIRST, 0.0, np.inf, 0, False
    before = slow = np.inf  # rotation in the last step, and what it must be below to come to rest, rad
    for _ in range(STEPS):
        if rod.work <= 0.0 or drag > LARGEST:
            break
        back, mesh, rod.then = rod.kept(), rod.mesh, then
        code, count, arrived = _step(rod, drag, q, F, ends, passed)
        spent += count
        if arrived is not None:
            stored = float(rod.totals[ENERGY])
            moved = _rotation(mesh, q, rod.mesh, arrived[0])
            # another mesh has another energy, by its error, of all but the same shape
            lowers = stored <= energy + ROUNDING * (1.0 + abs(energy))
            remeshed = moved < CALM and len(rod.mesh.lengths) != len(mesh.lengths)
            if moved <= LONGEST and (lowers or remeshed):
                (q, F), then = arrived, SAME
                rests = drag == 0.0
                if rests:
                    break
                energy, floor, last, before = stored, EASES * floor, drag, moved
                if moved < CALM:
                    still = drag * moved < STILL and moved < slow
                    drag = 0.0 if still else max(FADES * drag, floor)
                continue
        back()
        if drag > 0.0:
            drag = floor = GROWS * drag
        elif code == warm_step.NOT_CONVEX:
            # slow because it has only begun to leave: it comes to rest after it has slowed down again
            drag, slow = FADES * last, 0.5 * before
        else:
            drag = floor = last
    rod.drag, rod.trial, rod.ready, rod.then = 0.0, trial, False, SAME
    if rests:  # `_step` has judged and factored it
        return q, F, spent
    put_back()
    return None


def _step(
    rod: ActiveSetRod, drag: float, q: np.ndarray, F: np.ndarray, ends: Ends, passed: Callable[..., bool]
) -> tuple[int, int, tuple[np.ndarray, np.ndarray] | None]:
    """Code and iterations of a step against this drag, and where it arrives; None if it does not."""
    mesh, before, held = rod.mesh, rod.obstacles, rod.touched()
    rod.drag, rod.ready, rod.refactor_at = drag, False, 0.0  # a step against too little drag leads across
    code, count, q_new, F_new = rod.step_in_contact(q, F, *ends[:3], TOLERANCE, LIMIT, ends[3], drag == 0.0)
    if code != warm_step.ADVANCED or passed(q, F, q_new, F_new, mesh, before, held):
        return code, count, None
    if drag == 0.0 and not rod.refactor(q_new, F_new):
        return warm_step.NOT_CONVEX, count, None
    return code, count, (q_new, F_new)


def _rotation(mesh: Mesh, q: np.ndarray, mesh_new: Mesh, q_new: np.ndarray) -> float:
    """Largest rotation of a section, rad, from q (n, 4) on one mesh to q_new (k, 4) on another."""
    return quaternion.largest_rotation(mesh.interpolate(q, mesh_new.nodes), q_new)
