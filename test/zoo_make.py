# SPDX-License-Identifier: Apache-2.0
"""How the zoo's cases are made: scenes of one cable, led by a carriage or by the arm's joint."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from references.boundary_value import solve_planar
from references.reference import Reference, planar_frame, pose
from scipy.spatial.transform import Rotation

from cable_ros.bench.carriage import on_carriage
from cable_ros.bench.cases import Case, Pose

ARM = str(Path(__file__).parents[1] / "config" / "space_arm.yaml")
STAY = np.zeros(6)
START = pose(np.zeros(3), planar_frame(0.0))


def cable(
    end: np.ndarray,
    *,
    start: np.ndarray = START,
    gravity_number: float = 20.0,
    stiffness: Sequence[float] = (1.0, 1.0, 0.7),
    **fields: Any,
) -> dict[str, Any]:
    """Scene of a cable of length 1 m, weight along -Y."""
    weight = np.array([0.0, -gravity_number * min(stiffness[:2]), 0.0])
    reference = Reference(1.0, np.array(stiffness), start, end, STAY, STAY, weight=weight)
    mapping = reference.scene(**fields)
    return mapping if "total_twist" in fields else without_target_twist(mapping)


def without_target_twist(mapping: dict[str, Any]) -> dict[str, Any]:
    """The scene with nothing said of its branch: that of least energy is expected."""
    (one,) = mapping["cables"]
    del one["total_twist"]
    return mapping


def turned(position: Sequence[float], rotvec: Sequence[float]) -> np.ndarray:
    """Clamp at `position`, its frame the start's turned by a rotation vector in world axes."""
    return pose(np.array(position), Rotation.from_rotvec(rotvec).as_matrix() @ planar_frame(0.0))


SKEW = turned([0.5, 0.3, 0.35], [0.4, -0.7, 1.1])
"""A clamp in general position, chord 0.68."""


def led(name: str, expected: str, mapping: dict[str, Any], moves: Sequence[Pose], **options: Any) -> Case:
    """Case whose end clamp is on a carriage; each move is what differs from the home pose."""
    scene, urdf, home = on_carriage(mapping)
    path = tuple({**home, **{joint: home[joint] + by for joint, by in move.items()}} for move in moves)
    return Case(name, expected, scene, path, urdf=urdf, **options)


def arm(name: str, expected: str, degrees: Sequence[float], **options: Any) -> Case:
    path = tuple({"orientation": math.radians(angle)} for angle in degrees)
    return Case(name, expected, ARM, path, **options)


def exact(name: str, reference: Reference, tolerance: float = 2e-4, **options: Any) -> Case:
    # The tracker may be off by the 1e-4 that it is asked for, in force and in moment.
    return Case(
        name,
        "closed form",
        reference.scene(),
        wrench=reference.end_wrench,
        wrench_tolerance=tolerance,
        **options,
    )


def solved(reference: Reference) -> Callable[[], np.ndarray]:
    """The wrench by collocation, computed when asked for."""
    return lambda: solve_planar(reference).end_wrench
