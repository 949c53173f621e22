# SPDX-License-Identifier: Apache-2.0
"""Baseline: the published contact with a sphere, (48)-(58) of Liu et al. 2018, equations unchanged.

The nodes that lie inside the sphere when it is not there make the set U (49). Its middle node is put on the
surface with its tangent across the radius (55); every other one has its contact force times that same sum of
gap and tangency equal to 0 (56). The force per length acts along the radius (52), with the friction across
the cable (53), (54), and enters the load of (39) by (57). The larger system is minimised as the smaller one
is, with a dense Jacobian: positions depend on all nodes before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cable_ros.baselines import published_kernels as kernels
from cable_ros.baselines.published import _MM, FiniteDifferences, GaussNewton, minimise, solve
from cable_ros.baselines.result import BaselineResult, ClampedCable
from cable_ros.scene.obstacles import Sphere


@dataclass(frozen=True)
class ContactResult:
    """An equilibrium of the published scheme with the sphere."""

    rod: BaselineResult
    nodes: np.ndarray
    """(nc,) the set U: indices of the nodes that may touch; empty where the free cable is clear."""
    middle: int
    """The node of U that is put on the surface; -1 where U is empty."""
    force: np.ndarray
    """(nc,) contact force per length at the nodes, N/m; negative: the sphere pulls."""

    @property
    def total_force(self) -> float:
        """Sum of the normal forces, N: each acts on one part."""
        return float(self.force.sum()) * float(self.rod.arc_length[1] - self.rod.arc_length[0])


def solve_contact(
    cable: ClampedCable,
    sphere: Sphere,
    parts: int,
    guess: BaselineResult | None = None,
    *,
    friction: float = 0.0,
    options: GaussNewton | None = None,
) -> ContactResult:
    """Least-squares solution with `parts` parts, first without the sphere, then with the nodes inside it.

    `friction` is the coefficient of (53), signed: positive against an end that moves so that p1 x p2 points
    against the motion. Contact forces start from 0.
    """
    options = options or GaussNewton()
    free = solve(cable, parts, guess, options)
    nodes = touching(free.points, sphere)
    if not len(nodes):
        return ContactResult(free, nodes, -1, np.empty(0))
    problem = SphereDifferences(FiniteDifferences(cable, parts, free), sphere, nodes, friction)
    x = np.concatenate([problem.free.sample(free).ravel(), np.zeros(len(nodes))])
    x, iterations, converged, message = minimise(problem, x, options)
    state, force = problem.split(x)
    rod = problem.free.result(state, free.iterations + iterations, free.converged and converged, message)
    return ContactResult(rod, nodes, problem.middle, force / _MM)


def touching(points: np.ndarray, sphere: Sphere) -> np.ndarray:
    """(49): the nodes of the points (n + 1, 3) inside the sphere, but for the first, which has no part."""
    inside = np.linalg.norm(points - sphere.center, axis=1) < sphere.radius
    return np.flatnonzero(inside[1:]) + 1


def middle(nodes: Sequence[int] | np.ndarray) -> int:
    """The node P_d of U: the middle one, of two the one farther along the cable."""
    return int(nodes[0]) + len(nodes) // 2


def lifted(points: np.ndarray, sphere: Sphere) -> np.ndarray:
    """(58): points (m, 3) of the fitted curve, those inside the sphere moved along Z to its surface."""
    out = points.copy()
    away = points - sphere.center
    inside = np.linalg.norm(away, axis=1) < sphere.radius
    height = np.sqrt(sphere.radius**2 - away[inside, 0] ** 2 - away[inside, 1] ** 2)
    out[inside, 2] = sphere.center[2] + np.sign(away[inside, 2]) * height
    return out


class SphereDifferences:
    """Residual and Jacobian of (39) with (55)-(57); unknowns: those of (40), then a force for each of U."""

    def __init__(self, free: FiniteDifferences, sphere: Sphere, nodes: np.ndarray, friction: float) -> None:
        self.free, self.nodes, self.friction = free, nodes, friction
        self.parts = free.parts
        self.rows = free.rows + len(nodes)
        self.middle = middle(nodes)
        self.centre = (sphere.center - free.origin) / _MM
        self.radius = sphere.radius / _MM
        size = kernels.NODE * (free.parts + 1)
        self.jacobian = np.zeros((self.rows, size + len(nodes)))
        self.gradient = np.empty(size + len(nodes))
        self._position = np.empty((free.parts + 1, 3))
        self._by_state = np.empty((free.parts + 1, 3, size))

    def split(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The unknowns of (40) as (n + 1, 7), and the forces (nc,) in N/mm."""
        size = kernels.NODE * (self.parts + 1)
        return x[:size].reshape(-1, kernels.NODE), x[size:]

    def _geometry(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """p1 (50), p2 (51), signed gap [mm] and p1 . p2 at the nodes of U."""
        p1 = (self._position[self.nodes] - self._position[self.nodes - 1]) / self.free.step
        p2 = (self._position[self.nodes] - self.centre) / self.radius
        gap = self.radius * (np.linalg.norm(p2, axis=1) - 1.0)
        return p1, p2, gap, np.einsum("ni,ni->n", p1, p2)

    def _factor(self, force: np.ndarray) -> np.ndarray:
        """What multiplies gap and tangency: 1 in (55), the force in (56)."""
        return np.where(self.nodes == self.middle, 1.0, force)

    def residual(self, x: np.ndarray, v: np.ndarray) -> float:
        """v (7 n + 11 + nc,) into `v`; returns |v|^2 / 2."""
        state, force = self.split(x)
        self.free.residual(state, v[: self.free.rows])
        kernels.positions(state, self.free.step, self._position)
        p1, p2, gap, tangency = self._geometry()
        direction = p2 + self.friction * np.cross(p1, p2)
        load = np.empty(3)
        for node, f in zip(self.nodes, force[:, None] * direction, strict=True):
            kernels.load_in_section(state[node, :4], f, load)
            row = 11 + kernels.NODE * (node - 1)
            v[row + 1 : row + 4] += self.free.step * load
        v[self.free.rows :] = self._factor(force) * (np.abs(gap) + np.abs(tangency))
        return float(v @ v) / 2

    def linearise(self, x: np.ndarray, v: np.ndarray) -> None:
        """Jacobian and gradient (42) at x, at which `residual` was called last."""
        state, force = self.split(x)
        kernels.positions(state, self.free.step, self._position)
        kernels.position_derivatives(state, self.free.step, self._by_state)
        self._free_jacobian(state)
        p1, p2, gap, tangency = self._geometry()
        factor = self._factor(force)
        step, size, rows = self.free.step, state.size, self.free.rows
        by_q, load = np.empty((3, 4)), np.empty(3)
        for i, node in enumerate(self.nodes):
            here, before = self._by_state[node], self._by_state[node - 1]
            by_p1, by_p2 = (here - before) / step, here / self.radius
            direction = p2[i] + self.friction * np.cross(p1[i], p2[i])
            turn = by_p2 + self.friction * (_cross(p1[i]) @ by_p2 - _cross(p2[i]) @ by_p1)
            block = self.jacobian[12 + kernels.NODE * (node - 1) :][:3]
            to_section = np.empty((3, 3))
            for k in range(3):
                kernels.load_in_section(state[node, :4], np.eye(3)[k], load)
                to_section[:, k] = load
            kernels.load_in_section_matrix(state[node, :4], force[i] * direction, by_q)
            block[:, :size] += step * force[i] * to_section @ turn
            block[:, kernels.NODE * node :][:, :4] += step * by_q
            block[:, size + i] = step * to_section @ direction
            # (55), (56)
            outward = p2[i] / np.linalg.norm(p2[i])
            tangential = p1[i] @ by_p2 + p2[i] @ by_p1
            self.jacobian[rows + i, :size] = factor[i] * (
                np.sign(gap[i]) * outward @ here + np.sign(tangency[i]) * tangential
            )
            if node != self.middle:
                self.jacobian[rows + i, size + i] = np.abs(gap[i]) + np.abs(tangency[i])
        self.gradient[:] = self.jacobian.T @ v

    def _free_jacobian(self, state: np.ndarray) -> None:
        """The Jacobian of (39) without the sphere into the dense one."""
        free, node, n = self.free, kernels.NODE, self.parts
        kernels.jacobian(state, free.step, free.stiffness, free.load, free.local, free.whole)
        self.jacobian[:] = 0.0
        self.jacobian[:3, : state.size] = free.whole[:3]
        self.jacobian[3:7, :4] = np.eye(4)
        self.jacobian[7:11, node * n : node * n + 4] = np.eye(4)
        for part in range(n):
            first = node * max(part - 1, 0)
            self.jacobian[11 + node * part :, first:][:node, : 3 * node] = free.local[part]
        self.jacobian[11 + node * (n - 1), : state.size] = free.whole[3]

    def damped_step(self, mu: float) -> np.ndarray:
        """d of (43)."""
        damped = self.jacobian.T @ self.jacobian
        damped[np.diag_indices_from(damped)] += mu
        return np.linalg.solve(damped, -self.gradient)

    def predicted(self, d: np.ndarray) -> float:
        """Denominator of (44)."""
        return float(self.gradient @ d + np.sum((self.jacobian @ d) ** 2) / 2)


def _cross(v: np.ndarray) -> np.ndarray:
    """[v]x, so that [v]x u = v x u."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
