# SPDX-License-Identifier: Apache-2.0
"""The arm's cable as a PyElastica rod: Cosserat dynamics, damped until it rests."""

from __future__ import annotations

import elastica
import numpy as np
from peer_arm import Arm, clamped
from scipy.spatial.transform import Rotation

DAMPING = 20.0
"""1/s, of velocities and of angular velocities alike (rotational damping scaled by r^2 / 4); near the
critical damping of the lowest swing."""
RAMP = 40
"""Pieces in which the clamp moves on during the first half of the steps: at once, the rod would ring."""


class _Simulator(
    elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing, elastica.Damping
):  # as PyElastica wants it: features by inheritance
    pass


class _Held(elastica.ConstraintBase):
    def __init__(self, clamps, **keywords):
        super().__init__(**keywords)
        self._clamps = clamps

    def constrain_values(self, system, time):
        for side, (points, directors) in zip((slice(0, 2), slice(-2, None)), self._clamps, strict=True):
            system.position_collection[:, side] = points
            system.director_collection[..., 0 if side.start == 0 else -1] = directors

    def constrain_rates(self, system, time):
        for side in (slice(0, 2), slice(-2, None)):
            system.velocity_collection[:, side] = 0.0
        system.omega_collection[:, [0, -1]] = 0.0


class Rod:
    """The first and the last element are held; what the last but one pulls with is read."""

    name = "PyElastica"

    def __init__(self, arm: Arm, edges: int, step: float, steps: int) -> None:
        self.setting = f"n = {edges}, {steps} steps"
        self._arm, self._step, self._steps = arm, np.float64(step), steps
        chain = arm.chain(edges)
        self._edge = chain.edge
        turn = Rotation.from_quat(arm.start[3:])
        straight = arm.straight(edges)
        self._rod = elastica.CosseratRod.straight_rod(
            edges, straight[0], turn.apply([0.0, 0.0, 1.0]), turn.apply([1.0, 0.0, 0.0]),
            edges * chain.edge, arm.radius, arm.density / arm.area,
            youngs_modulus=arm.youngs_modulus, shear_modulus=arm.shear_modulus,
        )  # fmt: skip
        self._rod.position_collection[:] = chain.points.T
        self._rod.director_collection[:] = chain.frames.as_matrix().transpose(2, 1, 0)  # rows are directors
        self._clamps = [self._held(arm.start), self._held(arm.clamp(0.0))]
        simulator = self._simulator = _Simulator()
        simulator.append(self._rod)
        simulator.constrain(self._rod).using(_Held, clamps=self._clamps)
        simulator.add_forcing_to(self._rod).using(
            elastica.GravityForces, acc_gravity=np.array([0.0, 0.0, -arm.gravity])
        )
        simulator.dampen(self._rod).using(
            elastica.AnalyticalLinearDamper, uniform_damping_constant=DAMPING, time_step=self._step
        )
        simulator.finalize()
        self._stepper, self._time, self._degrees = elastica.PositionVerlet(), np.float64(0.0), 0.0
        for _ in range(3):
            self.warm(0.0)

    def _held(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return clamped(pose, self._edge).T, Rotation.from_quat(pose[3:]).as_matrix().T

    def _run(self, steps: int) -> None:
        for _ in range(steps):
            self._time = self._stepper.step(self._simulator, self._time, self._step)

    def warm(self, degrees: float) -> None:
        """Move the end clamp there and let the rod come to rest."""
        for angle in np.linspace(self._degrees, degrees, RAMP + 1)[1:]:
            self._clamps[1] = self._held(self._arm.clamp(angle))
            self._run(self._steps // (2 * RAMP))
        self._run(self._steps // 2)
        self._degrees = degrees

    def force(self) -> np.ndarray:
        """(3,) of the end clamp on the cable, world, N; with the weight of the last half edge."""
        pull = self._rod.internal_forces[:, -2:].sum(axis=1)
        return -pull + np.array([0.0, 0.0, self._arm.weight * self._edge])
