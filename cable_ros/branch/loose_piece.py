# SPDX-License-Identifier: Apache-2.0
"""A piece of a cable whose ends are not clamps, among obstacles or if it strains; `loose_ends` solves where
its ends are.

A free end that is held where it is tried would ask a cable that hangs straight for unbounded tension. So a
spring holds it, which pulls with the force that the end had: along the directions of `Tip.yields` the end
gives way to what its force changes by, and the next step begins where it arrived. The spring is no part of
any result, for there the force is the given one. With friction of obstacles each try begins at the last
pose, and so a soft spring pulls with the given force at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cable_ros.branch.cold_start import Conditions, Found, equilibria
from cable_ros.branch.held_ends import ends_of
from cable_ros.branch.results import Reader
from cable_ros.branch.searched_equilibrium import IDENTITY
from cable_ros.branch.shared_piece import Place, SharedPiece
from cable_ros.contact.active_set_rod import ActiveSetRod
from cable_ros.contact.overlaps import OUTLINE
from cable_ros.contact.response import HELD
from cable_ros.contact.shearing_rod import among_obstacles
from cable_ros.effects.effect import Properties
from cable_ros.rod import quaternion, warm_step
from cable_ros.rod.extensible import StretchingRod
from cable_ros.rod.kirchhoff import ALGEBRAIC, NOTHING, Rod
from cable_ros.rod.rod_state import ENERGY
from cable_ros.rod.units import relative
from cable_ros.scene import Cable, Kinematics
from cable_ros.scene.model import CLAMPED, FREE, SLIDING, Mount

ROUGHLY = 1e-2
"""Tolerance of an equilibrium without obstacles, beside which one is searched for."""
YIELD, LOOSELY = 0.1, 1e4
"""How far an end that yields does so, L, under the cable's load or EI / L^2; and L^3 / EI, with friction of
obstacles, so far that what it bears is the given force.
"""


class LoosePiece(SharedPiece):
    """A `SharedPiece` with ends that are not clamps; held at both, it is as one between clamps."""

    astray = NOTHING
    """(3,) m, world, from where its end was tried last to where it is."""

    def __init__(
        self, cable: Cable, properties: Properties, tolerance: float, polyline_points: int,
        obstacle_names: Sequence[str] = (),
    ) -> None:  # fmt: skip
        start, end = (replace(mount, kind=CLAMPED, turns=False) for mount in cable.mounts)
        held = replace(cable, start=start, end=end)
        self._follows = any(mount.kind in (FREE, SLIDING) for mount in cable.mounts)
        self._ends_free = cable.end.kind == FREE
        at_start, at_end = (0.0 if mount.kind == FREE else 1.0 for mount in cable.mounts)
        self._clamps = at_start * Rod.clamps[0], at_end * Rod.clamps[1]
        super().__init__(held, properties, tolerance, polyline_points, obstacle_names)
        load = sum(float(np.linalg.norm(mount.force)) for mount in cable.mounts) / self._units.force
        bend = sum(float(np.linalg.norm(mount.moment)) for mount in cable.mounts) / self._units.moment
        self._given = load + bend

    @property
    def _reach(self) -> float:
        """As of any piece; a given force stretches a cable as far as it goes."""
        return np.inf if self.stretches and self._follows else super()._reach

    @property
    def strains(self) -> bool:
        """Whether it stretches or shears."""
        return self._compliance is not None

    def without_obstacles(
        self, mounts: tuple[Mount, Mount], poses: np.ndarray
    ) -> list[tuple[Found, np.ndarray, np.ndarray]]:
        """Its equilibria between `mounts` at `poses` (2, 7) if there were no obstacles and no strain, by
        rising energy, and their points (n, 3), m, and frames (n, 4), world.
        """
        ends, unit = ends_of(*mounts, self._units), self._units
        there = Conditions(*relative(poses, IDENTITY, self._weight, unit.length, unit.force))
        if ends is None or not ends.chord(there.qe, there.re) < 1.0:
            return []
        out = []
        section = self._stiffness, self._natural
        for one in equilibria(*section, there, None, ROUGHLY, False, None, ends):
            start = poses[0].copy()
            if not ends.start.held:
                turn = quaternion.matrix_from_ros(start[3:])
                start[:3] = poses[1, :3] - unit.length * turn @ one.rod.totals[:3]
            out.append((one, *Reader().read(one.rod, one.q, one.F, start, unit, OUTLINE)[2:]))
        return out

    def adopt(self, kinematics: Kinematics, joints: np.ndarray, place: Place, hanging: Found) -> bool:
        """Take one of `without_obstacles` that hangs clear of them; whether it is an equilibrium here."""
        self.reset()
        self.set_length(place.length)
        self._judged_length, self._begin = place.length, place.begin
        there = self._conditions(kinematics, joints, place.poses, IDENTITY)
        section = self._stiffness, self._natural, self._compliance
        rod = among_obstacles(hanging.rod.mesh, *section, self.tolerance)
        self._weigh(rod)
        rod.set_conditions(there.qe, there.re, there.f, there.obstacles)
        self._let_yield(rod, place)
        back = quaternion.conjugate(hanging.q[0])
        q = rod.on_end(np.array([quaternion.multiply(back, one) for one in hanging.q]))
        F = quaternion.rotate(back, hanging.F)
        if not rod.refactor(q, F):
            return False
        code, iterations, q, F = rod.correct(q, F, ALGEBRAIC * self.tolerance)
        if code != warm_step.ADVANCED:
            return False
        self._take(Found.at(rod, q, F, iterations), joints)
        if self._refine(rod)[1]:
            return False
        assert self._rod is not None
        self._margin = self._rod.stability_margin()
        return True

    @property
    def _path_force(self) -> np.ndarray:
        """That at the start if the end is free, whose force is given."""
        if not self._ends_free or self._rod is None:
            return super()._path_force
        return self._rod.start_force(self._F)

    @property
    def _load(self) -> float:
        """Weight and given loads, EI / L^2 and EI / L."""
        return self._given + float(np.linalg.norm(self._weight)) / self._units.force * self.length

    @property
    def _counts(self) -> float:
        """Wrench that counts as nothing: at an end that bears none, that of the loads is what is told of."""
        load = self._load
        return max(Rod.least, 0.5 * min(load, np.sqrt(load)))

    def _weigh(self, rod: Rod) -> None:
        """Tell the rod which forces count, and at which ends."""
        rod.least, rod.clamps = self._counts, self._clamps

    def _take(self, found: Found, joints: np.ndarray) -> None:
        self._weigh(found.rod)
        super()._take(found, joints)

    def _let_yield(self, rod: Rod, place: Place) -> None:
        """Let the rod's end yield as it may there, or hold it."""
        self.astray, compliance = NOTHING, HELD
        if place.yields is not None:
            turn = quaternion.matrix_from_ros(place.poses[0, 3:])
            yields = turn.T @ place.yields @ turn
            compliance = YIELD / max(self._load, 1.0) * yields
            if self.rubs and place.pull is not None:
                compliance = LOOSELY * yields
                self._F = self._F + yields @ (place.pull @ turn / self._units.force - self._F)
        if isinstance(rod, ActiveSetRod):
            bare = rod.bare
            rod.yield_at_end(compliance)
            if rod.bare and not bare:
                rod.refactor(self._q, self._F)  # its factors are those of an end that yields
        elif isinstance(rod, StretchingRod) and rod.yield_at_end(compliance):
            rod.refactor(self._q, self._F)

    def resolve(self) -> bool:
        rod = self._rod
        if isinstance(rod, StretchingRod) and not isinstance(rod, ActiveSetRod):
            rod.yield_at_end(HELD)  # on another mesh its end is where it was
        return super().resolve()

    def _arrived(self, rod: Rod, place: Place) -> None:
        """Tell how far the end is from where it was tried, and hold it from here on where it is."""
        if place.yields is None:
            return
        turn = quaternion.matrix_from_ros(place.poses[0, 3:])
        astray = place.yields @ turn @ (rod.totals[:ENERGY] - rod.re)
        rod.set_conditions(rod.qe, rod.re + turn.T @ astray, rod.f)
        self.astray = self.length * astray

    def begin_with(self, force: np.ndarray, place: Place) -> None:
        """Begin the next step, to `place`, with this force (3,), N, world, at the end."""
        turn = quaternion.matrix_from_ros(place.poses[0, 3:])
        self._F = force @ turn / self._units.force
