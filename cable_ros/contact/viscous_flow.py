# SPDX-License-Identifier: Apache-2.0
"""How a cable with friction falls where its branch ends: as in a viscous medium, with friction's memory.

An energy descent would forget what sticks. An implicit Euler step in a medium whose drag is d times the
elastic metric D solves the equations of an equilibrium with d D times the rotations since the step's
beginning added, (H + d D) s = -(g + d D sum s), with contact and friction as in any step. The drag fades as
the motion calms down; at rest it does nothing. A branch that goes on attracts the cable, so one that leaves
in short steps, each of which lowers the energy, shows that its branch has ended.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cable_ros.contact.active_set_rod import ActiveSetRod
from cable_ros.contact.penalty_continuation import GRID
from cable_ros.contact.symmetry import GRID as EVENLY
from cable_ros.contact.symmetry import is_even, side_of
from cable_ros.rod import quaternion, warm_step
from cable_ros.rod.elements import Mesh
from cable_ros.rod.kirchhoff import Rod
from cable_ros.rod.rod_state import ENERGY
from cable_ros.rod.without_contact import SAME

FIRST, LARGEST = 0.3, 1e5
"""Drag at first, and the largest, over the elastic stiffness. Where one leg in a corner sticks no more, and
slips the wrong way in any step against less than 400, the cable was lost."""
FADES, GROWS, EASES = 0.3, 3.0, 0.7
"""Factors of the drag after a step that arrived and after one that failed, and, after every step, of the drag
below which it does not go since a step failed."""
FEW, FASTER, MOST_FAILS, RETURNS = 2, 10.0, 4, 10
"""Number of steps that failed in a row after which the drag grows faster; its factor then, and where the fall
goes back by a step; the number after which it does, and by how many steps at most."""
CALM, LONGEST = 0.03, 0.05
"""Maximum rotation of a section in a step, rad, after which the drag fades, and of any step."""
STILL = 1e-4
"""Maximum drag times that rotation, rad, of a cable that is all but at rest."""
STEPS = 1500
"""Maximum number of steps."""
TOLERANCE, LIMIT = 1e-7, 0.6
"""Of Newton's method in a step: its last rotation, and the maximum of any, rad."""
MOST_WORK = 1_500_000.0
"""Maximum work of a fall in all calls, iterations times unknowns: hoses that slid from link to link took up
to 580,000."""
ROUNDING = 1e-9
"""Relative rise of the energy that is rounding."""
SAME_ENDS = 1e-9
"""Maximum difference of conditions that are the same: they are computed from another fraction of the path."""
LEAN = 3e-3
"""How far a cable that is its own image leans to a side by rule before it falls, root of twice the elastic
energy: more than its mesh and rounding make it uneven."""
Ends = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""End frame, end position, load per length and obstacles, of `Rod.advance`."""
Passed = Callable[..., bool]


class Behind(NamedTuple):
    """Where a fall was before a step."""

    at: tuple[np.ndarray, np.ndarray]
    """Nodal frames (n, 4) and end force (3,)."""
    back: Callable[[], None]
    """Puts the rod there."""
    then: tuple[float, float]
    """See `Rod.then`."""
    energy: float
    """EI / L."""
    drag: float
    """Of the step."""


class Flow:
    """A fall: how far it has come, so that it can go on in the next call.

    Args:
        rod: with friction, at its equilibrium.
        q, F: nodal frames (n, 4) and end force (3,) there.
        ends: the new conditions, a little further along the path.
    """

    def __init__(self, rod: ActiveSetRod, q: np.ndarray, F: np.ndarray, ends: Ends) -> None:
        self.ends = ends
        self.pulled = F
        """End force (3,) where it began."""
        self.iterations = 0
        self.rest = 1.0
        """Where `ends` is on the path that is left, a fraction of it."""
        self._at, self._there, self._then = (q, F), rod.kept(), rod.then
        self._drag, self._last, self._floor, self._energy = FIRST, FIRST, 0.0, np.inf
        # rotation in the last step, and the most with which it may come to rest, rad
        self._before = self._slow = np.inf
        self._turned = np.zeros((len(GRID), 3))  # rotations in the last step, rad
        self._behind: deque[Behind] = deque(maxlen=RETURNS)
        self._left, self._steps, self._fails = MOST_WORK, STEPS, 0

    def leads_to(self, ends: Ends) -> bool:
        """Whether these are the conditions under which it falls, but for rounding."""
        return all(np.allclose(a, b, 0.0, SAME_ENDS) for a, b in zip(self.ends, ends, strict=True))

    def go(self, rod: ActiveSetRod, passed: Passed) -> tuple[np.ndarray, np.ndarray] | None:
        """Fall until the cable rests or the rod's work is used up; None if it does not rest, with the rod,
        which is where the fall began, as it was.

        Args:
            rod: at the equilibrium from which it falls.
            passed: whether a step has led through an obstacle, see `TouchingRod.passed_in_contact`.

        Returns:
            The stable equilibrium, factored: nodal frames (n, 4) and end force (3,).
        """
        put_back, trial, given = rod.kept(), rod.trial, rod.work
        self._there()
        rod.trial, rests = True, False
        while rod.work > 0.0 and not (rests or self.over):
            rests = self._go_on(rod, passed)
            self._steps -= 1
        self._left -= given - rod.work
        rod.drag, rod.carried, rod.trial, rod.ready, rod.then = 0.0, False, trial, False, SAME
        if rests:  # `_step` has judged and factored it
            return self._at
        self._there = rod.kept()
        put_back()
        return None

    @property
    def over(self) -> bool:
        """Whether it cannot be followed to its end."""
        return self._steps <= 0 or self._left <= 0.0 or self._drag > LARGEST

    def _go_on(self, rod: ActiveSetRod, passed: Passed) -> bool:
        """One step of the fall; whether it ends at rest."""
        q, F = self._at
        back, mesh, rod.then = rod.kept(), rod.mesh, self._then
        # against much drag the motion of the clamps alone may cost too much, or hold what would slip astray
        rod.carried = self._fails >= FEW and self._fails % 2 == 0
        code, count, arrived = _step(rod, self._drag, q, F, self.ends, passed)
        self.iterations += count
        if arrived is not None:
            stored = float(rod.totals[ENERGY])
            turned = _rotations(mesh, q, rod.mesh, arrived[0])
            moved = float(np.linalg.norm(turned, axis=1).max())
            # another mesh has another energy, by its error, of all but the same shape
            lowers = stored <= self._energy + ROUNDING * (1.0 + abs(self._energy))
            remeshed = moved < CALM and len(rod.mesh.lengths) != len(mesh.lengths)
            # nothing swings in a medium: one that turns back has been led across a ridge
            swings = moved > CALM and float(np.sum(turned * self._turned)) < 0.0
            if moved <= LONGEST and (lowers or remeshed) and not swings:
                self._behind.append(Behind(self._at, back, self._then, self._energy, self._drag))
                self._at, self._then, self._fails, self._turned = arrived, SAME, 0, turned
                if self._drag == 0.0:
                    return True
                self._energy, self._floor = stored, EASES * self._floor
                if len(self._behind) == 1 and (ahead := leaning(rod, arrived[0])) is not arrived[0]:
                    self._at, self._energy = (ahead, arrived[1]), np.inf  # to lean takes energy
                self._last, self._before = self._drag, moved
                if moved < CALM:
                    still = self._drag * moved < STILL and moved <= self._slow
                    self._drag = 0.0 if still else max(FADES * self._drag, self._floor)
                return False
        back()
        self._fails += 1
        if self._drag > 0.0:
            self._drag = self._floor = (GROWS if self._fails <= FEW else FASTER) * self._drag
            if (self._fails > MOST_FAILS or self._drag > LARGEST) and self._behind:
                # from this shape no drag leads on: what sticks and what slips changes in turn
                self._at, back, self._then, self._energy, drag = self._behind.pop()
                back()
                self._drag = self._floor = FASTER * drag
                self._fails, self._turned = 0, np.zeros_like(self._turned)
        else:
            # slow because it has only begun to leave: it comes to rest after it has slowed down again
            self._slow = 0.5 * self._before
            if code == warm_step.NOT_CONVEX:
                self._drag = FADES * self._last
            else:
                self._drag = self._floor = self._last
        return False


def _step(
    rod: ActiveSetRod, drag: float, q: np.ndarray, F: np.ndarray, ends: Ends, passed: Passed
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


def leaning(rod: Rod, q: np.ndarray) -> np.ndarray:
    """Frames (n, 4) from which the factored rod, at q (n, 4), falls to a side by rule if it is its own image.

    They are beside q, along its softest mode; else q itself.
    """
    if not is_even(rod.mesh.interpolate(q, EVENLY), rod.re):
        return q
    rod._softest()  # which finds that mode
    ahead, back = (rod.on_end(rod.retract(q, lean * rod.mode)) for lean in (LEAN, -LEAN))
    return ahead if side_of(rod.mesh, ahead) > side_of(rod.mesh, back) else back


def _rotations(mesh: Mesh, q: np.ndarray, mesh_new: Mesh, q_new: np.ndarray) -> np.ndarray:
    """Rotations (33, 3) of the sections at GRID, rad, from q (n, 4) on a mesh to q_new (k, 4) on another."""
    before, after = mesh.interpolate(q, GRID), mesh_new.interpolate(q_new, GRID)
    back = [quaternion.multiply(quaternion.conjugate(a), b) for a, b in zip(before, after, strict=True)]
    return np.array([quaternion.rotation_vector(one) for one in back])
