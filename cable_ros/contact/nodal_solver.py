# SPDX-License-Identifier: Apache-2.0
"""Equilibria of a rod whose contacts sit at fixed material points: Newton's method and a viscous flow."""

from __future__ import annotations

import numpy as np

from cable_ros.contact.distance import FRICTION_COEFFICIENT
from cable_ros.contact.nodal_contacts import NORMAL, TANGENTIAL, NodalContacts
from cable_ros.contact.nodal_kernels import COMPLIANCE, OPEN, SLIP, carry_history
from cable_ros.contact.nodal_newton import CONVERGED, extrapolate, newton
from cable_ros.contact.nodal_state import Step
from cable_ros.rod.initial_shapes import SIDE
from cable_ros.rod.rod_state import ENERGY
from cable_ros.solve.trust_region import Options

SOFT = 1e-5
"""Compliance of stick, L^3 / EI, at which a solve that failed is tried again first."""
RIGID = 1e-8
"""The same where a cable comes down fast, in the first trial. As its end is laid flat, the last 2 % of its
height move it by 1e-5 L along itself: with COMPLIANCE that hardly mobilises friction, and the end force is
5 % too small."""
KEPT = 1e-3
"""Scale of the projections in the first iteration, EI / L^3: so small that what touched still does, however
far an obstacle goes in a step."""
TOLERANCE = 1e-8
"""Of Newton's method: rotations, positions, relative forces."""
ROUGH = 1e-3
"""The same, of a solve that only leads to the next."""
DRAG, FREE, STIFFEST = 1e4, 1e-5, 1e7
"""Drag in a flow, EI / L^4: at first, below which it counts as none, and the largest."""
CALM = 0.003
"""Motion in a step of a flow, L, below which the drag is reduced tenfold."""
ROUNDING = 1e-9
"""Relative rise of the energy in a step of a flow that is rounding."""
DRAGS = 80
"""Maximum number of steps of a flow."""
ASIDE = 0.05
"""Fraction of the weight, and of 1 EI / L^3, that acts sideways at first, see `initial_shapes.SIDE`."""
FLOW_COST = 600
"""Maximum number of iterations of a flow."""


