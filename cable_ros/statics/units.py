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
    a, b, way = np.empty(4), np.empty(4), np.empty(3)
    for i in range(4):
        a[(i + 1) % 4], b[(i + 1) % 4] = poses[0, 3 + i], poses[1, 3 + i]
    for i in range(3):
        way[i] = (poses[1, i] - poses[0, i]) / length
    inverse = quaternion.conjugate(a)
    qe = quaternion.multiply(inverse, b)
    if qe[0] * previous[0] + qe[1] * previous[1] + qe[2] * previous[2] + qe[3] * previous[3] < 0.0:
        for i in range(4):
            qe[i] = -qe[i]
    re = quaternion.rotate(inverse, way)
    f = quaternion.rotate(inverse, weight)
    for i in range(3):
        f[i] *= length / force
    return qe, re, f


@njit(**OPTIONS)
def relative_change(change: np.ndarray, wrench: np.ndarray, least: float) -> float:
    """Relative size of a change (6,) of a wrench (6,), in cable units: the larger of force and moment.

    Where one of them passes through zero, the size that the other implies takes over: a force F bends over
    the length (EI / F)^1/2, hence moments of (EI F)^1/2. Nothing counts as less than `least`.
    """
    force, moment = norm3(wrench[:3]), norm3(wrench[3:])
    force_scale = max(force, 0.03 * moment**2, least)
    moment_scale = max(moment, 0.03 * np.sqrt(force), least)
    return max(norm3(change[:3]) / force_scale, norm3(change[3:]) / moment_scale)


@njit(**OPTIONS)
def norm3(v: np.ndarray) -> float:
    """Length of the vector v (3,)."""
    return np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
