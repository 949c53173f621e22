# SPDX-License-Identifier: Apache-2.0
"""Baseline: the rod's boundary-value problem handed to `scipy.integrate.solve_bvp`, as a competent user
would.

State over arc length: position, section quaternion (x y z w), moment in section axes (10 numbers). The
internal force follows from the constant load, F(s) = F_L + (L - s) f, so its end value is three unknown
parameters instead of three more states. Lengths are in units of L, moments in A/L, forces in A/L^2. Both
Jacobians are analytic.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.integrate import solve_bvp
from scipy.spatial.transform import Rotation

from cable_ros.baselines.result import BaselineResult, ClampedCable, continuous_sign, wrench_on_body


def solve(
    cable: ClampedCable,
    guess: BaselineResult,
    *,
    tolerance: float = 1e-6,
    max_nodes: int = 20000,
    jacobians: bool = True,
) -> BaselineResult:
    """Equilibrium near `guess`, on its mesh refined as `solve_bvp` finds necessary.

    `tolerance` is solve_bvp's bound on the relative residual; without `jacobians` it differentiates
    numerically.
    """
    problem = _Problem(cable, guess)
    with np.errstate(over="ignore", invalid="ignore"):  # an iteration that runs away is reported as failed
        solution = solve_bvp(
            problem.rates,
            problem.boundary,
            problem.mesh,
            problem.states,
            p=problem.end_force,
            fun_jac=problem.rates_jacobian if jacobians else None,
            bc_jac=problem.boundary_jacobian if jacobians else None,
            tol=tolerance,
            max_nodes=max_nodes,
        )
    return problem.result(solution)


def solve_cold(cable: ClampedCable, *, tolerance: float = 1e-6, turns: int = 0) -> BaselineResult:
    """Equilibrium without a guess: from the uniform helix that has the end's rotation (plus `turns` whole
    turns), its end is moved to the clamp and the load raised from zero, in steps that halve after a failure.
    Which of the stable equilibria this reaches depends on `turns`.
    """
    guess = _helix(cable, turns)
    free_end = guess.points[-1]
    coarse = max(tolerance, 1e-3)
    done, step, iterations = 0.0, 0.25, 0
    while done < 1.0:
        target = min(1.0, done + step)
        pose = np.concatenate([free_end + target * (cable.end[:3] - free_end), cable.end[3:]])
        partial = replace(cable, load=target * cable.load, end=pose)
        attempt = solve(partial, guess, tolerance=coarse, max_nodes=2000)
        iterations += attempt.iterations
        if attempt.converged:
            guess, done, step = attempt, target, 1.5 * step
        else:
            step /= 2
            if step < 1e-4:
                return replace(attempt, iterations=iterations)
    result = solve(cable, guess, tolerance=tolerance)
    return replace(result, iterations=iterations + result.iterations)


class _Problem:
    """The scaled equations, their Jacobians and the way back to SI."""

    def __init__(self, cable: ClampedCable, guess: BaselineResult) -> None:
        self.guess = guess
        self.length, self.start, self.end = cable.length, cable.start, cable.end
        self.moment_unit = cable.stiffness[0] / cable.length
        self.force_unit = self.moment_unit / cable.length
        self.compliance = cable.stiffness[0] / cable.stiffness
        self.load = cable.load * cable.length / self.force_unit
        self.mesh = guess.arc_length / cable.length
        # both ends' quaternion signs follow the guess: the sign at the end decides the branch
        orientations = guess.orientations * (1.0 if guess.orientations[0] @ self.start[3:] > 0 else -1.0)
        in_section = Rotation.from_quat(orientations).inv()
        self.states = np.vstack(
            [
                (guess.points - self.start[:3]).T / cable.length,
                orientations.T,
                in_section.apply(guess.moment).T / self.moment_unit,
            ]
        )
        self.end_force = guess.force[-1] / self.force_unit
        self.start_orientation = self.start[3:]
        self.end_position = (self.end[:3] - self.start[:3]) / cable.length
        x, y, z, w = self.end[3:]
        # vector part of conj(end) * q: zero when q is the end orientation, whatever its sign
        self.end_rows = np.array([[w, z, -y, -x], [-z, w, x, -y], [y, -x, w, -z]])

    def rates(self, s: np.ndarray, state: np.ndarray, end_force: np.ndarray) -> np.ndarray:
        """(10, m) derivatives: r' = t; q' = q kappa / 2; m' = m x kappa - e3 x (R^T F)."""
        x, y, z, w = state[3:7]
        mx, my, mz = state[7:]
        kx, ky, kz = self.compliance[:, None] * state[7:]
        fx, fy = self._shear(s, state, end_force)
        return np.stack(
            [
                2 * (x * z + w * y),
                2 * (y * z - w * x),
                w * w - x * x - y * y + z * z,
                (w * kx + y * kz - z * ky) / 2,
                (w * ky + z * kx - x * kz) / 2,
                (w * kz + x * ky - y * kx) / 2,
                -(x * kx + y * ky + z * kz) / 2,
                my * kz - mz * ky + fy,
                mz * kx - mx * kz - fx,
                mx * ky - my * kx,
            ]
        )

    def _force(self, s: np.ndarray, end_force: np.ndarray) -> np.ndarray:
        return end_force[:, None] + np.outer(self.load, 1.0 - s)

    def _shear(
        self, s: np.ndarray, state: np.ndarray, end_force: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """x and y components of R^T F."""
        x, y, z, w = state[3:7]
        fx, fy, fz = self._force(s, end_force)
        return (
            (w * w + x * x - y * y - z * z) * fx + 2 * (x * y + w * z) * fy + 2 * (x * z - w * y) * fz,
            2 * (x * y - w * z) * fx + (w * w - x * x + y * y - z * z) * fy + 2 * (y * z + w * x) * fz,
        )

    def rates_jacobian(
        self, s: np.ndarray, state: np.ndarray, end_force: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(10, 10, m) by state and (10, 3, m) by the end force."""
        x, y, z, w = state[3:7]
        mx, my, mz = state[7:]
        cx, cy, cz = self.compliance
        kx, ky, kz = cx * mx, cy * my, cz * mz
        fx, fy, fz = self._force(s, end_force)
        by_state = np.zeros((10, 10, len(s)))
        by_state[0, 3:7] = 2 * z, 2 * w, 2 * x, 2 * y
        by_state[1, 3:7] = -2 * w, 2 * z, 2 * y, -2 * x
        by_state[2, 3:7] = -2 * x, -2 * y, 2 * z, 2 * w
        by_state[3, 4:7] = kz / 2, -ky / 2, kx / 2
        by_state[4, 3], by_state[4, 5], by_state[4, 6] = -kz / 2, kx / 2, ky / 2
        by_state[5, 3], by_state[5, 4], by_state[5, 6] = ky / 2, -kx / 2, kz / 2
        by_state[6, 3:6] = -kx / 2, -ky / 2, -kz / 2
        by_state[3, 7:] = w * cx / 2, -z * cy / 2, y * cz / 2
        by_state[4, 7:] = z * cx / 2, w * cy / 2, -x * cz / 2
        by_state[5, 7:] = -y * cx / 2, x * cy / 2, w * cz / 2
        by_state[6, 7:] = -x * cx / 2, -y * cy / 2, -z * cz / 2
        # shear along x enters m_y' with a minus, along y enters m_x' with a plus
        by_state[8, 3:7] = (
            -2 * (x * fx + y * fy + z * fz),
            -2 * (-y * fx + x * fy - w * fz),
            -2 * (-z * fx + w * fy + x * fz),
            -2 * (w * fx + z * fy - y * fz),
        )
        by_state[7, 3:7] = (
            2 * (y * fx - x * fy + w * fz),
            2 * (x * fx + y * fy + z * fz),
            2 * (-w * fx - z * fy + y * fz),
            2 * (-z * fx + w * fy + x * fz),
        )
        by_state[7, 8], by_state[7, 9] = (cz - cy) * mz, (cz - cy) * my
        by_state[8, 7], by_state[8, 9] = (cx - cz) * mz, (cx - cz) * mx
        by_state[9, 7], by_state[9, 8] = (cy - cx) * my, (cy - cx) * mx
        by_force = np.zeros((10, 3, len(s)))
        by_force[7] = 2 * (x * y - w * z), w * w - x * x + y * y - z * z, 2 * (y * z + w * x)
        by_force[8] = y * y + z * z - w * w - x * x, -2 * (x * y + w * z), -2 * (x * z - w * y)
        return by_state, by_force

    def boundary(self, first: np.ndarray, last: np.ndarray, _end_force: np.ndarray) -> np.ndarray:
        """(13,) both clamps: seven numbers at the start, position and rotation vector at the end."""
        return np.concatenate(
            [
                first[:3],
                first[3:7] - self.start_orientation,
                last[:3] - self.end_position,
                self.end_rows @ last[3:7],
            ]
        )

    def boundary_jacobian(
        self, _first: np.ndarray, _last: np.ndarray, _end_force: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Derivatives of `boundary` by both end states and by the end force."""
        by_first, by_last = np.zeros((13, 10)), np.zeros((13, 10))
        by_first[:7, :7] = np.eye(7)
        by_last[7:10, :3] = np.eye(3)
        by_last[10:, 3:7] = self.end_rows
        return by_first, by_last, np.zeros((13, 3))

    def result(self, solution) -> BaselineResult:  # type: ignore[no-untyped-def]  # scipy's Bunch has no public type
        """Back to SI; the guess, with no wrench, where solve_bvp failed."""
        quaternions = solution.y[3:7].T
        if not (solution.success and np.all(np.linalg.norm(quaternions, axis=1) > 0)):
            return replace(
                self.guess,
                end_wrench=np.full(6, np.nan),
                iterations=solution.niter,
                converged=False,
                message=solution.message,
            )
        section = Rotation.from_quat(quaternions)
        force = self._force(solution.x, solution.p).T * self.force_unit
        moment = section.apply(solution.y[7:].T) * self.moment_unit
        return BaselineResult(
            end_wrench=wrench_on_body(force[-1], moment[-1], self.end[3:]),
            arc_length=solution.x * self.length,
            points=solution.y[:3].T * self.length + self.start[:3],
            orientations=quaternions,
            force=force,
            moment=moment,
            iterations=solution.niter,
            converged=True,
            message=solution.message,
        )


def _helix(cable: ClampedCable, turns: int) -> BaselineResult:
    """The rod of uniform strain with the end's rotation; the internal force is left to the first solve."""
    s = np.linspace(0.0, 1.0, 21)
    first = Rotation.from_quat(cable.start[3:])
    turn = (first.inv() * Rotation.from_quat(cable.end[3:])).as_rotvec()
    angle = np.linalg.norm(turn)
    axis = turn / angle if angle > 1e-9 else np.array([1.0, 0.0, 0.0])
    strain = axis * (angle + 2 * np.pi * turns)
    if np.linalg.norm(strain[:2]) < 0.5:
        # a straight rod cannot be shortened in one way: bend it, so that the solve has a side to go to
        strain = strain + np.array([1.0, 0.0, 0.0])
    sections = first * Rotation.from_rotvec(np.outer(s, strain))
    tangent = sections.apply([0.0, 0.0, 1.0])
    points = cable.start[:3] + cable.length * np.vstack(
        [np.zeros(3), np.cumsum((tangent[1:] + tangent[:-1]) / 2, axis=0) / 20]
    )
    return BaselineResult(
        end_wrench=np.full(6, np.nan),
        arc_length=s * cable.length,
        points=points,
        orientations=continuous_sign(sections.as_quat()),
        force=np.zeros_like(points),
        moment=sections.apply(cable.stiffness * strain / cable.length),
        iterations=0,
        converged=False,
        message="",
    )
