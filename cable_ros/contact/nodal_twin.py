# SPDX-License-Identifier: Apache-2.0
"""The error of a rod on a grid of contacts, by a twin that has fewer points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cable_ros.common.backoff import Backoff
from cable_ros.contact.distance import deepest
from cable_ros.contact.nodal_adoption import NodalAdoption
from cable_ros.contact.nodal_contacts import FEWEST
from cable_ros.contact.report import positions
from cable_ros.contact.travel import FRICTION_STEP, travel
from cable_ros.rod import quaternion, warm_step
from cable_ros.rod.extensible import least_force
from cable_ros.rod.kirchhoff import NOTHING, Rod
from cable_ros.rod.units import relative_change, wrench_scales

STEP = 0.5 * FRICTION_STEP
"""Longest step, lengths."""
TWIN = 0.75
"""Number of points of the twin, which serves to estimate the error, over this rod's."""
CORNER = 0.02
"""Fraction of the longest step by which the twin may lag: a path that turns back must not be cut short."""
FADING = 0.95
"""Least estimated error, fraction of the last step's: with contacts between the points it may vanish by
chance. Force and moment fade apart, in their units: one of them may pass through zero."""
FALLEN = 0.25
"""Relative difference of its wrench from which a twin has not taken this rod's place but has fallen."""
LONGEST_ALONE = 15
"""Maximum number of steps before it is tried again whether a twin can."""
SAG = 100.0
"""Relative error per depth, L, of the cable inside an obstacle between two contact points."""
PARTS = 5
"""Number of places between two contact points where that is looked for: an edge may be anywhere."""


