# SPDX-License-Identifier: Apache-2.0
"""A rod whose contacts sit at fixed material points: where it is, and what it says of an equilibrium."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cable_ros.contact.distance import FRICTION_COEFFICIENT, gap, gaps
from cable_ros.contact.nodal_kernels import COMPLIANCE, contact_frames, residuals
from cable_ros.contact.nodal_response import contact_tangents, frozen_step, wrench_response
from cable_ros.contact.nodal_stability import ITERATIONS, PENALTY, RIGID, condensed, softest
from cable_ros.contact.nodal_state import ORDER, Model, State, Step, spaces, workplace
from cable_ros.contact.nodal_stretch import stiffness
from cable_ros.contact.nodal_tangent import jacobian
from cable_ros.contact.report import positions
from cable_ros.linalg.band_lu import band_factor
from cable_ros.rod import quaternion
from cable_ros.rod.elements import Mesh, reference_element
from cable_ros.rod.extensible import least_force
from cable_ros.rod.kirchhoff import NOTHING, Rod
from cable_ros.rod.loaded_contacts import LoadedContacts
from cable_ros.rod.rod_state import ENERGY, Evaluation, Grid, Section, Tangents

FEWEST, MOST = 80, 192
"""Least and most points at which it may touch."""
LAYER = 11.0
"""Number of points along the length (EI / F)^1/2 over which a cable bends under its force F."""
NORMAL, TANGENTIAL = 1e4, 1e6
"""Scales of the projections of normal force and friction, EI / L^3."""
FIRST = np.array([1.0, 0.0, 0.0])
"""First direction of a contact's frame before anything has touched, not yet projected along the normal."""


def cells(count: int, at: Sequence[float] = ()) -> Mesh:
    """The mesh whose inner boundaries are the middles of `count` equal cells.

    Each contact stands for one cell. With a contact at the ends of cells the clamps would bear half of one.
    Of the arc lengths `at`, L, each has the boundary next to it.
    """
    lengths = np.full(count + 1, 1.0 / count)
    lengths[[0, -1]] *= 0.5
    if at:
        places = (np.arange(count) + 0.5) / count
        for s in at:
            k = int(np.clip(s * count, 0, count - 1))
            places[k] = np.clip(s, (k + SHORTEST) / count, (k + 1.0 - SHORTEST) / count)
        lengths = np.diff(np.concatenate(([0.0], places, [1.0])))
    return Mesh(reference_element(ORDER), lengths)


SHORTEST = 0.01
"""Least distance of a boundary from the end of its cell, cells."""


def point_count(force: float) -> int:
    """Number of contact points for a cable whose internal force, EI / L^2, is at most `force`."""
    return int(np.clip(32 * np.ceil(LAYER / 32 * np.sqrt(force)), FEWEST, MOST))


class Known(NamedTuple):
    """An equilibrium with m elements and o obstacles, to make a rod that stands there."""

    state: State
    frames: np.ndarray
    """(m + 1, o, 3) the first direction of each contact's frame."""
    slips: np.ndarray
    """(m + 1, o) bool, which contacts slip."""
    step: Step | None
    """The step that led there."""
    under: np.ndarray
    """(o, WIDTH) the obstacles there."""
    wrench: np.ndarray
    """(6,) its end force and moment."""
    conditions: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]
    """The conditions set: end frame (4,), end position (3,), load (3,) and obstacles (o, WIDTH)."""


def in_patches(pressed: np.ndarray) -> np.ndarray:
    """Which of the boundaries that are `pressed`, bool (m + 1, ...), are three or more side by side."""
    padded = np.pad(pressed, ((2, 2), *((0, 0),) * (pressed.ndim - 1)))
    threes = padded[:-2] & padded[1:-1] & padded[2:]
    return np.asarray(threes[:-2] | threes[1:-1] | threes[2:])


