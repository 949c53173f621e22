# SPDX-License-Identifier: Apache-2.0
"""The arm's cable as a discrete elastic rod of dismech-newton, on the CPU: implicit steps of a second."""

from __future__ import annotations

import contextlib
import io
import warnings
from typing import Any

import newton
import numpy as np
import warp
from peer_arm import Arm, angle_about, clamped, transported
from scipy.spatial.transform import Rotation


@warp.struct
class _Any:
    value: float


# Its annotations say `Struct | None`, which Python understands from 3.14 on; before, the type must learn `|`.
type(_Any).__or__ = lambda self, other: Any

from dismech_newton import DiSMechSolver, add_rod, fix_segment, flatten_state  # noqa: E402

STEP = 1.0
"""s; so long that inertia does not count, and a step is a static solve."""
STRETCH = 3.0
"""Times the axial stiffness: the references are inextensible, but single precision takes no more."""
DIFFERENCE = 1e-6
"""m, of the end force by central differences of the elastic energy."""


class Rod:
    """The last segment is prescribed through the state; its force is read from its neighbours' energy."""

    name = "dismech-newton"

    def __init__(self, arm: Arm, edges: int, iterations: int) -> None:
        self.setting = f"n = {edges}, {iterations} iterations"
        self._arm, self._edges = arm, edges
        chain = arm.chain(edges)
        edge = self._edge = chain.edge
        self._axial = STRETCH * arm.youngs_modulus * arm.area / edge
        frames = np.tile(arm.start[3:], (edges, 1))
        rod = newton.Rod(arm.straight(edges), quaternions=frames, radius=arm.radius)
        with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore", DeprecationWarning)
            builder = newton.ModelBuilder(gravity=-arm.gravity)
            DiSMechSolver.register_custom_attributes(builder)
            add_rod(
                builder, rod, cfg=newton.ModelBuilder.ShapeConfig(density=arm.density / arm.area),
                stretch_stiffness=self._axial, bend_stiffness=arm.bending / edge,
                twist_stiffness=arm.torsion / edge, proxies=False,
            )  # fmt: skip
            fix_segment(builder, edge=0)
            fix_segment(builder, edge=edges - 1)
            model = builder.finalize(device="cpu")
        self._solver = DiSMechSolver(model, iterations=iterations, exact=True, self_contact=False)
        self._states = [model.state(), model.state()]
        _, across, twists = chain.material(np.array([1.0, 0.0, 0.0]))
        for state in self._states:
            flatten_state(state)
            rods = state.dismech
            rods.q.assign(np.r_[chain.points.ravel(), np.zeros(edges)].astype(np.float32))
            rods.qd.zero_()
            rods.edge_d1_q.assign(across.astype(np.float32))
            rods.triplet_ref_twist_q.assign(twists.astype(np.float32))
        self._solver.reset(self._states[0])
        for _ in range(10):
            self.warm(0.0)

    def warm(self, degrees: float) -> None:
        """Move the last segment and its frame in the state that the step starts from; one implicit step."""
        state, other = self._states
        rods, n, pose = state.dismech, self._edges, self._arm.clamp(degrees)
        q, axes = rods.q.numpy(), rods.edge_d1_q.numpy()
        points = q[: 3 * (n + 1)].reshape(-1, 3)
        turn = Rotation.from_quat(pose[3:])
        tangent, before = turn.apply([0.0, 0.0, 1.0]), _unit(points[n] - points[n - 1])
        axes[n - 1] = transported(axes[n - 1], before, tangent)
        points[n - 1 :] = clamped(pose, self._edge)
        q[-1] = angle_about(tangent, axes[n - 1], turn.apply([1.0, 0.0, 0.0]))
        inner = _unit(points[n - 1] - points[n - 2])
        twists = rods.triplet_ref_twist_q.numpy()
        turned = angle_about(tangent, transported(axes[n - 2], inner, tangent), axes[n - 1])
        twists[-1] += _wrapped(turned - twists[-1])
        rods.q.assign(q)
        rods.edge_d1_q.assign(axes)
        rods.triplet_ref_twist_q.assign(twists)
        rods.qd.zero_()
        self._solver.step(state, other, None, None, STEP)
        self._states = [other, state]

    def force(self) -> np.ndarray:
        """(3,) of the end clamp on the cable, world, N; with the weight of the last half edge."""
        push = np.zeros(3)
        for k in range(3):
            moved = np.zeros(3)
            moved[k] = DIFFERENCE
            push[k] = (self._energy(moved) - self._energy(-moved)) / (2 * DIFFERENCE)
        return push + np.array([0.0, 0.0, self._arm.weight * self._edge])

    def _energy(self, moved: np.ndarray) -> float:
        """Elastic energy near the last segment after it has moved by (3,) m, in double precision, J."""
        rods, n, arm = self._states[0].dismech, self._edges, self._arm
        q = rods.q.numpy().astype(float)
        points, angles = q[: 3 * (n + 1)].reshape(-1, 3), q[3 * (n + 1) :]
        axes, known = rods.edge_d1_q.numpy().astype(float), rods.triplet_ref_twist_q.numpy().astype(float)
        after = points.copy()
        after[n - 1 :] += moved
        energy = 0.0
        for i in range(
            n - 2, n
        ):  # edges n - 2 and n - 1 with the nodes between them and their inner neighbours
            length = float(np.linalg.norm(after[i + 1] - after[i]))
            energy += 0.5 * self._axial * (length - self._edge) ** 2
            tangents = [_unit(after[k + 1] - after[k]) for k in (i - 1, i)]
            befores = [_unit(points[k + 1] - points[k]) for k in (i - 1, i)]
            first, second = (transported(axes[i - 1 + k], befores[k], tangents[k]) for k in (0, 1))
            binormal = 2.0 * np.cross(*tangents) / (1.0 + tangents[0] @ tangents[1])
            twist = angle_about(tangents[1], transported(first, *tangents), second)
            twist = known[i - 1] + _wrapped(twist - known[i - 1]) + angles[i] - angles[i - 1]
            energy += 0.5 * (arm.bending * binormal @ binormal + arm.torsion * twist**2) / self._edge
        return energy


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


def _wrapped(angle: float) -> float:
    return (angle + np.pi) % (2 * np.pi) - np.pi
