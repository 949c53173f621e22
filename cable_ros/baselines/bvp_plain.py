# SPDX-License-Identifier: Apache-2.0
"""Baseline: the rod's boundary-value problem as one writes it down from its equations in an afternoon.

State over arc length: position, section quaternion (x y z w), internal force and moment in the start clamp's
axes (13 numbers), so that (8) and (9) stand as they are printed. The right-hand side is vectorised;
`scipy.integrate.solve_bvp` differentiates it numerically. Units as in `bvp`, which takes fewer states and
exact Jacobians.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.integrate import solve_bvp
from scipy.spatial.transform import Rotation

from cable_ros.baselines.result import BaselineResult, ClampedCable, wrench_on_body


def solve(
    cable: ClampedCable, guess: BaselineResult, *, tolerance: float = 1e-6, max_nodes: int = 20000
) -> BaselineResult:
    """Equilibrium near `guess`, from its mesh and values; `tolerance` as in `bvp.solve`."""
    length, stiffness = cable.length, cable.stiffness / cable.stiffness[0]
    moment_unit = cable.stiffness[0] / length
    force_unit = moment_unit / length
    load = (cable.load * length / force_unit)[:, None]
    first = cable.start[3:]
    last_position = (cable.end[:3] - cable.start[:3]) / length
    last = Rotation.from_quat(cable.end[3:])

    def rates(_s: np.ndarray, state: np.ndarray) -> np.ndarray:
        """(13, m): r' = t; q' = q kappa / 2; F' = -f; M' = -t x F; kappa = K^-1 R^T M."""
        x, y, z, w = state[3:7]
        fx, fy, fz = state[7:10]
        mx, my, mz = state[10:]
        # columns of R
        ax, ay, az = 1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)
        bx, by, bz = 2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)
        tx, ty, tz = 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)
        kx = (ax * mx + ay * my + az * mz) / stiffness[0]
        ky = (bx * mx + by * my + bz * mz) / stiffness[1]
        kz = (tx * mx + ty * my + tz * mz) / stiffness[2]
        out = np.empty_like(state)
        out[0], out[1], out[2] = tx, ty, tz
        out[3] = (w * kx + y * kz - z * ky) / 2
        out[4] = (w * ky + z * kx - x * kz) / 2
        out[5] = (w * kz + x * ky - y * kx) / 2
        out[6] = -(x * kx + y * ky + z * kz) / 2
        out[7:10] = -load
        out[10] = tz * fy - ty * fz
        out[11] = tx * fz - tz * fx
        out[12] = ty * fx - tx * fy
        return out

    def clamps(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """(13,) position and quaternion at the start, position and turn off the clamp at the end."""
        x, y, z, w = cable.end[3:]
        q = b[3:7]
        turn = np.array(
            [
                w * q[0] + z * q[1] - y * q[2] - x * q[3],
                -z * q[0] + w * q[1] + x * q[2] - y * q[3],
                y * q[0] - x * q[1] + w * q[2] - z * q[3],
            ]
        )
        return np.concatenate([a[:3], a[3:7] - first, b[:3] - last_position, turn])

    sign = 1.0 if guess.orientations[0] @ first > 0 else -1.0
    states = np.vstack(
        [
            (guess.points - cable.start[:3]).T / length,
            sign * guess.orientations.T,
            guess.force.T / force_unit,
            guess.moment.T / moment_unit,
        ]
    )
    with np.errstate(over="ignore", invalid="ignore"):  # an iteration that runs away is reported as failed
        found = solve_bvp(
            rates, clamps, guess.arc_length / length, states, tol=tolerance, max_nodes=max_nodes
        )
    if not found.success:
        nothing = np.full(6, np.nan)
        return replace(
            guess, end_wrench=nothing, iterations=found.niter, converged=False, message=found.message
        )
    force, moment = found.y[7:10].T * force_unit, found.y[10:].T * moment_unit
    return BaselineResult(
        end_wrench=wrench_on_body(force[-1], moment[-1], last.as_quat()),
        arc_length=found.x * length,
        points=found.y[:3].T * length + cable.start[:3],
        orientations=found.y[3:7].T,
        force=force,
        moment=moment,
        iterations=found.niter,
        converged=True,
        message=found.message,
    )