class NodalContacts(Rod):
    """A rod in units of the cable whose contacts sit at the inner boundaries of its elements.

    Args:
        stiffness, natural: as in `Rod`.
        obstacles: (o, WIDTH) that it may touch.
        points: number of contact points, each in the middle of a cell; see `point_count`.
        coulomb: whether there is friction.
        compliance: (3,) 1 / GAx, 1 / GAy, 1 / EA in units of the cable.
        at: arc lengths, L, at which one of them is, instead of in the middle of its cell.
    """

    def __init__(
        self, stiffness: np.ndarray, natural: np.ndarray | None, obstacles: np.ndarray,
        points: int = FEWEST, coulomb: bool = True, compliance: np.ndarray = NOTHING,
        at: Sequence[float] = (),
    ) -> None:  # fmt: skip
        self.cells, self.at = points, tuple(at)
        self.compliance = np.ascontiguousarray(compliance, float)
        super().__init__(cells(self.cells, self.at), stiffness, natural)
        if self.soft:
            self.least = least_force(self.compliance)
        self.coulomb = coulomb
        elements, count = len(self.h), len(obstacles)
        self.state, self.before = State.zeros(elements, count), State.zeros(elements, count)
        self._trial = State.zeros(elements, count)
        self.obstacles, self._under = obstacles, obstacles  # those set, and those at the last equilibrium
        self._size = 0, 0
        self.frames = np.zeros((elements + 1, count, 3))
        self.frames[:] = FIRST
        self._slips = np.zeros((elements + 1, count), bool)
        self._step: Step | None = None
        self.wrench = np.zeros(6)
        """End force and moment (6,) of the last equilibrium, in units of the cable."""
        self._moved = False  # whether `before` is the equilibrium before the last
        evaluation, tangents, _ = self.saddle
        self._model = Model(
            np.zeros(3), Section(self.K, self.natural), Grid(self.h, self.s0, self.tables), self.compliance
        )
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
    def iteration_work(self) -> float:
        """Half that of a rod without contact of so many unknowns."""
        return 0.5 * len(self.elastic)

    @property
    def touches(self) -> bool:  # type: ignore[override]
        return bool(self.state.lam.any())

    @property
    def rubs(self) -> bool:
        """Whether it presses on something rough."""
        if not self.coulomb or self.obstacles is None:
            return False
        return bool(self.state.lam[:, self.obstacles[:, FRICTION_COEFFICIENT] > 0.0].any())

    def set_conditions(
        self, qe: np.ndarray, re: np.ndarray, f: np.ndarray, obstacles: np.ndarray | None = None
    ) -> None:
        super().set_conditions(qe, re, f)
        if obstacles is not None:
            self.obstacles = obstacles

    def contact_force(self) -> np.ndarray:
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
        """(m + 1, o) bool: points that press on each obstacle, and all between two of them if all
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

    def contacts(self) -> LoadedContacts:
        """The loaded contacts; three or more side by side are a patch, each the pressure on a cell."""
        at = np.nonzero(self.state.lam)
        spread = np.where(in_patches(self.state.lam != 0.0), 1.0 / self.cells, 0.0)[at]
        normals, forces = self._pressed()
        arc_lengths = np.append(self.s0, 1.0)[at[0]]
        positions, sliding = self.state.r[at[0]], self.sliding()[at]
        return LoadedContacts(arc_lengths, positions, normals[at], forces[at], at[1], sliding, spread)

    def loaded_contacts(self, q: np.ndarray) -> Callable[[], LoadedContacts] | None:
        return partial(LoadedContacts, *self.contacts()) if self.touches else None

    def _weigh(self) -> None:
        """Add the weight's potential energy to the elastic one, which is all that `residuals` counts."""
        self.totals[ENERGY] -= float(self.f @ self.state.r[1:-1].sum(axis=0)) / self.cells

    def _integrate(self) -> None:
        """Positions of the boundaries from the frames and the internal forces."""
        displacements = self.h[:, None] * np.einsum("g,mga->ma", self.tables.weights, self._rates())
        self.state.r[:] = np.concatenate((np.zeros((1, 3)), np.cumsum(displacements, axis=0)))

    def _rates(self) -> np.ndarray:
        """(m, g, 3) derivatives of the centreline by the arc length of the unloaded cable."""
        frames = self.mesh.interpolate(self.state.q, self._gauss_places().ravel())
        tangents = quaternion.tangents(frames).reshape(len(self.h), -1, 3)
        if self.soft:
            tension = np.einsum("ma,mga->mg", self.state.F, tangents)
            tangents *= 1.0 + self.compliance[2] * tension[..., None]
        if self.compliance[:2].any():
            turns = quaternion.matrices_from_ros(quaternion.to_ros(frames)).reshape(len(self.h), -1, 3, 3)
            across = turns[..., :2]  # the section's axes but the tangent
            tangents += np.einsum("mgad,d,mgbd,mb->mga", across, self.compliance[:2], across, self.state.F)
        return tangents

    def directions(self) -> np.ndarray:
        """(m + 1, 3) unit vectors along the centreline at the boundaries; where it has a kink, their mean.

        The frames' tangents, unless the cable shears.
        """
        if not self.compliance[:2].any():
            return quaternion.tangents(self.state.q[::ORDER])
        rates = self._boundary_rates()
        return np.asarray(rates / np.linalg.norm(rates, axis=1)[:, None])

    def _boundary_rates(self) -> np.ndarray:
        """(m + 1, 3) mean of the derivatives of the centreline on both sides of the boundaries."""
        F = self.state.F
        mean = np.concatenate((F[:1], 0.5 * (F[1:] + F[:-1]), F[-1:]))
        turns = quaternion.matrices_from_ros(quaternion.to_ros(self.state.q[::ORDER]))
        return np.asarray(turns[:, :, 2] + np.einsum("kad,d,kbd,kb->ka", turns, self.compliance, turns, mean))

    def lone(self) -> list[tuple[int, int, float]]:
        """Boundary, obstacle and arc length of each contact at one boundary, or between two, alone."""
        out, places = [], np.append(self.s0, 1.0)
        for o in range(self.state.lam.shape[1]):
            pressed = np.flatnonzero(self.state.lam[:, o] > 0.0)
            for run in np.split(pressed, np.flatnonzero(np.diff(pressed) > 1) + 1):
                if 0 < len(run) < 3:
                    lam = self.state.lam[run, o]
                    out.append((int(run[np.argmax(lam)]), o, float(lam @ places[run] / lam.sum())))
        return out

    def rise(self, k: int, body: np.ndarray, state: State | None = None) -> float:
        """Slope of the gap to an obstacle, `body` (WIDTH,), by the arc length at the boundary k.

        `state`: the last equilibrium, or one beside it.
        """
        n, d, bends = np.empty(3), np.empty((2, 3)), np.empty(2)
        state = self.state if state is None else state
        gap(body, state.r[k], n, d, bends)
        q, mean = state.q[ORDER * k], 0.5 * (state.F[k - 1] + state.F[k])
        turn = quaternion.matrices_from_ros(quaternion.to_ros(q[None] / np.linalg.norm(q)))[0]
        return float(n @ (turn[:, 2] + turn @ (self.compliance * (turn.T @ mean))))

    def bend(self, k: int, o: int) -> float:
        """About how `rise` changes, 1 / L, as the boundary k goes along the cable, and its kink with it."""
        assert self.obstacles is not None
        n, d, bends = np.empty(3), np.empty((2, 3)), np.empty(2)
        phi = [gap(self.obstacles[o], self.state.r[i], n, d, bends) for i in (k - 1, k + 1, k)]
        turn = quaternion.matrices_from_ros(quaternion.to_ros(self.state.q[ORDER * k][None]))[0]
        before, after = self.h[k - 1], self.h[k]
        kink = float(self.state.lam[k, o] * (self.compliance * (turn.T @ n) ** 2).sum())
        return float(2.0 * ((phi[1] - phi[2]) / after + (phi[0] - phi[2]) / before + kink) / (before + after))

    def centreline(self, q: np.ndarray, F: np.ndarray) -> np.ndarray:
        """(m, g + 1, 3) of `centreline.curve` at the last equilibrium, which (q, F) must be."""
        higher = np.einsum("kg,mga->mka", self.tables.primitives, self._rates()) * self.h[:, None, None]
        return np.concatenate((self.state.r[:-1, None], higher), axis=1)

    def stretch_anywhere(
        self, q: np.ndarray, F: np.ndarray, at: np.ndarray, start: np.ndarray, length: float,
        points: np.ndarray,
    ) -> None:  # fmt: skip
        if self.soft:
            turn = quaternion.matrix_from_ros(start[3:])
            points[:] = (
                start[:3]
                + length
                * positions(self.centreline(self.state.q, self.state.F[-1]), self.h, self.s0, at)
                @ turn.T
            )

    def _gauss_places(self) -> np.ndarray:
        """(m, g) arc lengths of the quadrature points."""
        return np.asarray(self.s0[:, None] + self.h[:, None] * self.tables.points)

    def depth(self, q: np.ndarray) -> float:
        """How deep the shape q (n, 4) is inside obstacles, lengths; negative if it is clear of them."""
        assert self.obstacles is not None
        self.state.q[:] = q
        self._integrate()
        return -min(float(gaps(self.obstacles, r).min()) for r in self.state.r[1:-1])

    def _known(self) -> Known:
        """A copy of the last equilibrium."""
        return Known(
            self.state.copy(), self.frames.copy(), self._slips, self._step, self._under, self.wrench,
            (self.qe, self.re, self.f, self.obstacles),
        )  # fmt: skip

    def _return(self, known: Known) -> None:
        """Go back to an equilibrium of this rod, its conditions and its history."""
        self.state.take(known.state)
        self.frames, self._slips = known.frames, known.slips
        self._step = None if known.step is None else known.step._replace(turned=known.frames)
        self._under, self.wrench, self._moved = known.under, known.wrench, False
        self.set_conditions(*known.conditions)

    # what an equilibrium says

    def linearize(self, x: np.ndarray, y: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """As `solve.trust_region.Problem.linearize`, at the last equilibrium only: all residuals are zero."""
        return float(self.totals[ENERGY]), np.zeros(3), np.zeros(self.g.size)

    def refactor(self, q: np.ndarray, F: np.ndarray) -> bool:
        """Set up and factor the tangent at the last equilibrium, for the step that led there."""
        state, step = self.state, self._last_step()
        residuals(state, self._model, step, self._work)
        self._weigh()
        self._size = jacobian(
            state, self._model, step, self._work, self._tangents, self._rows, self._band.a, self._band.b
        )
        self.rotation = 0.0
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
        """Whether the present equilibrium is a strict minimum, contacts and friction as they are."""
        return self._softest(1) > 0.0

    def _softest(self, iterations: int = ITERATIONS) -> float:
        """As `Rod.stability_margin`, of contacts and friction as they are; negative if it is not stable.

        With fewer iterations it is too large.
        """
        self.refactor(self.state.q, self.state.F[-1])
        at, _, contacts = contact_tangents(self.state, self._last_step(), self._rows, *self._size)
        links = stiffness(self.state.q, self._model, PENALTY) if self.soft else RIGID
        return softest(self._tangents, self._rows, at, contacts, self.start_vector(), iterations, links)

    def contact_stiffness(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of the c contacts: boundaries (c,), obstacles (c,), and stiffness (c, 3, 3) against motion there.

        At the last equilibrium, whose tangent must be set up, see `refactor`.
        """
        _, touched, contacts = contact_tangents(self.state, self._last_step(), self._rows, *self._size)
        return *touched, condensed(contacts)

    def all_wrenches(self, moving: Sequence[int]) -> np.ndarray:
        """(12 + 6 k,) on the cable: of the clamps along their axes, of k obstacles about the start clamp."""
        turn = quaternion.matrices_from_ros(quaternion.to_ros(self.qe)[None])[0]
        F, forces = self.state.F, self.contact_forces()
        parts = [-F[0], self.g[0], turn.T @ F[-1], self.g[-1]]
        for o in moving:
            parts += [forces[:, o].sum(axis=0), np.cross(self.state.r, forces[:, o]).sum(axis=0)]
        return np.concatenate(parts)

    def clamp_stiffness(self, q: np.ndarray, F: np.ndarray) -> np.ndarray:
        return self.wrench_response(q, F, ())

    def wrench_response(self, q: np.ndarray, F: np.ndarray, moving: Sequence[int]) -> np.ndarray:
        """Derivative of the wrenches on clamps and obstacles, see `nodal_response.wrench_response`.

        At the last equilibrium, which (q, F) must be.
        """
        return self._response(moving)[0]

    def _response(self, moving: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """`nodal_response.wrench_response` of the last equilibrium."""
        state, (normals, forces) = self.state, self._pressed()
        friction = forces - state.lam[:, :, None] * normals
        step = frozen_step(state, self._last_step(), friction, self.frames, self.sliding())
        return wrench_response(
            state, self._model, step, self._work, self._tangents, self._rows, self._band, forces, moving
        )
