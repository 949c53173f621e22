# SPDX-License-Identifier: Apache-2.0
"""One cable of a tracker, tracked from pose to pose on its branch of equilibria."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from cable_ros.branch.followed_equilibrium import FollowedEquilibrium
from cable_ros.branch.property_change import Section, follow, with_section
from cable_ros.contact.friction_kernels import COULOMB
from cable_ros.effects.effect import Properties
from cable_ros.equilibrium import Equilibrium, Status
from cable_ros.rod.kirchhoff import ALGEBRAIC
from cable_ros.rod.units import relative
from cable_ros.scene import Kinematics

MOST_WAITING = 64
"""Maximum number of poses that wait to be passed through, as friction depends on the path."""
ENOUGH = 0.1
"""Minimum fraction of the budget left to go from one of them to the next."""
POSES_CUT = f"more than {MOST_WAITING} poses wait to be passed through, and friction depends on the path"


class CableTracker(FollowedEquilibrium):
    """Keeps one cable on its branch, given the world poses (2, 7) of its two clamps."""

    def change_properties(
        self, properties: Properties, kinematics: Callable[[np.ndarray], np.ndarray], index: int
    ) -> bool:
        """Continue the equilibrium to other properties of the cable at fixed clamps.

        `kinematics(joints)[index]` are the poses of the clamps. Returns whether the continuation arrived. If
        not, the next solve starts from the old shape among obstacles, because friction depends on it, and
        otherwise from a search for the equilibrium nearest in twist.
        """
        before, rod = self._units, self._rod
        self._pending = None
        self._use(properties)
        if rod is None:
            return True
        poses = kinematics(self._joints)[index]
        load = relative(poses, rod.qe, self._weight, self._units.length, self._units.force)[2]
        section = Section(self._stiffness, self._natural, load, self._compliance)
        scale = self._units.force / before.force
        changed = follow(rod, self._q, self._F, section, scale, ALGEBRAIC * self.tolerance)
        self._estimate = np.inf
        if changed is not None:
            self._rod, self._q, self._F = changed
        elif rod.obstacles is not None and (rod.on_grid or not (self._shears and rod.touches)):
            self._rod, self._F = with_section(rod, section, scale), self._F / scale
            self._rod.refactor(self._q, self._F)
        else:
            self._rod = None
            self._lose("it could not be followed to the cable's new properties")
        return changed is not None

    def solve(
        self, kinematics: Kinematics, index: int, joints: np.ndarray, poses: np.ndarray, begin: float
    ) -> Equilibrium:
        """The equilibrium at `joints`, with the clamps at `poses`; `kinematics` gives those in between."""
        self._budget = self._full_budget
        if self._pending is not None:
            found = self._resume(joints, begin)
            if found is not None:
                return found
        if self._record.waiting:
            unfinished = self._catch_up(kinematics, index, joints, begin)
            if unfinished is not None:
                return unfinished
        return self._follow(kinematics, index, joints, poses, begin)

    def _catch_up(
        self, kinematics: Kinematics, index: int, joints: np.ndarray, begin: float
    ) -> Equilibrium | None:
        """Pass through the waiting poses before `joints`; returns a result if that is not finished."""
        waiting = self._record.waiting if self._model == COULOMB and self._rod is not None else ()
        self._record = replace(self._record, waiting=())
        if len(waiting) > MOST_WAITING:
            self._lose(POSES_CUT)
            return None
        if waiting and np.array_equal(waiting[-1], joints):
            waiting = waiting[:-1]
        for i, asked in enumerate(waiting):
            found = self._pass_through(kinematics, index, np.array(asked), begin)
            done = found.status is not Status.UNFINISHED
            if not done or self._budget <= ENOUGH * self._full_budget:
                left = replace(self._record, waiting=waiting[i + done :])
                self._record = left.with_waiting(self._joints, joints)
                return self.failed(Status.UNFINISHED, Status.UNFINISHED.sentence, time.perf_counter() - begin)
        return None

    def _pass_through(
        self, kinematics: Kinematics, index: int, joints: np.ndarray, begin: float
    ) -> Equilibrium:
        """Pass through a pose that was asked for before."""
        self._passing = True
        found = self._follow(kinematics, index, joints, kinematics.poses(joints)[index], begin)
        self._passing = False
        if self._rod is not None:
            self._budget = min(self._budget, self._rod.work)
        return found
