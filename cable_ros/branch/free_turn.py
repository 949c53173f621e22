# SPDX-License-Identifier: Apache-2.0
"""A round weightless cable between clamps in one line is free to turn about it: where it turns to."""

from __future__ import annotations

import numpy as np

from cable_ros.branch.cold_start import Conditions
from cable_ros.rod import quaternion
from cable_ros.rod.kirchhoff import Rod

IN_LINE = 1e-6
"""Maximum distance of what is in the line from it, L and rad: so far what is added to the Hessian holds the
cable where it is."""
SLIGHT = 1e-9
"""Least work over force and motion that tells one place from another."""


def place_to_turn_to(
    rod: Rod, q: np.ndarray, F: np.ndarray, conditions: Conditions
) -> tuple[np.ndarray, np.ndarray] | None:
    """The equilibrium to which one that turns freely turns as its end begins to move; None: not known.

    To first order the energy rises by what the end clamp does on the cable as it leaves the line. Turned by
    phi about that, the end wrench turns as well, so that this is A cos phi + B sin phi.

    Args:
        rod: at its equilibrium, factored.
        q, F: nodal frames (n, 4) and end force (3,) there.
        conditions: a little further along the path.

    Returns:
        Its nodal frames (n, 4) and end force (3,).
    """
    off = np.abs(np.concatenate((rod.re[:2], rod.qe[1:3], rod.natural[:2], rod.f))).max()
    if off > IN_LINE or rod.K[0] != rod.K[1] or rod.compliance.any():
        return None
    spin = np.array([conditions.qe[0], 0.0, 0.0, conditions.qe[3]])
    spin /= np.linalg.norm(spin)
    # out of the line
    motion = conditions.re[:2]
    rotation = quaternion.rotation_vector(quaternion.multiply(quaternion.conjugate(spin), conditions.qe))[:2]
    moment = rod.reactions()
    A = float(F[:2] @ motion + moment[:2] @ rotation)
    B = float(F[0] * motion[1] - F[1] * motion[0] + moment[0] * rotation[1] - moment[1] * rotation[0])
    size = np.linalg.norm(F) * np.linalg.norm(motion) + np.linalg.norm(moment) * np.linalg.norm(rotation)
    if np.hypot(A, B) <= SLIGHT * size:
        return None
    half = 0.5 * np.arctan2(-B, -A)
    turn = np.array([np.cos(half), 0.0, 0.0, np.sin(half)])
    back = quaternion.conjugate(turn)
    turned = np.array([quaternion.multiply(quaternion.multiply(turn, one), back) for one in q])
    return turned, quaternion.rotate(turn, F)
