# SPDX-License-Identifier: Apache-2.0
"""What a baseline takes and returns: one sampled rod, so that any result can start any other solve."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from cable_ros.equilibrium import Equilibrium


@dataclass(frozen=True)
class ClampedCable:
    """The problem that the baselines solve; plain numbers, SI units, world frame."""

    length: float
    stiffness: np.ndarray
    """(3,) EIx, EIy, GJ, N m^2."""
    load: np.ndarray
    """(3,) force per length, N/m."""
    start: np.ndarray
    """(7,) clamp pose: position [m] and quaternion x y z w, its z axis the tangent."""
    end: np.ndarray
    """(7,) the same at the end."""


@dataclass(frozen=True)
class BaselineResult:
    """An equilibrium at discrete arc lengths; SI units, world frame where not said otherwise."""

    end_wrench: np.ndarray
    """(6,) force [N] then moment [N m] that the cable exerts on the body at the end clamp, in the end
    clamp's frame.
    """
    arc_length: np.ndarray
    """(n,) m, from 0 to the length."""
    points: np.ndarray
    """(n, 3) centreline, m."""
    orientations: np.ndarray
    """(n, 4) section frames as quaternions x y z w; z axis = tangent; of one sign along the cable."""
    force: np.ndarray
    """(n, 3) internal force F(s), N: of the part beyond s on the part before it."""
    moment: np.ndarray
    """(n, 3) internal moment M(s), N m."""
    iterations: int
    converged: bool
    message: str

    @property
    def nodes(self) -> int:
        """How many nodes the result stands on."""
        return len(self.arc_length)

    def at(self, arc_length: np.ndarray) -> BaselineResult:
        """The same on another grid of arc lengths: linear between nodes, spherical for the sections."""

        def linear(values: np.ndarray) -> np.ndarray:
            columns = [np.interp(arc_length, self.arc_length, column) for column in values.T]
            return np.stack(columns, axis=1)

        sections = Slerp(self.arc_length, Rotation.from_quat(self.orientations))(arc_length).as_quat()
        first = sections[0] if sections[0] @ self.orientations[0] > 0 else -sections[0]
        return replace(
            self,
            arc_length=arc_length,
            points=linear(self.points),
            orientations=continuous_sign(np.vstack([first, sections[1:]])),
            force=linear(self.force),
            moment=linear(self.moment),
        )


def from_equilibrium(equilibrium: Equilibrium, cable: ClampedCable) -> BaselineResult:
    """A baseline's start from one of our own equilibria: (8) and (9) integrated from the end."""
    points = equilibrium.points
    arc_length = np.linspace(0.0, cable.length, len(points))
    to_world = Rotation.from_quat(cable.end[3:])
    end_force = -to_world.apply(equilibrium.end_wrench[:3])
    end_moment = -to_world.apply(equilibrium.end_wrench[3:])
    force = end_force + np.outer(cable.length - arc_length, cable.load)
    # M' = -r' x F with the trapezoidal F on each chord
    moment_steps = np.cross(np.diff(points, axis=0), (force[1:] + force[:-1]) / 2)
    moment = np.empty_like(points)
    moment[-1] = end_moment
    moment[:-1] = end_moment + np.cumsum(moment_steps[::-1], axis=0)[::-1]
    return BaselineResult(
        end_wrench=equilibrium.end_wrench,
        arc_length=arc_length,
        points=points,
        orientations=continuous_sign(equilibrium.orientations),
        force=force,
        moment=moment,
        iterations=equilibrium.iterations,
        converged=equilibrium.converged,
        message=equilibrium.message,
    )


def wrench_on_body(force: np.ndarray, moment: np.ndarray, end_orientation: np.ndarray) -> np.ndarray:
    """(6,) what the cable exerts on the end clamp, in its frame, from F(L) and M(L) in world axes."""
    to_clamp = Rotation.from_quat(end_orientation).inv()
    return -np.concatenate([to_clamp.apply(force), to_clamp.apply(moment)])


def relative_wrench_error(wrench: np.ndarray, reference: np.ndarray) -> float:
    """The larger of the force's and the moment's |difference| / |reference|."""
    force = np.linalg.norm(wrench[:3] - reference[:3]) / np.linalg.norm(reference[:3])
    moment = np.linalg.norm(wrench[3:] - reference[3:]) / np.linalg.norm(reference[3:])
    return float(max(force, moment))


def continuous_sign(quaternions: np.ndarray) -> np.ndarray:
    """The same rotations with signs such that neighbours lie in one half-space; the first keeps its sign."""
    flips = np.where(np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0, -1.0, 1.0)
    return quaternions * np.concatenate([[1.0], np.cumprod(flips)])[:, None]
