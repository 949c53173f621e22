# SPDX-License-Identifier: Apache-2.0
"""One cable at an equilibrium that a search finds, piece by piece within the budget of each call."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from cable_ros.branch.branch_record import BranchRecord
from cable_ros.branch.cold_start import Found, Sought, equilibria, same
from cable_ros.branch.property_change import Section, follow
from cable_ros.branch.refinement import refine
from cable_ros.branch.search import Search
from cable_ros.branch.tracked_equilibrium import TrackedEquilibrium
from cable_ros.branch.walk import VERY_TAUT
from cable_ros.contact.friction_kernels import COULOMB
from cable_ros.contact.nodal_rod import NodalRod
from cable_ros.contact.shearing_rod import without_shear
from cable_ros.equilibrium import Equilibrium, Status
from cable_ros.rod.kirchhoff import ALGEBRAIC, Rod
from cable_ros.scene import Kinematics

FREE_COLD_WORK = 300_000
"""Budget of a search without obstacles, iterations times unknowns: about 250 ms at 0.8 us."""
IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


@dataclass(frozen=True, eq=False)
class Pending:
    """An unfinished search."""

    search: Search
    joints: np.ndarray
    """(n,) joint values of its pose."""
    poses: np.ndarray
    """(2, 7) of the clamps."""
    loss_cause: str
    """How the branch was lost, a clause; empty: it was not."""


class SearchedEquilibrium(TrackedEquilibrium):
    """A cable with its last equilibrium and the search for another, while there is one."""

    _pending: Pending | None = None
    _budget = 0.0
    """Work left of the present solve for the next pose."""

    def reset(self) -> None:
        super().reset()
        self._pending = None

    def _cold(
        self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray, begin: float,
        target_twist: float | None, loss_cause: str = "",
    ) -> Equilibrium:  # fmt: skip
        """Search the pose for stable equilibria: take the one nearest the target twist, or of least energy.

        `loss_cause`: how the branch was lost, a clause; empty: it was not.
        """
        conditions = self._conditions(kinematics, joints, poses, IDENTITY)
        chord = self._chord(conditions)
        if not chord < self._reach:
            length = self._units.length
            message = (
                f"The clamps are {(chord - 1.0) * length * 1e3:.4g} mm farther apart than the cable is long"
                f" ({length:g} m)."
            )
            if chord <= 1.0:
                message = (
                    f"The clamps are as far apart as the cable is long ({length:g} m):"
                    " its tension has no bound."
                )
            return self.failed(Status.OUT_OF_REACH, message, time.perf_counter() - begin)
        if obstruction := self._obstruction(conditions):
            return self.failed(Status.OUT_OF_REACH, obstruction, time.perf_counter() - begin)
        sought = Sought(
            self._stiffness,
            self._natural,
            conditions,
            target_twist,
            self.tolerance,
            self._sought_compliance,
            self._ends,
            self._counts,
            self._clamps,
        )
        return self._search(Pending(Search(sought), joints, poses, loss_cause), begin)

    def _search(self, pending: Pending, begin: float) -> Equilibrium:
        """Continue a search; returns its result, `UNFINISHED` until it is over."""
        search = pending.search
        if self._obstacles is None:
            search.go(FREE_COLD_WORK)
        else:
            self._budget = search.go(self._budget)
        self._pending = None if search.over else pending
        seconds = time.perf_counter() - begin
        if not search.over:
            return self.failed(Status.UNFINISHED, Status.UNFINISHED.sentence, seconds)
        found = None if search.found is None else self._with_shear(search.found)
        if found is None:
            return self.failed(Status.NOT_CONVERGED, self._nothing_found, seconds)
        if pending.loss_cause:
            waiting, target_twist = self._record.waiting, search.sought.target_twist
            twist = (
                "" if target_twist is None else f", total twist {target_twist:.3f} -> {found.twist:.3f} rad"
            )
            self._lose(pending.loss_cause + twist, search.several)
            self._record = replace(self._record, waiting=waiting)
        self._grid_history, self._taut_force, self._share, self._way_back = None, VERY_TAUT, 1.0, 1.0
        self._take(found, pending.joints)
        return self._finish(Status.CONVERGED, search.sentence, found.iterations, pending.poses, begin)

    @property
    def _counts(self) -> float:
        """See `Rod.least`, of a rod that a search begins with."""
        return Rod.least

    @property
    def _sought_compliance(self) -> np.ndarray | None:
        """With which a search begins: among obstacles shear comes afterwards, see `_with_shear`."""
        return self._compliance if self._obstacles is None else without_shear(self._compliance)

    def _with_shear(self, found: Found) -> Found | None:
        """What a search among obstacles has found, brought to the cable's shear; None if that fails.

        Friction begins at zero there, as in any search.
        """
        if not self._shears or self._obstacles is None:
            return found
        section = Section(self._stiffness, self._natural, found.rod.f, self._compliance)
        followed = follow(found.rod, found.q, found.F, section, 1.0, ALGEBRAIC * self.tolerance)
        if followed is None:
            return None
        rod, q, F = followed
        if isinstance(rod, NodalRod):
            rod.coulomb = self._model == COULOMB
            rod.pair()
            return Found.at(rod, q, F, found.iterations)
        fine, estimate = refine(Found.at(rod, q, F, found.iterations), self.tolerance)
        return fine if estimate <= self.tolerance else None

    @property
    def _nothing_found(self) -> str:
        """The message of a search without result."""
        if self._ends is None or not self._ends.given_moments(IDENTITY).any():
            return Status.NOT_CONVERGED.sentence
        return (
            "No equilibrium was found that is stable for certain: the moment on its free end keeps its "
            "direction, and beyond about 2 EI / L nothing tells whether the cable is stable; make it smaller."
        )

    def _resume(self, joints: np.ndarray, begin: float) -> Equilibrium | None:
        """Continue the pending search; None if the cable can be tracked from its result to `joints`."""
        self._budget = max(self._budget, 1.0)  # one piece is always done
        pending = self._pending
        assert pending is not None
        if pending.search.sought.tolerance != self.tolerance:
            self._pending = None
            return None
        there = np.array_equal(joints, pending.joints)
        found = self._search(pending, begin)
        if self._pending is not None:
            if not there or self._record.waiting:
                self._record = self._record.with_waiting(pending.joints, joints)
            return found
        more_poses = self._model == COULOMB and bool(self._record.waiting)
        return found if there and not more_poses else None

    def branches(self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray) -> list[Equilibrium]:
        """The stable equilibria that a wide search finds, by rising energy; the last one is then tracked."""
        begin = time.perf_counter()
        conditions = self._conditions(kinematics, joints, poses, IDENTITY)
        out: list[Equilibrium] = []
        self._record, self._pending, self._grid_history = BranchRecord(), None, None
        if not self._chord(conditions) < self._reach:
            return out
        found: list[Found] = []
        for turns in (-1, 0, 1):
            target_twist = (self._target_twist or 0.0) + 2.0 * np.pi * turns
            for one in equilibria(
                self._stiffness,
                self._natural,
                conditions,
                target_twist,
                self.tolerance,
                True,
                self._sought_compliance,
                self._ends,
            ):
                fine, estimate = refine(one, self.tolerance)
                if estimate <= self.tolerance and not any(same(fine, other) for other in found):
                    found.append(fine)
        sheared = [self._with_shear(one) for one in found]
        for one in sorted([one for one in sheared if one is not None], key=lambda one: one.energy):
            self._take(one, joints)
            status = Status.CONVERGED
            out.append(self._finish(status, status.sentence, one.iterations, poses, begin))
        return out
