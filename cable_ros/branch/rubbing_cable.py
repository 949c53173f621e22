# SPDX-License-Identifier: Apache-2.0
"""A cable that touches others with friction: a force and a couple more at each contact point."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cable_ros.branch.crossing_cable import CrossingCable, Remembered, Touch
from cable_ros.branch.results import Tangent
from cable_ros.branch.shared_piece import Place
from cable_ros.contact.active_set_rod import ActiveSetRod
from cable_ros.contact.dead_loads import ANSWERS, LOADS
from cable_ros.contact.points import (
    ARC_LENGTH,
    ARM,
    BEFORE,
    COLUMNS,
    FORCE,
    FRICTION,
    GIVEN,
    HOLD,
    OBSTACLE,
    SPRING,
    TARGET,
)
from cable_ros.contact.report import positions
from cable_ros.equilibrium import Equilibrium
from cable_ros.linalg.cross import cross
from cable_ros.rod import quaternion
from cable_ros.scene import Kinematics


class Hold(NamedTuple):
    """What rubs at a contact, on one cable."""

    arc: float
    """Arc length of the section that it acts on, m."""
    arm: np.ndarray
    """(3,) from that one's centre to where the cables touch, along its axes, m."""
    force: np.ndarray
    """(3,) world, N."""
    place: np.ndarray
    """(3,) where a spring holds the end of the arm, world, m."""
    stiffness: float
    """Of that spring, N/m."""


class Section(NamedTuple):
    """A section of a cable; world."""

    position: np.ndarray
    """(3,) of its centre, m."""
    turn: np.ndarray
    """(3, 3) its axes in columns."""


class RubbingCable(CrossingCable):
    """One cable whose contacts in slots may carry friction, which its group gives."""

    clamps: np.ndarray
    """(2, 7) of the present equilibrium, world."""

    def reset(self) -> None:
        super().reset()
        self._holds: dict[int, Hold] = {}

    def find(self, kinematics: Kinematics, joints: np.ndarray, place: Place) -> Equilibrium:
        self.clamps = place.poses
        return super().find(kinematics, joints, place)

    def remember(self) -> Remembered:
        return super().remember()._replace(clamps=self.clamps)

    def recall(self, known: Remembered) -> None:
        super().recall(known)
        assert known.clamps is not None
        self.clamps = known.clamps

    def hold(self, holds: dict[int, Hold]) -> None:
        """Rub so, by slot, from the next attempt on; a slot that is left out has no friction."""
        self._holds = dict(holds)

    def attempt(self, kinematics: Kinematics, joints: np.ndarray, place: Place) -> bool:
        """See `CrossingCable.attempt`; with friction, also at a contact that begins."""
        self._load(place.poses[0])
        found = super().attempt(kinematics, joints, place)
        if found and self._load(place.poses[0]):
            found = super().attempt(kinematics, joints, place)
        if found:
            self.clamps = place.poses
        return found

    @property
    def start(self) -> np.ndarray:
        """(7,) the start clamp of the present equilibrium, world."""
        return self.clamps[0]

    def at(self, known: Remembered) -> bool:
        """Whether the present equilibrium is this one."""
        return self._q is known.kept.q

    def _load(self, start: np.ndarray) -> bool:
        """Give the contact points their friction; whether some had another. `start` (7,): the start clamp."""
        rod = self._rod
        assert isinstance(rod, ActiveSetRod)
        points = rod.points[: rod.count]
        if not len(points):
            return False
        turn, unit, changed = quaternion.matrix_from_ros(start[3:]), self._units, False
        for row in points:
            given, own = self._holds.get(int(row[OBSTACLE]) - self.first_slot), np.zeros(COLUMNS - ARM)
            if given is not None:
                own[:3], own[HOLD - ARM] = given.arm / unit.length, given.arc / unit.length
                own[GIVEN - ARM : TARGET - ARM] = given.force @ turn / unit.force
                own[TARGET - ARM : SPRING - ARM] = (given.place - start[:3]) @ turn / unit.length
                own[SPRING - ARM] = given.stiffness * unit.length / unit.force
            changed = changed or bool((row[ARM:] != own).any())
            rod.ready = rod.ready and bool(row[SPRING] == own[SPRING - ARM])  # other rows of its system
            row[ARM:] = own
            if given is None:
                row[FRICTION:BEFORE] = 0.0
        if changed:
            rod.settled = None  # the gradient there is another one
        return changed

    def friction(self, slot: int, start: np.ndarray) -> np.ndarray:
        """(3,) on this cable, where it touches in a slot, world, N; `start` (7,): the start clamp."""
        rod = self._rod
        assert isinstance(rod, ActiveSetRod)
        force = rod.points[self._first(slot), FRICTION:BEFORE]
        out: np.ndarray = quaternion.matrix_from_ros(start[3:]) @ force * self._units.force
        return out

    def _first(self, slot: int) -> int:
        """Number of its first contact point in a slot."""
        rod = self._rod
        assert isinstance(rod, ActiveSetRod)
        on = np.flatnonzero(rod.points[: rod.count, OBSTACLE] == self.first_slot + slot)
        return int(on[np.argmin(rod.points[on, ARC_LENGTH])])

    def touches(self, slot: int, start: np.ndarray) -> Touch:
        """See `CrossingCable.touches`; the wrench is without friction."""
        found = super().touches(slot, start)
        rod = self._rod
        assert isinstance(rod, ActiveSetRod)
        if slot not in self._holds or not found.points:
            return found
        normal = float(rod.points[self._first(slot), FORCE]) * self._units.force
        return found._replace(wrench=found.wrench * (normal / max(found.force, 1e-300)))

    def section_at(self, arc_length: float, start: np.ndarray) -> Section:
        """The section at an arc length, m, of the present equilibrium; `start` (7,): the start clamp."""
        rod = self._rod
        assert isinstance(rod, ActiveSetRod)
        s = np.array([arc_length / self.length])
        here = positions(rod.centreline(self._q, self._F), rod.mesh.lengths, rod.mesh.starts, s)[0]
        turn = quaternion.matrix_from_ros(start[3:])
        own = quaternion.matrix_from_ros(quaternion.to_ros(rod.mesh.interpolate(self._q, s)[0]))
        return Section(start[:3] + turn @ here * self.length, turn @ own)

    @property
    def pull(self) -> float:
        """Force of the end clamp, N."""
        return float(np.linalg.norm(self.end_force)) * self._units.force

    @property
    def stick_unit(self) -> float:
        """EI / L^3, N/m."""
        return self._units.force / self._units.length


