"""SI to units of the cable and back; world to the start clamp's frame and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cable_ros.compilation import njit
from cable_ros.mechanics import quaternion

OPTIONS = {"cache": True, "error_model": "numpy"}


@dataclass(frozen=True)
class Units:
    """The cable's own units: its length L and EI = (EIx EIy)^1/2."""

    length: float
    stiffness: float

    @property
    def force(self) -> float:
        """EI / L^2, N."""
        return self.stiffness / self.length**2

    @property
    def moment(self) -> float:
        """EI / L, N m; also the unit of energy."""
        return self.stiffness / self.length


@njit(**OPTIONS)
def relative(
    poses: np.ndarray, previous: np.ndarray, weight: np.ndarray, length: float, force: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Conditions in the start clamp's frame from the clamps' world `poses` (2, 7), x y z, quaternion x y z w.

    `weight` (3,): load per length in the world, N/m; `previous` (4,): the end frame before, whose sign is
    followed. Returns the end frame (4,) scalar first, end position (3,) and load (3,).
    """
    a, b = np.empty(4), np.empty(4)
    a[0], a[1], a[2], a[3] = poses[0, 6], poses[0, 3], poses[0, 4], poses[0, 5]
    b[0], b[1], b[2], b[3] = poses[1, 6], poses[1, 3], poses[1, 4], poses[1, 5]
    inverse = quaternion.conjugate(a)
    qe = quaternion.multiply(inverse, b)
    if qe[0] * previous[0] + qe[1] * previous[1] + qe[2] * previous[2] + qe[3] * previous[3] < 0.0:
        qe = -qe
    re = quaternion.rotate(inverse, poses[1, :3] - poses[0, :3]) / length
    f = quaternion.rotate(inverse, weight) * (length / force)
    return qe, re, f


def relative_change(change: np.ndarray, wrench: np.ndarray, least: float) -> float:
    """Relative size of a change (6,) of a wrench (6,), in cable units: the larger of force and moment.

    Where one of them passes through zero, the size that the other implies takes over: a force F bends over
    the length (EI / F)^1/2, hence moments of (EI F)^1/2. Nothing counts as less than `least`.
    """
    force, moment = float(np.linalg.norm(wrench[:3])), float(np.linalg.norm(wrench[3:]))
    force_scale = max(force, 0.03 * moment**2, least)
    moment_scale = max(moment, 0.03 * force**0.5, least)
    return float(max(np.linalg.norm(change[:3]) / force_scale, np.linalg.norm(change[3:]) / moment_scale))
