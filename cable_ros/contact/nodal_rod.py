# SPDX-License-Identifier: Apache-2.0
"""A cable whose contacts sit at fixed material points: robust, and it keeps friction's history.

`TouchingRod` places contacts at any arc length and adapts its mesh to them: exact, but it can lose its branch
if many contacts change at once. This rod has a uniform mesh and looks for contact in the middles of equal
cells only. It carries a step that the other cannot, to an accuracy that the grid limits.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from cable_ros.contact.distance import AXES, CENTRE, DIMENSIONS, FRICTION_COEFFICIENT
from cable_ros.contact.laying_down import Landing
from cable_ros.contact.nodal_contacts import Known, in_patches
from cable_ros.contact.nodal_newton import CONVERGED, state_moved
from cable_ros.contact.nodal_response import obstacle_motions
from cable_ros.contact.nodal_state import ORDER, State
from cable_ros.contact.nodal_twin import FALLEN, STEP, NodalTwin, sizes
from cable_ros.contact.travel import SHORTER, stride, travel
from cable_ros.linalg.cross import cross_matrix
from cable_ros.rod import quaternion, warm_step
from cable_ros.rod.elements import Mesh
from cable_ros.rod.kirchhoff import Rod
from cable_ros.rod.units import wrench_scales
from cable_ros.rod.without_contact import SHORTEST_STEP

BESIDE = 1e-4
"""Motion by which derivatives of what touches at a point alone are differences, cells and fractions."""
FINER = 1.6
"""Number of points of a finer grid over this rod's."""
LEAP, LEAST_LEAP = 10.0, 2e-3
"""Maximum motion of the cable in a step: multiple of the motion of clamps and obstacles, and an addend, L."""
LANDED, LANDED_AT_ONCE = 4, 1e-6
"""Maximum number of points that come down on something rough in a step, and the length of a step, L, in which
any number may, as of a straight cable that lands all along. In a step all of them slip the whole way, while
what has landed sticks; the end of a cable that is laid flat lands ever faster, and in one step left an end
force 4 % too large. With 6 it was 2 % off, with 2 nothing was better."""
SHORT = 1e-3
"""Step, L, in which what sticks is rigid once such a point has come down: the motion of most of what lies is
as small as its compliance."""
PRESSING = 5e-3
"""Normal force, over the end force, below which such a point counts by that part: a light cable lies along
points that hardly press, and come and go. Where they did not count, a cable was laid flat in one step, and
3 % of its end force were missing."""
FRICTION_CHANGE, WRENCH_CHANGE = 0.2, 0.3
"""Maximum change in a step, on something rough: of the friction of what slips, relative to all possible
friction, and of the end wrench. Within a step slip has one direction. Where the end force of a hose falls to
a third while its end goes 0.02 L, it is 4 % from that in ever shorter steps. How friction turns tells less:
what hardly moves turns to and fro, in short steps most of all. With 0.12 and without the other, 47 of 1,370
poses of hoses were not had in time, now 14."""
OPEN = 0.5
"""Part of the friction that landing leaves open, see `Landing.open`, by which an end force is off: of a lift
laid flat by 2 % where that is 6 %, of another one by 0.7 to 1.1 % where it is 2 to 2.7 %."""
ENDS = np.array([0.0, 1.0])
"""Arc lengths of the clamps, L."""
RARE = 0.2
"""Fraction of the longest step below which a step that fails is made in a viscous medium."""


