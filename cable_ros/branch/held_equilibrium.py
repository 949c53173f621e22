# SPDX-License-Identifier: Apache-2.0
"""The present equilibrium of one cable, and what is known of its branch and of friction's history."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from cable_ros.branch import results
from cable_ros.branch.branch_record import BranchRecord, GridHistory, Loss, is_unique, relative_motion
from cable_ros.branch.cable_model import CableModel
from cable_ros.branch.cold_start import Conditions, Found, conditions_of
from cable_ros.branch.snap_through import SnapThrough
from cable_ros.branch.walk import VERY_TAUT
from cable_ros.common.backoff import Backoff
from cable_ros.contact.friction_kernels import COULOMB
from cable_ros.effects.choice import Choice
from cable_ros.effects.effect import Properties
from cable_ros.rod.kirchhoff import Rod
from cable_ros.rod.rod_state import TWIST
from cable_ros.scene import Cable

LONGEST_STAY = 63
"""Maximum number of poses that a cable stays on its grid of contacts before it is solved without again."""


class HeldEquilibrium(CableModel):
    """A cable with its last equilibrium, and whether its branch is known."""

    def __init__(
        self, cable: Cable, properties: Properties, tolerance: float, polyline_points: int,
        obstacle_names: Sequence[str] = (),
    ) -> None:  # fmt: skip
        super().__init__(cable, properties, obstacle_names)
        self.tolerance, self.polyline_points = tolerance, polyline_points
        self.fractions: np.ndarray | None = None
        """(n,) of its length, at which a piece of a cable with clips has points; None: at equal distances."""
        self.environment: dict[str, float] = {}
        self.choice: Choice | None = None
        self._reader, self._outline = results.Reader(), results.Reader()
        self.reset()

    def reset(self) -> None:
        """Forget the equilibrium."""
        self._rod: Rod | None = None
        self._q, self._F = np.empty((0, 4)), np.empty(3)
        self._joints = np.empty(0)
        self._twist: float | None = None
        self._record = BranchRecord()
        self._passing = False  # whether the pose is a waiting one that the path passes through
        self._resolved = 0.0
        self._estimate = self._margin = np.nan
        self._apart = np.inf
        self._turned_over = 0  # poses in a row that the friction of `friction_model: sliding` kept it from
        self._snapped = 0  # times with friction on the way to a pose that has not been reached yet
        self._crawled = 0  # solves in a row that hardly got on
        self._share = 1.0  # of the longest step: what is left to try after a budget without progress
        self._way_back = 1.0  # of the longest step: with which a taut cable tries the next pose
        self._afresh = False  # whether it has got another mesh since the last pose
        self._taut_force = VERY_TAUT  # end force, EI / L^2, from which this branch is known to be taut
        self._grid_history: GridHistory | None = None
        self._off_grid = Backoff(LONGEST_STAY)

    @property
    def lost(self) -> str:
        """Why the branch was lost, a clause; empty while it is known."""
        loss = self._record.loss
        return "" if loss is None else loss.cause

    def distrust(self, cause: str) -> None:
        """Treat the branch as lost until it is known again, or `reset`; `cause`: a clause."""
        self._lose(cause)

    def _lose(self, cause: str, several: bool = False) -> None:
        history = self._model == COULOMB
        self._record = self._record.after_loss(cause, history, self._joints, self._twist, several)
        if self._rod is not None:
            self._rod.forgot = False

    def _record_snaps(self, snaps: Sequence[SnapThrough]) -> None:
        """Update whether the branch is known after snap-throughs."""
        for snap in snaps:
            if snap.touched and self._model == COULOMB:
                self._lose("it snapped, and the friction of its contacts was forgotten")
            elif snap.jumped and not snap.folded:
                turned = f"total twist {snap.twist_before:.3f} -> {snap.twist_after:.3f} rad"
                self._lose(f"it snapped, {turned}, with a stability margin of {snap.margin:.2g} before")
            elif snap.jumped:
                self._record = self._record.after_snap(snap)
            elif snap.forks:
                self._record = self._record.after_fork(snap.at)

    def _add_motion(self, before: Conditions, step: bool, free: Callable[[Loss], float | None]) -> None:
        """Add the motion since `before` to the record of a lost branch, which may be known again by it.

        `free` gives the twist here of a cable without contact, continued from the last known pose.
        """
        rod, loss = self._rod, self._record.loss
        assert rod is not None
        touching = rod.touches
        motion, slips = relative_motion(before, conditions_of(rod)), touching and rod.all_slip
        if self._grid_history is not None:
            self._grid_history = self._grid_history.after_motion(motion, touching)
        if loss is None:
            return
        loss = loss.after_motion(motion, slips, step)
        if loss.resolved or (not touching and loss.search_due and self._is_unique(rod, free(loss))):
            rod.slip_anew()
            self._record = BranchRecord()
            return
        searched = not touching and loss.search_due
        self._record = BranchRecord(replace(loss, since_search=0.0) if searched else loss)

    @property
    def _error(self) -> float:
        """Estimated relative error of the end wrench, with that of friction's history."""
        return max(self._estimate, self._earlier_error)

    @property
    def _earlier_error(self) -> float:
        """That of friction's history from a grid."""
        return 0.0 if self._grid_history is None else self._grid_history.error

    def _keep_grid_error(self, error: float) -> None:
        """Let friction's history have come from a grid, with this relative error or the one that it had."""
        self._grid_history = GridHistory(max(error, self._earlier_error))

    @property
    def _remembers(self) -> bool:
        """Whether the motion since a loss, or since friction came from a grid, counts."""
        return self._record.loss is not None or self._grid_history is not None

    def _is_unique(self, rod: Rod, free: float | None) -> bool:
        """Whether no other equilibrium is near, and its twist is within half a turn of `free`, rad."""
        if free is not None and not abs(float(rod.totals[TWIST]) - free) < np.pi:
            return False
        energy, _, _ = rod.linearize(self._q, self._F)
        rod.factor(0.0)
        here = Found(rod, self._q, self._F, energy, float(rod.totals[TWIST]), 0)
        return is_unique(here, self._stiffness, self._natural, self._compliance, self.tolerance, self._ends)

    def _take(self, found: Found, joints: np.ndarray) -> None:
        self._rod, self._q, self._F, self._joints = found.rod, found.q, found.F, joints
        self._estimate = np.inf  # not known yet
        found.rod.use_friction(self._model)  # it is factored without
        self._resolved = self.tolerance
