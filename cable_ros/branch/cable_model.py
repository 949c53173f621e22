# SPDX-License-Identifier: Apache-2.0
"""One cable in its own units: section, obstacles, and whether it can reach between its clamps at all."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cable_ros.branch.cold_start import (
    Conditions,
)
from cable_ros.branch.held_ends import ends_of
from cable_ros.contact.destination import destination, rest_clamps
from cable_ros.contact.distance import FRICTION_COEFFICIENT, nearest, placed
from cable_ros.contact.friction_kernels import COULOMB, FRICTIONLESS, SLIDING
from cable_ros.contact.shortest_path import too_short
from cable_ros.effects.effect import Properties
from cable_ros.rod.kirchhoff import NOTHING, Rod
from cable_ros.rod.units import Units, relative, relative_change
from cable_ros.scene import Cable, Kinematics
from cable_ros.scene.model import FREE

CLAMP_DEPTH = 1e-6
"""Maximum depth of a clamp inside an obstacle, L: rounding of poses."""
MODELS = {"coulomb": COULOMB, "sliding": SLIDING}
LONGEST_STRETCH = 1.1
"""Maximum chord of an extensible cable, L: beyond it the stiffness is not constant."""


class Destination(NamedTuple):
    """Where a step leads, units of the cable, start clamp's frame."""

    qe: np.ndarray
    """(4,) end frame."""
    re: np.ndarray
    """(3,) end position."""
    f: np.ndarray
    """(3,) load per length."""
    obstacles: np.ndarray | None = None
    """(o, WIDTH); None: no contact."""
    travel: float = 0.0
    """See `contact.travel`."""
    room: float = np.inf
    """Least gap at the clamps."""


class CableModel:
    """A cable with its properties by scene and effects; SI outside, units of the cable inside."""

    _clamps = Rod.clamps
    """Weights of the errors at its ends."""

    def __init__(self, cable: Cable, properties: Properties, obstacle_names: Sequence[str] = ()) -> None:
        self.name = cable.name
        self._target_twist = cable.total_twist
        self._names = obstacle_names
        self._diameter = 2.0 * cable.radius
        self._density = cable.linear_density
        self._mounts = cable.mounts
        self._use(properties)

    def _use(self, properties: Properties) -> None:
        bending = properties.stiffness[:2]
        self._units = Units(properties.length, float(np.sqrt(bending[0] * bending[1])))
        self._stiffness = properties.stiffness / self._units.stiffness
        self._natural = np.zeros(3) if properties.natural is None else properties.natural * properties.length
        self._weight = properties.weight
        self._ends = ends_of(*self._mounts, self._units)
        compliance = properties.compliance
        self._compliance = None if compliance is None else compliance * self._units.force
        self._obstacles = properties.obstacles
        self._model = FRICTIONLESS
        if properties.obstacles is not None and properties.friction is not None and properties.friction.any():
            self._obstacles = properties.obstacles.copy()
            self._obstacles[:, FRICTION_COEFFICIENT] = properties.friction
            self._model = MODELS[properties.friction_model]

    @property
    def _reach(self) -> float:
        """Maximum distance between the clamps, L."""
        return 1.0 if self._compliance is None or not self._compliance[2] else LONGEST_STRETCH

    @property
    def _shears(self) -> bool:
        """Whether sections tilt against the centreline: such a cable has contact on a grid alone."""
        return self._compliance is not None and bool(self._compliance[:2].any())

    def _conditions(
        self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray, before: np.ndarray
    ) -> Conditions:
        qe, re, f = relative(poses, before, self._weight, self._units.length, self._units.force)
        obstacles = self._placed(kinematics, joints, poses)
        if obstacles is not None:
            rest_clamps(obstacles, qe, re)
        return Conditions(qe, re, f, obstacles)

    def _destination(
        self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray, rod: Rod
    ) -> Destination:
        """Where a step of `rod` to the clamps' `poses` (2, 7) leads."""
        unit, around = self._units, self._around(kinematics, joints, poses[0])
        if around is None:
            return Destination(*relative(poses, rod.qe, self._weight, unit.length, unit.force))
        conditions = np.empty(4), np.empty(3), np.empty(3), around[0].copy()
        last, size = (rod.qe, rod.re, rod.obstacles), (unit.length, unit.force)
        return Destination(*conditions, *destination(poses, last, self._weight, size, around, conditions))

    def _placed(self, kinematics: Kinematics, joints: np.ndarray, poses: np.ndarray) -> np.ndarray | None:
        around = self._around(kinematics, joints, poses[0])
        return None if around is None else placed(*around, poses[0], self._units.length)

    def _around(
        self, kinematics: Kinematics, joints: np.ndarray, start: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Obstacles (o, WIDTH) in frames, SI, and (o, 7) these in the world; None: no contact.

        `start` (7,): the start clamp in the world.
        """
        return None if self._obstacles is None else (self._obstacles, kinematics.obstacle_poses(joints))

    def _chord(self, conditions: Conditions) -> float:
        """Least distance of the cable's ends, L."""
        if self._ends is not None:
            return self._ends.chord(conditions.qe, conditions.re)
        return float(np.linalg.norm(conditions.re))

    def _obstruction(self, conditions: Conditions) -> str:
        """Why no cable of this length can be between the clamps, a sentence; empty if one can."""
        obstacles, re = conditions.obstacles, conditions.re
        return self._clamp_inside(obstacles, re) or self._too_short(obstacles, re)

    def _clamp_inside(self, obstacles: np.ndarray | None, re: np.ndarray) -> str:
        """A sentence if a clamp is inside an obstacle; else empty."""
        if obstacles is None:
            return ""
        for end, r in (("start", NOTHING), ("end", re)):
            distance, which = nearest(obstacles, r)
            if distance < -CLAMP_DEPTH:
                return (
                    f"The {end} clamp of cable '{self.name}' is"
                    f" {-distance * self._units.length * 1e3:.4g} mm inside"
                    f" obstacle '{self._names[which]}', the cable's radius counted; it must be outside."
                )
        return ""

    def _too_short(self, obstacles: np.ndarray | None, re: np.ndarray) -> str:
        """A sentence if the shortest path found past the obstacles is longer than the cable; else empty."""
        found = None if obstacles is None else too_short(re, obstacles, self._reach)
        if found is None or obstacles is None:
            return ""
        missing, which = found
        return (
            f"Cable '{self.name}' is too short to get past obstacle '{self._names[which]}': the shortest path"
            f" found between its clamps is {missing * self._units.length * 1e3:.4g} mm longer."
        )

    def difference(self, found: np.ndarray, expected: np.ndarray) -> float:
        """Relative difference of two end wrenches (6,), SI: the larger of the force's and the moment's."""
        unit = np.repeat([self._units.force, self._units.moment], 3)
        return relative_change((found - expected) / unit, expected / unit, Rod.least)

    def telling_wrench(self, end: np.ndarray, start: np.ndarray) -> np.ndarray:
        """The wrench (6,) that shows what changes: at the end or, if that one is free, at the start."""
        return start if self._mounts[1].kind == FREE else end

    def size(self, wrench: np.ndarray) -> float:
        """Magnitude of a wrench (6,), SI, in units of the cable."""
        return float(np.hypot(np.linalg.norm(wrench[:3]) / self._units.force,
                              np.linalg.norm(wrench[3:]) / self._units.moment)) + Rod.least  # fmt: skip
