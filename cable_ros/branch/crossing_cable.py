# SPDX-License-Identifier: Apache-2.0
"""A cable that may touch others and itself, and sees an obstacle wherever it does."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cable_ros.branch.results import Reader
from cable_ros.branch.shared_piece import Kept, Place, SharedPiece
from cable_ros.branch.strand_springs import Strands, StrandSprings
from cable_ros.contact.active_set_rod import ActiveSetRod
from cable_ros.contact.crossing import Curve
from cable_ros.contact.distance import AXES, CENTRE, DIMENSIONS, OFFSET, SHAPE, SPHERE, WIDTH
from cable_ros.contact.overlaps import SPACING, closest_approach
from cable_ros.contact.points import ARC_LENGTH, FORCE, INTERFACE, KIND, OBSTACLE, POINT
from cable_ros.contact.report import contact_table
from cable_ros.effects.effect import Properties
from cable_ros.linalg.cross import cross
from cable_ros.rod import warm_step
from cable_ros.rod.kirchhoff import ALGEBRAIC
from cable_ros.rod.units import relative
from cable_ros.scene import Kinematics

SLOTS = 6
"""Maximum number of places where a cable touches others; where it touches itself, two."""
FINEST = 1e-12
"""Minimum tolerance, relative."""
ASIDE = 1e-4
"""Rotation of sections, rad, by which a descent begins beside an equilibrium that it leaves."""
DEEP = 0.9
"""Distance of two parts in diameters, by a polyline, below which they overlap for certain."""
WORLD = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


def _nowhere() -> np.ndarray:
    """(WIDTH,) an obstacle that is nowhere, in the frame of the start clamp."""
    row = np.zeros(WIDTH)
    row[SHAPE], row[AXES:DIMENSIONS], row[OFFSET] = SPHERE, np.eye(3).ravel(), -1e6
    return row


class Touch(NamedTuple):
    """How a cable touches one obstacle."""

    wrench: np.ndarray
    """(6,) what it exerts on it at the first point, N and N m, about the world's origin."""
    arc_length: float
    """Where, m; NaN: nowhere."""
    points: int
    """Number of points; more than one where it lies along it, or meets it twice."""

    @property
    def force(self) -> float:
        """N."""
        return float(np.linalg.norm(self.wrench[:3]))


class Remembered(NamedTuple):
    """An equilibrium of a cable among what it saw."""

    kept: Kept
    seen: dict[int, np.ndarray]
    """(WIDTH,) obstacles by slot, world, SI."""
    clamps: np.ndarray | None = None
    """(2, 7) its clamps, where friction needs them."""


