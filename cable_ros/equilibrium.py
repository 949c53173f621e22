"""The result of one solve for one cable."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cable_ros.solve.status import Status


@dataclass(frozen=True)
class Equilibrium:
    """One cable's equilibrium at one pose of the robot; SI units.

    Where `status.trusted` is false every number is the solver's last attempt or NaN, never to be
    published as true.
    """

    status: Status
    message: str
    """The status sentence with this case's numbers in it."""
    converged: bool
    stable: bool
    stability_margin: float
    """Smallest eigenvalue of the energy Hessian on the tangent space of the end conditions,
    relative to the elastic stiffness; 0 at a fold."""
    end_wrench: np.ndarray
    """(6,) force [N] then moment [N m] about the clamp point that the cable exerts on the body at
    the end clamp, in the end clamp's frame."""
    start_wrench: np.ndarray
    """(6,) the same at the start clamp, in the start clamp's frame."""
    points: np.ndarray
    """(n, 3) centreline at equal arc lengths, world frame, m."""
    orientations: np.ndarray
    """(n, 4) section frames as quaternions x y z w, world frame; z axis = tangent."""
    total_twist: float
    """Integral of the twist over the length, rad: the name of the branch."""
    energy: float
    """Elastic energy plus potential of the weight (relative to the start clamp), J."""
    error_estimate: float
    """Estimated relative error of the end wrench."""
    iterations: int
    solve_time: float
    """Wall time of this solve, s."""
    stiffness: np.ndarray
    """(6, 6) derivative of `end_wrench` with respect to a small translation [m] and rotation [rad]
    of the end clamp, about and along the end clamp's own axes, the start clamp held."""
