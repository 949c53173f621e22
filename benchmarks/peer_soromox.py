# SPDX-License-Identifier: Apache-2.0
"""The arm's cable as a soromox GVS segment, Legendre strains, closed at its tip by Newton's method in JAX.

soromox has no static solver and no second clamp: both are the few lines of `_residual` here.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from peer_arm import Arm
from scipy.spatial.transform import Rotation
from soromox.systems.components import JointSpec, LinkSpec
from soromox.systems.gvs import GVS
from soromox.systems.gvs.specs import GVSSegment, StrainBasisSpec

jax.config.update("jax_enable_x64", True)

AXES = Rotation.from_matrix(np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]))
"""soromox's sections have their tangent along x, ours along z."""
SETTLE = 30
"""Newton steps at the first pose."""


class Strains:
    """Curvature, twist and the tip's wrench are the unknowns; stretch and shear are left out."""

    name = "soromox GVS"

    def __init__(self, arm: Arm, order: int, points: int, steps: int) -> None:
        self.setting = f"order {order}, {points} points, {steps} Newton steps"
        self._arm, self._steps = arm, steps
        link = LinkSpec.circular(
            length=arm.length, density=arm.density / arm.area, radius=arm.radius,
            young_modulus=arm.youngs_modulus, shear_modulus=arm.shear_modulus,
            reference_strain=[0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
        )  # fmt: skip
        basis = StrainBasisSpec("legendre", ("kappa_x", "kappa_y", "kappa_z"), order)
        base = self._frame(arm.start)
        robot = GVS.from_segments(
            [GVSSegment(link, JointSpec.fixed(), basis, points)],
            gravity=jnp.array([0.0, 0.0, -arm.gravity]),
            base_pose=jnp.array(np.r_[Rotation.from_matrix(base[:3, :3]).as_quat(), base[:3, 3]]),
        )
        tip = jnp.array(arm.length)

        def residual(x, target):
            q, wrench = x[:-6], x[-6:]
            pose, jacobian = robot.forward_kinematics(q, tip), robot.jacobian_bodyframe(q, tip)
            turned = target[:3, :3].T @ pose[:3, :3]
            turn = 0.5 * jnp.array(
                [turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]]
            )
            miss = pose[:3, :3].T @ (pose[:3, 3] - target[:3, 3]) / arm.length
            balance = robot.elastic_force(q) + robot.gravitational_force(q) - jacobian.T @ wrench
            return jnp.concatenate([balance, turn, miss])

        tangent = jax.jacfwd(residual)
        self._newton = jax.jit(lambda x, t: x - jnp.linalg.solve(tangent(x, t), residual(x, t)))
        self._x = jnp.concatenate([jnp.array(self._fitted(order)), jnp.zeros(6)])
        for _ in range(SETTLE):
            self.warm(0.0)

    def _frame(self, pose: np.ndarray) -> np.ndarray:
        out = np.eye(4)
        out[:3, :3] = (Rotation.from_quat(pose[3:]) * AXES).as_matrix()
        out[:3, 3] = pose[:3]
        return out

    def _fitted(self, order: int) -> np.ndarray:
        """Coefficients of the starting shape's curvature and twist, least squares."""
        grid = np.linspace(0.0, self._arm.length, 401)
        _, frames = self._arm.sections(grid)
        strains = AXES.inv().apply((frames[:-1].inv() * frames[1:]).as_rotvec()) / (grid[1] - grid[0])
        middle = (grid[:-1] + grid[1:]) / self._arm.length - 1.0
        fit = np.linalg.lstsq(np.polynomial.legendre.legvander(middle, order), strains, rcond=None)[0]
        return fit.T.ravel()

    def warm(self, degrees: float) -> None:
        """A fixed number of Newton steps from the last equilibrium."""
        target = jnp.array(self._frame(self._arm.clamp(degrees)))
        for _ in range(self._steps):
            self._x = self._newton(self._x, target)
        self._x.block_until_ready()
        self._degrees = degrees

    def force(self) -> np.ndarray:
        """(3,) of the end clamp on the cable, world, N."""
        return self._frame(self._arm.clamp(self._degrees))[:3, :3] @ np.asarray(self._x[-3:])