class CrossingCable(SharedPiece):
    """One cable with `SLOTS` obstacles more than the scene has, which its group moves."""

    asked = 0.0
    """Accepted relative error of the wrenches of cables that touch."""
    finer = 1.0
    """How much finer each of them is solved by itself: a point that is off turns the short line between two
    touching points, and with it the force, by many times as much."""

    @property
    def tolerance(self) -> float:
        """Of this cable among resting obstacles."""
        return max(self.asked * self.finer, FINEST)

    @tolerance.setter
    def tolerance(self, value: float) -> None:
        self.asked = value

    def _use(self, properties: Properties) -> None:
        super()._use(properties)
        if self._obstacles is None:
            self._obstacles = np.zeros((0, WIDTH))

    def reset(self) -> None:
        super().reset()
        self._reader, self._outline = Reader(), Reader()  # its length stays
        self._seen: dict[int, np.ndarray] = {}

    def _around(
        self, kinematics: Kinematics, joints: np.ndarray, start: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        fixed = super()._around(kinematics, joints, start)
        assert fixed is not None
        # what is nowhere moves with the cable, so that no step has to be short because of it
        slots, frames = np.tile(_nowhere(), (SLOTS, 1)), np.tile(start, (SLOTS, 1))
        if self._seen:
            which = list(self._seen)
            slots[which], frames[which] = list(self._seen.values()), WORLD
        return np.concatenate([fixed[0], slots]), np.concatenate([fixed[1], frames])

    @property
    def first_slot(self) -> int:
        """Number of its first slot among its obstacles."""
        assert self._obstacles is not None
        return len(self._obstacles)

    def name_others(self, others: dict[int, str]) -> None:
        """Which cable each slot stands for, by slot."""
        fixed = tuple(self._names)[: self.first_slot]
        self._names = (*fixed, *(others.get(slot, "") for slot in range(SLOTS)))

    def see(
        self, seen: dict[int, np.ndarray], kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray
    ) -> None:
        """Have these obstacles (WIDTH,), world, SI, by slot; poses (2, 7): of the clamps, at `joints`.

        One that comes or goes does so at once, also from the last equilibrium; others move with the next
        step.
        """
        before, self._seen = self._seen, dict(seen)
        changed = seen.keys() ^ before.keys()
        rod = self._rod
        if not changed or rod is None:
            return
        assert isinstance(rod, ActiveSetRod)
        there = self._placed(kinematics, joints, poses)
        assert rod.obstacles is not None
        assert there is not None
        which = [self.first_slot + slot for slot in changed]
        obstacles = rod.obstacles.copy()
        obstacles[which] = there[which]
        points, _, h, s0 = rod.state()
        points = points[~np.isin(points[:, OBSTACLE].astype(int), which)]
        rod.restore((points, len(points), h, s0))
        rod.ready = False
        rod.set_conditions(rod.qe, rod.re, rod.f, obstacles)
        rod.refactor(self._q, self._F)

    def attempt(self, kinematics: Kinematics, joints: np.ndarray, place: Place) -> bool:
        """See `SharedPiece.attempt`; again for a cable that stretches, whose first step ends beside it."""
        found = super().attempt(kinematics, joints, place)
        return found and (self._compliance is None or super().attempt(kinematics, joints, place))

    def _closest_approach(self, start: np.ndarray) -> float:
        """See `SearchedEquilibrium`; infinite if not certainly an overlap.

        The group knows where it touches itself better than a polyline does, but only where the distance of
        two strands has a minimum.
        """
        if not self._diameter or self._rod is None:
            return np.inf
        points, length = self.outline(start), self._units.length
        if float(np.linalg.norm(points[-1] - points[0])) < self._diameter:  # start and end beside each other
            step = length / (len(points) - 1)
            cut = int(np.ceil(SPACING * self._diameter / step))
            points, length = points[cut:-cut], length - 2 * cut * step
        if len(points) < 2:
            return np.inf
        apart = closest_approach(points, length, SPACING * self._diameter)
        return apart if apart < DEEP * self._diameter else np.inf

    def descend(
        self, kinematics: Kinematics, joints: np.ndarray, place: Place, diameter: float, known: list[Strands]
    ) -> tuple[bool, list[tuple[Strands, float]]]:
        """Descend the energy of this cable alone at a place nearby, its strands kept apart by springs.

        Args:
            kinematics, joints: of the robot.
            place: where it is held.
            diameter: L.
            known: its strands that were near each other before; see `StrandSprings`.

        Returns:
            Whether it has got to a minimum, and where its strands press on each other at the end, with the
            forces, EI / L^2: then `press` must follow. A cable that stretches or is among obstacles, which
            springs do not know, does not move.
        """
        rod = self._rod
        assert isinstance(rod, ActiveSetRod)
        if self.first_slot or self._compliance is not None or not diameter:
            return False, []
        unit, self._seen = self._units, {}
        qe, re, f = relative(place.poses, rod.qe, self._weight, unit.length, unit.force)
        if not rod.chord(qe, re) < 1.0:
            return False, []
        rod.count, rod.ready = 0, False
        rod.set_conditions(qe, re, f, self._placed(kinematics, joints, place.poses))
        # on the old mesh, coarse but at its contacts, energy and gradient would differ where it goes
        q = rod.refined(self._q)
        rod.refactor(q, self._F)
        springs = StrandSprings(rod, diameter, known)
        # of two mirror images always the same one, whatever the last bit
        found, arrived = springs.descend(rod.retract(rod.on_end(q), ASIDE * rod.start_vector()), self._F)
        self._spent += found.iterations
        pressed = [(one, springs.force(one)) for one in springs.pressed(found.x)]
        if arrived:
            self._q, self._F, self._joints = found.x, found.y, joints
        return arrived and (bool(pressed) or rod.refactor(found.x, found.y)), pressed

    def press(self, loads: dict[int, tuple[float, float]]) -> bool:
        """Find the equilibrium beside a shape that presses on slots: at an arc length, L, with EI / L^2."""
        rod = self._rod
        assert isinstance(rod, ActiveSetRod)
        rod.count, rod.ready = len(loads), False
        points = rod.points[: rod.count]
        points[:] = 0.0
        points[:, INTERFACE] = -1.0
        for row, (slot, (arc, force)) in zip(points, loads.items(), strict=True):
            row[OBSTACLE], row[ARC_LENGTH], row[KIND], row[FORCE] = self.first_slot + slot, arc, POINT, force
        rod.work = self._full_budget
        q = rod.fit(self._q)
        code, iterations, q, F = rod.correct(q, self._F, ALGEBRAIC * self.tolerance)
        self._spent += iterations
        if code == warm_step.ADVANCED:
            self._q, self._F = q, F
        return bool(code == warm_step.ADVANCED)

    def remember(self) -> Remembered:
        """The present equilibrium, for `recall`."""
        return Remembered(self.keep(), dict(self._seen))

    def recall(self, known: Remembered) -> None:
        """Return to an equilibrium of the same rod."""
        self._seen = known.seen
        self.put_back(known.kept)

    def curve(self, start: np.ndarray) -> Curve:
        """The centreline of the present equilibrium; `start` (7,): its start clamp."""
        rod = self._rod
        assert isinstance(rod, ActiveSetRod)
        return Curve.of(self._q, rod.centreline(self._q, self._F), rod.mesh, start, self._units.length)

    def size_of(self, change: np.ndarray) -> float:
        """Of a change (12,) of its wrenches on its start and end clamp, SI, relative to these."""
        assert self._rod is not None
        end, start = self.wrenches(self._rod)
        return max(self.difference(start + change[:6], start), self.difference(end + change[6:], end))

    def touches(self, slot: int, start: np.ndarray) -> Touch:
        """Where and how it presses on the obstacle in this slot; `start` (7,): its start clamp."""
        rod = self._rod
        assert rod is not None
        loaded = rod.loaded_contacts(self._q)
        table = None if loaded is None else contact_table(loaded, self._names, start, self._units)
        on = np.zeros(0, int) if table is None else np.flatnonzero(table.obstacle == self.first_slot + slot)
        if table is None or not len(on):
            return Touch(np.zeros(6), np.nan, 0)
        # the normal at the cable's last shape: that of the table is of the iteration before
        row, r = self._seen[slot], table.position[on[0]]
        axis, across = row[AXES + 2 : DIMENSIONS : 3], r - row[CENTRE:AXES]
        across = across - (across @ axis) * axis
        force = -float(np.linalg.norm(table.force[on[0]])) * across / np.linalg.norm(across)
        return Touch(np.concatenate([force, cross(r, force)]), float(table.arc_length[on[0]]), len(on))

    def response_of(self, slots: Sequence[int], poses: np.ndarray) -> np.ndarray:
        """(12 + 6 k, same) see `Equilibrium.wrench_response`, of the obstacles in k slots."""
        return self.tangent(poses).response_of([self.first_slot + slot for slot in slots])