class NodalTwin(NodalAdoption):
    """A rod that knows the error of its end wrench from a twin, which follows it.

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
        super().__init__(stiffness, natural, obstacles, points, coulomb, compliance, at)
        self.offset: float | None = None
        """Distance, L, of lone contacts from where the cable touches; None: not known."""
        if self.compliance.any():
            self.least = least_force(self.compliance)
        self.twin: NodalTwin | None = None
        self.follows = False  # whether it is a twin, which takes the other's steps
        self._unpaired = False  # whether the twin could not stand where this rod does, and is tried again
        self._pairing = Backoff(LONGEST_ALONE)
        self._lands = False  # whether it comes down so fast that steps must be shorter
        # estimated errors of end force and moment, from the twin: all of it, and that of friction's history
        self._errors, self._history_errors = np.full(2, np.inf), np.zeros(2)
        self._compared = np.ones(2)  # the force and moment that they were relative to
        self._place_error = np.inf  # that of the end wrench by where contacts are, relative

    def _advance_twin(self, rigid: bool) -> int:
        """Let the twin follow in one step; if it cannot, it starts again from this rod's equilibrium.

        `rigid`: whether what sticks was tried rigid.
        """
        twin = self.twin
        if twin is None:
            if self._unpaired and self._pairing.waits:
                self._pairing.skip()
            elif self._unpaired:
                self._pairing.tried()
                self.pair()
            return 0
        qe, re, f, obstacles = self.qe, self.re, self.f, self._under
        far = travel(twin.qe, twin.re, twin._under, qe, re, obstacles)
        if far < CORNER * STEP and not self._lands:
            return 0
        twin._lands = rigid
        left = twin.work
        code, iterations, _, _ = twin.advance(twin.state.q, twin.state.F[-1], qe, re, f, 0.0, 0.6, obstacles)
        self.work -= left - twin.work
        if code != warm_step.ADVANCED:
            self.pair()
            return iterations
        self._compare(twin)
        return iterations

    def _compare(self, twin: NodalTwin) -> None:
        """Estimate the error of the end wrench from the difference to the twin's.

        It is taken to be of order 1.5: the rod and the pressure are of the second, but patches begin and end
        between points. An obstacle that presses at a single point can be off by half a cell on both grids.
        """
        change = (self.wrench - twin.wrench) / (TWIN**-1.5 - 1.0)
        new = np.array([np.linalg.norm(change[:3]), np.linalg.norm(change[3:])])
        known = np.isfinite(self._place_error)
        self._errors = self._faded(self._errors, new) if known else new
        self._history_errors = self._faded(self._history_errors, new)
        self._compared = self._scales()
        self._place_error = max(self._placed(), FADING * self._place_error if known else 0.0)

    def _apart(self, twin: NodalTwin) -> float:
        """Relative difference of the end wrenches."""
        return float(relative_change(self.wrench - twin.wrench, self.wrench, self.least))

    @property
    def twin_error(self) -> float:
        """Estimated relative error of the end wrench by friction's history on this grid."""
        return self._relative(self._history_errors)

    def _relative(self, errors: np.ndarray) -> float:
        """Errors (2,) of end force and moment, relative to those at present."""
        return float((errors / self._scales()).max())

    def _faded(self, before: np.ndarray, new: np.ndarray) -> np.ndarray:
        """Errors (2,) of end force and moment: the `new` ones, and at least those of the last comparison.

        They shrink as force and moment do, as friction does, and do not grow with them.
        """
        return np.maximum(new, FADING * before * np.minimum(1.0, self._scales() / self._compared))

    def _scales(self) -> np.ndarray:
        """(2,) the end force and moment that an error is relative to."""
        return np.array(wrench_scales(self.wrench, self.least))

    def _placed(self) -> float:
        """Estimated relative error of the end wrench by where contacts are, without the twin."""
        mine = self.wrench
        alone = (self.state.lam > 0.0).sum(axis=0) <= 2
        lone = float(self.state.lam[:, alone].max(initial=0.0))
        away = 0.25 * lone / self.cells if self.offset is None else self.offset * lone
        lever = np.array([0.0, 0.0, 0.0, away, 0.0, 0.0])
        beside = float(relative_change(lever, mine, self.least))
        # error by lumping the force of a cell in its middle
        lumped = float(np.linalg.norm(self.state.F[-1])) / (12.0 * self.cells**2)
        # and at least this error by edges that cut into it between two points
        tangents = self.directions()
        cut = SAG * self._cut()
        # between two sliding points the true normal has no component along the cable, but theirs have one
        normals, _ = self._pressed()
        axial = np.where(self._slips, self.state.lam * np.einsum("ka,koa->ko", tangents, normals), 0.0)
        along = float(np.linalg.norm(axial.T @ tangents, axis=1).sum())
        slope = np.concatenate((mine[:3] * along / max(float(np.linalg.norm(mine[:3])), 1e-300), np.zeros(3)))
        edges = float(relative_change(slope, mine, self.least))
        return max(beside, lumped, cut, edges)

    def _cut(self) -> float:
        """How deep the centreline is inside an obstacle between two contact points, L; negative outside."""
        at = (self.s0[:, None] + self.h[:, None] * np.arange(PARTS) / PARTS).ravel()
        r = positions(self.centreline(self.state.q, self.state.F[-1]), self.h, self.s0, at)
        tangents = quaternion.tangents(self.mesh.interpolate(self.state.q, at))
        return float(deepest(r, tangents, np.diff(at), self._under))

    def adopt(self, rod: Rod, q: np.ndarray, F: np.ndarray, arc_lengths: np.ndarray, forces: np.ndarray,
              obstacles: np.ndarray, pair: bool = True) -> bool:  # fmt: skip
        """As `NodalAdoption.adopt`. `pair`: whether to have a twin."""
        found = super().adopt(rod, q, F, arc_lengths, forces, obstacles)
        if found and pair:
            self.pair()
            self._history_errors[:] = 0.0  # its friction is the other rod's, without a step on this grid
        return found

    def doubt(self, error: float) -> None:
        """Let the relative error of the end wrench be this much at least; it fades slowly."""
        self._at_least(error * self._scales())

    def _at_least(self, errors: np.ndarray) -> None:
        """Let the errors of end force and moment be these (2,) at least."""
        self._errors = np.maximum(self._errors, errors)
        self._history_errors = np.maximum(self._history_errors, errors)

    def pair(self) -> None:
        """Make the twin, of fewer cells, whose end wrench shows the error of the grid."""
        twin = type(self)(
            self.K, self.natural, self._under, int(TWIN * self.cells), self.coulomb, self.compliance, self.at
        )
        twin.follows, twin.work = True, 0.0
        found = twin.adopt(self, self.state.q, self.state.F[-1], *self._spread(), False)
        self.work += twin.work
        found = found and self._apart(twin) < FALLEN
        self.twin, self._unpaired = twin if found else None, not found
        if found:
            self._compare(twin)

    def relative_error(self, q: np.ndarray, F: np.ndarray) -> float:
        """Relative difference of its end wrench from its twin's, when they last were at one pose."""
        return max(self._relative(self._errors), self._place_error)
