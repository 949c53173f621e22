# SPDX-License-Identifier: Apache-2.0
"""SI to units of the cable and back; world to the start clamp's frame and back."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cable_ros.compilation import INNER, LEAF_ENTRY, njit
from cable_ros.rod import quaternion

OPTIONS = {"cache": True, "error_model": "numpy"}


@dataclass(frozen=True)
class Units:
    """The cable's own units: its length L and EI = (EIx EIy)^1/2."""

    length: float
    stiffness: float

    @cached_property
    def force(self) -> float:
        """EI / L^2, N."""
        return self.stiffness / self.length**2

    @cached_property
    def moment(self) -> float:
        """EI / L, N m; also the unit of energy."""
        return self.stiffness / self.length


def relative(
    poses: np.ndarray, previous: np.ndarray, weight: np.ndarray, length: float, force: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Conditions in the start clamp's frame from the clamps' world `poses` (2, 7), x y z, quaternion x y z w.

    `weight` (3,): load per length in the world, N/m; `previous` (4,): the end frame before, whose sign is
    followed. Returns the end frame (4,) scalar first, end position (3,) and load (3,).
    """
    qe, re, f = np.empty(4), np.empty(3), np.empty(3)
    relative_conditions(poses, previous, weight, length, force, qe, re, f)
    return qe, re, f


@njit(**LEAF_ENTRY)
def relative_conditions(poses, previous, weight, length, force, qe, re, f):  # type: ignore[no-untyped-def]
    """`relative` with space for what it returns: compiled code makes arrays more slowly than Python."""
    start, end = poses[0], poses[1]
    inverse = start[6], -start[3], -start[4], -start[5]
    w, x, y, z = quaternion.product(inverse, (end[6], end[3], end[4], end[5]))
    same = w * previous[0] + x * previous[1] + y * previous[2] + z * previous[3] >= 0.0
    qe[0], qe[1], qe[2], qe[3] = (w, x, y, z) if same else (-w, -x, -y, -z)
    chord = (end[0] - start[0]) / length, (end[1] - start[1]) / length, (end[2] - start[2]) / length
    re[0], re[1], re[2] = quaternion.turned(inverse, chord)
    load = weight[0] * length / force, weight[1] * length / force, weight[2] * length / force
    f[0], f[1], f[2] = quaternion.turned(inverse, load)


@njit(**OPTIONS)
def relative_change(change: np.ndarray, wrench: np.ndarray, least: float) -> float:
    """Relative size of a change (6,) of a wrench (6,), in cable units: the larger of force and moment.

    Where one of them passes through zero, the size that the other implies takes over: a force F bends over
    the length (EI / F)^1/2, hence moments of (EI F)^1/2. Nothing counts as less than `least`.
    """
    force_scale, moment_scale = wrench_scales(wrench, least)
    return max(norm3(change[:3]) / force_scale, norm3(change[3:]) / moment_scale)


@njit(**OPTIONS)
def wrench_scales(wrench: np.ndarray, least: float) -> tuple[float, float]:
    """The force and the moment that `relative_change` compares with."""
    force, moment = norm3(wrench[:3]), norm3(wrench[3:])
    return max(force, 0.03 * moment**2, least), max(moment, 0.03 * np.sqrt(force), least)


def norm(v: np.ndarray) -> float:
    """Length of the vector v (3,). A step asks for a dozen; `numpy.linalg.norm` takes four times as long."""
    return math.sqrt(v.dot(v))


@njit(**INNER)
def norm3(v: np.ndarray) -> float:
    """Length of the vector v (3,)."""
    return np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
