# SPDX-License-Identifier: Apache-2.0
"""The arm's cable as MuJoCo's native 1D flex: a discrete elastic rod of point masses and twist hinges."""

from __future__ import annotations

import mujoco
import numpy as np
from peer_arm import Arm
from scipy.spatial.transform import Rotation

EDGES = 1e-5
"""Factor of the compliance of the edge constraints, which are soft by default."""
SETTLE = 60
"""Warm steps at the first pose."""


class Flex:
    """The first edge is pinned to the world, the last to a mocap body that is the end clamp.

    A mocap body has no degrees of freedom, so none tells the force on it: that is the tension of the last
    free edge's constraint, and the elastic force on the clamp's nodes as a second model, in which they can
    slide, has it for the same state.
    """

    name = "MuJoCo flex"

    def __init__(self, arm: Arm, edges: int, step: float, steps: int) -> None:
        self.setting = f"n = {edges}, {steps} steps of {step:g} s"
        self._arm, self._edges, self._step, self._steps = arm, edges, step, steps
        chain = arm.chain(edges)
        self._edge, self._rest = chain.edge, arm.straight(edges)
        model = self._model = mujoco.MjModel.from_xml_string(self._xml(free_end=False))
        model.flexedge_invweight0[:] *= EDGES
        data = self._data = mujoco.MjData(model)
        mujoco.mj_step(model, data)  # fills the reference frames of the straight rod
        axis = Rotation.from_quat(arm.start[3:]).inv().apply(data.plastic[3:6])
        mujoco.mj_resetData(model, data)
        self._reader = mujoco.MjModel.from_xml_string(self._xml(free_end=True))
        self._read = mujoco.MjData(self._reader)
        tangents, across, twists = chain.material(axis)
        data.plastic[:] = np.r_[np.hstack([tangents, across]).ravel(), twists]
        data.qpos[: 3 * (edges - 3)] = (chain.points - self._rest)[2:-2].ravel()
        for _ in range(SETTLE):
            self.warm(0.0)

    def _xml(self, free_end: bool) -> str:
        arm, edges, mass = self._arm, self._edges, self._arm.density * self._edge
        turn = Rotation.from_quat(arm.start[3:])
        clamp = 0.5 * (self._rest[-2] + self._rest[-1])
        polar = 0.5 * mass * arm.radius**2
        names, vertices = ["world"] * 2, [*self._rest[:2]]
        bodies = []
        for i in range(2, edges + 1 if free_end else edges - 1):
            slides = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "0 1 0", "0 0 1"))
            bodies.append(
                f'<body name="v{i}" pos="{_text(self._rest[i])}"><inertial pos="0 0 0" mass="{mass}" '
                f'diaginertia="1e-9 1e-9 1e-9"/>{slides}</body>'
            )
            names.append(f"v{i}")
            vertices.append(np.zeros(3))
        if not free_end:
            names += ["clamp"] * 2
            vertices += [turn.inv().apply(point - clamp) for point in self._rest[-2:]]
            quaternion = turn.as_quat()[[3, 0, 1, 2]]
            bodies.append(
                f'<body name="clamp" mocap="true" pos="{_text(clamp)}" quat="{_text(quaternion)}"/>'
            )
        for i in range(1, edges if free_end else edges - 1):
            name = "cable_twist" if i == edges - 1 else f"cable_twist_{i}"
            bodies.append(
                f'<body name="{name}"><inertial pos="0 0 0" mass="{mass}" '
                f'diaginertia="{polar} {polar} {polar}"/>'
                f'<joint name="{name}" type="hinge" axis="1 0 0"/></body>'
            )
        elements = " ".join(f"{i} {i + 1}" for i in range(edges))
        return f"""<mujoco>
          <option timestep="{self._step}" gravity="0 0 {-arm.gravity}" integrator="discrete" solver="Newton"/>
          <worldbody>{"".join(bodies)}</worldbody>
          <deformable><flex name="cable" dim="1" radius="{arm.radius}" body="{" ".join(names)}"
              vertex="{_text(vertices)}" element="{elements}">
            <elasticity young="{arm.youngs_modulus}" shear="{arm.shear_modulus}" section="circle"/>
            <contact contype="0" conaffinity="0" selfcollide="none"/></flex></deformable>
          <equality>
            <flex flex="cable" solref="{2 * self._step} 1" solimp="0.9999 0.9999 0.001 0.5 2"/>
          </equality>
        </mujoco>"""

    def warm(self, degrees: float) -> None:
        """Move the end clamp there and settle."""
        data, pose = self._data, self._arm.clamp(degrees)
        data.mocap_pos[0], data.mocap_quat[0] = pose[:3], pose[[6, 3, 4, 5]]
        for _ in range(self._steps):
            mujoco.mj_step(self._model, data)

    def force(self) -> np.ndarray:
        """(3,) of the end clamp on the cable, world, N; with the weight of the last half edge."""
        data, read, n = self._data, self._read, self._edges
        mujoco.mj_forward(self._model, data)
        points = data.flexvert_xpos
        read.plastic[:] = data.plastic
        read.qpos[: 3 * (n - 1)] = (points - self._rest)[2:].ravel()
        read.qpos[3 * (n - 1) : -1] = data.qpos[3 * (n - 3) :]
        read.qpos[-1] = 0.0  # the last edge's frame is its reference frame's, in which the clamp holds it
        mujoco.mj_forward(self._reader, read)
        elastic = read.qfrc_passive[3 * (n - 3) : 3 * (n - 1)].reshape(2, 3).sum(axis=0)
        along = (points[n - 1] - points[n - 2]) / np.linalg.norm(points[n - 1] - points[n - 2])
        tension = data.efc_force[-1] * along
        return -(elastic + tension) + np.array([0.0, 0.0, self._arm.weight * self._edge])


def _text(values: object) -> str:
    return " ".join(f"{value:.17g}" for value in np.ravel(values))
