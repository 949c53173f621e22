# SPDX-License-Identifier: Apache-2.0
"""A cable whose contacts sit at fixed material points: robust, and it keeps friction's history.

`TouchingRod` places contacts at any arc length and adapts its mesh to them: exact, but it can lose its way
where many contacts change at once. This rod has a uniform mesh and looks for contact in the middles of equal
cells only. It carries a step that the other cannot, to an accuracy that the grid limits.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cable_ros.contact.distance import FRICTION_COEFFICIENT, gap, gaps
from cable_ros.contact.nodal_kernels import (
    COMPLIANCE,
    OPEN,
    SLIP,
    carry_history,
    contact_frames,
    residuals,
    tangent_frame,
)
from cable_ros.contact.nodal_newton import CONVERGED, extrapolate, newton
from cable_ros.contact.nodal_response import contact_tangents, standing, wrench_response
from cable_ros.contact.nodal_stability import ITERATIONS, softest
from cable_ros.contact.nodal_state import ORDER, Model, State, Step, spaces, workplace
from cable_ros.contact.nodal_tangent import jacobian
from cable_ros.contact.travel import FRICTION_LEAST, FRICTION_STEP, SHORTER, stride, travel
from cable_ros.linalg.band_lu import band_factor
from cable_ros.rod import quaternion, warm_step
from cable_ros.rod.elements import Mesh, reference_element
from cable_ros.rod.initial_shapes import SIDE
from cable_ros.rod.kirchhoff import Rod
from cable_ros.rod.rod_state import ENERGY, Evaluation, Grid, Section, Tangents
from cable_ros.rod.units import relative_change
from cable_ros.solve.trust_region import Options

FEWEST, MOST = 80, 192
"""Number of places where it may touch."""
TWIN = 0.75
"""The twin that tells the error has so many times as many."""
LAYER = 11.0
"""Number of them along the length (EI / F)^1/2 over which a cable bends under its force F."""
NORMAL, TANGENTIAL = 1e4, 1e6
"""Scales of the projections of normal force and friction, EI / L^3."""
STEP = 0.5 * FRICTION_STEP
"""Longest step, lengths."""
FADING = 0.95
"""An estimated error is no less than so much of the last step's: where contacts stand between places it may
be nothing by chance."""
CORNER = 0.02
"""Part of the longest step by which the twin may lag: a path that turns back must not be cut short."""
SOFT = 1e-5
"""Compliance of stick, L^3 / EI, at which a solve that failed is tried again first."""
SEED = 2e-5
"""Motion, lengths, by which stick gives way at most while an equilibrium of another rod is taken over. What
sticks hardly moves, and friction along a patch hardly changes."""
ASIDE = 0.05
"""Part of the weight, and of 1 EI / L^3, that acts aside at first, see `initial_shapes.SIDE`."""
FAINT = 1e-2
"""Friction, EI / L^2, that counts as none there."""
TOLERANCE = 1e-8
"""Of Newton's method: rotations, positions, relative forces."""
ROUGH = 1e-3
"""Of a solve that only leads to the next."""
DRAG, FREE, STIFFEST = 1e4, 1e-2, 1e7
"""Drag in a fall, EI / L^4: at first, below which it counts as none, and the most."""
CALM = 0.003
"""Motion in a step of a fall, lengths, below which the drag is reduced tenfold."""
DRAGS = 80
"""Maximum number of steps of a fall."""
LEAP, LEAST_LEAP = 10.0, 2e-3
"""A step leads no place of the cable farther than so many times what is led, and so much more, lengths."""
RARE = 0.2
"""Part of the longest step below which a step that fails is made in a viscous medium."""
FIRST = np.array([1.0, 0.0, 0.0])
"""The first direction of a contact's frame before anything has touched, but for its part along the normal."""
FLOW_COST = 300
"""Iterations after which a fall is given up."""


def cells(count: int) -> Mesh:
    """The mesh whose inner boundaries are the middles of `count` equal cells.

    Each contact stands for one cell. With a contact at the ends of cells the clamps would bear half of one.
    """
    lengths = np.full(count + 1, 1.0 / count)
    lengths[[0, -1]] *= 0.5
    return Mesh(reference_element(ORDER), lengths)


def places_for(force: float) -> int:
    """Number of places that a cable wants whose internal force, EI / L^2, is at most `force`."""
    return int(np.clip(32 * np.ceil(LAYER / 32 * np.sqrt(force)), FEWEST, MOST))


