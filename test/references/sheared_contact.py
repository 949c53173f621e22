# SPDX-License-Identifier: Apache-2.0
"""A heavy rod that shears on flat ground, lifted at its end: manufactured by integration along it.

In the plane, with theta the angle of the section's normal, F the internal force, c = 1 / GA and n across the
section's normal t, weight w per length, EI = 1:

    r' = t + c (F.n) n,    theta' = M,    M' = -(r' x F).

What lies has y' = 0, so F.n = -tan(theta) / c: beside the ends of the patch the sections tilt, by exp(-s / l)
with l = c^1/2, and the ground presses by as much more. Where the cable lifts off all of theta, M and F are
continuous, and the pressure falls from its largest value to 0.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

from references.contact import GROUND
from references.planar import STIFF
from references.reference import Reference, planar_frame, planar_wrench, pose


def lifted(
    c: float, *, lies: float = 0.45, force: float = 19.0, tension: float = 10.0, weight: float = 60.0
) -> Reference:
    """A rod that lies along `lies` of its length from the start clamp.

    Args:
        c: 1 / GA.
        lies: unloaded length of what lies.
        force: total of the pressure beyond the weight, near the lift-off.
        tension: horizontal force.
        weight: per length.
    """
    tilt = np.arctan(force * c)

    def lying(_: float, u: np.ndarray) -> list[float]:
        _, theta, M = u
        Fn = -np.tan(theta) / c
        Fy = (Fn + tension * np.sin(theta)) / np.cos(theta)
        dx = np.cos(theta) - c * Fn * np.sin(theta)
        return [dx, M, -dx * Fy]

    def end(M: float) -> float:
        return float(np.log(abs(run(M).y[1, -1]) / tilt))

    def run(M: float):
        return solve_ivp(lying, (0.0, lies), [0.0, 0.0, M], "DOP853", rtol=1e-13, atol=1e-30)

    # it grows in proportion but for the little that is not linear
    M = tilt / np.sqrt(c) / np.cosh(lies / np.sqrt(c))
    for _ in range(8):
        M *= np.exp(-end(M))
    x, theta, moment = run(M).y[:, -1]
    Fy = (-np.tan(theta) / c + tension * np.sin(theta)) / np.cos(theta)

    def free(_: float, u: np.ndarray) -> list[float]:
        cos, sin = np.cos(u[2]), np.sin(u[2])
        Fn = -u[4] * sin + u[5] * cos
        dx, dy = cos - c * Fn * sin, sin + c * Fn * cos
        return [dx, dy, u[3], -(dx * u[5] - dy * u[4]), 0.0, weight]

    b = solve_ivp(
        free, (0.0, 1.0 - lies), [x, 0.0, theta, moment, tension, Fy], "DOP853", rtol=1e-12, atol=1e-13
    ).y[:, -1]
    return Reference(
        1.0, np.array([STIFF, 1.0, STIFF]),
        pose(np.zeros(3), planar_frame(0.0)), pose(np.array([*b[:2], 0.0]), planar_frame(b[2])),
        planar_wrench(0.0, tension, 0.0, M), planar_wrench(b[2], -b[4], -b[5], -b[3]),
        weight=np.array([0.0, -weight, 0.0]), obstacles=(GROUND,),
        facts={"touchdown_end": lies, "tilt": float(theta)},
    )  # fmt: skip