class NodalSolver(NodalContacts):
    """A rod in units of the cable whose contacts sit at the inner boundaries of its elements.

    Each solve starts from the last equilibrium, with its friction.
    """

    def _solve(
        self, qe: np.ndarray, re: np.ndarray, f: np.ndarray, obstacles: np.ndarray, drag: float,
        give: np.ndarray | None = None, rigid: bool = False, cycles: bool = False,
    ) -> tuple[int, int]:  # fmt: skip
        """Newton's method from the last equilibrium; on failure the state is what it was.

        `rigid`: whether it is tried first with what sticks rigid; `cycles`: whether, against drag, it is
        tried with a soft stick as well.
        """
        state, kept = self.state, self.state.copy()
        if not self.coulomb:
            obstacles = obstacles.copy()
            obstacles[:, FRICTION_COEFFICIENT] = 0.0
        carried, turned = np.empty((*state.lam.shape, 3)), np.empty((*state.lam.shape, 3))
        carry_history(state.r, self.frames, self._under, obstacles, carried, turned)
        qe = qe if state.q[-1] @ qe > 0.0 else -qe
        spent = 0
        alike = np.full(state.lam.shape, COMPLIANCE)
        stiff = NORMAL, TANGENTIAL, alike if give is None else give
        soft = NORMAL, 1.0 / SOFT, np.full(state.lam.shape, SOFT)
        hard = (NORMAL, TANGENTIAL, np.full(state.lam.shape, RIGID)) if rigid else stiff
        # whether it is extrapolated, whether only what touched touches at first, and the scales in turn
        trials = (
            (True, True, (hard,)), (False, True, (stiff,)),
            (False, False, (stiff,)), (False, False, (soft, stiff)),
        )  # fmt: skip
        for predict, keep, stages in trials if drag == 0.0 else trials[2 : 4 if cycles else 3]:
            goes_on = predict and self._moved and extrapolate(state, self.before, re, drag)
            if predict and not (goes_on or rigid):
                continue
            code = CONVERGED
            for scales in stages:
                step = Step(qe, re, f, obstacles, carried, turned, kept.tau, kept.q, kept.r, drag, *scales)
                first = step._replace(normal=KEPT, tangential=KEPT) if keep else step
                code, count = newton(
                    state, self._model, first, step, self._work, self._tangents, self._rows, self._band,
                    self._trial, ROUGH if scales is soft else TOLERANCE,
                )  # fmt: skip
                spent += count
                self.work -= count * self.iteration_work
                if code != CONVERGED:
                    break
            if code == CONVERGED:
                self._step = step
                self._settle(qe, re, f, obstacles, turned)
                return code, spent
            state.take(kept)
        return code, spent

    def _settle(
        self, qe: np.ndarray, re: np.ndarray, f: np.ndarray, obstacles: np.ndarray, turned: np.ndarray
    ) -> None:
        self.set_conditions(qe, re, f)
        self.wrench = np.concatenate((self.state.F[-1], self.g[-1]))
        self.obstacles = self._under = obstacles
        self.frames = turned
        kinds, state = self._work.kinds, self.state
        state.lam[kinds == OPEN] = 0.0
        state.tau[kinds == OPEN] = 0.0
        self._slips = (kinds == SLIP) & (state.lam > 0.0)
        self._pressed()  # the directions across go along with the normal from here on
        self._weigh()
        self.rotation, self.rotation_before = 0.0, 0.0

    def minimum(
        self, q: np.ndarray, F: np.ndarray, options: Options
    ) -> tuple[np.ndarray, np.ndarray, int] | None:
        """Where the cable comes to rest under the conditions set, in a viscous medium.

        Implicit Euler steps of that flow: friction keeps its history, and unstable equilibria are left.
        """
        assert self.obstacles is not None
        spent = self._leant(self.qe, self.re, self.f, self.obstacles)
        return None if spent is None else (self.shape, self.end_force, spent)

    def begin(self, q: np.ndarray, qe: np.ndarray, re: np.ndarray, f: np.ndarray) -> int | None:
        """Bring a shape q (n, 4), free of forces, to rest; number of iterations, or None if that fails."""
        assert self.obstacles is not None
        state = self.state
        for part in state:
            part[:] = 0.0
        state.q[:] = q
        self._integrate()
        self._under, self._moved = self.obstacles, False
        return self._leant(qe, re, f, self.obstacles)

    def _leant(self, qe: np.ndarray, re: np.ndarray, f: np.ndarray, obstacles: np.ndarray) -> int | None:
        """As `_flow`, with a small load in a fixed direction of the start clamp's frame at first.

        Of two mirror images the cable takes the one on that side, whatever the last bit.
        """
        aside = ASIDE * (1.0 + float(np.linalg.norm(f))) * SIDE
        leant = self._flow(qe, re, f + aside, obstacles)
        spent = None if leant is None else self._flow(qe, re, f, obstacles)
        if leant is None or spent is None or not self._stable():
            return None
        return leant + spent

    def _flow(
        self, qe: np.ndarray, re: np.ndarray, f: np.ndarray, obstacles: np.ndarray,
        give: np.ndarray | None = None,
    ) -> int | None:  # fmt: skip
        """Come to rest in a viscous medium; iterations, or None if that fails, with the state as it was.

        Energy only falls: an implicit step that raises it is so long that it leads back to an unstable
        equilibrium, and is made again shorter.
        """
        known, energy = self._known(), np.inf
        drag, slow, failed, spent = DRAG, DRAG, 0.0, 0
        fails = 0  # in a row: what stays in spite of more drag is a cycle of stick and slip
        springs = COMPLIANCE if give is None else give[:, :, None]  # of what sticks
        self._moved = False
        for _ in range(DRAGS):
            here = self._known()
            code, count = self._solve(qe, re, f, obstacles, drag, give, cycles=fails > 0)
            fails = 0 if code == CONVERGED else fails + 1
            spent += count
            stored = self.totals[ENERGY] + 0.5 * float((springs * self.state.tau**2).sum())
            rises = code == CONVERGED and stored > energy + ROUNDING * (1.0 + abs(energy))
            if code == CONVERGED and drag == 0.0 and not rises:
                return spent
            if spent > FLOW_COST:
                break
            if rises:
                self._return(here)
                drag = 3.0 * drag if drag > 0.0 else slow
            elif code == CONVERGED:
                energy, slow = stored, drag
                gone = float(np.abs(self.state.r - here.state.r).max())
                failed = failed if drag > failed else 0.0
                fast = gone < CALM and 0.1 * drag > failed
                drag *= 0.1 if fast else 0.5 if gone < 10.0 * CALM else 1.0
                drag = 0.0 if drag < FREE and gone < CALM else drag
            elif drag == 0.0:
                drag = 10.0 * FREE
            elif drag < STIFFEST:
                failed = drag
                drag *= 5.0
            else:
                break
        self._return(known)
        return None
