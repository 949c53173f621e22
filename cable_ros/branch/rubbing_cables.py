# SPDX-License-Identifier: Apache-2.0
"""Cables that touch each other with friction, from pose to pose: what friction remembers, and forgets."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from cable_ros.branch.cable_tracker import MOST_WAITING, POSES_CUT, CableTracker
from cable_ros.branch.coulomb_contact import SLIPS, key
from cable_ros.branch.crossed_cables import MOST_ITERATIONS, SHORTEST, CrossedCables
from cable_ros.branch.crossing_cable import CrossingCable
from cable_ros.branch.crossing_newton import Pair
from cable_ros.branch.followed_equilibrium import POSE_LEFT_OUT
from cable_ros.branch.rubbing_cable import RubbingCable
from cable_ros.branch.rubbing_newton import RubbingNewton
from cable_ros.contact.crossing import Spacer
from cable_ros.equilibrium import ContactTable, Equilibrium
from cable_ros.scene import Kinematics, Scene

FAINT = 0.02
"""Maximum force of a contact that begins, over the largest one of a clamp: its friction is not known yet."""
BEGINS = 4.0
"""Steps of `SHORTEST` in which contact may begin with any force."""
ROUGH_ITSELF = "Cable '{}' comes to touch itself, which cannot be combined with friction between cables yet."


class RubbingCables(RubbingNewton, CrossedCables):
    """As `CrossedCables`, with friction."""

    def reset(self) -> None:
        super().reset()
        self._waiting: list[np.ndarray] = []  # poses asked for that the path still has to pass through
        self._itself = ""

    def _newton(
        self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray, guess: Sequence[Spacer]
    ) -> list[Spacer] | None:
        rough = next((one for one in guess if one.of_itself), None)
        if rough is not None:
            self._itself = ROUGH_ITSELF.format(self.cables[rough.cables[0]].name)
            return None
        return super()._newton(kinematics, joints, poses, guess)

    def _follow(self, kinematics: Kinematics, joints: np.ndarray) -> bool | None:
        """As `CrossedCables._follow`, through all poses that were asked for before."""
        route, spent, self._itself = [*self._waiting, joints], 0, ""
        if len(route) > MOST_WAITING:
            route = route[-MOST_WAITING:]
            self._distrust(POSES_CUT)
        for k, there in enumerate(route):
            arrived = super()._follow(kinematics, there)
            spent += self.iterations
            if arrived is False:
                self._waiting = []
                if self.spacers:
                    self._distrust(POSE_LEFT_OUT)
                return False
            if arrived is None or (spent >= MOST_ITERATIONS and k + 1 < len(route)):
                self._waiting = route[k + (arrived is True) :]
                return None
        self._waiting = []
        return True

    def _distrust(self, cause: str) -> None:
        for cable in self.cables:
            cable.distrust(cause)

    def _past_fold(self, kinematics: Kinematics, joints: np.ndarray, at: float, step: float) -> float | None:
        """As `CrossedCables._past_fold`; not among contacts, whose friction would be forgotten."""
        if self.spacers:
            return None
        beyond = super()._past_fold(kinematics, joints, at, step)
        if beyond is not None and self.spacers:
            self._distrust("it snapped, and the friction of its contacts is not known")
        return beyond

    def _pushed(
        self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray, spacers: list[Spacer],
        pair: Pair, slots: tuple[int, int],
    ) -> list[Spacer] | None:  # fmt: skip
        """As `CrossedCables._pushed`; contact begins, without friction, in a step in which it is faint.

        Contact that has been left in this step, and would begin again, shows that the step is too long: its
        friction is that of the last equilibrium, from which pushing starts far away.
        """
        begins = self._cold or self._joints is None
        short = begins or float(np.abs(joints - self._joints).max(initial=0.0)) <= BEGINS * SHORTEST
        before = None if short else self._before_was(pair)
        if before is not None and before.known_to(self.spacers):
            return None
        found = super()._pushed(kinematics, joints, poses, spacers, pair, slots)
        if found is None or short:
            return found
        largest = max(cable.pull for cable in self.cables)
        force = max(touch.force for touch in self._touches(found[-1], poses))
        return found if force <= FAINT * largest else None

    def _why(self) -> str:
        return self._itself or super()._why()

    def _publish(
        self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray, begin: float
    ) -> list[Equilibrium]:
        found = super()._publish(kinematics, joints, poses, begin)
        slipping: list[set[int]] = [set() for _ in self.cables]
        for one in self.spacers:
            if self._last[key(one)][1] == SLIPS:
                for i, slot in zip(one.cables, one.slots, strict=True):
                    slipping[i].add(self.cables[i].first_slot + slot)
        return [
            replace(one, _touching=partial(_with_sliding, one._touching, which)) if which else one
            for one, which in zip(found, slipping, strict=True)
        ]


def _with_sliding(read: Callable[[], ContactTable | None] | None, which: set[int]) -> ContactTable | None:
    """The contacts of a cable of which these slide, by number of the obstacle."""
    table = None if read is None else read()
    return None if table is None else replace(table, sliding=np.isin(table.obstacle, list(which)))


def crossed_cables(scene: Scene, tracked: Sequence[CableTracker]) -> CrossedCables | None:
    """The cables of a scene whose cables touch each other; `tracked`: of its cables."""
    if not scene.cable_contact:
        return None
    radii = [cable.radius for cable in scene.cables]
    rubbing = [one for one in tracked if isinstance(one, RubbingCable)]
    if rubbing:
        return RubbingCables(rubbing, radii, scene.cable_friction)
    return CrossedCables([one for one in tracked if isinstance(one, CrossingCable)], radii)
