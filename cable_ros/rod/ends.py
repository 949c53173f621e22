# SPDX-License-Identifier: Apache-2.0
"""How the two ends of a rod are held, where they are not clamped; units of the cable.

What is given at an end is either a motion or the force that belongs to it. With the end force F, positive on
the cable, and the load f per length, the balance of the whole rod gives what the start exerts, -(F + f): so a
given force at either end is a given component of F, and the end position is held across that direction only.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from cable_ros.rod import quaternion

HELD = (False, False, False)
SWIVEL = (False, False, True)
TURNING = (True, True, True)
ZERO = np.zeros(3)
IDENTITY = np.eye(3)
NO_MOMENTS = np.zeros((2, 3))


@dataclass(frozen=True, eq=False)
class End:
    """One end; vectors along the axes of its mount."""

    turns: tuple[bool, bool, bool] = HELD
    """Whether the end section may turn about each of its own axes; the last one is the tangent."""
    placed: bool = True
    """Whether its position is held at least across `axis`; if not, the end is free."""
    axis: np.ndarray | None = None
    """(3,) unit vector along which it slides; None: it does not slide."""
    force: np.ndarray = field(default_factory=lambda: ZERO)
    """(3,) force on the cable where its position is not held, EI / L^2."""
    moment: np.ndarray = field(default_factory=lambda: ZERO)
    """(3,) moment on the cable of a free end, EI / L."""

    @property
    def held(self) -> bool:
        """Whether its position is held in all directions."""
        return self.placed and self.axis is None

    def scaled(self, factor: float) -> End:
        """With another unit of force, `factor` times the old numbers."""
        moment = self.moment if self.moment is ZERO else factor * self.moment
        return replace(self, force=factor * self.force, moment=moment)


@dataclass(frozen=True, eq=False)
class Ends:
    """Both ends of a rod. The position of at least one of them is held."""

    start: End
    end: End

    def scaled(self, factor: float) -> Ends:
        """With another unit of force, `factor` times the old numbers."""
        return Ends(self.start.scaled(factor), self.end.scaled(factor))

    @cached_property
    def turns(self) -> np.ndarray:
        """(2, 3) which rotations of the first and of the last section are free."""
        return np.array([self.start.turns, self.end.turns])

    @property
    def free(self) -> bool:
        """Whether one end is free: then all of the end force is given."""
        return not (self.start.placed and self.end.placed)

    @property
    def both_turn(self) -> bool:
        """Whether both ends may turn, so that the rod may turn as a rigid body."""
        return any(self.start.turns) and any(self.end.turns)

    @property
    def twist_held(self) -> bool:
        """Whether the total twist is fixed up to whole turns."""
        return not (self.start.turns[2] or self.end.turns[2])

    def axis(self, qe: np.ndarray) -> np.ndarray | None:
        """(3,) direction along which an end slides, in the start's frame; `qe` (4,): end frame."""
        if self.start.axis is not None:
            return self.start.axis
        return None if self.end.axis is None else quaternion.rotate(qe, self.end.axis)

    def rows(self, qe: np.ndarray) -> tuple[np.ndarray, int]:
        """(3, 3) orthonormal rows, and of how many of them the end position is held along."""
        if self._rows is None:
            return IDENTITY, 0 if self.free else 3
        if self.start.axis is not None:
            return self._rows, 2
        return np.stack([quaternion.rotate(qe, row) for row in self._rows]), 2

    @cached_property
    def _rows(self) -> np.ndarray | None:
        """(3, 3) two directions across the axis of sliding, and the axis; None: no end slides."""
        axis = self.end.axis if self.start.axis is None else self.start.axis
        if axis is None:
            return None
        across = np.cross(axis, IDENTITY[np.argmin(np.abs(axis))])
        across /= np.linalg.norm(across)
        return np.stack([across, np.cross(axis, across), axis])

    @cached_property
    def constant(self) -> bool:
        """Whether rows, given force and given moments do not depend on the conditions."""
        return self.start.held and self.end.held

    def given_force(self, qe: np.ndarray, f: np.ndarray) -> np.ndarray:
        """(3,) part of the end force that is given, in the start's frame; `f` (3,): load per length."""
        if self.free:
            return -(self.start.force + f) if self.end.placed else quaternion.rotate(qe, self.end.force)
        axis = self.axis(qe)
        if axis is None:
            return ZERO
        if self.end.axis is not None:
            return float(self.end.axis @ self.end.force) * axis
        return -float(axis @ (self.start.force + f)) * axis

    def given_moments(self, qe: np.ndarray) -> np.ndarray:
        """(2, 3) given moments on the cable at the start and at the end, in the start's frame."""
        if self.start.moment is ZERO is self.end.moment:
            return NO_MOMENTS
        return np.stack([self.start.moment, quaternion.rotate(qe, self.end.moment)])

    def chord(self, qe: np.ndarray, re: np.ndarray) -> float:
        """Least distance of the ends, L, with the mounts' distance re (3,)."""
        rows, count = self.rows(qe)
        return float(np.linalg.norm(rows[:count] @ re))

    def free_rotations(self, nodes: int) -> np.ndarray:
        """(3 nodes,) 1 for every nodal rotation that is unknown, 0 for those that are held."""
        out = np.ones(3 * nodes)
        out[:3], out[-3:] = self.start.turns, self.end.turns
        return out
