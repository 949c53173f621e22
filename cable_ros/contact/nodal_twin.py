# SPDX-License-Identifier: Apache-2.0
"""The error of a rod on a grid of contacts, by a twin that has fewer points."""

from __future__ import annotations

import numpy as np

from cable_ros.common.backoff import Backoff
from cable_ros.contact.distance import deepest
from cable_ros.contact.nodal_adoption import NodalAdoption
from cable_ros.contact.report import positions
from cable_ros.contact.travel import FRICTION_STEP, travel
from cable_ros.rod import quaternion, warm_step
from cable_ros.rod.kirchhoff import Rod
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


def sizes(wrench: np.ndarray) -> np.ndarray:
    """(2,) the size of the force and that of the moment of a wrench (6,), or of a change of one."""
    return np.array([np.linalg.norm(wrench[:3]), np.linalg.norm(wrench[3:])])


class NodalTwin(NodalAdoption):
    """A rod that knows the error of its end wrench from a twin, which follows it.

    Its arguments are those of `NodalContacts`.
    """

    offset: float | None = None
    """Distance, L, of lone contacts from where the cable touches; None: not known."""
    twin: NodalTwin | None = None
    follows = False
    """Whether it is a twin, which takes the other's steps."""
    _lands = False  # whether it comes down so fast that steps must be shorter
    _pairing: Backoff | None = None  # when a twin that could not stand where this rod does is tried again
    # estimated errors of end force and moment, from the twin: all of it, and that of friction's history
    _errors, _history_errors = np.full(2, np.inf), np.zeros(2)
    _compared = np.ones(2)  # the force and moment that they were relative to
    _place_error = np.inf  # that of the end wrench by where contacts are, relative

    def _advance_twin(self, rigid: bool) -> int:
        """Let the twin follow in one step; if it cannot, it starts again from this rod's equilibrium.

        `rigid`: whether what sticks was tried rigid.
        """
        twin, pairing = self.twin, self._pairing
        if twin is None:
            if pairing is not None and pairing.waits:
                pairing.skip()
            elif pairing is not None:
                pairing.tried()
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
        new, scales = sizes(change), self._scales()
        known = np.isfinite(self._place_error)
        # they shrink as force and moment do, as friction does, and do not grow with them
        kept = FADING * np.minimum(1.0, scales / self._compared)
        self._errors = np.maximum(new, kept * self._errors) if known else new
        self._history_errors = np.maximum(new, kept * self._history_errors)
        self._compared = scales
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
            self._history_errors = np.zeros(2)  # its friction is the other rod's, without a step on this grid
        return found

    def doubt(self, error: float) -> None:
        """Let the relative error of the end wrench be this much at least; it fades slowly."""
        self._at_least(error * self._scales())

    def add_error(self, force: float) -> None:
        """Let the end force be off by that much more, EI / L^2, by friction's history; it fades slowly."""
        more = np.array([force, 0.0])
        self._errors, self._history_errors = self._errors + more, self._history_errors + more

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
        self.twin = twin if found else None
        if found:
            self._compare(twin)
        elif self._pairing is None:
            self._pairing = Backoff(LONGEST_ALONE)

    def relative_error(self, q: np.ndarray, F: np.ndarray) -> float:
        """Relative difference of its end wrench from its twin's, when they last were at one pose."""
        return max(self._relative(self._errors), self._place_error)