class Known(NamedTuple):
    """What is known of an equilibrium with m elements and o obstacles, to make a rod that stands there."""

    state: State
    frames: np.ndarray
    """(m + 1, o, 3) the first direction of each contact's frame."""
    slips: np.ndarray
    """(m + 1, o) bool, which contacts slip."""
    step: Step | None
    """The step that led there."""
    under: np.ndarray
    """(o, WIDTH) the obstacles there."""
    conditions: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]
    """What is asked for: end frame (4,), end position (3,), load (3,) and obstacles (o, WIDTH)."""

    def rod(self, like: NodalRod, stiffness: np.ndarray, natural: np.ndarray, scale: float = 1.0) -> NodalRod:
        """A rod without a twin at this equilibrium, with the cells and the friction of the rod `like`.

        Args:
            stiffness, natural: as in `Rod`.
            scale: of forces, new unit over old.
        """
        new = NodalRod(stiffness, natural, self.under, like.cells, like.coulomb)
        new.state.take(self.state)
        for forces in (new.state.F, new.state.lam, new.state.tau):
            forces /= scale
        new.frames, new._slips = self.frames.copy(), self.slips
        if self.step is not None:
            f, tau = self.step.f / scale, self.step.tau / scale
            new._step = self.step._replace(f=f, tau=tau, turned=new.frames)
        qe, re, f, obstacles = self.conditions
        new.set_conditions(qe, re, f / scale, obstacles)
        return new