class NodalRod(NodalTwin):
    """A rod in units of the cable whose contacts sit at the inner boundaries of its elements.

    Its arguments are those of `NodalContacts`.
    """

    few = 25
    remembers = True
    on_grid = True
    longest_step, first_stride = STEP, 1.0
    twin: NodalRod | None = None
    tried = 0
    """Number of trials that found no exact equilibrium beside it, see `handover.exact`."""

    def advance(
        self, q: np.ndarray, F: np.ndarray, qe: np.ndarray, re: np.ndarray, f: np.ndarray,
        tolerance: float, limit: float = 0.6, obstacles: np.ndarray | None = None,
    ) -> tuple[int, int, np.ndarray, np.ndarray]:  # fmt: skip
        """One step from the last equilibrium, which (q, F) must be; see `warm_step.advance`."""
        assert obstacles is not None
        distance = travel(self.qe, self.re, self._under, qe, re, obstacles)
        if distance > STEP:
            return warm_step.TOO_FAR, 0, q, F
        known, self.stride, self.offset, rigid = self._known(), 2.0, None, self._lands
        code, iterations = self._solve(qe, re, f, obstacles, 0.0, rigid=rigid)
        flown = None
        if code != CONVERGED and distance < RARE * STEP:
            # where Newton's method fails in one step, a flow in a viscous medium converges in many
            flown = self._flow(qe, re, f, obstacles)
            if flown is not None:
                code, iterations = CONVERGED, iterations + flown
        if code != CONVERGED:
            return warm_step.NOT_CONTRACTING, iterations, q, F
        if flown is None and not self.follows:
            turns = self._history_stride(known)
            landed = self._landed(known.state)
            lands = stride(landed, LANDED)
            self._lands = landed >= 1.0 and (rigid or lands < SHORTER or distance < SHORT)
            self.stride = min(turns, lands)
            turns_far = turns < SHORTER and distance > SHORTEST_STEP
            if turns_far or (lands < SHORTER and distance > LANDED_AT_ONCE):
                self._return(known)
                return warm_step.TOO_FAR, iterations, q, F
        leapt = np.abs(self.state.r - known.state.r).max() > LEAP * distance + LEAST_LEAP
        turned = np.abs(np.sum(known.state.q * self.state.q, axis=1)).min() < np.cos(0.5 * limit)
        if leapt or turned:
            # Newton's method has no line search and can end on another branch
            self._return(known)
            return warm_step.NOT_CONTRACTING, iterations, q, F
        if not self._stable():
            # the branch has lost its stability in between, as a straight cable under compression
            self._return(known)
            return warm_step.NOT_CONVEX, iterations, q, F
        self.before.take(known.state)
        self._moved = True
        iterations += self._advance_twin(rigid)
        if not self.follows:
            self.add_error(OPEN * self._left_open(known.state))
        return warm_step.ADVANCED, iterations, self.state.q.copy(), self.state.F[-1].copy()

    def fall_with_friction(
        self, q: np.ndarray, F: np.ndarray, qe: np.ndarray, re: np.ndarray, f: np.ndarray,
        obstacles: np.ndarray | None,
    ) -> tuple[np.ndarray, np.ndarray, int] | None:  # fmt: skip
        """As in a viscous medium from the last equilibrium; `q` and `F` are not used.

        None unless the twin falls as well, and as far: a grid may fall where the branch goes on.
        """
        assert obstacles is not None
        known, twin = self._known(), self.twin
        iterations = None if twin is None else self._flow(qe, re, f, obstacles)
        if twin is None or iterations is None:
            return None
        fallen = twin._flow(qe, re, f, obstacles)
        if fallen is None or self._apart(twin) > FALLEN:
            self._return(known)
            self.pair()
            return None
        self._compare(twin)
        return self.shape, self.end_force, iterations + fallen

    def _landed(self, before: State) -> float:
        """Number of points that have come down on something rough since `before`; see PRESSING."""
        if not self.coulomb:
            return 0.0
        new = (before.lam == 0.0) & (self._under[:, FRICTION_COEFFICIENT] > 0.0)
        presses = np.where(new, self.state.lam, 0.0).max(axis=1)
        whole = max(PRESSING * float(np.linalg.norm(self.state.F[-1])), 1e-300)
        return float(np.minimum(presses / whole, 1.0).sum())

    def _left_open(self, before: State) -> float:
        """Friction, EI / L^2, that a step from `before` has left open; see `Landing.open`."""
        lay, lies = (in_patches(lam.max(axis=1) > 0.0) for lam in (before.lam, self.state.lam))
        if not self.coulomb or not lay.any() or not lies.any():
            return 0.0
        friction = (self.state.lam * self._under[:, FRICTION_COEFFICIENT]).max(axis=1)
        places = np.append(self.s0, 1.0)
        before_it, after_it = places[lay][[0, -1]], places[lies][[0, -1]]
        per_length = float(np.median(friction[lies])) * self.cells
        return Landing(np.abs(ENDS - before_it), np.abs(ENDS - after_it), per_length).open

    def _history_stride(self, before: Known) -> float:
        """`travel.stride` by what friction's history allows: how much has changed since `before`."""
        possible = float((self.state.lam * self._under[:, FRICTION_COEFFICIENT]).sum())
        if possible == 0.0 or not self.coulomb:
            return 2.0
        force = float(np.linalg.norm(self.wrench[:3]))
        friction_change = self._friction_change(before.state) / max(possible, force)
        larger = np.maximum(self._scales(), wrench_scales(before.wrench, self.least))
        wrench_change = float((sizes(self.wrench - before.wrench) / larger).max())
        return min(stride(wrench_change, WRENCH_CHANGE), stride(friction_change, FRICTION_CHANGE))

    def _friction_change(self, before: State) -> float:
        """Change across the cable, EI / L^2, since `before`, of the friction of what slips; see `travel`."""
        (normals, _), change = self._pressed(), self.state.tau - before.tau
        along = quaternion.tangents(self.state.q[::ORDER])[:, None]
        across = np.cross(
            along, change[..., :1] * self.frames + change[..., 1:] * np.cross(normals, self.frames)
        )
        return float(np.linalg.norm(across, axis=2)[self._slips].sum())

    # equilibria of other rods

    def finer(self) -> NodalRod | None:
        """The equilibrium and its friction on a finer grid; None if that fails.

        The error that friction has from this grid stays; that of where contacts are does not.
        """
        new = NodalRod(
            self.K, self.natural, self._under, int(FINER * self.cells), self.coulomb, self.compliance
        )
        new.work, new.tried = self.work, self.tried
        if not new.adopt(self, self.state.q, self.state.F[-1], *self._spread()):
            return None
        new._at_least(self._history_errors)
        return new

    def moved(self, places: Sequence[float]) -> NodalRod | None:
        """The same equilibrium with boundaries at these arc lengths, L, without a twin; None if it fails."""
        new = NodalRod(
            self.K, self.natural, self._under, self.cells, self.coulomb, self.compliance, sorted(places)
        )
        new.work = self.work
        arc_lengths, _, _, forces, obstacles, _, _ = self.contacts()
        taken = new.adopt(self, self.state.q, self.state.F[-1], arc_lengths, forces, obstacles, False)
        return new if taken else None

    def wrench_response(self, q: np.ndarray, F: np.ndarray, moving: Sequence[int]) -> np.ndarray:
        """As `NodalContacts.wrench_response`; what touches at a point alone goes along the cable.

        It goes to where the gap still has no slope. How wrenches and slopes follow it are differences. With
        friction it stays, as all contacts of a grid do.
        """
        out, x = self._response(moving)
        if self.offset is None or self.state.tau.any() or not np.isfinite(x).all():
            return out
        touching, by = self.lone(), BESIDE / self.cells
        by_motion = np.array([self._slopes_by(k, o, x, moving) for k, o, _ in touching])
        changes, by_place = [], []
        for k, _, _ in touching:
            here, sides = float(self.s0[k]), []
            for s in (here + by, here - by):
                new = self.moved([s if abs(place - here) < by else place for place in self.at])
                if new is None:
                    return np.full_like(out, np.nan)
                slopes = [new.rise(i, self._under[o]) for i, o, _ in touching]
                sides.append(np.append(new.all_wrenches(moving), slopes))
            changes.append((sides[0] - sides[1])[: len(out)] / (2.0 * by))
            by_place.append((sides[0] - sides[1])[len(out) :] / (2.0 * by))
        goes = -np.linalg.solve(np.array(by_place).T, by_motion)
        return out + np.array(changes).T @ goes

    def _slopes_by(self, k: int, o: int, x: np.ndarray, moving: Sequence[int]) -> np.ndarray:
        """(12 + 6 k,) derivative of the gap's slope at a boundary by the motions that change the unknowns by
        x (unknowns, 12 + 6 k).
        """
        shift, spin = obstacle_motions(len(self._under), moving)
        centre, axes = self._under[o, CENTRE:AXES], self._under[o, AXES:DIMENSIONS].reshape(3, 3)
        out = np.empty(x.shape[1])
        for j in range(x.shape[1]):
            sides = []
            for part in (BESIDE, -BESIDE):
                state_moved(self.state, np.ascontiguousarray(x[:, j]), part, self._rows, self._trial)
                body, turn = self._under[o].copy(), part * cross_matrix(spin[o, :, j])
                body[CENTRE:AXES] += part * shift[o, :, j] + turn @ centre
                body[AXES:DIMENSIONS] += (turn @ axes).ravel()
                sides.append(self.rise(k, body, self._trial))
            out[j] = (sides[0] - sides[1]) / (2.0 * BESIDE)
        return out

    def variant(
        self, mesh: Mesh | None = None, stiffness: np.ndarray | None = None,
        natural: np.ndarray | None = None, scale: float = 1.0, compliance: np.ndarray | None = None,
    ) -> NodalRod:  # fmt: skip
        """As `Rod.variant`, at the same equilibrium and mesh. `compliance`: in the new unit of force."""
        section = self.K if stiffness is None else stiffness, self.natural if natural is None else natural
        soft = scale * self.compliance if compliance is None else compliance
        new = restored_rod(self._known(), self, *section, soft, scale)
        if self.twin is not None:
            new.twin = self.twin.variant(None, stiffness, natural, scale, compliance)
            new.twin.follows = True
        return new

    def snapshot(self) -> Callable[[], Rod]:
        return partial(restored_rod, self._known(), self, self.K, self.natural, self.compliance)


def restored_rod(
    known: Known, like: NodalRod, stiffness: np.ndarray, natural: np.ndarray, compliance: np.ndarray,
    scale: float = 1.0,
) -> NodalRod:  # fmt: skip
    """A rod without a twin at a known equilibrium, with the cells and the friction of the rod `like`.

    Args:
        known: the equilibrium.
        like: a rod.
        stiffness, natural, compliance: as in `NodalRod`.
        scale: of forces, new unit over old.
    """
    new = NodalRod(stiffness, natural, known.under, like.cells, like.coulomb, compliance, like.at)
    new.state.take(known.state)
    for forces in (new.state.F, new.state.lam, new.state.tau):
        forces /= scale
    new.frames, new._slips, new.offset = known.frames.copy(), known.slips, like.offset
    new.wrench = known.wrench / scale
    if known.step is not None:
        f, tau = known.step.f / scale, known.step.tau / scale
        new._step = known.step._replace(f=f, tau=tau, turned=new.frames)
    qe, re, f, obstacles = known.conditions
    new.set_conditions(qe, re, f / scale, obstacles)
    return new