def loaded_response(
    tangent: Tangent, moving: Sequence[int], loaded: Sequence[int], before: Sequence[float]
) -> np.ndarray:
    """(12 + 6 m + ANSWERS k, 12 + 6 m + LOADS k) see `Equilibrium.wrench_response` and `contact.dead_loads`.

    World, SI. With friction given at k contacts, of which the obstacles' wrenches are without.

    Args:
        tangent: of the cable.
        moving: numbers of m obstacles.
        loaded: numbers of the k obstacles that are touched with friction.
        before: (k,) arc lengths that touched them before, m.
    """
    copy, q, F, unit, start = tangent.parts()
    arcs = np.array(before, float) / unit.length
    out = copy.loaded_response(q, F, moving, np.array(loaded, int), arcs)
    m, k = 2 + len(moving), len(loaded)
    turn = quaternion.matrix_from_ros(start[3:])
    rows = np.concatenate([
        -np.tile(np.repeat([unit.force, unit.moment], 3), m),
        np.tile(np.repeat([unit.length, 1.0], 3), 2 * k),
    ])  # fmt: skip
    columns = np.concatenate([
        np.tile(np.repeat([unit.length, 1.0], 3), m), np.tile(np.repeat([unit.force, unit.moment], 3), k),
    ])  # fmt: skip
    out = out * rows[:, None] / columns[None, :]
    left, right = np.eye(len(out)), np.eye(len(columns))
    for at in range(12, 6 * m, 6):
        # obstacles: from the start clamp's frame to the world's
        seen = np.zeros((6, 6))
        seen[:3, :3] = seen[3:, 3:] = turn.T
        seen[:3, 3:] = np.column_stack([-turn.T @ cross(start[:3], axis) for axis in np.eye(3)])
        left[at : at + 6, at : at + 6], right[at : at + 6, at : at + 6] = seen.T, seen
    for at in range(6 * m, len(out), 3):
        left[at : at + 3, at : at + 3] = turn
    for at in range(6 * m, len(columns), 3):
        right[at : at + 3, at : at + 3] = turn.T
    assert len(out) == 6 * m + ANSWERS * k
    assert len(columns) == 6 * m + LOADS * k
    whole: np.ndarray = left @ out @ right
    return whole