class NodalRod(Rod):
    """A rod in units of the cable whose contacts sit at the inner boundaries of its elements.

    Args:
        stiffness, natural: as in `Rod`.
        obstacles: (o, WIDTH) that it may touch.
        places: number of places where it may touch, each in the middle of a cell; see `places_for`.
        coulomb: whether obstacles rub.
    """

    few = 25
    cost = 0.5
    remembers = True

    def __init__(
        self, stiffness: np.ndarray, natural: np.ndarray | None, obstacles: np.ndarray,
        places: int = FEWEST, coulomb: bool = True,
    ) -> None:  # fmt: skip
        self.cells = places
        super().__init__(cells(self.cells), stiffness, natural)
        self.coulomb = coulomb
        elements, count = len(self.h), len(obstacles)
        self.state, self.before = State.zeros(elements, count), State.zeros(elements, count)
        self._trial = State.zeros(elements, count)
        self.obstacles, self._under = obstacles, obstacles  # asked for, and at the last equilibrium
        self.twin: NodalRod | None = None
        self.tried = 0  # trials that found no exact equilibrium beside it, see `handover.exact`
        self.follows = False  # whether it is a twin, which takes the other's steps
        self._estimate = np.inf
        self._size = 0, 0
        self.frames = np.zeros((elements + 1, count, 3))
        self.frames[:] = FIRST
        self._slips = np.zeros((elements + 1, count), bool)
        self._step: Step | None = None
        self._moved = False  # whether `before` is the equilibrium before the last
        evaluation, tangents, _ = self.saddle
        self._model = Model(np.zeros(3), Section(self.K, self.natural), Grid(self.h, self.s0, self.tables))
        self._work = workplace(Evaluation(*evaluation), elements, count)
        self._tangents = Tangents(*tangents)
        self._rows, self._band = spaces(elements, count)

    @property
    def shape(self) -> np.ndarray:
        """(n, 4) frames of the last equilibrium."""
        return self.state.q.copy()

    @property
    def end_force(self) -> np.ndarray:
        """(3,) its end force."""
        return self.state.F[-1].copy()

    @property
    def touches(self) -> bool:
        """Whether it presses on anything."""
        return bool(self.state.lam.any())

    def set_conditions(
        self, qe: np.ndarray, re: np.ndarray, f: np.ndarray, obstacles: np.ndarray | None = None
    ) -> None:
        super().set_conditions(qe, re, f)
        if obstacles is not None:
            self.obstacles = obstacles

    def held(self) -> np.ndarray:
        return self.contact_forces().sum(axis=(0, 1))

    def contact_forces(self) -> np.ndarray:
        """(m + 1, o, 3): force of each obstacle on the cable at each boundary."""
        return self._pressed()[1]

    def _pressed(self) -> tuple[np.ndarray, np.ndarray]:
        """Normals and forces of the contacts, (m + 1, o, 3) each; zero where nothing presses."""
        normals, forces = np.empty_like(self.frames), np.empty_like(self.frames)
        contact_frames(self.state, self._under, self.frames, normals, forces)
        return normals, forces

    def lies_on(self, level: float) -> np.ndarray:
        """(m + 1, o) bool: where it presses on each obstacle, and from one such place to the next where all
        gaps between are less than `level` / cells^2.
        """
        pressed = self.state.lam != 0.0
        out = pressed.copy()
        for o, obstacle in enumerate(self._under):
            at = np.flatnonzero(pressed[:, o])
            for low, high in pairwise(at.tolist()):
                between = self.state.r[low + 1 : high]
                if all(gaps(obstacle[None], r)[0] < level / self.cells**2 for r in between):
                    out[low:high, o] = True
        return out

    def sliding(self) -> np.ndarray:
        """(m + 1, o): which contacts slide."""
        return self._slips

    def contacts(self) -> tuple[np.ndarray, ...]:
        """Arc lengths (c,), positions, normals and forces (c, 3), obstacles, whether they slide, and the
        length along which each force is spread (c,), by rising arc length.

        Three or more side by side are a patch, each the pressure on a cell.
        """
        at = np.nonzero(self.state.lam)
        pressed = np.pad(self.state.lam != 0.0, ((2, 2), (0, 0)))
        count = len(self.state.lam)
        runs = [pressed[k : k + count] & pressed[k + 1 : k + 1 + count] & pressed[k + 2 : k + 2 + count]
                for k in range(3)]  # fmt: skip
        spread = np.where(runs[0] | runs[1] | runs[2], 1.0 / self.cells, 0.0)[at]
        normals, forces = self._pressed()
        places = np.append(self.s0, 1.0)[at[0]]
        return places, self.state.r[at[0]], normals[at], forces[at], at[1], self.sliding()[at], spread

    # steps

    def advance(
        self, q: np.ndarray, F: np.ndarray, qe: np.ndarray, re: np.ndarray, f: np.ndarray,
        tolerance: float, limit: float = 0.6, obstacles: np.ndarray | None = None,
    ) -> tuple[int, int, np.ndarray, np.ndarray]:  # fmt: skip
        """One step from the last equilibrium, which (q, F) must be; see `warm_step.advance`."""
        assert obstacles is not None
        way = travel(self.qe, self.re, self._under, qe, re, obstacles)
        if way > STEP:
            return warm_step.TOO_FAR, 0, q, F
        known, self.stride = self._known(), 2.0
        code, iterations = self._solve(qe, re, f, obstacles, 0.0)
        flown = None
        if code != CONVERGED and way < RARE * STEP:
            # what Newton's method cannot do at once a viscous medium does little by little
            flown = self._flow(qe, re, f, obstacles)
            iterations += FLOW_COST if flown is None else flown
            code = code if flown is None else CONVERGED
        self.work -= self.cost * iterations * len(self.elastic)
        if code != CONVERGED:
            return warm_step.NOT_CONTRACTING, iterations, q, F
        if flown is None and not self.follows:
            self.stride = stride(self._friction_change(known.state))
            if self.stride < SHORTER and way > FRICTION_LEAST:
                self._return(known)
                return warm_step.TOO_FAR, iterations, q, F
        leapt = np.abs(self.state.r - known.state.r).max() > LEAP * way + LEAST_LEAP
        turned = np.abs(np.sum(known.state.q * self.state.q, axis=1)).min() < np.cos(0.5 * limit)
        if leapt or turned:
            # Newton's method has no line search and can end on another branch
            self._return(known)
            return warm_step.NOT_CONTRACTING, iterations, q, F
        if not self._stable():
            # on the way the branch has lost its stability, as a straight cable that is pressed
            self._return(known)
            return warm_step.NOT_CONVEX, iterations, q, F
        self.before.take(known.state)
        self._moved = True
        iterations += self._advance_twin(qe, re, f, obstacles)
        return warm_step.ADVANCED, iterations, self.state.q.copy(), self.state.F[-1].copy()

    def _friction_change(self, before: State) -> float:
        """How much the friction of what slips has changed since `before` across the cable, see `travel`."""
        state, (normals, _) = self.state, self._pressed()
        possible = float((state.lam * self._under[:, FRICTION_COEFFICIENT]).sum())
        if possible == 0.0:
            return 0.0
        possible = max(possible, float(np.linalg.norm(state.F[-1])))
        change = state.tau - before.tau
        along = quaternion.tangents(state.q[::ORDER])[:, None]
        across = np.cross(
            along, change[..., :1] * self.frames + change[..., 1:] * np.cross(normals, self.frames)
        )
        return float(np.linalg.norm(across, axis=2)[self._slips].sum()) / possible

    def _advance_twin(self, qe: np.ndarray, re: np.ndarray, f: np.ndarray, obstacles: np.ndarray) -> int:
        """Let the twin follow in its own steps; if it cannot, it starts again from this rod's equilibrium."""
        twin = self.twin
        if twin is None or travel(twin.qe, twin.re, twin._under, qe, re, obstacles) < CORNER * STEP:
            return 0
        code, iterations, _, _ = twin.advance(twin.state.q, twin.state.F[-1], qe, re, f, 0.0, 0.6, obstacles)
        if code != warm_step.ADVANCED:
            self.pair()
            return iterations
        self._compare(twin)
        return iterations

    def _compare(self, twin: NodalRod) -> None:
        """Estimate the error of the end wrench from the difference to the twin's.

        It is taken to be of order 1.5: the rod and the pressure are of the second, but patches begin and end
        between places. An obstacle that presses at a single place can be off by half a cell on both grids.
        """
        mine = np.concatenate((self.state.F[-1], self.g[-1]))
        other = np.concatenate((twin.state.F[-1], twin.g[-1]))
        change = (mine - other) / (TWIN**-1.5 - 1.0)
        alone = (self.state.lam > 0.0).sum(axis=0) <= 2
        lone = float(self.state.lam[:, alone].max(initial=0.0))
        lever = np.array([0.0, 0.0, 0.0, 0.25 * lone / self.cells, 0.0, 0.0])
        error = max(relative_change(change, mine, self.least), relative_change(lever, mine, self.least))
        before = FADING * self._estimate if np.isfinite(self._estimate) else 0.0
        # a force that is spread over a cell, not lumped in its middle, bends the cable so much otherwise
        lumped = float(np.linalg.norm(self.state.F[-1])) / (12.0 * self.cells**2)
        self._estimate = max(float(error), before, lumped)

    def _solve(
        self, qe: np.ndarray, re: np.ndarray, f: np.ndarray, obstacles: np.ndarray, drag: float,
        give: np.ndarray | None = None,
    ) -> tuple[int, int]:  # fmt: skip
        """Newton's method from the last equilibrium; on failure the state is what it was."""
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
        trials = ((True, (stiff,)), (False, (stiff,)), (False, (soft, stiff)))
        for ahead, stages in trials if drag == 0.0 else trials[1:2]:
            if ahead and not (self._moved and extrapolate(state, self.before, re, drag)):
                continue
            code = CONVERGED
            for scales in stages:
                step = Step(qe, re, f, obstacles, carried, turned, kept.tau, kept.q, kept.r, drag, *scales)
                code, count = newton(
                    state, self._model, step, self._work, self._tangents, self._rows, self._band,
                    self._trial, TOLERANCE if scales is stiff else ROUGH,
                )  # fmt: skip
                spent += count
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
        self.obstacles = self._under = obstacles
        self.frames = turned
        kinds, state = self._work.kinds, self.state
        state.lam[kinds == OPEN] = 0.0
        state.tau[kinds == OPEN] = 0.0
        self._slips = (kinds == SLIP) & (state.lam > 0.0)
        self._pressed()  # the directions across go along with the normal from here on
        self._weigh()
        self.drift, self.age = 0.0, 0.0

    def _weigh(self) -> None:
        """Add the weight's potential energy to the elastic one, which is all that `residuals` counts."""
        self.totals[ENERGY] -= float(self.f @ self.state.r[1:-1].sum(axis=0)) / self.cells

    # equilibria of other rods

    def adopt(self, rod: Rod, q: np.ndarray, F: np.ndarray, places: np.ndarray, forces: np.ndarray,
              obstacles: np.ndarray, pair: bool = True) -> bool:  # fmt: skip
        """Take over another rod's equilibrium (q, F) with its friction; whether that succeeded.

        Args:
            rod: among the same obstacles, see `set_conditions`.
            places, forces, obstacles: of its contacts: arc lengths (c,), forces on the cable (c, 3) and which
                obstacles (c,).
            pair: whether to have a twin.
        """
        assert rod.obstacles is not None
        state, m = self.state, len(self.h)
        fresh = rod.mesh.interpolate(q, self.mesh.nodes)
        fresh[0], fresh[-1] = q[0], q[-1]
        # neighbours on one side of the sphere of unit quaternions
        signs = np.cumprod(np.sign(np.concatenate(([1.0], np.sum(fresh[1:] * fresh[:-1], axis=1)))))
        state.q[:] = fresh * signs[:, None]
        self._integrate()
        middles = self.s0 + 0.5 * self.h
        for e in range(m):
            state.F[e] = F + forces[places > middles[e]].sum(axis=0) + rod.f * (m - 1 - e) / self.cells
        state.lam[:], state.tau[:] = 0.0, 0.0
        self.obstacles, self._under, self._moved = rod.obstacles, rod.obstacles, False
        self.frames[:] = FIRST
        n, d, bends = np.empty(3), np.empty((2, 3)), np.empty(2)
        for s, force, o in zip(places, forces, obstacles, strict=True):
            at = np.clip(s * self.cells + 0.5, 1.0, m - 1.0)
            low = min(int(at), m - 2)
            for k, share in ((low, low + 1 - at), (low + 1, at - low)):
                if share > 0.0:
                    gap(self._under[o], state.r[k], n, d, bends)
                    tangent_frame(n, FIRST, d)
                    self.frames[k, o] = d[0]
                    state.lam[k, o] += share * max(force @ n, 0.0)
                    state.tau[k, o] += share * (d @ force)
        self.set_conditions(rod.qe, rod.re, rod.f)
        give = SEED / np.maximum(state.lam * rod.obstacles[:, FRICTION_COEFFICIENT], FAINT)
        if (
            self._solve(rod.qe, rod.re, rod.f, rod.obstacles, 0.0, give)[0] != CONVERGED
            and self._flow(rod.qe, rod.re, rod.f, rod.obstacles, give) is None
        ):
            return False
        if pair:
            self.pair()
        return True

    def pair(self) -> None:
        """Have a twin of fewer cells, whose end wrench tells how much the grid matters."""
        twin = NodalRod(self.K, self.natural, self._under, int(TWIN * self.cells), self.coulomb)
        twin.follows = True
        places, _, _, forces, obstacles, _, _ = self.contacts()
        found = twin.adopt(self, self.state.q, self.state.F[-1], places, forces, obstacles, False)
        self.twin = twin if found else None
        if found:
            self._compare(twin)

    def variant(
        self, mesh: Mesh | None = None, stiffness: np.ndarray | None = None,
        natural: np.ndarray | None = None, scale: float = 1.0,
    ) -> NodalRod:  # fmt: skip
        """As `Rod.variant`, at the same equilibrium; the mesh stays."""
        made_of = self.K if stiffness is None else stiffness, self.natural if natural is None else natural
        new = self._known().rod(self, *made_of, scale)
        if self.twin is not None:
            new.twin = self.twin.variant(None, stiffness, natural, scale)
            new.twin.follows = True
        return new

    def snapshot(self) -> Callable[[], Rod]:
        return partial(self._known().rod, self, self.K, self.natural)

    def _known(self) -> Known:
        """A copy of what is known of the last equilibrium."""
        return Known(
            self.state.copy(), self.frames.copy(), self._slips, self._step, self._under,
            (self.qe, self.re, self.f, self.obstacles),
        )  # fmt: skip

    def _return(self, known: Known) -> None:
        """Go back to an equilibrium of this rod, its conditions and its history."""
        self.state.take(known.state)
        self.frames, self._slips = known.frames, known.slips
        self._step = None if known.step is None else known.step._replace(turned=known.frames)
        self._under, self._moved = known.under, False
        self.set_conditions(*known.conditions)

    def begin(self, q: np.ndarray, qe: np.ndarray, re: np.ndarray, f: np.ndarray) -> int | None:
        """Let a shape q (n, 4), free of forces, come to rest; iterations, or None if it does not."""
        assert self.obstacles is not None
        state = self.state
        for part in state:
            part[:] = 0.0
        state.q[:] = q
        self._integrate()
        self._under, self._moved = self.obstacles, False
        return self._leant(qe, re, f, self.obstacles)

    def depth(self, q: np.ndarray) -> float:
        """How deep the shape q (n, 4) is inside obstacles, lengths; negative if it is clear of them."""
        assert self.obstacles is not None
        self.state.q[:] = q
        self._integrate()
        return -min(float(gaps(self.obstacles, r).min()) for r in self.state.r[1:-1])

    def _integrate(self) -> None:
        """Positions of the boundaries from the frames."""
        tangents = quaternion.tangents(self.mesh.interpolate(self.state.q, self._gauss_places().ravel()))
        ways = self.h[:, None] * np.einsum(
            "g,mga->ma", self.tables.weights, tangents.reshape(len(self.h), -1, 3)
        )
        self.state.r[:] = np.concatenate((np.zeros((1, 3)), np.cumsum(ways, axis=0)))

    def _gauss_places(self) -> np.ndarray:
        """(m, g) arc lengths of the quadrature points."""
        return np.asarray(self.s0[:, None] + self.h[:, None] * self.tables.points)

    # falls

    def minimum(
        self, q: np.ndarray, F: np.ndarray, options: Options
    ) -> tuple[np.ndarray, np.ndarray, int] | None:
        """Where the cable comes to rest under the conditions set, dragged back by a viscous medium.

        Implicit Euler steps of that flow: friction follows the path, and what is not stable is left behind.
        """
        assert self.obstacles is not None
        spent = self._leant(self.qe, self.re, self.f, self.obstacles)
        return None if spent is None else (self.shape, self.end_force, spent)

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
        """Come to rest in a viscous medium; iterations, or None if that fails, with the state as it was."""
        known = self._known()
        drag, spent = DRAG, 0
        self._moved = False
        for _ in range(DRAGS):
            before = self.state.r.copy()
            code, count = self._solve(qe, re, f, obstacles, drag, give)
            spent += count
            if code == CONVERGED and drag == 0.0:
                return spent
            if spent > FLOW_COST:
                break
            if code == CONVERGED:
                gone = float(np.abs(self.state.r - before).max())
                drag *= 0.1 if gone < CALM else 0.5 if gone < 10.0 * CALM else 1.0
                drag = 0.0 if drag < FREE else drag
            elif drag == 0.0:
                drag = 10.0 * FREE
            elif drag < STIFFEST:
                drag *= 5.0
            else:
                break
        self._return(known)
        return None

    # what a solution says

    def linearize(self, x: np.ndarray, y: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Energy at the last equilibrium, which (x, y) must be, and that all residuals vanish."""
        return float(self.totals[ENERGY]), np.zeros(3), np.zeros(self.g.size)

    def refactor(self, q: np.ndarray, F: np.ndarray) -> bool:
        """Set up and factor the tangent at the last equilibrium, for the step that led there."""
        state, step = self.state, self._last_step()
        residuals(state, self._model, step, self._work)
        self._weigh()
        self._size = jacobian(
            state, self._model, step, self._work, self._tangents, self._rows, self._band.a, self._band.b
        )
        self.drift = 0.0
        return bool(band_factor(self._band.a, *self._size, self._band.pivots))

    def _last_step(self) -> Step:
        """The step that led to the last equilibrium; if there was none, one that stays there."""
        state = self.state
        return self._step or Step(
            state.q[-1], state.r[-1], self.f, self._under, np.repeat(state.r[:, None], state.lam.shape[1], 1),
            self.frames, state.tau, state.q, state.r, 0.0, NORMAL, TANGENTIAL,
            np.full(state.lam.shape, COMPLIANCE),
        )  # fmt: skip

    def _stable(self) -> bool:
        return self._softest(1) > 0.0

    def _softest(self, iterations: int = ITERATIONS) -> float:
        """As `Rod.stability_margin`, of contacts and friction as they are; negative if it is not stable.

        With fewer iterations it is too large.
        """
        self.refactor(self.state.q, self.state.F[-1])
        at, _, contacts = contact_tangents(self.state, self._last_step(), self._rows, *self._size)
        return softest(self._tangents, self._rows, at, contacts, self.waves(), iterations)

    def relative_error(self, q: np.ndarray, F: np.ndarray) -> float:
        """Relative difference of its end wrench from its twin's, when they last were at one pose."""
        return self._estimate

    def clamp_stiffness(self, q: np.ndarray, F: np.ndarray) -> np.ndarray:
        return self.wrench_response(q, F, ())

    def wrench_response(self, q: np.ndarray, F: np.ndarray, moving: Sequence[int]) -> np.ndarray:
        """Derivative of the wrenches on clamps and obstacles, see `nodal_response.wrench_response`.

        At the last equilibrium, which (q, F) must be.
        """
        state, (normals, forces) = self.state, self._pressed()
        friction = forces - state.lam[:, :, None] * normals
        step = standing(state, self._last_step(), friction, self.frames, self.sliding())
        return wrench_response(
            state, self._model, step, self._work, self._tangents, self._rows, self._band, forces, moving
        )
